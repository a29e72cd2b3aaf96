//! Rollouts of grasps: a grasp is verified by closing and holding it in physics, without errors or under given ones.
//!
//! A *first* grasp is verified alone: take, lift, hold. A *second* grasp is verified while the ring and little fingers
//! already hold an object: the rollout starts from a snapshot of that hold and runs to the end of the trial.

pub mod circumstances;

use std::sync::{Arc, LazyLock};

use anyhow::Result;
use control::executor::{Executor, GraspTarget, Phase, Skill};
use control::motion::MotionProtocol;
use control::outcome_model::TryOutcome;
use dexterous_grasping::Grasp;
use dexterous_grasping::grasp::pregrasp_pose;
use dexterous_grasping::synthesis::held::HeldContact;
use hand_model::hand::MAX_HAND_JOINTS;
use hand_model::{ArmVector, Digit, Hand};
use nalgebra::Isometry3;
use scenarios::generator::trial_rng;
use scenarios::noise::{ExecutionNoise, NoiseLevels, PerceptionNoise, TrialNoise};
use sim::robot::{GroundTruth, SimulatedRobot};
use sim::tactile::TactileBoard;
use world::holding::{GRIPPED_RULE, LIFTED_RULE};
use world::objects::ObjectModel;

use crate::simulated_world::{SimulatedWorld, drive, tick};

/// Seed of the errors under which grasps are verified. No benchmark trial draws from it.
const VERIFICATION_SEED: u64 = 0x005e_ed0f_9a05;

/// Result of the hold at the end of a rollout.
#[derive(Debug, Clone)]
pub struct HoldOutcome {
    /// True if the object was lifted, is held to the end and is off the table.
    pub held: bool,
    /// Pose of the object in the palm frame at the end.
    pub palm_from_object: Isometry3<f64>,
    /// Slip: distance that the object moved in the hand while held, m.
    pub slip: f64,
    /// Finger joint angles at the end, rad.
    pub joints: Vec<f64>,
    /// Contacts with the hand at the end, palm frame.
    pub contacts: Vec<HeldContact>,
}

/// Snapshot of a rollout: the robot together with its controller.
#[derive(Clone)]
pub struct RolloutSnapshot<R = SimulatedRobot> {
    /// The robot.
    pub robot: R,
    /// The controller.
    pub executor: Executor,
}

/// Initial conditions of a trial, besides the world and the tactile sensors.
#[derive(Debug, Clone, Copy)]
pub struct TrialStart<'a> {
    /// Distances and times.
    pub protocol: MotionProtocol,
    /// Planned grasps, one per object.
    pub grasps: &'a [&'a Grasp],
    /// Errors of the arm and of object detection.
    pub noise: &'a TrialNoise,
    /// Posture of the arm, rad.
    pub arm: ArmVector,
}

impl RolloutSnapshot {
    /// Creates the snapshot of a trial that is about to begin. `objects` stand at the places of the objects that the
    /// grasps are for, and are detected with the errors of the noise.
    pub fn at_start(
        world: &SimulatedWorld,
        start: &TrialStart<'_>,
        objects: &[Arc<ObjectModel>],
        board: TactileBoard,
    ) -> Result<Self> {
        let TrialStart { protocol, grasps, noise, arm: start } = *start;
        let seen = world.detected_objects(objects, noise);
        let robot = SimulatedRobot::new(world.simulated_robot(), &world.scene(objects, start, noise), board);
        let tick = hand_model::robot::RobotBackend::tick_length(&robot);
        let targets =
            grasps.iter().zip(seen).map(|(grasp, percept)| GraspTarget { grasp: (*grasp).clone(), detected: percept });
        let servo = world.cell.arm_servo(start)?;
        let executor = Executor::new(world.cell.robot.hand.clone(), servo, protocol, targets.collect(), tick)?;
        Ok(Self { robot, executor })
    }
}

