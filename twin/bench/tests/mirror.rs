//! Fault detection beside a simulated robot. The residuals of a sound robot are small in free motion, those of a broken
//! one are not. Faults are detected, a sound robot raises no alarm, and the detector does not influence the robot.

use std::sync::Arc;

use anyhow::Result;
use bench::builtin::make_bench;
use bench::fault_watch::FaultDetectionWatcher;
use bench::trial::filming::Watchers;
use bench::trial::{TickView, Watcher};
use control::executor::{Phase, Skill};
use fault_detection::FaultDetector;
use fault_detection::fault::{DetectedFault, FaultKind};
use fault_detection::measurements::TickMeasurements;
use fault_detection::reference_model::ReferenceModel;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{RobotCommand, ServoGoal, TactileFrame, TactileImage};
use hand_model::{Arm, Digit, DigitVector, RobotModel};
use nalgebra::{Isometry3, Vector3};
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// Bound of the residual of a taut cable of a sound robot in free motion, N (recordings/log/fault detector.md, rounded
/// up).
const SOUND_RESIDUAL_BOUND: f64 = 0.1;
/// Time over which the cables are wound, s.
const WINDING_TIME: f64 = 1.0;
/// Duration of the whole motion, s.
const MOTION_DURATION: f64 = 2.0;
/// Time at which the cable breaks, s.
const BREAK_TIME: f64 = 1.5;

/// Time limit for the diagnosis of a fault, s.
const DIAGNOSIS_TIME_LIMIT: f64 = 0.5;

/// Creates the nominal robot of `world`, with an empty hand.
fn robot(world: &SimulatedWorld) -> SimulatedRobot {
    let cell = &world.cell;
    let setup =
        SceneSetup { cables: world.cable_losses(), ..SceneSetup::ideal(cell.world_from_base, Arm::gen3().home) };
    SimulatedRobot::new(&cell.robot, &setup, TactileBoard::blank())
}

/// Returns the command of the motion at `time` (s): the hand closes while the arm moves.
fn command(time: f64) -> RobotCommand {
    let mut arm = Arm::gen3().home;
    arm[0] += 0.1 * time;
    let mut servos = [ServoGoal::Current(0.05 * (time / WINDING_TIME).min(1.0)); 6];
    servos[5] = ServoGoal::Current(0.0);
    RobotCommand { arm, servos: servos.into(), capture: false }
}

/// Returns the residuals of the five cables, N, as means of four ticks each, with the time of the last tick (s). The
/// robot is nominal and closes its hand on nothing while its arm moves. Cable `broken` breaks at [`BREAK_TIME`].
fn residuals(broken: Option<usize>) -> Vec<(f64, DigitVector)> {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).expect("the world");
    let mut robot = robot(&world);
    let mut twin = ReferenceModel::new(&world, &robot.observe().arm.position);
    let mut broken = broken;
    let mut all = Vec::new();
    while robot.time() < MOTION_DURATION {
        let seen = robot.observe();
        if let Some(n) = broken.take_if(|_| seen.time >= BREAK_TIME) {
            robot.break_cable(n);
        }
        let innovation = twin.correct(&seen.servos, &seen.arm, false);
        all.push((seen.time, innovation.loads));
        let sent = robot.send(&command(seen.time));
        twin.advance_with(&sent);
        robot.wait_for_tick();
    }
    let mean = |ticks: &[(f64, DigitVector)]| {
        let of = |n: usize| ticks.iter().map(|(_, loads)| loads[n]).sum::<f64>() / ticks.len() as f64;
        let loads = (0..5).map(of).collect();
        (ticks[ticks.len() - 1].0, loads)
    };
    all.chunks_exact(4).map(mean).collect()
}

/// Every residual of a sound robot is small. That of a broken cable is a lasting pull; the other cables are unaffected.
#[test]
fn a_broken_cable_leaves_what_a_sound_one_stays_within() {
    let ring = Digit::Ring.index();
    for (time, loads) in residuals(None) {
        assert!(loads.iter().all(|load| load.abs() < SOUND_RESIDUAL_BOUND), "at {time} s: {loads:?}");
    }
    for (time, loads) in residuals(Some(ring)) {
        for (n, load) in loads.iter().enumerate().filter(|(n, _)| *n != ring || time < BREAK_TIME) {
            assert!(load.abs() < SOUND_RESIDUAL_BOUND, "cable {n} at {time} s: {load}");
        }
        assert!(time < BREAK_TIME + 0.1 || loads[ring] < -10.0 * SOUND_RESIDUAL_BOUND, "at {time} s: {loads:?}");
    }
}

