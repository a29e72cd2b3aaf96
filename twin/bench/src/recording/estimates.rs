//! Estimates and decisions of a controller, recorded while they are valid.

use std::collections::BTreeMap;

use anyhow::Result;
use control::perception::ObjectEstimate;
use control::policy::DecisionRecord;
use control::strategy::HeldObjectPath;
use telemetry::pose_estimate::ObjectPath;
use telemetry::recorder::Recorder;
use telemetry::state_page::ScoredCandidate;
use world::phase::Phase;

/// True in phases to which a decision refers.
fn is_decision_phase(phase: Phase) -> bool {
    phase.waits_for_decision() && phase.has_lifted(0) && !phase.has_begun_carry()
        || phase.has_begun(1) && !phase.has_lifted(1)
}

/// State of the last recorded estimates and decision.
#[derive(Default)]
pub struct RecordedEstimates {
    /// Cost and number of patches of each object's recorded estimate, which identify it.
    estimates: BTreeMap<usize, (f64, usize)>,
    /// True while a decision is shown.
    decision_shown: bool,
}

impl RecordedEstimates {
    /// Records new estimates of the objects `names` with their height maps, and clears those that have become void.
    /// Returns the valid estimates: an object that touch reports as lost, or that was put down, has no pose in the
    /// hand.
    pub fn record_estimates<'a>(
        &mut self,
        recorder: &mut Recorder,
        names: &[String],
        phase: Phase,
        felt: &'a [ObjectEstimate],
    ) -> Result<Vec<&'a ObjectEstimate>> {
        let felt = felt.iter().filter(|felt| felt.hold_state.holds(felt.object) && phase.has_begun_lift(felt.object));
        let felt: Vec<&ObjectEstimate> = felt.collect();
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
                recorder.log_touch_covariance(&names[felt.object], &place)?;
            }
            self.estimates = known;
        }
        if self.decision_shown && !is_decision_phase(phase) {
            self.decision_shown = false;
            recorder.log_candidates(Vec::new())?;
            recorder.log_paths(&names[0], &ObjectPath::default(), &ObjectPath::default())?;
        }
        Ok(felt)
    }

    /// Records a decision about the path of the object `name` in the hand.
    pub fn record_decision(&mut self, recorder: &mut Recorder, name: &str, choice: &DecisionRecord) -> Result<()> {
        self.decision_shown = true;
        let marked = |n: usize, planned: bool| match (choice.chosen == Some(n), planned) {
            (true, true) => "plan, chosen",
            (true, false) => "chosen",
            (false, true) => "plan",
            (false, false) => "",
        };
        let options = choice.candidates.iter().enumerate().map(|(n, option)| ScoredCandidate {
            grasp: option.grasp,
            aim: [option.aim.x * 1e3, option.aim.y * 1e3],
            clearance: option.clearance.filter(|clearance| clearance.is_finite()).map(|clearance| clearance * 1e3),
            risk: option.risk,
            held: option.held,
            score: option.score,
            mark: marked(n, option.planned),
        });
        recorder.log_candidates(options.collect())?;
        let way = |course: &Option<HeldObjectPath>| {
            course.as_ref().map_or_else(ObjectPath::default, |course| ObjectPath {
                poses: course.poses.clone(),
                nearest: course.nearest,
            })
        };
        recorder.log_paths(name, &way(&choice.rejected), &way(&choice.course))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use world::phase::{Skill, SkillStage};

    use super::*;

    /// With the hand open, and while an object is put down or grasped again, no estimate is shown.
    #[test]
    fn estimates_last_while_something_is_held() {
        for phase in [
            Phase::run(Skill::PutDown, 0),
            Phase::run(Skill::StepAside, 0),
            Phase::decide(Skill::Begin, 0),
            Phase::palpate(0, SkillStage::Decide),
            Phase::run(Skill::Approach, 0),
        ] {
            assert!(!phase.has_begun_lift(0) && !is_decision_phase(phase), "{}", phase.name());
        }
        assert!(Phase::run(Skill::Carry, 0).has_begun_lift(0) && !is_decision_phase(Phase::run(Skill::Carry, 0)));
        assert!(Phase::run(Skill::Approach, 1).has_begun_lift(0) && is_decision_phase(Phase::run(Skill::Approach, 1)));
    }
}
