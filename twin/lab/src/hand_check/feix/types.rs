//! The 33 grasp types of Feix et al. (2016), with a suitable object for each.

use hand_model::Digit;
use nalgebra::{Isometry3, Vector3};
use sim::test_stand::Prop;
use world::ObjectShape;

/// Parts of the hand between which the object is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Opposition {
    /// Palm and fingers.
    Palm,
    Pad,
    /// Thumb and side of a finger, or the sides of two fingers.
    Side,
}

pub struct GraspType {
    /// Number of the type, 1 to 33.
    pub number: usize,
    /// Name in the taxonomy.
    pub name: &'static str,
    pub opposition: Opposition,
    /// Digits that must touch, thumb first.
    pub digits: &'static [Digit],
    /// Digits that may touch in addition.
    pub helpers: &'static [Digit],
    /// True if the thumb is abducted.
    pub abducted: bool,
    /// Digits that lie straight on the object, with more than their first links.
    pub extended: &'static [Digit],
    /// Held object. Its long axis is z; the digits oppose each other along x.
    pub prop: Prop,
    /// Half of the object's size along x, m.
    pub half: f64,
    /// Range of contact positions along the pads: -1 to 1 on their flat part, 2 is the fingertip.
    pub along: (f64, f64),
    /// Simplification of the object, if any.
    pub note: &'static str,
}

use Digit::{Index as I, Little as L, Middle as M, Ring as R, Thumb as T};

const FINGERS: &[Digit] = &[I, M, R, L];
const ALL_DIGITS: &[Digit] = &[T, I, M, R, L];
const NO_DIGITS: &[Digit] = &[];
const THUMB: &[Digit] = &[T];

/// Contact positions: anywhere on the pad, and with the fingertip.
const PAD_RANGE: (f64, f64) = (-0.4, 1.3);
const TIP_RANGE: (f64, f64) = (0.9, 1.7);
/// Contact position at the pad's base, so that more than the last phalanx goes around the object.
const BASE_RANGE: (f64, f64) = (-1.0, 0.0);

fn rod(radius: f64, length: f64, mass: f64) -> (Prop, f64) {
    (Prop::new("rod", ObjectShape::Cylinder { radius, half_height: 0.5 * length }, mass, 0.8), radius)
}

fn ball(radius: f64, mass: f64) -> (Prop, f64) {
    (Prop::new("ball", ObjectShape::Sphere { radius }, mass, 0.8), radius)
}

fn slab(x: f64, y: f64, z: f64, mass: f64) -> (Prop, f64) {
    let half = 0.5 * Vector3::new(x, y, z);
    (Prop::new("slab", ObjectShape::Cuboid { half, radius: 0.2 * half.min() }, mass, 0.8), half.x)
}

/// Returns a disk whose flat sides face z; the digits oppose each other across its rim.
fn disk(radius: f64, thickness: f64, mass: f64) -> (Prop, f64) {
    (Prop::new("disk", ObjectShape::Cylinder { radius, half_height: 0.5 * thickness }, mass, 0.8), radius)
}

/// Returns two parallel rods with a bridge: shanks of scissors, or sticks.
fn rod_pair(radius: f64, apart: f64, length: f64, mass: f64) -> (Prop, f64) {
    let shank = ObjectShape::Cylinder { radius, half_height: 0.5 * length };
    let bridge = ObjectShape::Cuboid { half: Vector3::new(0.5 * apart, 0.6 * radius, 0.003), radius: 0.001 };
    let parts = vec![
        (Isometry3::translation(0.5 * apart, 0.0, 0.0), shank.clone()),
        (Isometry3::translation(-0.5 * apart, 0.0, 0.0), shank),
        (Isometry3::translation(0.0, 0.0, 0.4 * length), bridge),
    ];
    (Prop { name: "pair".into(), parts, mass, friction: 0.8 }, 0.5 * apart + radius)
}

