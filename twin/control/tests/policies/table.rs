//! A constructed table, with a robot above it and its object detector.

use std::sync::Arc;

use control::detection::{DetectedObject, DetectionError, ObjectDetector, PoseDetection};
use control::executor::{Executor, GraspTarget, Phase, Skill, SkillStage};
use control::motion::MotionProtocol;
use control::perception::{HoldState, KnownObject};
use control::policy::touch::TouchPolicy;
use control::policy::{InjectedHold, Knowledge, Recovery};
use control::score::GraspCandidate;
use control::sensing::TouchPerception;
use control::trajectory::PathLimits;
use control::uncertainty::Uncertainty;
use control::workcell::Workcell;
use dexterous_grasping::{Grasp, Repertoire};
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{Observation, ServoState, TactileImage};
use hand_model::transmission::friction::CableFriction;
use hand_model::{Arm, Digit, RobotModel};
use nalgebra::{Isometry3, Translation3};
use tactile_perception::{PhotometricCalibration, TouchPipeline};
use world::Sensing;
use world::objects::{ObjectModel, ObjectSet};

pub const TICK: f64 = 0.02;
pub const FIRST: &str = "cube_45";
pub const SECOND: &str = "golf_ball";
/// Digits that take the first object, and those that take the second.
pub const SIDE: &[Digit] = &[Digit::Ring, Digit::Little];
pub const PINCH: &[Digit] = &[Digit::Thumb, Digit::Index, Digit::Middle];
pub const TIME_LIMIT: f64 = 120.0;

/// Observation of a robot that has not moved.
pub fn still() -> Observation {
    Observation { servos: [ServoState::default(); 6].into(), ..Observation::default() }
}

/// Phases of the executor in a trial of two objects.
pub const REACH_FIRST: Phase = Phase::palpate(0, SkillStage::Reach);
pub const LOCATE_FIRST: Phase = Phase::decide(Skill::Palpate, 0);
pub const APPROACH_FIRST: Phase = Phase::run(Skill::Approach, 0);
pub const GRASP_FIRST: Phase = Phase::run(Skill::Grasp, 0);
pub const DECIDE: Phase = Phase::decide(Skill::Snapshot, 0);
pub const REACH_SECOND: Phase = Phase::palpate(1, SkillStage::Reach);
pub const LOCATE_SECOND: Phase = Phase::decide(Skill::Palpate, 1);
pub const APPROACH_SECOND: Phase = Phase::run(Skill::Approach, 1);
pub const CONFIRM: Phase = Phase::decide(Skill::Snapshot, 1);
pub const DONE: Phase = Phase::decide(Skill::Verify, 0);
pub const PUT_DOWN: Phase = Phase::run(Skill::PutDown, 0);
pub const STEP_ASIDE: Phase = Phase::run(Skill::StepAside, 0);

pub fn grasp(id: u32, object: &str, digits: &[Digit], center: [f64; 3], score: f64) -> Grasp {
    let mut close_tension = [0.0; 5];
    for digit in digits {
        close_tension[digit.index()] = 10.0;
    }
    Grasp {
        id,
        object: object.into(),
        digits: digits.to_vec(),
        yaw: 0.0,
        pitch: 0.0,
        roll: 0.0,
        center,
        pre_tension: [0.0; 5].into(),
        close_tension: close_tension.into(),
        opposition: 0.5,
        raise: 0.0,
        thumb_delay: 0.0,
        held: None,
        held_joints: None,
        held_sigmas: None,
        score,
    }
}

/// A robot above a table with two objects in front of it, and the controller's knowledge of them.
pub struct Table {
    pub cell: Workcell,
    pub library: ObjectSet,
    pub repertoire: Repertoire,
    pub objects: [Arc<ObjectModel>; 2],
    pub known: KnownObject,
    pub pipeline: TouchPipeline,
}

impl Table {
    pub fn new() -> Self {
        let mut cell = Workcell {
            robot: RobotModel::ftac_gen3(),
            world_from_base: Isometry3::identity(),
            ready_posture: Arm::gen3().home,
        };
        let level = grasp(0, FIRST, SIDE, [0.0; 3], 1.0).palm_rotation(0.0);
        let above = Isometry3::from_parts(Translation3::new(0.55, 0.0, 0.30), level);
        cell.ready_posture = cell.posture(&above, &Arm::gen3().home).expect("within reach");
        let library = ObjectSet::standard().with_fallen();
        let objects = [FIRST, SECOND].map(|name| library.get(name).expect("a standard object").clone());
        let mut repertoire = Repertoire::default();
        repertoire.insert(grasp(0, FIRST, SIDE, [-0.02, 0.08, -0.05], 1.0));
        repertoire.insert(grasp(1, FIRST, SIDE, [-0.02, 0.09, -0.05], 0.9));
        let image = Arc::new(TactileImage { rgb: vec![100; 3 * IMAGE_SIZE * IMAGE_SIZE] });
        let calibration = PhotometricCalibration { version: 1, configurations: Default::default() };
        let backgrounds = vec![image; cell.robot.hand.cameras.len()];
        let pipeline = TouchPipeline::new(&cell.robot.hand, calibration, backgrounds).expect("made");
        Self { known: KnownObject::new(objects[0].clone()), cell, library, repertoire, objects, pipeline }
    }

