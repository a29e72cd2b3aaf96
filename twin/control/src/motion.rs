//! Motion shared by all executors: the arm servo follows a palm path, the cables pull, and tactile images are
//! collected.
//!
//! An executor decides which path comes next and which tensions are desired; [`MotionExecutor`] carries that out tick
//! by tick. [`mod@approach`] makes the paths to a grasp, [`tension`] the tensions over time.

pub mod approach;
pub mod tension;

use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, Observation, RobotCommand, ServoState, TactileFrame};
use hand_model::transmission::friction::CableFriction;
use hand_model::{ActuatorVector, DigitVector, Hand};
use nalgebra::{Isometry3, Translation3, Vector3};
use tactile_perception::Readings;

use self::approach::{approach, duration};
use self::tension::{ramp_tension, servo_goals};
use crate::detection::DetectedObject;
use crate::inverse_kinematics::{ArmServo, IkError, Joints};
use crate::tactile_snapshot::TactileSnapshot;
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Time given to the digits to close, s.
pub const CLOSING_TIME: f64 = 1.1;
/// Rest before and after the images of a tactile snapshot are taken, s.
pub const SNAPSHOT_REST_TIME: f64 = 0.3;
/// Time given to the digits to open when objects are put down, s.
pub const OPENING_TIME: f64 = 0.7;
/// Share of the speed limits at which objects are lifted and put down.
const LIFT_SPEED_SHARE: f64 = 0.7;

/// Tolerance of the palm's distance from a path, m. If every path exceeds it, the first path that ends well is taken.
const PATH_TOLERANCE: f64 = 0.02;
/// Tolerance of the palm's error at the end of a path, m and rad.
const END_TOLERANCE: (f64, f64) = (0.002, 0.02);
/// Shares of the speed limits that are tried: joints in an unfavourable posture cannot follow at full speed.
const SPEED_SHARES: [f64; 2] = [1.0, 0.5];
/// Time step of a path's rollout by the arm servo, and its settling time at the end, s. Both are coarser than the real
/// ones.
const ROLLOUT_TIMING: (f64, f64) = (1.0 / 40.0, 0.1);

/// Distances, times and limits of an executor's motions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionProtocol {
    /// Height by which objects are lifted, m.
    pub lift: f64,
    /// Distance by which they are carried sideways, m.
    pub carry_distance: f64,
    /// Time for which they are held at the end, s.
    pub hold_time: f64,
    /// Cartesian limits of free motion.
    pub limits: PathLimits,
    /// Known friction in the cable guides, for which the servos compensate by pulling harder.
    pub friction: CableFriction,
}

/// Error that stops a motion.
#[derive(Debug, thiserror::Error)]
pub enum MotionError {
    /// A path could not be made.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The arm servo failed.
    #[error(transparent)]
    Ik(#[from] IkError),
}

/// Arm, cables and cameras in motion along one palm path after another.
#[derive(Clone)]
pub struct MotionExecutor {
    hand: Arc<Hand>,
    servo: ArmServo,
    /// Palm pose at the very beginning.
    home: Isometry3<f64>,
    path: PosePath,
    /// Time on the present path, s.
    clock: f64,
    /// Present tension set-points, N.
    tension: DigitVector,
    images: Vec<TactileFrame>,
    newest: Vec<TactileFrame>,
    sequences_before: Vec<Option<u64>>,
    servos: ActuatorVector<ServoState>,
    arm: ArmState,
    tick: f64,
    max_tracking_error: f64,
}

impl MotionExecutor {
    /// At rest in the posture of `servo` with slack cables. A tick lasts `tick` s.
    pub fn new(hand: Arc<Hand>, servo: ArmServo, tick: f64) -> Result<Self, MotionError> {
        let (home, still) = (servo.palm_pose(), *servo.qd());
        Ok(Self {
            sequences_before: vec![None; hand.cameras.len()],
            tension: hand.slack_tensions(),
            servos: hand.each_actuator(|_| ServoState::default()),
            hand,
            servo,
            home,
            path: PosePath::new(vec![(0.0, home)])?,
            clock: 0.0,
            images: Vec::new(),
            newest: Vec::new(),
            arm: ArmState::at_rest(still),
            tick,
            max_tracking_error: 0.0,
        })
    }

    /// Returns the hand that is moved.
    pub fn hand(&self) -> &Arc<Hand> {
        &self.hand
    }

    /// Length of a tick, s.
    pub fn tick_length(&self) -> f64 {
        self.tick
    }

    /// Time on the present path, s.
    pub fn clock(&self) -> f64 {
        self.clock
    }

