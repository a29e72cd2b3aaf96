//! Estimates the pose of a ball that lies in one pad of the open F-TAC Hand, from its contact patch and a wrong prior:
//! `cargo run --release -p tactile-perception --example pose_in_hand`.
//!
//! The patches are computed from the known pose; on a robot they come from [`tactile_perception::TouchPipeline`].

use std::error::Error;

use nalgebra::{Isometry3, Point3, Vector3};
use tactile_perception::contacts::{ContactOptions, contact_free_points, find_contacts};
use tactile_perception::hand_model::Hand;
use tactile_perception::hand_model::robot::ServoState;
use tactile_perception::{
    IMAGE_SIZE, KnownShape, PIXELS, PadTouch, PoseInputs, PoseOptions, PosePrior, Readings, estimate_pose,
};

/// A ball of this radius, m.
struct Ball(f64);

impl KnownShape for Ball {
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let distance = point.coords.norm();
        let outward = if distance > 0.0 { point.coords / distance } else { Vector3::z() };
        (distance - self.0, outward)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    // The open hand, and a ball that lies 0.6 mm deep in the pad of the middle finger.
    let (hand, ball) = (Hand::ftac(), Ball(0.030));
    let poses = hand.pad_poses(&hand.tree.forward(&hand.open_angles()));
    let middle = hand.find_pad("middle_proximal").ok_or("no such pad")?;
    let center = poses[middle] * Point3::new(0.0, 0.0, ball.0 - 0.6e-3);
    let truth = Isometry3::translation(center.x, center.y, center.z);

    // Every pad feels the depth of the ball in its gel, or nothing.
    let mut touches: Vec<PadTouch> = (0..hand.pads.len()).map(|pad| PadTouch { pad, ..PadTouch::default() }).collect();
    for (index, camera) in hand.cameras.iter().enumerate() {
        let (pad, pad_from_object) = (&hand.pads[camera.pad], poses[camera.pad].inverse() * truth);
        let at = pad_from_object.translation.vector;
        let depth = |pixel: usize| {
            let (x, y) = camera.pixel_center(pixel % IMAGE_SIZE, pixel / IMAGE_SIZE);
            let square = ball.0 * ball.0 - (x - at.x).powi(2) - (y - at.y).powi(2);
            if square > 0.0 { (pad.surface_height(x, y) - at.z + square.sqrt()).max(0.0) as f32 } else { 0.0 }
        };
        let height: Vec<f32> = (0..PIXELS).map(depth).collect();
        let options = ContactOptions::default();
        let touch = &mut touches[camera.pad];
        touch.patches.extend(find_contacts(pad, index, camera, hand.gel(), &height, &options));
        touch.contact_free.extend(contact_free_points(pad, camera, Some(&height), options.raised, 4, 6));
        touch.force = touch.patches.iter().map(|patch| patch.force).sum();
    }
    for touch in touches.iter().filter(|touch| touch.is_touched()) {
        println!("{}: {:.2} N", hand.pads[touch.pad].name, touch.force);
    }

    // The object was expected 8 mm away.
    let expected = Isometry3::translation(center.x + 0.006, center.y - 0.005, center.z + 0.002);
    let servos = vec![ServoState::default(); hand.cables.len() + 1];
    let estimate = estimate_pose(&PoseInputs {
        hand: &hand,
        touches: &touches,
        readings: Readings::without_gravity(&servos),
        prior: &PosePrior::weak(expected),
        shape: &ball,
        options: &PoseOptions::default(),
    })?;
    let error = |pose: &Isometry3<f64>| 1e3 * (pose.translation.vector - truth.translation.vector).norm();
    println!(
        "expected {:.1} mm from the true position, estimated {:.1} mm",
        error(&expected),
        error(&estimate.palm_from_object)
    );
    println!(
        "stated standard deviation {:.1} mm; {} patches, {} steps",
        1e3 * estimate.sigma().0,
        estimate.patches,
        estimate.steps
    );
    Ok(())
}