    pub fn place(&self, index: usize) -> Isometry3<f64> {
        let object = &self.objects[index];
        let at = Translation3::new(0.55, [-0.10, 0.10][index], object.rest_height());
        Isometry3::from_parts(at, object.rest)
    }

    pub fn detected(&self, index: usize) -> DetectedObject {
        DetectedObject::from_pose(&self.objects[index], &self.place(index))
    }

    /// Second grasps, the plan first. They differ in the object's position in the palm frame.
    pub fn second(&self) -> Vec<GraspCandidate> {
        [[0.02, 0.09, -0.05], [0.02, 0.09, -0.12]]
            .iter()
            .zip(0..)
            .map(|(center, id)| GraspCandidate::new(grasp(id, SECOND, PINCH, *center, 1.0), 1.0))
            .collect()
    }

    /// An executor on its way to the first object.
    pub fn executor(&self) -> Executor {
        let mut executor = self.waiting();
        executor.continue_as_planned().expect("a path");
        executor
    }

    /// An executor that waits to begin.
    pub fn waiting(&self) -> Executor {
        let first = self.repertoire.for_digits(FIRST, SIDE).next().expect("a first grasp").clone();
        let grasps = [first, self.second()[0].grasp.clone()].into_iter().enumerate();
        self.with_list(grasps.map(|(n, grasp)| GraspTarget { grasp, detected: self.detected(n) }).collect())
    }

    /// An executor with any list of objects.
    pub fn with_list(&self, targets: Vec<GraspTarget>) -> Executor {
        let servo = self.cell.arm_servo(self.cell.ready_posture).expect("at rest");
        let (limits, friction) = (PathLimits::default(), CableFriction::NONE);
        let protocol = MotionProtocol { lift: 0.12, carry_distance: 0.1, hold_time: 0.5, limits, friction };
        Executor::new(self.cell.robot.hand.clone(), servo, protocol, targets, TICK).expect("at rest")
    }

    pub fn knowledge(&self) -> Knowledge<'_> {
        Knowledge {
            cell: &self.cell,
            library: &self.library,
            repertoire: &self.repertoire,
            objects: self.objects.to_vec(),
            known_objects: vec![&self.known; 2],
            second_candidates: self.second(),
            third_candidates: Vec::new(),
            fallen_candidates: Vec::new(),
            alternative_firsts: Vec::new(),
            uncertainty: Uncertainty { arm: 0.005, detector: 0.0065, detector_persistent_share: 0.5 },
            first_detection_sigmas: [None; 3],
            time_limit: TIME_LIMIT,
            recovery: Recovery::FULL,
            palpates: false,
            look_ahead: None,
            reordered: None,
        }
    }

    pub fn touch(&self) -> TouchPolicy<'_> {
        let senses = TouchPerception::new(&self.pipeline, Sensing::TruePose).expect("made");
        let first = self.repertoire.for_digits(FIRST, SIDE).next().expect("a first grasp");
        TouchPolicy::new(self.knowledge(), senses, first)
    }
}

/// Detects the objects at their poses and counts the detections.
pub struct CountingDetector<'a> {
    pub table: &'a Table,
    pub detections: [usize; 2],
    /// Number of further detections for which each object is hidden.
    pub hidden: [usize; 2],
    /// Height of each object above the table, m.
    pub raised: [f64; 2],
}

impl<'a> CountingDetector<'a> {
    pub fn new(table: &'a Table) -> Self {
        Self { table, detections: [0, 0], hidden: [0, 0], raised: [0.0, 0.0] }
    }
}

impl ObjectDetector for CountingDetector<'_> {
    fn detect(&mut self, object: usize) -> Result<Option<PoseDetection>, DetectionError> {
        self.detections[object] += 1;
        if self.hidden[object] > 0 {
            self.hidden[object] -= 1;
            return Ok(None);
        }
        let raised = Translation3::new(0.0, 0.0, self.raised[object]);
        Ok(Some((raised * self.table.place(object)).into()))
    }
}

/// Runs ticks until `phase`, without any image: snapshots end by their time limit.
pub fn run_until(executor: &mut Executor, phase: Phase) {
    for _ in 0..100_000 {
        if executor.phase() == phase {
            return;
        }
        executor.tick(&still()).expect("a command");
    }
    panic!("{phase} is not reached");
}

/// Runs ticks until the next decision.
pub fn run_on(executor: &mut Executor) {
    while !executor.phase().waits_for_decision() {
        executor.tick(&still()).expect("a command");
    }
}

pub fn in_hand(first: bool, second: bool) -> Option<InjectedHold> {
    let palm_from_object = Isometry3::translation(-0.02, 0.08, -0.05);
    Some(InjectedHold { palm_from_object, hold_state: HoldState::from_iter([first, second]) })
}