    /// Present set-point of `world_from_palm`.
    pub fn palm(&self) -> Isometry3<f64> {
        self.path.sample(self.clock).0
    }

    /// Reference posture of the arm, rad.
    pub fn posture(&self) -> &Joints {
        self.servo.q()
    }

    /// Newest servo readings.
    pub fn servos(&self) -> &[ServoState] {
        &self.servos
    }

    /// Newest readings of the arm.
    pub fn arm(&self) -> &ArmState {
        &self.arm
    }

    /// Newest image of each camera, whenever it was taken.
    pub fn newest_images(&self) -> &[TactileFrame] {
        &self.newest
    }

    /// The last tactile snapshot, completed or in progress.
    pub fn snapshot(&self) -> TactileSnapshot<'_> {
        let readings = Readings::new(&self.servos, &self.palm().rotation);
        TactileSnapshot { images: &self.images, sequences_before: &self.sequences_before, readings }
    }

    /// Largest distance so far between the palm's set-point and the reached reference, m.
    pub fn max_tracking_error(&self) -> f64 {
        self.max_tracking_error
    }

    /// Fraction of the present path that is over, 0 to 1.
    pub fn progress(&self) -> f64 {
        let whole = self.path.duration();
        if whole > 0.0 { (self.clock / whole).min(1.0) } else { 1.0 }
    }

    /// True if the present path is over.
    pub fn is_over(&self) -> bool {
        self.clock + 1e-9 >= self.path.duration()
    }

    /// Palm pose at the end of the present path.
    pub fn end(&self) -> Isometry3<f64> {
        self.path.end()
    }

    /// Begins a new path.
    pub fn begin(&mut self, path: PosePath) {
        self.path = path;
        self.clock = 0.0;
    }

    /// Replaces the path that has just begun.
    pub fn redirect(&mut self, path: PosePath) {
        self.path = path;
    }

