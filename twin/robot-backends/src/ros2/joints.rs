//! The newest state of each joint of a robot, from joint states that may name all of them or a part.

use std::collections::HashMap;

use hand_model::RobotModel;
use hand_model::robot::{ArmState, ServoState};
use hardware_bridge::safety::checks::{ArmReading, Measurements, ServoReading};
use robot_ros2::messages::JointState;

use super::config::Ros2Config;

/// Temperature that is reported for the servos, degrees Celsius: joint states have none.
const REPORTED_TEMPERATURE: f64 = 25.0;

/// A value that a joint state lacks.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("joint `{joint}`: {field}: found {found}, expected {expected}")]
pub struct JointError {
    /// Name of the joint.
    pub joint: String,
    /// List of the message: `position`, `velocity` or `effort`.
    pub field: &'static str,
    pub found: String,
    pub expected: &'static str,
}

/// State of a joint.
#[derive(Debug, Clone, Copy)]
struct JointValue {
    position: f64,
    velocity: f64,
    effort: f64,
    /// Time of the measurement, s on the bridge's clock.
    time: f64,
}

/// A joint of the robot.
#[derive(Debug, Clone)]
struct JointSlot {
    name: String,
    /// True if its effort is used.
    has_effort: bool,
    newest: Option<JointValue>,
}

/// The newest states of all joints: those of the arm, then those of the servos.
#[derive(Debug, Clone)]
pub struct JointTable {
    slots: Vec<JointSlot>,
    by_name: HashMap<String, usize>,
    arm_joints: usize,
    /// Torque constant of each servo, N m/A.
    torque_constants: Vec<f64>,
}

impl JointTable {
    /// Creates the table of the joints that a configuration names.
    pub fn new(config: &Ros2Config, model: &RobotModel) -> Self {
        let slot = |has_effort: bool| move |name: String| JointSlot { name, has_effort, newest: None };
        let (arm, servos) = (config.arm_joints(model), config.servo_joints(model));
        let arm_joints = arm.len();
        let slots: Vec<JointSlot> =
            arm.into_iter().map(slot(config.arm.senses_torque)).chain(servos.into_iter().map(slot(true))).collect();
        Self {
            by_name: slots.iter().enumerate().map(|(n, slot)| (slot.name.clone(), n)).collect(),
            slots,
            arm_joints,
            torque_constants: model.hand.servos.iter().map(|servo| servo.torque_constant).collect(),
        }
    }

    /// Enters the joints that a message names, measured at `time` (s on the bridge's clock). Other joints are left out.
    ///
    /// # Errors
    /// [`JointError`] with the joint whose position, velocity or effort is missing or not a number.
    pub fn update(&mut self, message: &JointState, time: f64) -> Result<(), JointError> {
        for (n, name) in message.name.iter().enumerate() {
            let Some(&slot) = self.by_name.get(name) else { continue };
            let slot = &mut self.slots[slot];
            let value = |field: &'static str, values: &[f64]| {
                let fault = |found: String| JointError {
                    joint: name.clone(),
                    field,
                    found,
                    expected: "a finite number for each joint",
                };
                let value = *values.get(n).ok_or_else(|| fault("none".to_owned()))?;
                if value.is_finite() { Ok(value) } else { Err(fault(value.to_string())) }
            };
            slot.newest = Some(JointValue {
                position: value("position", &message.position)?,
                velocity: value("velocity", &message.velocity)?,
                effort: if slot.has_effort { value("effort", &message.effort)? } else { 0.0 },
                time,
            });
        }
        Ok(())
    }

    /// Returns the name of the first joint that no message has named.
    pub fn first_unread(&self) -> Option<&str> {
        self.slots.iter().find(|slot| slot.newest.is_none()).map(|slot| slot.name.as_str())
    }

    /// Returns the currents of the servos, A; 0 for one that was not read.
    pub fn servo_currents(&self) -> impl Iterator<Item = f64> {
        let efforts = self.slots[self.arm_joints..].iter().map(|slot| slot.newest.map_or(0.0, |value| value.effort));
        efforts.zip(&self.torque_constants).map(|(effort, constant)| effort / constant)
    }

    /// Puts the newest states into `measured`. The arm is as old as the oldest of its joints.
    pub fn write(&self, measured: &mut Measurements) {
        let (arm, servos) = self.slots.split_at(self.arm_joints);
        for ((newest, slot), constant) in measured.servos.iter_mut().zip(servos).zip(&self.torque_constants) {
            *newest = slot.newest.map(|value| ServoReading {
                received_at: value.time,
                state: ServoState {
                    position: value.position,
                    velocity: value.velocity,
                    current: value.effort / constant,
                    temperature: REPORTED_TEMPERATURE,
                },
                voltage: None,
                alert: false,
            });
        }
        let Some(values) = arm.iter().map(|slot| slot.newest).collect::<Option<Vec<_>>>() else { return };
        let of = |value: fn(&JointValue) -> f64| values.iter().map(value).collect();
        let state = ArmState {
            position: of(|joint| joint.position),
            velocity: of(|joint| joint.velocity),
            torque: of(|joint| joint.effort),
        };
        let received_at = values.iter().map(|value| value.time).fold(f64::INFINITY, f64::min);
        measured.arm = Some(ArmReading { received_at, state, fault: None });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(names: &[&str], value: f64) -> JointState {
        let values = vec![value; names.len()];
        let name = names.iter().map(|name| (*name).to_owned()).collect();
        JointState { name, position: values.clone(), velocity: values.clone(), effort: values, ..JointState::default() }
    }

    fn table() -> JointTable {
        let model = RobotModel::ftac_gen3();
        JointTable::new(&toml::from_str("version = 1\n").expect("defaults"), &model)
    }

    /// Arm and hand may come in messages of their own, in any order, among joints of others.
    #[test]
    fn a_robot_comes_in_parts() {
        let mut table = table();
        table.update(&message(&["joint_7", "joint_6", "gripper", "joint_5", "joint_4"], 0.5), 1.0).expect("read");
        table.update(&message(&["joint_1", "joint_2", "joint_3"], 0.25), 2.0).expect("read");
        assert_eq!(table.first_unread(), Some("thumb"));
        let mut measured = Measurements::none(6);
        table.write(&mut measured);
        let arm = measured.arm.expect("the arm is complete");
        assert_eq!((arm.received_at, arm.state.position[0], arm.state.position[6]), (1.0, 0.25, 0.5));
        assert!(measured.servos.iter().all(Option::is_none));
        let hand = ["thumb", "index", "middle", "ring", "little", "opposition"];
        table.update(&message(&hand, 1.0), 3.0).expect("read");
        table.write(&mut measured);
        assert_eq!(table.first_unread(), None);
        let constant = RobotModel::ftac_gen3().hand.servos[0].torque_constant;
        assert_eq!(measured.servos[0].map(|servo| servo.state.current), Some(1.0 / constant));
    }

    #[test]
    fn a_missing_value_is_named() {
        let mut table = table();
        let state = JointState { velocity: Vec::new(), ..message(&["joint_1"], 0.0) };
        let error = table.update(&state, 0.0).expect_err("refused").to_string();
        assert_eq!(error, "joint `joint_1`: velocity: found none, expected a finite number for each joint");
        let error = table.update(&message(&["index"], f64::NAN), 0.0).expect_err("refused").to_string();
        assert_eq!(error, "joint `index`: position: found NaN, expected a finite number for each joint");
    }
}
