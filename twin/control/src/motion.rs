//! Motion shared by all executors: the arm servo follows a palm path, the cables pull, and tactile images are
//! collected.
//!
//! An executor decides which path comes next and which tensions are desired; [`Motion`] carries that out tick by tick.
//! [`approach`] makes the paths to a grasp, [`tension`] the tensions over time.

pub mod approach;
pub mod tension;

use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, Command, Observation, ServoState, TactileFrame};
use hand_model::transmission::friction::CableFriction;
use hand_model::{ActuatorVector, DigitVector, Hand};
use nalgebra::{Isometry3, Translation3, Vector3};
use tactile_perception::Readings;

use self::approach::{approach, duration};
use self::tension::{approach_tension, servo_goals};
use crate::inverse_kinematics::{ArmServo, IkError, Joints};
use crate::look::Look;
use crate::percept::Percept;
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Time given to the digits to close, s.
pub const CLOSING_TIME: f64 = 1.1;
/// Rest before and after the images of a look are taken, s.
pub const LOOK_TIME: f64 = 0.3;
/// Time given to the digits to open when objects are put down, s.
pub const OPENING_TIME: f64 = 0.7;
/// Share of the speed limits at which objects are lifted and put down.
const LIFTING: f64 = 0.7;

/// Tolerance of the palm's distance from a path, m. If every path exceeds it, the first path that ends well is taken.
const OFF_PATH: f64 = 0.02;
/// Tolerance of the palm's error at the end of a path, m and rad.
const OFF_END: (f64, f64) = (0.002, 0.02);
/// Shares of the speed limits that are tried: joints in an unfavourable posture cannot follow at full speed.
const SPEEDS: [f64; 2] = [1.0, 0.5];
/// Time step of a path's rehearsal by the arm servo, and its settling time at the end, s. Both are coarser than the
/// real ones.
const REHEARSAL: (f64, f64) = (1.0 / 40.0, 0.1);

/// Distances, times and limits of an executor's motions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// Height by which objects are lifted, m.
    pub lift: f64,
    /// Distance by which they are carried sideways, m.
    pub carry: f64,
    /// Time for which they are held at the end, s.
    pub hold: f64,
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
pub struct Motion {
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
    worst_tracking: f64,
}

impl Motion {
    /// At rest in the posture of `servo` with slack cables. A tick lasts `tick` s.
    pub fn new(hand: Arc<Hand>, servo: ArmServo, tick: f64) -> Result<Self, MotionError> {
        let (home, still) = (servo.palm_pose(), *servo.qd());
        Ok(Self {
            sequences_before: vec![None; hand.cameras.len()],
            tension: hand.slack(),
            servos: hand.each_actuator(|_| ServoState::default()),
            hand,
            servo,
            home,
            path: PosePath::new(vec![(0.0, home)])?,
            clock: 0.0,
            images: Vec::new(),
            newest: Vec::new(),
            arm: ArmState::still(still),
            tick,
            worst_tracking: 0.0,
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

    /// The last look, completed or in progress.
    pub fn look(&self) -> Look<'_> {
        let readings = Readings::new(&self.servos, &self.palm().rotation);
        Look { images: &self.images, sequences_before: &self.sequences_before, readings }
    }

    /// Largest distance so far between the palm's set-point and the reached reference, m.
    pub fn worst_tracking(&self) -> f64 {
        self.worst_tracking
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
    pub fn rest(&self, time: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end()), (time, self.end())])
    }