    /// Path that rests for `time` s at the end of the present path.
    pub fn rest_path(&self, time: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end()), (time, self.end())])
    }

    /// Path that rests for `time` s at the present palm pose, also before the end of the present path.
    pub fn stop_path(&self, time: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.palm()), (time, self.palm())])
    }

    /// Path without motion: the executor waits for a decision.
    pub fn wait_path(&self) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end())])
    }

    /// Path on which the palm rises by `raise` m while the digits close.
    pub fn closing_path(&self, raise: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end()), (CLOSING_TIME, self.end_raised(raise))])
    }

    /// Straight path to `target` within `limits`.
    pub fn straight_path(&self, limits: &PathLimits, target: Isometry3<f64>) -> Result<PosePath, PathError> {
        let here = self.end();
        PosePath::new(vec![(0.0, here), (duration(limits, &here, &target), target)])
    }

    /// Slow path to the pose at the very beginning, from which the hand occludes nothing in front of it.
    pub fn home_path(&self, limits: &PathLimits) -> Result<PosePath, PathError> {
        self.straight_path(&limits.scaled(LIFT_SPEED_SHARE), self.home)
    }

    /// Slow path up by `height` m.
    pub fn lift_path(&self, limits: &PathLimits, height: f64) -> Result<PosePath, PathError> {
        self.straight_path(&limits.scaled(LIFT_SPEED_SHARE), self.end_raised(height))
    }

    /// Path down by `height` m, with a pause in which the digits open, and up again. Also returns the path time at
    /// which they are to open, s.
    pub fn put_down_path(&self, limits: &PathLimits, height: f64) -> Result<(PosePath, f64), PathError> {
        let (here, down) = (self.end(), self.end_raised(-height));
        let time = duration(&limits.scaled(LIFT_SPEED_SHARE), &here, &down);
        let opened = time + OPENING_TIME;
        Ok((PosePath::new(vec![(0.0, here), (time, down), (opened, down), (opened + time, here)])?, time))
    }

    /// End of the present path, `height` m higher.
    fn end_raised(&self, height: f64) -> Isometry3<f64> {
        let here = self.end();
        Isometry3::from_parts(Translation3::from(here.translation.vector + Vector3::z() * height), here.rotation)
    }

    /// Straight path from the end of the present path to the pose at which `grasp` closes on the object at `detected`.
    pub fn approach_path(
        &self,
        limits: &PathLimits,
        grasp: &Grasp,
        detected: &DetectedObject,
    ) -> Result<PosePath, PathError> {
        approach((self.hand(), limits), &[self.end()], grasp, detected)
    }

    /// Path like [`MotionExecutor::approach_path`] by way of `stops`, checked with a rollout of the arm servo: straight
    /// or through the pose at the very beginning, at full speed or slower.
    ///
    /// A straight path from the end of a failed try can lead the joints to their limits with the palm decimetres off,
    /// although another posture would reach the target. `None` if no path ends there.
    pub fn feasible_approach(
        &self,
        limits: &PathLimits,
        grasp: &Grasp,
        detected: &DetectedObject,
        stops: &[Isometry3<f64>],
    ) -> Option<PosePath> {
        let by_home = [stops, &[self.home]].concat();
        let paths = |limits: &PathLimits| {
            [stops, &by_home].map(|stops| approach((self.hand(), limits), stops, grasp, detected))
        };
        self.first_feasible(limits, paths)
    }

    /// Returns the first of the `paths`, at full speed and then at lower speeds, that the arm can follow. If the arm
    /// lags behind on all of them, returns the first path whose end it reaches.
    pub fn first_feasible<P: IntoIterator<Item = Result<PosePath, PathError>>>(
        &self,
        limits: &PathLimits,
        paths: impl Fn(&PathLimits) -> P,
    ) -> Option<PosePath> {
        let mut lagging = None;
        for path in SPEED_SHARES.iter().flat_map(|speed| paths(&limits.scaled(*speed))).flatten() {
            match self.max_path_deviation(&path) {
                Some(off) if off < PATH_TOLERANCE => return Some(path),
                Some(_) => lagging = lagging.or(Some(path)),
                None => {}
            }
        }
        lagging
    }

    /// End of the present path, and the pose `rise` m above it if that differs.
    pub fn start_stops(&self, rise: f64) -> Vec<Isometry3<f64>> {
        let here = self.end();
        if rise > 0.0 { vec![here, self.end_raised(rise)] } else { vec![here] }
    }

    /// Largest distance (m) of the palm from `path` on the way; `None` if the palm would not reach its end.
    fn max_path_deviation(&self, path: &PosePath) -> Option<f64> {
        let (tick, settle) = ROLLOUT_TIMING;
        let done = self.servo.roll_out(path, settle, tick).ok()?;
        let there = done.position_error < END_TOLERANCE.0 && done.rotation_error < END_TOLERANCE.1;
        there.then_some(done.worst_position_error)
    }

    /// Begins a tactile snapshot. Earlier images do not count.
    pub fn begin_snapshot(&mut self) {
        self.images.clear();
        for frame in &self.newest {
            if let Some(before) = self.sequences_before.get_mut(frame.camera) {
                *before = Some(frame.sequence);
            }
        }
    }

    /// True if the images of a snapshot have arrived, or will not arrive any more.
    pub fn snapshot_is_complete(&self) -> bool {
        self.images.len() >= self.hand.cameras.len() || self.clock > 2.0 * SNAPSHOT_REST_TIME
    }

    /// True if the images of a snapshot are to be requested in this tick: at the end of the path, when everything
    /// rests.
    pub fn captures_snapshot(&self) -> bool {
        (self.clock - self.path.duration() + self.tick).abs() < 0.6 * self.tick
    }

    /// Takes the measurements. Of the images that arrived, those in `looked` belong to a snapshot.
    pub fn measure(&mut self, observation: &Observation, looked: &[TactileFrame]) {
        self.servos = observation.servos;
        self.arm = observation.arm;
        keep_newest(&mut self.newest, &observation.tactile);
        if self.clock > self.path.duration() - 1.5 * self.tick {
            keep_newest(&mut self.images, looked);
        }
    }

    /// Advances one tick along the path and returns the set-points of the arm, rad.
    pub fn follow(&mut self) -> Result<Joints, MotionError> {
        self.clock += self.tick;
        let (palm, twist) = self.path.sample(self.clock);
        let step = self.servo.step(&palm, &twist, self.tick)?;
        self.max_tracking_error = self.max_tracking_error.max(step.position_error);
        Ok(step.q)
    }

    /// Command of a tick: the tensions move towards `wanted` (N), the opposition joint goes to `opposition` (rad).
    pub fn command(&mut self, arm: Joints, wanted: &[f64], opposition: f64, capture: bool) -> RobotCommand {
        ramp_tension(&mut self.tension, wanted, self.tick);
        RobotCommand { arm, servos: servo_goals(&self.hand, &self.tension, opposition), capture }
    }
}

/// Replaces the frame of each camera by its newer one. The images of a real board arrive one after the other.
fn keep_newest(kept: &mut Vec<TactileFrame>, arrived: &[TactileFrame]) {
    for frame in arrived {
        match kept.iter_mut().find(|known| known.camera == frame.camera) {
            Some(known) => *known = frame.clone(),
            None => kept.push(frame.clone()),
        }
    }
}
