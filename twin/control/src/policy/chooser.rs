//! A policy that delegates to a chooser: the grasp of the second object, its aim, and whether to try again.
//!
//! The [`Chooser`] receives the knowledge of this crate's own policies, measurements and estimates, and answers with
//! one of the candidates. Everything else is as in [`super::touch`]: the tactile snapshot is interpreted, the objects
//! are detected again before a choice, the arm servo predicts each path, and no try begins too late for the trial. The
//! first object is taken as planned. A chooser that fails, or gives an invalid answer, ends its trial with the reason
//! in the record.

use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, ServoState, TactileFrame};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use tactile_perception::ExpectedObject;
use world::attempt::Attempt;

use super::{DecisionTrace, InjectedHold, Knowledge, PolicyError, PolicyStep, TrialPolicy};
use crate::detection::{DetectedObject, ObjectDetector};
use crate::executor::{Executor, GraspTarget, Phase};
use crate::perception::{ExpectedHolds, HoldState, ObjectEstimate, default_prior, detect_hold_state, estimate_hold};
use crate::score::GraspCandidate;
use crate::sensing::TouchPerception;

/// Time that a trial needs from the start of a try to its end, s. No choice is requested if less time is left.
const MIN_TRY_TIME: f64 = 10.0;
/// Largest offset of an aim from the detected pose along an axis, m, and in yaw, rad.
const MAX_AIM_OFFSET: (f64, f64) = (0.1, std::f64::consts::PI);

/// Information for a chooser.
pub struct ChooserSituation<'a> {
    /// The decision: after a snapshot of the first object, which should be in the hand, or of the second one, which has
    /// been tried and lifted.
    pub phase: Phase,
    /// The robot's clock, s.
    pub time: f64,
    /// Time left until the trial fails, s.
    pub time_left: f64,
    /// Number of tries at the second object so far.
    pub tries: u32,
    pub servos: &'a [ServoState],
    pub arm: &'a ArmState,
    /// Commanded `world_from_palm`.
    pub palm: Isometry3<f64>,
    /// Tactile images of the last snapshot, one per camera that has sent one.
    pub images: &'a [TactileFrame],
    /// Names of the first and the second object.
    pub objects: Vec<&'a str>,
    /// Their latest detected poses.
    pub detected: Vec<DetectedObject>,
    /// True if the second object was detected just now; otherwise it is hidden.
    pub second_is_visible: bool,
    /// The grasp that took the first object.
    pub first: &'a Grasp,
    /// Grasps of the second object, the planned one first.
    pub candidates: &'a [GraspCandidate],
    /// The first object as felt after its lift.
    pub felt: Option<&'a ObjectEstimate>,
    /// Objects that are felt to be in the hand now.
    pub hold_state: HoldState,
}

/// Offset of an aim from the detected pose of an object.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AimOffset {
    /// Offset along x, m, world.
    pub x: f64,
    /// Offset along y, m, world.
    pub y: f64,
    /// Offset in yaw about the vertical, rad.
    pub yaw: f64,
}

/// Answer of a chooser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChooserDecision {
    /// Take the second object, or try again if it has been tried.
    Take {
        /// Index of the candidate.
        candidate: usize,
        aim: AimOffset,
    },
    /// Carry away the contents of the hand. Before the second object was tried, this leaves it alone.
    Keep,
}

/// Error of a chooser.
pub type ChooserError = Box<dyn std::error::Error + Send + Sync>;

/// Decision maker for the second grasp.
pub trait Chooser {
    /// Chooses in a situation. It may take any time: the robot's clock stands still.
    fn choose(&mut self, situation: &ChooserSituation) -> Result<ChooserDecision, ChooserError>;
}

/// Asks a [`Chooser`]; see the module documentation. Supports trials of two objects.
pub struct ChooserPolicy<'a> {
    knowledge: Knowledge<'a>,
    senses: TouchPerception<'a>,
    chooser: &'a mut dyn Chooser,
    trace: DecisionTrace,
    tries: u32,
    felt: Option<ObjectEstimate>,
    hold_state: HoldState,
}

impl<'a> ChooserPolicy<'a> {
    /// The policy of a trial with the choices of `chooser`.
    pub fn new(knowledge: Knowledge<'a>, senses: TouchPerception<'a>, chooser: &'a mut dyn Chooser) -> Self {
        Self {
            knowledge,
            senses,
            chooser,
            trace: DecisionTrace::default(),
            tries: 0,
            felt: None,
            hold_state: HoldState::default(),
        }
    }

