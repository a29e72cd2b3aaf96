//! Estimates and decisions of a controller, recorded as long as they refer to something that is there.

use std::collections::BTreeMap;

use anyhow::Result;
use control::perception::Felt;
use control::policy::Choice;
use control::strategy::Course;
use telemetry::belief::Way;
use telemetry::now::Weighed;
use telemetry::recorder::Recorder;
use world::phase::Phase;

/// True in phases that a decision is about.
fn decides(phase: Phase) -> bool {
    phase.waits() && phase.has_lifted(0) && !phase.carries() || phase.begins(1) && !phase.has_lifted(1)
}

/// State of the last recorded estimates and decision.
#[derive(Default)]
pub struct Beliefs {
    /// Cost and number of patches of each object's recorded estimate, which identify it.
    estimates: BTreeMap<usize, (f64, usize)>,
    /// True while a decision is shown.
    weighing: bool,
}

impl Beliefs {
    /// Records new estimates of the objects `names` with their height maps, and clears those that have become void.
    /// Returns the estimates that still hold: an object that was felt to be gone, or was put down, has no pose in the
    /// hand.
    pub fn see<'a>(
        &mut self,
        recorder: &mut Recorder,
        names: &[String],
        phase: Phase,
        felt: &'a [Felt],
    ) -> Result<Vec<&'a Felt>> {
        let felt = felt.iter().filter(|felt| felt.grip.holds(felt.object) && phase.lifts(felt.object));
        let felt: Vec<&Felt> = felt.collect();
        let known: BTreeMap<usize, _> =
            felt.iter().map(|felt| (felt.object, (felt.estimate.cost, felt.estimate.patches))).collect();
        if known != self.estimates {
            recorder.clear_heights()?;
            for map in felt.iter().flat_map(|felt| &felt.touches).flat_map(|touch| &touch.heights) {
                recorder.log_height(map.camera, &map.height, 240, 240)?;
            }
            for felt in felt.iter().filter(|felt| known.get(&felt.object) != self.estimates.get(&felt.object)) {
                let turn = felt.estimate.palm_from_object.rotation.to_rotation_matrix().into_inner();
                let place = turn.transpose() * felt.estimate.region().fixed_view::<3, 3>(0, 0) * turn;
                recorder.log_felt(&names[felt.object], &place)?;
            }
            self.estimates = known;
        }
        if self.weighing && !decides(phase) {
            self.weighing = false;
            recorder.log_options(Vec::new())?;
            recorder.log_ways(&names[0], &Way::default(), &Way::default())?;
        }
        Ok(felt)
    }

    /// Records a decision about the path of the object `name` in the hand.
    pub fn weighs(&mut self, recorder: &mut Recorder, name: &str, choice: &Choice) -> Result<()> {
        self.weighing = true;
        let marked = |n: usize, planned: bool| match (choice.chosen == Some(n), planned) {
            (true, true) => "plan, chosen",
            (true, false) => "chosen",
            (false, true) => "plan",
            (false, false) => "",
        };
        let options = choice.weighed.iter().enumerate().map(|(n, option)| Weighed {
            grasp: option.grasp,
            aim: [option.aim.x * 1e3, option.aim.y * 1e3],
            clearance: option.clearance.filter(|clearance| clearance.is_finite()).map(|clearance| clearance * 1e3),
            risk: option.risk,
            held: option.held,
            worth: option.utility,
            mark: marked(n, option.planned),
        });
        recorder.log_options(options.collect())?;
        let way = |course: &Option<Course>| {
            course
                .as_ref()
                .map_or_else(Way::default, |course| Way { poses: course.poses.clone(), nearest: course.nearest })
        };
        recorder.log_ways(name, &way(&choice.rejected), &way(&choice.course))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use world::phase::{Skill, Stage};

    use super::*;

    /// With the hand open, and while an object is put down or grasped anew, no estimate is shown.
    #[test]
    fn beliefs_last_while_something_is_held() {
        for phase in [
            Phase::run(Skill::PutDown, 0),
            Phase::run(Skill::StepAside, 0),
            Phase::decide(Skill::Begin, 0),
            Phase::palpate(0, Stage::Decide),
            Phase::run(Skill::Approach, 0),
        ] {
            assert!(!phase.lifts(0) && !decides(phase), "{}", phase.name());
        }
        assert!(Phase::run(Skill::Carry, 0).lifts(0) && !decides(Phase::run(Skill::Carry, 0)));
        assert!(Phase::run(Skill::Approach, 1).lifts(0) && decides(Phase::run(Skill::Approach, 1)));
    }
}