/// True if object `index` is in the grip of the hand at any height: touched by the hand, off the table and near the
/// palm.
pub fn in_grip(truth: &GroundTruth, index: usize) -> bool {
    GRIPPED_RULE.holds(&truth.support(index))
}

/// True if object `index` is in the hand and lifted.
pub fn in_hand(truth: &GroundTruth, index: usize) -> bool {
    LIFTED_RULE.holds(&truth.support(index))
}

/// Posture of the arm at the start of a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartPosture {
    /// The posture in which every trial starts. The rollout is then bit for bit the ideal run of the trial.
    Ready,
    /// Right before the grasp, which saves time.
    Near,
}

/// Parameters of the rollout of a first grasp.
#[derive(Debug, Clone, Copy)]
pub struct FirstGraspRollout<'a> {
    /// Distances and times.
    pub protocol: MotionProtocol,
    /// Posture of the arm at the start.
    pub start: StartPosture,
    /// The first grasp, then one grasp for each object that stands by.
    pub grasps: &'a [&'a Grasp],
    /// Errors of the arm and of object detection.
    pub noise: &'a TrialNoise,
}

impl<'a> FirstGraspRollout<'a> {
    /// Creates the first half of the ideal run: no errors, and the arm starts in the ready posture.
    pub fn ideal(world: &SimulatedWorld, grasps: &'a [&'a Grasp]) -> Self {
        static NO_NOISE: LazyLock<TrialNoise> = LazyLock::new(TrialNoise::none);
        Self { protocol: world.protocol(), start: StartPosture::Ready, grasps, noise: &NO_NOISE }
    }
}

/// Takes the first object and runs the trial up to the decision on the second grasp. Returns `None` if the arm does not
/// reach the object or the grasp does not hold it.
pub fn roll_out_first(
    world: &SimulatedWorld,
    rollout: &FirstGraspRollout<'_>,
    board: &TactileBoard,
) -> Result<Option<(RolloutSnapshot, HoldOutcome)>> {
    let FirstGraspRollout { protocol, start, grasps, noise } = *rollout;
    let Some(first) = grasps.first() else { return Ok(None) };
    let objects = grasps.iter().map(|grasp| world.object(&grasp.object)).collect::<Result<Vec<_>>>()?;
    let seen = world.detected_objects(&objects, noise)[0];
    let target = first.palm_pose(&seen.position, seen.yaw);
    let near = pregrasp_pose(&world.cell.robot.hand, &target, 0.12);
    let (Ok(near), Ok(_)) =
        (world.posture(&near, &world.cell.ready_posture), world.posture(&target, &world.cell.ready_posture))
    else {
        return Ok(None);
    };
    let arm = if start == StartPosture::Near { near } else { world.cell.ready_posture };
    let start = TrialStart { protocol, grasps, noise, arm };
    let mut snapshot = RolloutSnapshot::at_start(world, &start, &objects, board.clone())?;
    snapshot.executor.take_planned(0)?;
    drive(&mut snapshot.robot, &mut snapshot.executor, Phase::run(Skill::Lift, 0), |_, _| {})?;
    if snapshot.robot.truth().touched_by[0] == 0 {
        return Ok(None);
    }
    drive(&mut snapshot.robot, &mut snapshot.executor, Phase::run(Skill::Snapshot, 0), |_, _| {})?;
    let before = snapshot.robot.truth();
    drive(&mut snapshot.robot, &mut snapshot.executor, Phase::decide(Skill::Snapshot, 0), |_, _| {})?;
    let after = snapshot.robot.truth();
    let outcome = hold_outcome(&before, &after, 0);
    Ok(outcome.held.then_some((snapshot, outcome)))
}

/// Monitors a try at a later object, by the referee's rule for collisions.
struct TryMonitor {
    /// Index of the object.
    object: usize,
    /// Bits of the digits that hold the earlier objects.
    holding: u32,
    free: Vec<u32>,
    gripped: bool,
    collided: bool,
}