/// Returns the faults detected in the same motion. `strike` is applied to the robot once at [`BREAK_TIME`], and `press`
/// in each tick from then on.
fn detected_faults(
    strike: impl FnOnce(&mut SimulatedRobot),
    press: impl Fn(&mut SimulatedRobot),
) -> Vec<DetectedFault> {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).expect("the world");
    let mut robot = robot(&world);
    let mut mirror = FaultDetector::new(&world, &robot.observe().arm.position).expect("a fault detector");
    let mut strike = Some(strike);
    while robot.time() < MOTION_DURATION {
        let seen = robot.observe();
        if let Some(strike) = strike.take_if(|_| seen.time >= BREAK_TIME) {
            strike(&mut robot);
        }
        let sent = robot.send(&command(seen.time));
        if strike.is_none() {
            press(&mut robot);
        }
        robot.wait_for_tick();
        mirror.update(&TickMeasurements {
            time: robot.time(),
            servos: &seen.servos,
            arm: &seen.arm,
            images: &[],
            sent: &sent,
            phase: Phase::run(Skill::Approach, 0),
            progress: 0.5 * robot.time() / MOTION_DURATION,
            targets: &[],
            felt: None,
        });
    }
    mirror.faults().to_vec()
}

#[test]
fn a_sound_robot_raises_nothing() {
    assert_eq!(detected_faults(|_| {}, |_| {}), []);
}

/// Each fault is detected once, with its digit, and in time.
#[test]
fn faults_are_named() {
    let (ring, index) = (Digit::Ring.index(), Digit::Index.index());
    let push = Vector3::new(0.0, 12.0, 0.0);
    let cases = [
        (detected_faults(|robot| robot.break_cable(ring), |_| {}), FaultKind::CableBroken, "ring"),
        (detected_faults(|robot| robot.slip_cable(index, 0.003), |_| {}), FaultKind::CableSlipped, "index"),
        (detected_faults(|robot| robot.weaken_servo(ring, 0.6), |_| {}), FaultKind::ServoWeak, "ring"),
        (detected_faults(|_| {}, |robot| robot.apply_force(None, push)), FaultKind::UnexpectedContact, "hand"),
    ];
    for (named, kind, part) in cases {
        let [only] = &named[..] else { panic!("{kind}: {named:?}") };
        assert_eq!((only.kind, only.part.as_str()), (kind, part));
        assert!((BREAK_TIME..BREAK_TIME + DIAGNOSIS_TIME_LIMIT).contains(&only.time), "{only}");
    }
}

/// Load pattern of a busy host: robot ticks between two observations, and the delay of each within its tick, ticks.
const BUSY_LOAD_PATTERN: [(usize, f64); 12] = [
    (1, 0.0),
    (1, 0.3),
    (2, 0.1),
    (1, 0.8),
    (4, 0.2),
    (1, 0.0),
    (1, 0.5),
    (3, 0.9),
    (1, 0.1),
    (7, 0.4),
    (2, 0.0),
    (1, 0.6),
];

/// Returns the images of all cameras of capture `n`, with read-out noise. Those of camera `frozen` are always the same.
fn images(n: u64, frozen: Option<usize>) -> Vec<TactileFrame> {
    let image = |camera: usize| {
        let n = if frozen == Some(camera) { 0 } else { n };
        let noise = |pixel: usize| 100 + ((pixel as u64 * 7 + n * 13 + camera as u64) % 5) as u8;
        Arc::new(TactileImage { rgb: (0..IMAGE_SIZE * IMAGE_SIZE * 3).map(noise).collect() })
    };
    (0..RobotModel::ftac_gen3().hand.cameras.len())
        .map(|camera| TactileFrame { camera, time: 0.2 * n as f64, sequence: n, image: image(camera) })
        .collect()
}

