//! Proposals for the search: against the palm here, between opposed digits in [`opposed`].

use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::attempt::{GraspAttempt, MAX_TENSION, aligning_rotation, draw_in_range, draw_opposition, draw_tension};
use super::free_postures::FreePostureTable;
use super::opposed;
use super::types::{GraspType, Opposition};

pub fn propose(hand: &Hand, curls: &FreePostureTable, kind: &GraspType, rng: &mut ChaCha8Rng) -> GraspAttempt {
    match kind.opposition {
        // If all digits take part, the object may also lie along the palm under the fingers.
        Opposition::Side if kind.digits.len() == 5 && rng.random_bool(0.5) => propose_at_palm(hand, kind, rng),
        Opposition::Palm => propose_at_palm(hand, kind, rng),
        Opposition::Pad | Opposition::Side => opposed::propose(hand, curls, kind, rng),
    }
}

/// Proposes a placement against the palm: the object's x faces the palm, and its z lies roughly across the fingers.
fn propose_at_palm(hand: &Hand, kind: &GraspType, rng: &mut ChaCha8Rng) -> GraspAttempt {
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let flat = kind.prop.name == "disk";
    // A tool along which the index finger lies points along that finger; everything else lies across the fingers.
    let along_index = kind.digits.contains(&Digit::Index) && kind.digits[0] == Digit::Middle;
    // An object that a finger must touch with its side crosses the palm at an angle.
    let crosses = along_index || kind.opposition == Opposition::Side;
    let slant = draw_in_range(rng, if crosses { (0.5, 1.3) } else { (-0.5, 0.5) });
    let across = Vector3::new(slant.cos(), slant.sin(), 0.0);
    // A disk lies flat on the palm, everything else on its side.
    let rotation = if flat { UnitQuaternion::identity() } else { aligning_rotation(&Vector3::z(), &across) };
    let height = if flat { 0.012 } else { kind.half };
    let depth = skin - height - draw_in_range(rng, (2e-4, 3e-3));
    let at = if along_index {
        // Its axis passes under the index finger between the first and the last joint; its offset along the axis is
        // free.
        let knuckle = hand.tree.joints[Digit::Index.ftac_joints()[0]].origin.translation.vector;
        let under = Vector3::new(knuckle.x, knuckle.y + draw_in_range(rng, (0.0, 0.07)), depth);
        under - across * draw_in_range(rng, (0.02, 0.07))
    } else {
        Vector3::new(draw_in_range(rng, (-0.012, 0.012)), draw_in_range(rng, (-0.03, 0.02)), depth)
    };
    let strength = draw_tension(rng, 10.0, 80.0);
    let mut tensions = [0.0; 5];
    for digit in kind.digits.iter().chain(kind.helpers) {
        tensions[digit.index()] = (strength * draw_in_range(rng, (-0.4, 0.4)).exp()).min(MAX_TENSION);
    }
    if along_index {
        // The index finger lies along the object nearly straight.
        tensions[Digit::Index.index()] = draw_tension(rng, 0.5, 6.0);
    }
    if !kind.digits.contains(&Digit::Thumb) && rng.random_bool(0.5) {
        tensions[0] = 0.0;
    }
    GraspAttempt::new(&Isometry3::from_parts(at.into(), rotation), tensions.into(), draw_opposition(kind, rng))
}
