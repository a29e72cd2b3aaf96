//! The joints of the emulated Gen3 when the hand's plant has the arm: the goals of the arm's controller and the
//! measurements of the plant's arm, shared between the two.

use std::sync::{Arc, Mutex};

use crate::kortex_link::to_gen3;
use hand_model::robot::ArmState;
use hand_model::{Arm, ArmVector};
use kinova_kortex::emulator::{Drive, Plant};
use kinova_kortex::{JointMotion, ToolPose};

use crate::lock::lock;
use crate::safety::limits::ArmLimits;

#[derive(Debug)]
struct Joints {
    state: ArmState,
    /// Time since the state was measured, s.
    age: f64,
    goal: ArmVector,
    /// Remaining speeds while braking, rad/s.
    braking: Option<ArmVector>,
    limits: ArmLimits,
    model: Arc<Arm>,
}

/// The arm as shared between its controller and the plant.
#[derive(Debug, Clone)]
pub struct SharedArm(Arc<Mutex<Joints>>);

impl SharedArm {
    /// Creates an arm of this model in this state, which holds its position.
    pub fn at(state: ArmState, model: Arc<Arm>) -> Self {
        let limits = ArmLimits::from_model(&model);
        Self(Arc::new(Mutex::new(Joints { state, age: 0.0, goal: state.position, braking: None, limits, model })))
    }

    /// Returns the controller's goal for the joints, rad.
    pub fn goal(&self) -> ArmVector {
        lock(&self.0).goal
    }

    /// Returns the state of the plant's arm.
    pub fn state(&self) -> ArmState {
        lock(&self.0).state
    }

    /// Sets the state of the plant's arm.
    pub fn set_state(&self, state: ArmState) {
        let mut joints = lock(&self.0);
        (joints.state, joints.age) = (state, 0.0);
    }
}

impl Plant for SharedArm {
    fn advance(&mut self, drive: &Drive, seconds: f64) {
        let joints = &mut *lock(&self.0);
        if *drive != Drive::Hold {
            joints.braking = None;
        }
        match drive {
            Drive::Position(target) => joints.goal = (*target).into(),
            Drive::Velocity(speed) => {
                for (goal, speed) in joints.goal.iter_mut().zip(speed) {
                    *goal += speed * seconds;
                }
            }
            // Brake from the measured position and speed and stay there: no earlier command may pull the joints back.
            Drive::Hold => {
                let ArmState { position, velocity, .. } = joints.state;
                let (from, speed) = match joints.braking {
                    Some(speed) => (joints.goal, speed),
                    None => {
                        (position.iter().zip(velocity).map(|(at, speed)| at + speed * joints.age).collect(), velocity)
                    }
                };
                let (goal, slower) = joints.limits.brake(&from, &speed, seconds);
                (joints.goal, joints.braking) = (goal, Some(slower));
            }
        }
        joints.age += seconds;
    }

    fn state(&self) -> JointMotion {
        let ArmState { position, velocity, torque } = lock(&self.0).state;
        JointMotion { position: to_gen3(&position), velocity: to_gen3(&velocity), torque: to_gen3(&torque) }
    }

    /// Returns the tool's pose. The tool frame is the interface of the bracelet, as on an arm whose web page has no
    /// other tool.
    fn tool_pose(&self) -> Option<ToolPose> {
        let joints = lock(&self.0);
        let pose = joints.model.tool_pose(&joints.state.position);
        let (x, y, z) = pose.rotation.euler_angles();
        Some(ToolPose { position: pose.translation.vector.into(), angles: [x, y, z] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moving(speed: f64) -> ArmState {
        ArmState { position: [0.3; 7].into(), velocity: [speed; 7].into(), ..ArmState::default() }
    }

    fn gen3_at(state: ArmState) -> SharedArm {
        SharedArm::at(state, Arc::new(Arm::gen3()))
    }

    /// An arm at rest stays there to the last bit; commands are passed on unchanged.
    #[test]
    fn rest_and_commands() {
        let mut arm = gen3_at(moving(0.0));
        arm.advance(&Drive::Hold, 1e-3);
        assert_eq!(arm.goal()[..], [0.3; 7]);
        arm.advance(&Drive::Position([0.31; 7]), 1e-3);
        assert_eq!(arm.goal()[..], [0.31; 7]);
    }

    /// At home the tool points forward, 0.43 m over the base: published as 90, 0 and 90 degrees.
    #[test]
    fn tool_at_home() {
        let arm = gen3_at(ArmState { position: Arm::gen3().home, ..ArmState::default() });
        let ToolPose { position, angles } = arm.tool_pose().expect("known");
        assert_eq!(angles.map(|angle| angle.to_degrees().round().abs()), [90.0, 0.0, 90.0]);
        assert!((position[2] - 0.43).abs() < 0.01 && position[1].abs() < 0.03, "{position:?}");
        assert!(angles[0] > 0.0 && angles[2] > 0.0 && position[0] > 0.3, "{position:?} {angles:?}");
    }

    /// A stopped arm runs out by v^2 / 2a from its measured position, not from its last set-point.
    #[test]
    fn stops_from_where_it_is() {
        let mut arm = gen3_at(moving(0.0));
        arm.advance(&Drive::Position([0.35; 7]), 1e-3);
        arm.set_state(moving(0.86));
        for _ in 0..200 {
            arm.advance(&Drive::Hold, 1e-3);
        }
        let way = arm.goal()[4] - 0.3;
        assert!((way - 0.86 * 0.86 / (2.0 * 8.6)).abs() < 1e-3, "{way}");
    }
}
