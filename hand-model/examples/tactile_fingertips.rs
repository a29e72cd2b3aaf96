//! An Allegro Hand with four camera fingertips closes on a round bar across its palm; prints the contact forces and the
//! pads' poses.
//!
//! `cargo run -p hand-model --example tactile_fingertips` takes the hand from this package, and with `-- HAND.toml`
//! reads a parameter file of your own, for example that of a hand with DIGIT or GelSight fingertips.

use std::error::Error;
use std::path::Path;

use hand_model::Hand;
use hand_model::nalgebra::{Point3, Vector3};
use hand_model::statics::{GuideFriction, contact_equilibrium};

const ALLEGRO: &str = include_str!("../data/robots/allegro.toml");

/// Bar along x of the palm frame: a point of its axis and its radius, m.
const AXIS: [f64; 3] = [0.0, 0.01, -0.03];
const RADIUS: f64 = 0.025;
/// Tension of each finger, N. The thumb stays open.
const TENSION: f64 = 12.0;

fn main() -> Result<(), Box<dyn Error>> {
    let hand = match std::env::args().nth(1) {
        Some(path) => Hand::parse(&std::fs::read_to_string(&path)?, Path::new(&path))?,
        None => Hand::parse(ALLEGRO, Path::new("allegro.toml"))?,
    };
    println!("{}: {} digits, {} joints", hand.parameters.name, hand.digits().len(), hand.tree.len());

    // Signed distance from the bar's surface, and the outward direction.
    let axis = Point3::from(AXIS);
    let bar = |point: &Point3<f64>| {
        let offset = (point - axis).component_mul(&Vector3::new(0.0, 1.0, 1.0));
        let distance = offset.norm();
        (distance - RADIUS, offset / distance.max(f64::MIN_POSITIVE))
    };
    let mut tensions = hand.each_digit(|_| TENSION);
    tensions[0] = 0.0;
    let rest = contact_equilibrium(&hand, &tensions, 0.0, &GuideFriction::NONE, hand.gel().stiffness, bar)?;

    println!("joint angles, degrees:");
    for &digit in hand.digits() {
        let angles: Vec<String> =
            hand.links(digit).iter().map(|joint| format!("{:6.1}", rest.angles[*joint].to_degrees())).collect();
        println!("  {:7} {}", digit.name(), angles.join(" "));
    }
    println!("contacts:");
    for contact in &rest.contact_forces {
        let link = &hand.tree.joints[contact.link].name;
        println!("  {link}: {:.2} N at {:.3?} m", contact.force.norm(), contact.point.coords.as_slice());
    }
    println!("pads, in the palm frame:");
    let palm_from_pad = hand.pad_poses(&hand.tree.forward(&rest.angles));
    for (pad, pose) in hand.pads.iter().zip(&palm_from_pad) {
        let (center, normal) = (pose.translation.vector, pose * Vector3::z());
        let distance = 1e3 * bar(&Point3::from(center)).0;
        println!("  {}: centre {:.3?} m, normal {:.2?}", pad.name, center.as_slice(), normal.as_slice());
        println!("    {distance:.1} mm from the bar");
        for camera in pad.cameras.iter().map(|camera| &hand.cameras[*camera]) {
            let (x, y) = camera.pixel_size();
            println!("    camera {}: a pixel is {:.3} x {:.3} mm", camera.name, 1e3 * x, 1e3 * y);
        }
    }
    Ok(())
}