/// Returns the fault detector of the same motion observed by a busy host. `strike` is applied to the robot once at
/// [`BREAK_TIME`], and from then on camera `frozen` sends the same image.
fn detector_in_real_time(strike: impl FnOnce(&mut SimulatedRobot), frozen: Option<usize>) -> FaultDetector {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).expect("the world");
    let mut robot = robot(&world);
    let tick = robot.tick_length();
    let mut mirror = FaultDetector::new(&world, &robot.observe().arm.position).expect("a fault detector");
    let (mut strike, mut last) = (Some(strike), 0.0);
    let mut known = images(0, None);
    for (ticks, late) in BUSY_LOAD_PATTERN.into_iter().cycle() {
        let seen = robot.observe();
        let time = seen.time + late * tick;
        if time >= MOTION_DURATION {
            break;
        }
        if let Some(strike) = strike.take_if(|_| seen.time >= BREAK_TIME) {
            strike(&mut robot);
        }
        let capture = seen.time >= last + 0.2;
        if capture {
            last = seen.time;
            known = images((seen.time / 0.2) as u64, frozen.filter(|_| seen.time >= BREAK_TIME));
        }
        let sent = robot.send(&RobotCommand { capture, ..command(seen.time) });
        for _ in 0..ticks {
            robot.wait_for_tick();
        }
        mirror.update(&TickMeasurements {
            time,
            servos: &seen.servos,
            arm: &seen.arm,
            images: &known,
            sent: &sent,
            phase: Phase::run(Skill::Approach, 0),
            progress: 0.5 * time / MOTION_DURATION,
            targets: &[],
            felt: None,
        });
    }
    mirror
}

/// A busy host observes late, twice within a tick, or not at all for some ticks. The detector follows without a reset
/// and reports nothing on a sound robot.
#[test]
fn late_and_dropped_ticks_are_no_restart() {
    let mirror = detector_in_real_time(|_| {}, None);
    assert_eq!((mirror.gaps(), mirror.faults()), (0, &[][..]));
}

/// A frozen camera is detected by its images, however unevenly they are observed. So is a broken cable.
#[test]
fn a_frozen_camera_is_named_in_real_time() {
    let camera = 7;
    let mirror = detector_in_real_time(|_| {}, Some(camera));
    let [only] = mirror.faults() else { panic!("{:?}", mirror.faults()) };
    assert_eq!(only.kind, FaultKind::CameraDead);
    assert!((BREAK_TIME..BREAK_TIME + DIAGNOSIS_TIME_LIMIT).contains(&only.time), "{only}");
    assert_eq!(mirror.gaps(), 0);

    let mirror = detector_in_real_time(|robot| robot.break_cable(Digit::Ring.index()), None);
    let [only] = mirror.faults() else { panic!("{:?}", mirror.faults()) };
    assert_eq!((only.kind, only.part.as_str()), (FaultKind::CableBroken, "ring"));
    assert!((BREAK_TIME..BREAK_TIME + DIAGNOSIS_TIME_LIMIT).contains(&only.time), "{only}");
}

/// Records the joint angles and object poses.
#[derive(Default)]
struct RecordedStates(Vec<(f64, Vec<f64>, Vec<Isometry3<f64>>)>);

impl Watcher for RecordedStates {
    fn is_active(&self) -> bool {
        false
    }
    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        let truth = moment.truth.expect("the ground truth of the simulated backend");
        self.0.push((moment.time, truth.hand.clone(), truth.objects.clone()));
        Ok(())
    }
    fn on_branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }
    fn on_outcome(&mut self, _: &TrialRecord) -> Result<()> {
        Ok(())
    }
}

/// Every bit of a trial is the same with fault detection beside it.
#[test]
fn a_mirror_changes_no_bit_of_a_trial() {
    let bench = make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 1, 1, true).expect("a bench");
    let (mut alone, mut beside) = (RecordedStates::default(), RecordedStates::default());
    let without = bench.run_each_condition(0, 0, &[Condition::Blind], &[], &mut alone).expect("a trial");
    let mut mirroring = FaultDetectionWatcher::new(&bench, None);
    let with =
        bench.run_each_condition(0, 0, &[Condition::Blind], &[], &mut Watchers(vec![&mut mirroring, &mut beside]));
    assert_eq!(without.records, with.expect("a trial").records);
    assert!(mirroring.effort().0 as usize == beside.0.len(), "the fault detector observed every tick");
    assert_eq!(mirroring.gaps(), 0);
    assert_eq!(alone.0.len(), beside.0.len());
    assert!(alone.0 == beside.0, "joints and objects");
}