impl TryMonitor {
    fn new(executor: &Executor, object: usize) -> Self {
        let hand = executor.motion().hand();
        let holding: Vec<Digit> =
            executor.targets()[..object].iter().flat_map(|target| target.grasp.digits.iter().copied()).collect();
        let free = hand.digits().iter().filter(|digit| !holding.contains(digit));
        let free = free.map(|digit| digit_bits(hand, &[*digit])).collect();
        // One digit holds against the palm.
        let gripped = executor.target(object).grasp.digits.len() == 1;
        Self { object, holding: digit_bits(hand, &holding), free, gripped, collided: false }
    }

    /// Runs up to `phase`, or to a collision.
    fn drive(&mut self, robot: &mut SimulatedRobot, executor: &mut Executor, phase: Phase) -> Result<()> {
        while executor.phase() != phase && !self.collided {
            tick(robot, executor)?;
            self.record_contacts(robot, executor);
        }
        Ok(())
    }

    /// Records the contacts of the object in the last tick.
    fn record_contacts(&mut self, robot: &SimulatedRobot, executor: &Executor) {
        // The palm may touch an object that two free digits hold.
        self.gripped |= self.free.iter().filter(|digit| robot.is_touched(self.object, **digit)).count() >= 2;
        let unwanted = if self.gripped { self.holding } else { self.holding | PALM };
        self.collided = !executor.phase().has_begun_lift(self.object) && robot.is_touched(self.object, unwanted);
    }
}

/// Runs the rest of the trial from a hold of the only object. Returns the result of the hold.
pub fn roll_out_carry(snapshot: &RolloutSnapshot) -> Result<HoldOutcome> {
    let RolloutSnapshot { mut robot, mut executor } = snapshot.clone();
    executor.carry_aside()?;
    drive(&mut robot, &mut executor, Phase::run(Skill::Hold, 0), |_, _| {})?;
    let before = robot.truth();
    drive(&mut robot, &mut executor, Phase::decide(Skill::Verify, 0), |_, _| {})?;
    Ok(hold_outcome(&before, &robot.truth(), 0))
}

/// Takes `object` with `grasp` from a hold of the objects before it, up to the decision on what follows. Returns `None`
/// if any of them is not in the hand then. Collisions are left to the referee, because neighbouring fingers meet on
/// small objects.
pub fn roll_out_next(snapshot: &RolloutSnapshot, object: usize, grasp: &Grasp) -> Result<Option<RolloutSnapshot>> {
    let RolloutSnapshot { mut robot, mut executor } = snapshot.clone();
    if executor.take_with(object, grasp.clone()).is_err() {
        return Ok(None);
    }
    for phase in [Phase::run(Skill::Lift, object), Phase::decide(Skill::Snapshot, object)] {
        drive(&mut robot, &mut executor, phase, |_, _| {})?;
        if robot.truth().touched_by[object] == 0 {
            return Ok(None);
        }
    }
    let truth = robot.truth();
    Ok((0..=object).all(|one| in_hand(&truth, one)).then_some(RolloutSnapshot { robot, executor }))
}

/// Runs the rest of the trial from a hold of all objects but the last, with `grasp` for the last one. Returns true if
/// there was a collision before the digits had closed, and the result of the hold. A trial that can no longer succeed
/// is not run to the end.
pub fn roll_out_last(snapshot: &RolloutSnapshot, grasp: &Grasp) -> Result<(bool, HoldOutcome)> {
    let RolloutSnapshot { mut robot, mut executor } = snapshot.clone();
    let last = executor.targets().len() - 1;
    executor.take_with(last, grasp.clone())?;
    let mut watch = TryMonitor::new(&executor, last);
    for phase in [
        Phase::run(Skill::Grasp, last),
        Phase::run(Skill::Lift, last),
        Phase::decide(Skill::Snapshot, last),
        Phase::run(Skill::Hold, 0),
    ] {
        watch.drive(&mut robot, &mut executor, phase)?;
        let truth = robot.truth();
        let lost = match phase.skill {
            Skill::Lift => truth.touched_by[last] == 0,
            Skill::Snapshot | Skill::Hold => !in_hand(&truth, last),
            _ => false,
        };
        if watch.collided || lost {
            return Ok((watch.collided, HoldOutcome { held: false, ..hold_outcome(&truth, &truth, last) }));
        }
        if phase.skill == Skill::Snapshot {
            executor.carry_aside()?;
        }
    }
    let before = robot.truth();
    drive(&mut robot, &mut executor, Phase::decide(Skill::Verify, 0), |_, _| {})?;
    let after = robot.truth();
    let mut outcome = hold_outcome(&before, &after, last);
    outcome.held &= (0..last).all(|object| in_hand(&after, object));
    Ok((watch.collided, outcome))
}

