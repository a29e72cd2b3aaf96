//! The description of a robot by its driver, and its comparison with the robot model.

use hand_model::pads::IMAGE_SIZE;
use hand_model::{ActuatorVector, Hand, RobotModel};
use hardware_bridge::config::RATES;
use hardware_bridge::safety::set_points::TICK;
use serde::{Deserialize, Serialize};

use crate::wire_emulation::servo_travel;

/// Greatest travel of a servo, rad.
const MAX_TRAVEL: f64 = 100.0;

/// A robot as its driver describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriverDescription {
    /// Name of the class.
    pub name: String,
    /// Names of the arm's joints, from the base outwards.
    pub joints: Vec<String>,
    /// Names of the hand's actuators.
    pub servos: Vec<String>,
    /// Names of the cameras, with height and width of their images, pixels; empty for a robot without cameras.
    pub cameras: Vec<(String, [usize; 2])>,
    /// Rate at which the robot is measured and commanded, Hz.
    pub rate: f64,
    /// True if the measurements of the arm hold measured torques.
    pub senses_torque: bool,
    /// Travel of each servo, rad; none for that of the robot model.
    pub travel: Option<Vec<f64>>,
    /// True if time passes with the controller's ticks only.
    pub lockstep: bool,
    /// True if it lays out, detects and judges the objects itself.
    pub owns_scene: bool,
}

/// A difference between a description and the robot model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: found {found}, expected {expected}")]
pub struct DescriptionError {
    /// Field of the description.
    pub field: String,
    pub found: String,
    pub expected: String,
}

impl DriverDescription {
    /// Checks that this is a robot of this model.
    ///
    /// # Errors
    /// The first difference.
    pub fn check(&self, robot: &RobotModel) -> Result<(), DescriptionError> {
        let (arm, hand) = (&robot.arm, &robot.hand);
        let joints: Vec<&str> = arm.tree.joints.iter().take(arm.joints()).map(|joint| joint.name.as_str()).collect();
        check_names("joints", &self.joints, &joints, &arm.name)?;
        let servos: Vec<&str> = hand.parameters.actuator.iter().map(|actuator| actuator.name.as_str()).collect();
        check_names("servos", &self.servos, &servos, &hand.parameters.name)?;
        if !self.cameras.is_empty() {
            let found: Vec<&str> = self.cameras.iter().map(|(name, _)| name.as_str()).collect();
            let expected: Vec<&str> = hand.cameras.iter().map(|camera| camera.name.as_str()).collect();
            check_names("cameras", &found, &expected, &hand.parameters.name)?;
        }
        for (name, size) in &self.cameras {
            if *size != [IMAGE_SIZE; 2] {
                let expected = format!("{IMAGE_SIZE} x {IMAGE_SIZE} pixels");
                return Err(error(&format!("cameras[{name}]"), format!("{} x {} pixels", size[0], size[1]), expected));
            }
        }
        let control_rate = 1.0 / TICK;
        if self.lockstep && (self.rate - control_rate).abs() > 1e-6 {
            let expected = format!("{control_rate:.0}, the rate of the control ticks, of a robot in lock-step");
            return Err(error("rate", self.rate, expected));
        }
        if !(RATES.0..=RATES.1).contains(&self.rate) {
            return Err(error("rate", self.rate, format!("{} to {} Hz", RATES.0, RATES.1)));
        }
        let Some(travel) = &self.travel else { return Ok(()) };
        if travel.len() != servos.len() {
            let expected = format!("{}, one for each servo", servos.len());
            return Err(error("travel", format!("{} numbers", travel.len()), expected));
        }
        match travel.iter().position(|travel| !(*travel > 0.0 && *travel <= MAX_TRAVEL)) {
            Some(n) => {
                let expected = format!("an angle above 0, up to {MAX_TRAVEL} rad");
                Err(error(&format!("travel[{}]", servos[n]), travel[n], expected))
            }
            None => Ok(()),
        }
    }

    /// Returns the travel of each servo of `hand`, rad.
    pub fn travel(&self, hand: &Hand) -> ActuatorVector {
        match &self.travel {
            Some(travel) => travel.iter().copied().collect(),
            None => servo_travel(hand),
        }
    }
}

fn error(field: &str, found: impl ToString, expected: String) -> DescriptionError {
    DescriptionError { field: field.to_owned(), found: found.to_string(), expected }
}

/// Checks that `found` are the names `expected` of the part `of` of the robot, in this order.
fn check_names(field: &str, found: &[impl AsRef<str>], expected: &[&str], of: &str) -> Result<(), DescriptionError> {
    if found.len() != expected.len() {
        let names = if expected.is_empty() { "none".to_owned() } else { expected.join(", ") };
        return Err(error(field, found.len(), format!("{}, those of {of}: {names}", expected.len())));
    }
    match found.iter().zip(expected).position(|(found, expected)| found.as_ref() != *expected) {
        Some(n) => Err(error(
            &format!("{field}[{n}]"),
            format!("`{}`", found[n].as_ref()),
            format!("`{}`: those of {of} are, in this order: {}", expected[n], expected.join(", ")),
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Description of the built-in robot, without cameras.
    pub(crate) fn described(robot: &RobotModel) -> DriverDescription {
        let arm = &robot.arm;
        DriverDescription {
            name: "Mine".to_owned(),
            joints: arm.tree.joints.iter().take(arm.joints()).map(|joint| joint.name.clone()).collect(),
            servos: robot.hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect(),
            cameras: Vec::new(),
            rate: 120.0,
            senses_torque: true,
            travel: None,
            lockstep: true,
            owns_scene: false,
        }
    }

    #[test]
    fn another_robot_is_refused_by_name() {
        let robot = RobotModel::ftac_gen3();
        let refused = |change: &dyn Fn(&mut DriverDescription)| {
            let mut description = described(&robot);
            change(&mut description);
            description.check(&robot).expect_err("refused").to_string()
        };
        described(&robot).check(&robot).expect("the robot");
        let error = refused(&|own| drop(own.joints.pop()));
        assert!(error.starts_with("joints: found 6, expected 7, those of gen3: joint_1, joint_2, "), "{error}");
        let error = refused(&|own| own.servos.swap(0, 1));
        assert!(error.starts_with("servos[0]: found `index`, expected `thumb`: those of "), "{error}");
        let error = refused(&|own| own.cameras.push(("eye".to_owned(), [240, 240])));
        assert!(error.starts_with("cameras: found 1, expected 18, those of "), "{error}");
        let cameras = |size| robot.hand.cameras.iter().map(move |camera| (camera.name.clone(), size));
        let error = refused(&|own| own.cameras = cameras([480, 640]).collect());
        assert!(error.contains("]: found 480 x 640 pixels, expected 240 x 240 pixels"), "{error}");
        let error = refused(&|own| own.rate = 50.0);
        assert!(error.starts_with("rate: found 50, expected 120, the rate of the control ticks"), "{error}");
        let error = refused(&|own| (own.rate, own.lockstep) = (5.0, false));
        assert_eq!(error, "rate: found 5, expected 20 to 500 Hz");
        let error = refused(&|own| own.travel = Some(vec![4.0, 4.0]));
        assert_eq!(error, "travel: found 2 numbers, expected 6, one for each servo");
        let error = refused(&|own| own.travel = Some(vec![4.0, 4.0, f64::NAN, 4.0, 4.0, 4.0]));
        assert_eq!(error, "travel[middle]: found NaN, expected an angle above 0, up to 100 rad");
    }
}
