//! How hard the digits pull: as the grasps say, and harder where something slips.

use hand_model::Digit;
use hand_model::robot::Observation;

use super::{Executive, Grasp, Phase};
use crate::slip::{self, SlipWatch};

impl Executive {
    /// From now on holds harder what slips while it is carried; pads are looked at for that.
    pub fn react_to_slip(&mut self) {
        self.slip = Some(SlipWatch::default());
    }

    /// How often either object was felt to slip so far.
    pub fn slips(&self) -> [u32; 2] {
        self.slip.as_ref().map_or([0; 2], SlipWatch::steps)
    }

    pub(super) fn carrying(&self) -> bool {
        matches!(self.phase, Phase::Carry | Phase::Hold | Phase::Verify)
    }

    /// Tensions wanted at present, with what slipping adds, N.
    pub(super) fn held_tension(&mut self, observation: &Observation) -> [f64; 5] {
        let (plan, carrying) = (self.wanted_tension(), self.carrying());
        let Some(watch) = &mut self.slip else { return plan };
        if !carrying {
            if self.phase < Phase::Carry {
                watch.begin();
            }
            return plan;
        }
        let most = slip::most_tension(&self.hand);
        watch.tick(&self.hand, &observation.servos, &observation.tactile, &plan, most, self.tick)
    }

    /// Tensions wanted in the present phase, N.
    fn wanted_tension(&self) -> [f64; 5] {
        let (first, second) = (&self.first.0, &self.second.0);
        let closing = |grasp: &Grasp, digit: usize| {
            // The thumb may start later or earlier than the fingers.
            let delay =
                if digit == Digit::Thumb.index() { grasp.thumb_delay.max(0.0) } else { (-grasp.thumb_delay).max(0.0) };
            if self.clock >= delay { grasp.close_tension[digit] } else { grasp.pre_tension[digit] }
        };
        std::array::from_fn(|digit| match self.phase {
            Phase::ApproachFirst => first.pre_tension[digit],
            Phase::GraspFirst => closing(first, digit),
            Phase::LiftFirst | Phase::Look | Phase::Decide => first.close_tension[digit],
            Phase::ApproachSecond => first.close_tension[digit].max(second.pre_tension[digit]),
            Phase::GraspSecond => first.close_tension[digit].max(closing(second, digit)),
            Phase::PutDown if self.clock >= self.open_from => 0.0,
            Phase::PutDown
            | Phase::LiftSecond
            | Phase::Check
            | Phase::Confirm
            | Phase::Carry
            | Phase::Hold
            | Phase::Verify
            | Phase::Done => first.close_tension[digit].max(second.close_tension[digit]),
        })
    }
}