    /// Asks the chooser and checks its answer. On an invalid answer, the error is the reason in words.
    fn ask(&mut self, executor: &Executor, time: f64, sees_second: bool) -> Result<ChooserDecision, String> {
        let look = executor.motion().snapshot();
        let situation = ChooserSituation {
            phase: executor.phase(),
            time,
            time_left: self.knowledge.time_limit - time,
            tries: self.tries,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            palm: executor.motion().palm(),
            images: look.images,
            objects: self.knowledge.objects.iter().map(|object| object.name.as_str()).collect(),
            detected: executor.targets().iter().map(|target| target.detected).collect(),
            second_is_visible: sees_second,
            first: &executor.target(0).grasp,
            candidates: &self.knowledge.second_candidates,
            felt: self.felt.as_ref(),
            hold_state: self.hold_state,
        };
        let answer = self.chooser.choose(&situation).map_err(|error| format!("the chooser failed: {error}"))?;
        if let ChooserDecision::Take { candidate, aim } = answer {
            let count = self.knowledge.second_candidates.len();
            if candidate >= count {
                return Err(format!("the chooser's candidate: found {candidate}, expected less than {count}"));
            }
            let AimOffset { x, y, yaw } = aim;
            if !(x.abs() <= MAX_AIM_OFFSET.0 && y.abs() <= MAX_AIM_OFFSET.0 && yaw.abs() <= MAX_AIM_OFFSET.1) {
                let (most, turn) = MAX_AIM_OFFSET;
                return Err(format!("the chooser's aim: found {aim:?}, expected up to {most} m and {turn:.2} rad"));
            }
        }
        Ok(answer)
    }

    /// Takes the second object with a candidate, aimed at an offset from its detected pose.
    fn take(&mut self, executor: &mut Executor, candidate: usize, aim: AimOffset) -> Result<PolicyStep, PolicyError> {
        let grasp = self.knowledge.second_candidates[candidate].grasp.clone();
        let seen = executor.target(1).detected;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), aim.yaw);
        let beside = DetectedObject {
            position: seen.position + Vector3::new(aim.x, aim.y, 0.0),
            rotation: turn * seen.rotation,
            yaw: seen.yaw + aim.yaw,
        };
        let paths: Vec<_> = executor.approach_paths().collect();
        let path = paths.iter().find_map(|stops| executor.feasible_approach(stops, &grasp, &beside));
        let Some(path) = path else {
            let at = beside.position;
            self.trace.record(format!("grasp {} is out of reach at ({:.2}, {:.2}) m", grasp.id, at.x, at.y));
            return Ok(PolicyStep::GiveUp);
        };
        self.tries += 1;
        self.trace.decisions += 1;
        self.trace.retries += u32::from(self.tries > 1);
        self.trace.switched |= candidate > 0;
        self.trace.aimed |= aim != AimOffset::default();
        let (id, why) = (grasp.id, "as chosen".to_owned());
        executor.take(1, GraspTarget { grasp, detected: beside })?;
        executor.redirect(path);
        self.trace.attempts.push(Attempt { object: 1, grasp: id, why, ..Attempt::default() });
        self.trace.record(format!("grasp {id} was chosen"));
        Ok(PolicyStep::Continue)
    }
}

impl TrialPolicy for ChooserPolicy<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<InjectedHold>) -> Result<(), PolicyError> {
        let [GraspTarget { grasp: first, detected: percept }, GraspTarget { grasp: second, .. }] =
            [0, 1].map(|object| executor.target(object));
        let expected = ExpectedHolds::from_grasps(first, percept, Some(second));
        if !executor.phase().has_lifted(1) {
            let mut felt =
                estimate_hold(&self.senses, &executor.motion().snapshot(), self.knowledge.known_objects[0], &expected)?;
            if let Some(injected) = injected {
                felt.estimate.palm_from_object = injected.palm_from_object;
                felt.hold_state = injected.hold_state;
            }
            self.trace.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
            self.hold_state = felt.hold_state;
            self.felt = Some(felt);
            return Ok(());
        }
        let held = self.felt.as_ref().map_or(expected.palm_from_object, |felt| felt.estimate.palm_from_object);
        let first = ExpectedObject { shape: self.knowledge.known_objects[0], prior: default_prior(held) };
        let second = second
            .held
            .map(|held| ExpectedObject { shape: self.knowledge.known_objects[1], prior: default_prior(held) });
        let both: Vec<ExpectedObject> = std::iter::once(first).chain(second).collect();
        self.hold_state = match injected {
            Some(injected) => injected.hold_state,
            None => detect_hold_state(&self.senses, &executor.motion().snapshot(), &expected, &both)?,
        };
        Ok(())
    }

    fn decide(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        time: f64,
    ) -> Result<PolicyStep, PolicyError> {
        let phase = executor.phase();
        if phase.is_done() {
            return Ok(PolicyStep::Finish);
        }
        let seen = detector.detect(1)?.map(|seen| DetectedObject::from_pose(&self.knowledge.objects[1], &seen.pose));
        if let Some(seen) = seen {
            executor.update_detection(1, seen);
        }
        let late = time + MIN_TRY_TIME > self.knowledge.time_limit;
        let answer = if late { Ok(ChooserDecision::Keep) } else { self.ask(executor, time, seen.is_some()) };
        match answer {
            Ok(ChooserDecision::Take { candidate, aim }) => self.take(executor, candidate, aim),
            Ok(ChooserDecision::Keep) if phase.has_lifted(1) => {
                executor.carry_aside()?;
                Ok(PolicyStep::Continue)
            }
            Ok(ChooserDecision::Keep) => {
                self.trace.record("the second object is left alone".to_owned());
                Ok(PolicyStep::Decline)
            }
            Err(why) => {
                self.trace.record(why);
                Ok(PolicyStep::Failed)
            }
        }
    }

    fn trace(&mut self) -> &mut DecisionTrace {
        &mut self.trace
    }

    fn felt(&self) -> &[ObjectEstimate] {
        self.felt.as_slice()
    }

    fn deliberates(&self) -> bool {
        true
    }
}
