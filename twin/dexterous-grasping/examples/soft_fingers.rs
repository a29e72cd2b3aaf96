//! Compares grasps of a parallel gripper with hard fingertips and with soft ones, as those of a GelSight or DIGIT sensor.
//!
//! `cargo run -p dexterous-grasping --example soft_fingers`

use std::f64::consts::PI;

use dexterous_grasping::force_closure::{
    ForceClosureError, FrictionContact, dfc_residual, soft_wrench_margin, wrench_margin,
};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Limit of the sum of all normal forces, N.
const MAX_FORCE: f64 = 20.0;
/// Radius of the contact on a soft fingertip, m.
const CONTACT_RADIUS: f64 = 0.005;
/// Friction coefficient of gel on plastic.
const FRICTION: f64 = 0.9;

/// Two opposed contacts on a box, 50 mm apart, `offset` (m) above its centre of mass, turned against each other by
/// `tilt` (rad).
fn gripper(offset: f64, tilt: f64) -> [FrictionContact; 2] {
    [1.0, -1.0].map(|side| FrictionContact {
        point: Point3::new(0.025 * side, 0.0, offset),
        // The direction in which the finger pushes: into the object.
        normal: UnitVector3::new_normalize(Vector3::new(-side * tilt.cos(), 0.0, tilt.sin())),
        friction: FRICTION,
    })
}

/// Three contacts around a can of 33 mm radius.
fn three_fingers() -> [FrictionContact; 3] {
    [0.0, 2.0, 4.0].map(|third| {
        let (sin, cos) = (third * PI / 3.0).sin_cos();
        let outward = UnitVector3::new_normalize(Vector3::new(cos, sin, 0.0));
        FrictionContact { point: Point3::from(outward.scale(0.033)), normal: -outward, friction: FRICTION }
    })
}

fn main() -> Result<(), ForceClosureError> {
    // Hertz: a circular contact of radius a bears a torque of mu f 3 pi / 16 a about its normal.
    let torsion_arm = 3.0 * PI / 16.0 * CONTACT_RADIUS;
    // Torques count as forces at this arm, m.
    let length = 0.025;
    println!("{:32} {:>9} {:>9} {:>9}", "", "hard, N", "soft, N", "residual");
    let show = |name: &str, contacts: &[FrictionContact]| -> Result<(), ForceClosureError> {
        let hard = wrench_margin(contacts, &Point3::origin(), length, MAX_FORCE)?;
        let soft = soft_wrench_margin(contacts, torsion_arm, &Point3::origin(), length, MAX_FORCE)?;
        println!("{name:32} {hard:9.3} {soft:9.3} {:9.3}", dfc_residual(contacts));
        Ok(())
    };
    show("gripper at the centre of mass", &gripper(0.0, 0.0))?;
    show("gripper 20 mm above it", &gripper(0.02, 0.0))?;
    show("gripper, faces tilted by 0.3 rad", &gripper(0.0, 0.3))?;
    show("three fingers around a can", &three_fingers())
}