/// Runs one try of `second` from a hold of the first object, up to the end of its lift.
pub fn try_second(snapshot: &RolloutSnapshot, second: &Grasp) -> Result<TryOutcome> {
    let RolloutSnapshot { mut robot, mut executor } = snapshot.clone();
    executor.take_with(1, second.clone())?;
    roll_out_try(&mut robot, &mut executor)
}

/// Runs a try at the second object, which `executor` is about to approach, until both objects are carried.
pub fn roll_out_to_carry(mut robot: SimulatedRobot, mut executor: Executor) -> Result<TryOutcome> {
    let lifted = roll_out_try(&mut robot, &mut executor)?;
    if lifted != TryOutcome::Held {
        return Ok(lifted);
    }
    drive(&mut robot, &mut executor, Phase::decide(Skill::Snapshot, 1), |_, _| {})?;
    executor.carry_aside()?;
    drive(&mut robot, &mut executor, Phase::run(Skill::Hold, 0), |_, _| {})?;
    let truth = robot.truth();
    Ok(if in_hand(&truth, 0) && in_hand(&truth, 1) { TryOutcome::Held } else { TryOutcome::Missed })
}

/// Runs a try at the second object, which `executor` is about to approach, up to the end of its lift.
fn roll_out_try(robot: &mut SimulatedRobot, executor: &mut Executor) -> Result<TryOutcome> {
    let mut watch = TryMonitor::new(executor, 1);
    for phase in [Phase::run(Skill::Grasp, 1), Phase::run(Skill::Lift, 1), Phase::run(Skill::Snapshot, 1)] {
        watch.drive(robot, executor, phase)?;
        if watch.collided {
            return Ok(TryOutcome::Contact);
        }
        if phase.skill == Skill::Lift && robot.truth().touched_by[1] == 0 {
            return Ok(TryOutcome::Missed);
        }
    }
    let truth = robot.truth();
    Ok(if in_hand(&truth, 0) && in_hand(&truth, 1) { TryOutcome::Held } else { TryOutcome::Missed })
}

/// Returns `grasp` as it turns out under the errors of `noise` when it takes object `index`, to first order in the
/// errors. The planner aims at the detected object. An error of detection or of the arm therefore shifts and turns the
/// object the other way relative to the hand.
pub fn misaimed(grasp: &Grasp, noise: &TrialNoise, index: usize) -> Grasp {
    let mut misaimed = grasp.clone();
    let seen = noise.objects[index];
    let shift = grasp.palm_rotation(0.0).inverse() * (seen.offset + noise.position);
    for axis in 0..3 {
        misaimed.center[axis] -= shift[axis];
    }
    // Small rotations about the world's axes, which coincide with roll, pitch and yaw while the hand points forward.
    misaimed.roll += noise.rotation.x;
    misaimed.pitch += noise.rotation.y;
    misaimed.yaw += noise.rotation.z + seen.yaw;
    misaimed
}

/// Noise that a planner expects. Grasps are verified and ranked under it, whatever the noise of a scenario's trials.
const EXPECTED_NOISE: NoiseLevels = NoiseLevels {
    execution: ExecutionNoise { position_sigma: 0.003, rotation_sigma: 0.01 },
    perception: PerceptionNoise { xy_sigma: 0.004, z_sigma: 0.0015, yaw_sigma: 0.05 },
};

