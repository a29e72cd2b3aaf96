//! The robots that the bridge and its emulated devices can drive.

use ftac_platform::data::DataError;
use hand_model::{Arm, RobotModel};

use kinova_kortex::joints::JOINTS;

/// Number of servos on the bus: those of the F-TAC Hand, in the order of its actuators.
pub const SERVOS: usize = 6;
/// Tolerance of angles and speeds that are compared with those of a Gen3, rad and rad/s.
const TOLERANCE: f64 = 1e-6;
/// Name of the arm model that the bridge and its emulators drive.
pub(crate) const SUPPORTED_ARM: &str = "gen3";

/// Rejects robots with an arm other than a Gen3, or with a hand whose actuators are not those of the F-TAC Hand.
///
/// # Errors
/// A [`DataError`] that names the robot's file.
pub fn check_supported(robot: &RobotModel) -> Result<(), DataError> {
    let refused = |field: &str, found: String, expected: &str| {
        let expected = format!(
            "{expected}: the hardware bridge and its emulated devices drive no other; `--robot sim` runs this one, and so does a driver of your own (`--robot FILE.py:CLASS`)"
        );
        Err(DataError::field(robot.file(), field, found, expected))
    };
    if robot.arm.name != SUPPORTED_ARM || robot.arm.joints() != JOINTS {
        return refused("arm", format!("`{}`", robot.arm.name), "`gen3`");
    }
    // The limits of the bridge are the model's: no file may widen those of the arm that is there.
    let gen3 = Arm::gen3();
    for (joint, (own, known)) in robot.arm.tree.joints.iter().zip(&gen3.tree.joints).enumerate() {
        let (speed, most) = (robot.arm.velocity_limits[joint], gen3.velocity_limits[joint]);
        if own.lower < known.lower - TOLERANCE || own.upper > known.upper + TOLERANCE || speed > most + TOLERANCE {
            let found = format!("joint {}: {} to {} rad, {speed} rad/s", joint + 1, own.lower, own.upper);
            let expected = format!("within {} to {} rad and {most} rad/s of a Gen3", known.lower, known.upper);
            return refused("arm", found, &expected);
        }
    }
    let (servos, opposition) = (robot.hand.servos.len(), robot.hand.transmission.opposition);
    if servos != SERVOS || opposition.is_none() {
        return refused(
            "hand",
            format!("{servos} actuators"),
            &format!("{SERVOS}, the last of which opposes the thumb"),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// The bridge takes an arm's limits from its model, so that a model may narrow those of a Gen3, but not widen them.
    #[test]
    fn no_file_widens_the_limits_of_the_arm_that_is_there() {
        let with = |change: fn(&mut Arm)| {
            let mut robot = RobotModel::ftac_gen3();
            change(Arc::make_mut(&mut robot.arm));
            check_supported(&robot).map_err(|error| error.to_string())
        };
        with(|_| ()).expect("a Gen3");
        with(|arm| arm.velocity_limits[2] = 0.5).expect("a slower one");
        for change in [(|arm| arm.velocity_limits[2] = 50.0) as fn(&mut Arm), |arm| arm.tree.joints[1].upper = 6.0] {
            let error = with(change).expect_err("refused");
            assert!(error.contains("arm: found joint") && error.contains("rad/s of a Gen3"), "{error}");
        }
    }
}
