//! The scene as far as a body without truth lets it be known: robot from its encoders, objects where the controller believes them to be.

use std::sync::Arc;

use anyhow::Result;
use control::executor::Executor;
use control::inverse_kinematics::ArmKinematics;
use control::perception::Felt;
use control::workcell::Workcell;
use hand_model::Hand;
use nalgebra::Isometry3;
use stream::SignalFrame;
use stream::recorder::Recorder;
use touch::posture::{Posture, free_posture};

/// Draws what was measured and believed.
pub struct Measured {
    hand: Arc<Hand>,
    kinematics: ArmKinematics,
    /// `palm_from_object` of objects that are taken to be in the hand.
    carried: [Option<Isometry3<f64>>; 2],
}

impl Measured {
    pub fn new(cell: &Workcell) -> Self {
        Self { hand: cell.robot.hand.clone(), kinematics: cell.kinematics(), carried: [None; 2] }
    }

    /// Records the scene and the signals of a moment. Digits are drawn as if they touched nothing: their encoders tell no more.
    pub fn log(
        &mut self,
        recorder: &mut Recorder,
        names: &[String; 2],
        executor: &Executor,
        felt: Option<&Felt>,
    ) -> Result<()> {
        let arm = executor.motion().arm().position;
        let palm = self.kinematics.palm_pose(&arm);
        let Posture { q, tensions, .. } = free_posture(&self.hand, executor.motion().servos());
        recorder.log_robot(&self.kinematics.link_poses(&arm), &palm, &self.hand.tree.forward(&q))?;
        for (name, pose) in names.iter().zip(self.believed(executor, &palm, felt)) {
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

    /// `world_from_object` of both: where it was seen, and from its lift on with the palm.
    fn believed(&mut self, executor: &Executor, palm: &Isometry3<f64>, felt: Option<&Felt>) -> [Isometry3<f64>; 2] {
        let seen = [executor.target(0).percept.pose(), executor.target(1).percept.pose()];
        std::array::from_fn(|n| {
            if !executor.phase().lifts(n) {
                self.carried[n] = None;
                return seen[n];
            }
            let carried = *self.carried[n].get_or_insert_with(|| palm.inverse() * seen[n]);
            palm * felt.filter(|_| n == 0).map_or(carried, |felt| felt.estimate.palm_from_object)
        })
    }
}
