//! How hard the digits pull: as the grasps say, and harder where something slips.

use hand_model::robot::{Observation, ServoGoal};
use hand_model::{ACTUATORS, Digit, Hand};

use super::{Executive, Grasp, Phase};
use crate::slip::{self, SlipWatch};

/// Current limit of the opposition servo, A.
const OPPOSITION_CURRENT: f64 = 0.6;
/// How fast tensions change, N/s.
const TENSION_RATE: f64 = 80.0;

/// What the servos are asked for five cable tensions (N) and the angle of the opposition joint (rad).
pub(crate) fn servo_goals(hand: &Hand, tension: &[f64; 5], opposition: f64) -> [ServoGoal; ACTUATORS] {
    hand.servo_goals(tension, opposition, OPPOSITION_CURRENT)
}

/// Changes the tensions of `now` towards those `wanted` (N) for a tick (s).
pub(crate) fn approach_tension(now: &mut [f64; 5], wanted: &[f64; 5], tick: f64) {
    for (now, wanted) in now.iter_mut().zip(wanted) {
        *now += (wanted - *now).clamp(-TENSION_RATE * tick, TENSION_RATE * tick);
    }
}

/// Tension of a digit (N) when `grasp` has been closing for `time` (s): the thumb may start later or earlier than the fingers.
pub(crate) fn closing_tension(grasp: &Grasp, digit: usize, time: f64) -> f64 {
    let delay = if digit == Digit::Thumb.index() { grasp.thumb_delay.max(0.0) } else { (-grasp.thumb_delay).max(0.0) };
    if time >= delay { grasp.close_tension[digit] } else { grasp.pre_tension[digit] }
}

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
        let closing = |grasp: &Grasp, digit: usize| closing_tension(grasp, digit, self.clock);
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
