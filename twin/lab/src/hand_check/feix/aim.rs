//! Proposals for the search: against the palm here, between opposed digits in [`opposed`].

use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::attempt::{Attempt, STRONGEST, opposition, tension, turn, within};
use super::curl::Curls;
use super::opposed;
use super::types::{GraspType, Opposition};

pub fn propose(hand: &Hand, curls: &Curls, kind: &GraspType, rng: &mut ChaCha8Rng) -> Attempt {
    match kind.opposition {
        // If all digits take part, the object may also lie along the palm under the fingers.
        Opposition::Side if kind.digits.len() == 5 && rng.random_bool(0.5) => at_palm(hand, kind, rng),
        Opposition::Palm => at_palm(hand, kind, rng),
        Opposition::Pad | Opposition::Side => opposed::propose(hand, curls, kind, rng),
    }
}

/// Proposes a placement against the palm: the object's x faces the palm, and its z lies roughly across the fingers.
fn at_palm(hand: &Hand, kind: &GraspType, rng: &mut ChaCha8Rng) -> Attempt {
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let flat = kind.prop.name == "disk";
    // A tool along which the index finger lies points along that finger; everything else lies across the fingers.
    let along_index = kind.digits.contains(&Digit::Index) && kind.digits[0] == Digit::Middle;
    // An object that a finger must touch with its side crosses the palm at an angle.
    let crosses = along_index || kind.opposition == Opposition::Side;
    let slant = within(rng, if crosses { (0.5, 1.3) } else { (-0.5, 0.5) });
    let across = Vector3::new(slant.cos(), slant.sin(), 0.0);
    // A disk lies flat on the palm, everything else on its side.
    let rotation = if flat { UnitQuaternion::identity() } else { turn(&Vector3::z(), &across) };
    let height = if flat { 0.012 } else { kind.half };
    let depth = skin - height - within(rng, (2e-4, 3e-3));
    let at = if along_index {
        // Its axis passes under the index finger between the first and the last joint; its offset along the axis is
        // free.
        let knuckle = hand.tree.joints[Digit::Index.ftac_joints()[0]].origin.translation.vector;
        let under = Vector3::new(knuckle.x, knuckle.y + within(rng, (0.0, 0.07)), depth);
        under - across * within(rng, (0.02, 0.07))
    } else {
        Vector3::new(within(rng, (-0.012, 0.012)), within(rng, (-0.03, 0.02)), depth)
    };
    let strength = tension(rng, 10.0, 80.0);
    let mut tensions = [0.0; 5];
    for digit in kind.digits.iter().chain(kind.helpers) {
        tensions[digit.index()] = (strength * within(rng, (-0.4, 0.4)).exp()).min(STRONGEST);
    }
    if along_index {
        // The index finger lies along the object nearly straight.
        tensions[Digit::Index.index()] = tension(rng, 0.5, 6.0);
    }
    if !kind.digits.contains(&Digit::Thumb) && rng.random_bool(0.5) {
        tensions[0] = 0.0;
    }
    Attempt::new(&Isometry3::from_parts(at.into(), rotation), tensions.into(), opposition(kind, rng))
}