/// Draws `count` samples of the noise that a planner expects. They are the same for every grasp, and robustness is
/// measured under them.
pub fn verification_errors(count: usize) -> Vec<TrialNoise> {
    let mut rng = trial_rng(VERIFICATION_SEED, 0, 0);
    (0..count).map(|_| TrialNoise::draw(&EXPECTED_NOISE, 2, &mut rng)).collect()
}

/// Factor on the expected noise in the rollouts of second grasps for the outcome model. It is wide enough to cover the
/// expected errors of the controllers of the benchmark's robot.
const WIDE_NOISE_FACTOR: f64 = 1.6;
/// Factor on the position noise once the object has been touched in place. The rotation noise keeps
/// [`WIDE_NOISE_FACTOR`].
const NARROW_NOISE_FACTOR: f64 = 0.5;

/// Draws `count` samples of noise wider than a planner expects (`WIDE_NOISE_FACTOR`), the same ones for every grasp.
pub fn wide_errors(count: usize) -> Vec<TrialNoise> {
    let levels = EXPECTED_NOISE.scaled(WIDE_NOISE_FACTOR);
    let mut rng = trial_rng(VERIFICATION_SEED, 1, 0);
    (0..count).map(|_| TrialNoise::draw(&levels, 2, &mut rng)).collect()
}

/// Draws `count` samples of the noise that remains once the object has been touched, the same ones for every grasp.
pub fn narrow_errors(count: usize) -> Vec<TrialNoise> {
    let levels = narrow_levels();
    let mut rng = trial_rng(VERIFICATION_SEED, 2, 0);
    (0..count).map(|_| TrialNoise::draw(&levels, 2, &mut rng)).collect()
}

/// Returns the noise of the pose of an object that has been touched. The rotation noise is as wide as before.
fn narrow_levels() -> NoiseLevels {
    let (wide, narrow) = (EXPECTED_NOISE.scaled(WIDE_NOISE_FACTOR), EXPECTED_NOISE.scaled(NARROW_NOISE_FACTOR));
    NoiseLevels {
        execution: ExecutionNoise { rotation_sigma: wide.execution.rotation_sigma, ..narrow.execution },
        perception: PerceptionNoise { yaw_sigma: wide.perception.yaw_sigma, ..narrow.perception },
    }
}

/// Bit of the palm in [`GroundTruth::touched_by`].
pub const PALM: u32 = 1 << MAX_HAND_JOINTS;

/// Returns the bits of the links of `digits` in [`GroundTruth::touched_by`].
pub fn digit_bits(hand: &Hand, digits: &[Digit]) -> u32 {
    digits.iter().flat_map(|digit| hand.links(*digit)).fold(0, |bits, link| bits | 1 << link)
}

fn hold_outcome(before: &GroundTruth, after: &GroundTruth, index: usize) -> HoldOutcome {
    let inside = |truth: &GroundTruth| truth.palm.inverse() * truth.objects[index];
    let (a, b) = (inside(before), inside(after));
    HoldOutcome {
        held: in_hand(after, index),
        palm_from_object: b,
        slip: (a.translation.vector - b.translation.vector).norm(),
        joints: after.hand.clone(),
        contacts: contacts_in_palm(after, index),
    }
}

/// Returns the contacts of object `index` with the hand, palm frame.
fn contacts_in_palm(truth: &GroundTruth, index: usize) -> Vec<HeldContact> {
    let own = truth.contacts.iter().filter(|contact| contact.object == index && contact.force.norm() > 0.0);
    let in_palm = own.map(|contact| HeldContact {
        link: contact.link,
        point: truth.palm.inverse_transform_point(&contact.point).coords.into(),
        normal: truth.palm.inverse_transform_vector(&contact.force.normalize()).into(),
        force: contact.force.norm(),
    });
    in_palm.collect()
}

#[cfg(test)]
mod tests;
