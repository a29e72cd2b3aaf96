//! Curling of the digits: table of their free postures against cable tension while closing, with friction in the
//! guides.

use hand_model::hand::CoverShape;
use hand_model::statics::{self, GuideFriction};
use hand_model::transmission::Crossing;
use hand_model::{Hand, HandVector};
use nalgebra::{Isometry3, Point3};
use sim::test_stand::Prop;

/// Number of tabulated tensions, and their range, N; spaced uniformly in the logarithm.
const TENSION_COUNT: usize = 64;
const TENSION_RANGE: (f64, f64) = (0.3, 24.0);

/// Side of a skin element, m.
const SKIN_ELEMENT_SIDE: f64 = 0.008;

/// Table of the five digits' free postures, with joints that no cable moves at 0, and sample points of the hand's skin.
pub struct FreePostureTable {
    /// Postures, one row per tension.
    postures: Vec<HandVector>,
    /// Skin points of each link, link frame, and of the palm, m.
    skin: Vec<Vec<Point3<f64>>>,
    palm: Vec<Point3<f64>>,
}

impl FreePostureTable {
    /// Solves for the postures.
    pub fn new(hand: &Hand) -> Self {
        let posture = |n: usize| {
            let slid = GuideFriction { friction: hand.parameters.cable.friction, state: 1.0 };
            statics::free_equilibrium_with_friction(hand, &[row_tension(n as f64); 5], 0.0, &slid)
        };
        let points = |cover: &CoverShape| {
            cover.skin_elements(SKIN_ELEMENT_SIDE).into_iter().map(|element| element.point).collect()
        };
        Self {
            postures: (0..TENSION_COUNT).map(posture).collect(),
            skin: hand.covers.iter().map(points).collect(),
            palm: points(&hand.palm_cover),
        }
    }

    /// Returns the largest penetration of the skin into `prop` at `palm_from_prop`, m, with the links at `links`; 0 if
    /// there is none.
    pub fn penetration(&self, links: &[Isometry3<f64>], prop: &Prop, palm_from_prop: &Isometry3<f64>) -> f64 {
        let depth = |from_palm: &Isometry3<f64>, points: &[Point3<f64>]| {
            points.iter().map(|point| -prop.signed_distance(&(from_palm * point)).0).fold(0.0, f64::max)
        };
        let from_palm = palm_from_prop.inverse();
        let of_links = links.iter().zip(&self.skin).map(|(link, points)| depth(&(from_palm * link), points));
        of_links.fold(depth(&from_palm, &self.palm), f64::max)
    }

    /// Interpolates the joint angles (rad) at cable `tensions` (N), with the opposition joint at `opposition` (rad).
    pub fn posture(&self, hand: &Hand, tensions: &[f64], opposition: f64) -> HandVector {
        let mut angles = hand.open_angles();
        for (path, tension) in hand.transmission.cables.iter().zip(tensions) {
            let at = fractional_row(*tension);
            let low = (at as usize).min(TENSION_COUNT - 2);
            let part = at - low as f64;
            for Crossing { joint, .. } in &path.joints {
                let [a, b] = [low, low + 1].map(|n| self.postures[n][*joint]);
                angles[*joint] = a + (b - a) * part;
            }
        }
        angles[hand_model::Digit::Thumb.ftac_joints()[0]] = opposition;
        angles
    }
}

fn row_tension(place: f64) -> f64 {
    TENSION_RANGE.0 * (TENSION_RANGE.1 / TENSION_RANGE.0).powf(place / (TENSION_COUNT - 1) as f64)
}

/// Returns the fractional row of a tension in the table, clamped to its ends.
fn fractional_row(tension: f64) -> f64 {
    let last = (TENSION_COUNT - 1) as f64;
    ((tension.max(1e-9) / TENSION_RANGE.0).ln() / (TENSION_RANGE.1 / TENSION_RANGE.0).ln() * last).clamp(0.0, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the tabulated tensions the postures agree with the statics, and beyond them they are the outermost.
    #[test]
    fn agrees_with_statics() {
        let hand = Hand::ftac();
        let curls = FreePostureTable::new(&hand);
        let slid = GuideFriction { friction: hand.parameters.cable.friction, state: 1.0 };
        for tension in [0.7, 3.3, 9.1] {
            let solved = statics::free_equilibrium_with_friction(&hand, &[tension; 5], 0.8, &slid);
            let found = curls.posture(&hand, &[tension; 5], 0.8);
            for (a, b) in solved.iter().zip(&found) {
                assert!((a - b).abs() < 0.01, "{tension} N: {solved:?} {found:?}");
            }
        }
        let most = |tension| curls.posture(&hand, &[tension; 5], 0.0);
        assert_eq!(most(TENSION_RANGE.1), most(100.0));
    }
}