    /// Path that rests for `time` s at the present palm pose, on the way.
    pub fn stop(&self, time: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.palm()), (time, self.palm())])
    }

    /// Path without motion: the executor waits for a decision.
    pub fn wait(&self) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end())])
    }

    /// Path on which the palm rises by `raise` m while the digits close.
    pub fn close(&self, raise: f64) -> Result<PosePath, PathError> {
        PosePath::new(vec![(0.0, self.end()), (CLOSING_TIME, self.above(raise))])
    }

    /// Straight path to `target` within `limits`.
    pub fn straight(&self, limits: &PathLimits, target: Isometry3<f64>) -> Result<PosePath, PathError> {
        let here = self.end();
        PosePath::new(vec![(0.0, here), (duration(limits, &here, &target), target)])
    }

    /// Slow path to the pose at the very beginning, from which the hand occludes nothing in front of it.
    pub fn home(&self, limits: &PathLimits) -> Result<PosePath, PathError> {
        self.straight(&limits.scaled(LIFTING), self.home)
    }

    /// Slow path up by `height` m.
    pub fn lift(&self, limits: &PathLimits, height: f64) -> Result<PosePath, PathError> {
        self.straight(&limits.scaled(LIFTING), self.above(height))
    }

    /// Path down by `height` m, with a pause in which the digits open, and up again. Also returns the path time at
    /// which they are to open, s.
    pub fn put_down(&self, limits: &PathLimits, height: f64) -> Result<(PosePath, f64), PathError> {
        let (here, down) = (self.end(), self.above(-height));
        let time = duration(&limits.scaled(LIFTING), &here, &down);
        let opened = time + OPENING_TIME;
        Ok((PosePath::new(vec![(0.0, here), (time, down), (opened, down), (opened + time, here)])?, time))
    }

    /// End of the present path, `height` m higher.
    fn above(&self, height: f64) -> Isometry3<f64> {
        let here = self.end();
        Isometry3::from_parts(Translation3::from(here.translation.vector + Vector3::z() * height), here.rotation)
    }

    /// Straight path from the end of the present path to the pose at which `grasp` closes on the object at `percept`.
    pub fn approach(&self, limits: &PathLimits, grasp: &Grasp, percept: &Percept) -> Result<PosePath, PathError> {
        approach((self.hand(), limits), &[self.end()], grasp, percept)
    }

    /// Path like [`Motion::approach`] by way of `stops`, rehearsed by the arm servo: straight or through the pose at
    /// the very beginning, at full speed or slower.
    ///
    /// A straight path from the end of a failed try can lead the joints to their limits with the palm decimetres off,
    /// although another posture would reach the target. `None` if no path ends there.
    pub fn rehearsed_approach(
        &self,
        limits: &PathLimits,
        grasp: &Grasp,
        percept: &Percept,
        stops: &[Isometry3<f64>],
    ) -> Option<PosePath> {
        let by_home = [stops, &[self.home]].concat();
        let paths =
            |limits: &PathLimits| [stops, &by_home].map(|stops| approach((self.hand(), limits), stops, grasp, percept));
        self.rehearsed(limits, paths)
    }

    /// Returns the first of the `paths`, at full speed and then at lower speeds, that the arm can follow. If the arm
    /// lags behind on all of them, returns the first path whose end it reaches.
    pub fn rehearsed<P: IntoIterator<Item = Result<PosePath, PathError>>>(
        &self,
        limits: &PathLimits,
        paths: impl Fn(&PathLimits) -> P,
    ) -> Option<PosePath> {
        let mut lagging = None;
        for path in SPEEDS.iter().flat_map(|speed| paths(&limits.scaled(*speed))).flatten() {
            match self.off_path(&path) {
                Some(off) if off < OFF_PATH => return Some(path),
                Some(_) => lagging = lagging.or(Some(path)),
                None => {}
            }
        }
        lagging
    }

    /// End of the present path, and the pose `rise` m above it if that differs.
    pub fn stops(&self, rise: f64) -> Vec<Isometry3<f64>> {
        let here = self.end();
        if rise > 0.0 { vec![here, self.above(rise)] } else { vec![here] }
    }

    /// Largest distance (m) of the palm from `path` on the way; `None` if the palm would not reach its end.
    fn off_path(&self, path: &PosePath) -> Option<f64> {
        let (tick, settle) = REHEARSAL;
        let done = self.servo.rehearse(path, settle, tick).ok()?;
        let there = done.position_error < OFF_END.0 && done.rotation_error < OFF_END.1;
        there.then_some(done.worst_position_error)
    }

    /// Begins a look. Earlier images do not count.
    pub fn begin_look(&mut self) {
        self.images.clear();
        for frame in &self.newest {
            if let Some(before) = self.sequences_before.get_mut(frame.camera) {
                *before = Some(frame.sequence);
            }
        }
    }

    /// True if the images of a look have arrived, or will not arrive any more.
    pub fn has_looked(&self) -> bool {
        self.images.len() >= self.hand.cameras.len() || self.clock > 2.0 * LOOK_TIME
    }

    /// True if the images of a look are to be requested in this tick: at the end of the path, when everything rests.
    pub fn captures_look(&self) -> bool {
        (self.clock - self.path.duration() + self.tick).abs() < 0.6 * self.tick
    }

    /// Takes the measurements. Of the images that arrived, those in `looked` belong to a look.
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
        self.worst_tracking = self.worst_tracking.max(step.position_error);
        Ok(step.q)
    }

    /// Command of a tick: the tensions move towards `wanted` (N), the opposition joint goes to `opposition` (rad).
    pub fn command(&mut self, arm: Joints, wanted: &[f64], opposition: f64, capture: bool) -> Command {
        approach_tension(&mut self.tension, wanted, self.tick);
        Command { arm, servos: servo_goals(&self.hand, &self.tension, opposition), capture }
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
