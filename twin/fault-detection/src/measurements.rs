//! Input of fault detection in one tick: measurements, the sent command, and the controller's estimates.

use control::executor::{Executor, GraspTarget, Phase};
use control::perception::ObjectEstimate;
use hand_model::robot::{ArmState, RobotCommand, ServoState, TactileFrame};

/// One tick without ground truth: a real robot provides all of it.
#[derive(Clone, Copy)]
pub struct TickMeasurements<'a> {
    /// Time after the tick, s.
    pub time: f64,
    /// The servos as measured before the command was sent.
    pub servos: &'a [ServoState],
    /// The arm as measured before the command was sent.
    pub arm: &'a ArmState,
    /// Newest image of each camera, whenever it was taken.
    pub images: &'a [TactileFrame],
    /// Sent command, after limits.
    pub sent: &'a RobotCommand,
    /// Phase of the controller.
    pub phase: Phase,
    /// Progress of the present path, 0 to 1.
    pub progress: f64,
    /// Objects to grasp, in their order, with the intended grasps.
    pub targets: &'a [GraspTarget],
    /// Pose estimate of the first object from touch, if any.
    pub felt: Option<&'a ObjectEstimate>,
}

impl<'a> TickMeasurements<'a> {
    /// Collects the input of a tick of `executor` that ended at `time` (s) and in which `sent` was sent.
    pub fn from_executor(
        executor: &'a Executor,
        time: f64,
        sent: &'a RobotCommand,
        felt: Option<&'a ObjectEstimate>,
    ) -> Self {
        Self {
            time,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            images: executor.motion().newest_images(),
            sent,
            phase: executor.phase(),
            progress: executor.motion().progress(),
            targets: executor.targets(),
            felt,
        }
    }
}
