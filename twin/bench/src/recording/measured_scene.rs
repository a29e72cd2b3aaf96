//! The known scene of a backend without ground truth: the robot from its encoders, objects at their estimated poses.

use std::sync::Arc;

use anyhow::Result;
use control::executor::Executor;
use control::inverse_kinematics::ArmKinematics;
use control::perception::ObjectEstimate;
use control::workcell::Workcell;
use hand_model::Hand;
use nalgebra::Isometry3;
use tactile_perception::posture::{Posture, free_posture};
use telemetry::SignalFrame;
use telemetry::recorder::Recorder;

/// Draws measurements and estimates.
pub struct MeasuredScene {
    hand: Arc<Hand>,
    kinematics: ArmKinematics,
    /// `palm_from_object` of the objects that are assumed to be in the hand.
    carried: Vec<Option<Isometry3<f64>>>,
}

impl MeasuredScene {
    pub fn new(cell: &Workcell) -> Self {
        Self { hand: cell.robot.hand.clone(), kinematics: cell.kinematics(), carried: Vec::new() }
    }

    /// Logs the scene and the signals of a moment. Digits are drawn as if they touched nothing, as their encoders
    /// report no more.
    pub fn log(
        &mut self,
        recorder: &mut Recorder,
        names: &[String],
        executor: &Executor,
        felt: &[&ObjectEstimate],
    ) -> Result<()> {
        let arm = executor.motion().arm().position;
        let palm = self.kinematics.palm_pose(&arm);
        let Posture { q, tensions, .. } = free_posture(&self.hand, executor.motion().servos());
        recorder.log_robot(&self.kinematics.link_poses(&arm), &palm, &self.hand.tree.forward(&q))?;
        for (name, pose) in names.iter().zip(self.estimated_poses(executor, &palm, felt)) {
            recorder.log_estimate(name, Some(&pose))?;
        }
        recorder.log_scalars(&SignalFrame {
            tensions: Some(tensions),
            currents: Some(executor.motion().servos().iter().map(|servo| servo.current).collect()),
            joint_angles: Some(q),
            arm_angles: Some(arm),
            ..SignalFrame::default()
        })?;
        Ok(())
    }

    /// Returns `world_from_object` of each object: as detected, and from its lift on moving with the palm.
    fn estimated_poses(
        &mut self,
        executor: &Executor,
        palm: &Isometry3<f64>,
        felt: &[&ObjectEstimate],
    ) -> Vec<Isometry3<f64>> {
        let seen = executor.targets().iter().map(|target| target.detected.pose()).enumerate();
        self.carried.resize(executor.targets().len(), None);
        seen.map(|(n, seen)| {
            if !executor.phase().has_begun_lift(n) {
                self.carried[n] = None;
                return seen;
            }
            let carried = *self.carried[n].get_or_insert_with(|| palm.inverse() * seen);
            let felt = felt.iter().find(|felt| felt.object == n);
            palm * felt.map_or(carried, |felt| felt.estimate.palm_from_object)
        })
        .collect()
    }
}