/// Returns all 33 types, in order.
pub fn all_types() -> Vec<GraspType> {
    use Opposition::{Pad, Palm, Side};
    let mut types: Vec<GraspType> = Vec::new();
    let mut add = |name, opposition, digits, helpers, abducted, (prop, half): (Prop, f64), note| {
        let number = types.len() + 1;
        let extended = if name == "Index Finger Extension" { &[I][..] } else { NO_DIGITS };
        let along = match name {
            "Tip Pinch" => TIP_RANGE,
            "Ring" => BASE_RANGE,
            _ => PAD_RANGE,
        };
        types.push(GraspType {
            number,
            name,
            opposition,
            digits,
            helpers,
            abducted,
            extended,
            prop,
            half,
            along,
            note,
        });
    };
    add("Large Diameter", Palm, FINGERS, THUMB, true, rod(0.036, 0.12, 0.4), "");
    add("Small Diameter", Palm, FINGERS, THUMB, true, rod(0.012, 0.12, 0.1), "");
    add("Medium Wrap", Palm, FINGERS, THUMB, true, rod(0.024, 0.12, 0.3), "");
    add("Adducted Thumb", Palm, ALL_DIGITS, NO_DIGITS, false, rod(0.014, 0.14, 0.1), "");
    add("Light Tool", Palm, FINGERS, THUMB, false, rod(0.008, 0.14, 0.05), "");
    add("Prismatic 4 Finger", Pad, ALL_DIGITS, NO_DIGITS, true, rod(0.008, 0.12, 0.02), "");
    add("Prismatic 3 Finger", Pad, &[T, I, M, R], NO_DIGITS, true, rod(0.008, 0.10, 0.02), "");
    add("Prismatic 2 Finger", Pad, &[T, I, M], NO_DIGITS, true, rod(0.008, 0.07, 0.015), "");
    add("Palmar Pinch", Pad, &[T, I], NO_DIGITS, true, slab(0.010, 0.016, 0.016, 0.005), "");
    add("Power Disk", Palm, FINGERS, THUMB, true, disk(0.042, 0.024, 0.1), "");
    add("Power Sphere", Palm, FINGERS, THUMB, true, ball(0.034, 0.1), "");
    add("Precision Disk", Pad, ALL_DIGITS, NO_DIGITS, true, disk(0.042, 0.020, 0.08), "");
    add("Precision Sphere", Pad, ALL_DIGITS, NO_DIGITS, true, ball(0.034, 0.08), "");
    add("Tripod", Pad, &[T, I, M], NO_DIGITS, true, ball(0.016, 0.02), "");
    add("Fixed Hook", Palm, FINGERS, NO_DIGITS, false, rod(0.011, 0.12, 0.1), "");
    add("Lateral", Side, &[T, I], &[M, R, L], false, slab(0.004, 0.024, 0.05, 0.015), "");
    add("Index Finger Extension", Palm, &[M, R, L, I], THUMB, false, rod(0.011, 0.16, 0.08), "");
    add("Extension Type", Pad, ALL_DIGITS, NO_DIGITS, true, slab(0.012, 0.05, 0.09, 0.06), "");
    add(
        "Distal Type",
        Pad,
        ALL_DIGITS,
        NO_DIGITS,
        true,
        rod_pair(0.005, 0.03, 0.10, 0.04),
        "scissors as two joined shanks",
    );
    add("Writing Tripod", Side, &[T, I, M], &[R], true, rod(0.005, 0.14, 0.012), "");
    add(
        "Tripod Variation",
        Side,
        &[T, I, M],
        &[R],
        true,
        rod_pair(0.0035, 0.018, 0.16, 0.02),
        "chopsticks joined at one end",
    );
    add("Parallel Extension", Pad, ALL_DIGITS, NO_DIGITS, false, slab(0.014, 0.05, 0.09, 0.06), "");
    add("Adduction Grip", Side, &[I, M], NO_DIGITS, true, rod(0.0035, 0.08, 0.003), "");
    add("Tip Pinch", Pad, &[T, I], NO_DIGITS, true, slab(0.008, 0.012, 0.012, 0.002), "");
    add("Lateral Tripod", Side, &[T, I, M], &[R], false, rod(0.006, 0.10, 0.01), "");
    add("Sphere 4 Finger", Pad, &[T, I, M, R], NO_DIGITS, true, ball(0.030, 0.07), "");
    add("Quadpod", Pad, &[T, I, M, R], NO_DIGITS, true, ball(0.020, 0.03), "");
    add("Sphere 3 Finger", Pad, &[T, I, M], NO_DIGITS, true, ball(0.027, 0.06), "");
    add("Stick", Side, &[T, I], &[M, R, L], false, slab(0.010, 0.010, 0.10, 0.01), "");
    add("Palmar", Palm, FINGERS, NO_DIGITS, false, slab(0.012, 0.06, 0.08, 0.06), "");
    add("Ring", Pad, &[T, I], NO_DIGITS, true, rod(0.018, 0.05, 0.02), "");
    add("Ventral", Side, ALL_DIGITS, NO_DIGITS, false, rod(0.011, 0.14, 0.04), "");
    add("Inferior Pincer", Pad, &[T, I], NO_DIGITS, true, ball(0.010, 0.004), "");
    types
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Totals stated in the taxonomy.
    #[test]
    fn totals_of_the_taxonomy() {
        let types = all_types();
        let count = |opposition| types.iter().filter(|kind| kind.opposition == opposition).count();
        assert_eq!(types.len(), 33);
        assert_eq!((count(Opposition::Palm), count(Opposition::Pad), count(Opposition::Side)), (10, 16, 7));
        assert_eq!(types.iter().filter(|kind| kind.abducted).count(), 23);
    }
}
