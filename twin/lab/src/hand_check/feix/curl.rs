//! Curling of the digits: table of their free postures against cable tension while closing, with friction in the
//! guides.

use hand_model::hand::CoverShape;
use hand_model::statics::{self, Slid};
use hand_model::transmission::Crossing;
use hand_model::{Hand, HandVector};
use nalgebra::{Isometry3, Point3};
use sim::stand::Prop;

/// Number of tabulated tensions, and their range, N; spaced uniformly in the logarithm.
const LOOKED_AT: usize = 64;
const TENSIONS: (f64, f64) = (0.3, 24.0);

/// Side of a skin element, m.
const ELEMENT: f64 = 0.008;

/// Table of the five digits' free postures, with joints that no cable moves at 0, and sample points of the hand's skin.
pub struct Curls {
    /// Postures, one row per tension.
    postures: Vec<HandVector>,
    /// Skin points of each link, link frame, and of the palm, m.
    skin: Vec<Vec<Point3<f64>>>,
    palm: Vec<Point3<f64>>,
}

impl Curls {
    /// Solves for the postures.
    pub fn new(hand: &Hand) -> Self {
        let posture = |n: usize| {
            let slid = Slid { friction: hand.parameters.cable.friction, state: 1.0 };
            statics::free_sliding(hand, &[tension(n as f64); 5], 0.0, &slid)
        };
        let points = |cover: &CoverShape| cover.skin(ELEMENT).into_iter().map(|element| element.point).collect();
        Self {
            postures: (0..LOOKED_AT).map(posture).collect(),
            skin: hand.covers.iter().map(points).collect(),
            palm: points(&hand.palm_cover),
        }
    }

    /// Returns the largest penetration of the skin into `prop` at `palm_from_prop`, m, with the links at `links`; 0 if
    /// there is none.
    pub fn buried(&self, links: &[Isometry3<f64>], prop: &Prop, palm_from_prop: &Isometry3<f64>) -> f64 {
        let depth = |from_palm: &Isometry3<f64>, points: &[Point3<f64>]| {
            points.iter().map(|point| -prop.signed_distance(&(from_palm * point)).0).fold(0.0, f64::max)
        };
        let from_palm = palm_from_prop.inverse();
        let of_links = links.iter().zip(&self.skin).map(|(link, points)| depth(&(from_palm * link), points));
        of_links.fold(depth(&from_palm, &self.palm), f64::max)
    }

    /// Interpolates the joint angles (rad) at cable `tensions` (N), with the opposition joint at `opposition` (rad).
    pub fn posture(&self, hand: &Hand, tensions: &[f64], opposition: f64) -> HandVector {
        let mut angles = hand.open();
        for (path, tension) in hand.transmission.cables.iter().zip(tensions) {
            let at = place(*tension);
            let low = (at as usize).min(LOOKED_AT - 2);
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

fn tension(place: f64) -> f64 {
    TENSIONS.0 * (TENSIONS.1 / TENSIONS.0).powf(place / (LOOKED_AT - 1) as f64)
}

/// Returns the fractional row of a tension in the table, clamped to its ends.
fn place(tension: f64) -> f64 {
    let last = (LOOKED_AT - 1) as f64;
    ((tension.max(1e-9) / TENSIONS.0).ln() / (TENSIONS.1 / TENSIONS.0).ln() * last).clamp(0.0, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the tabulated tensions the postures agree with the statics, and beyond them they are the outermost.
    #[test]
    fn agrees_with_statics() {
        let hand = Hand::ftac();
        let curls = Curls::new(&hand);
        let slid = Slid { friction: hand.parameters.cable.friction, state: 1.0 };
        for tension in [0.7, 3.3, 9.1] {
            let solved = statics::free_sliding(&hand, &[tension; 5], 0.8, &slid);
            let found = curls.posture(&hand, &[tension; 5], 0.8);
            for (a, b) in solved.iter().zip(&found) {
                assert!((a - b).abs() < 0.01, "{tension} N: {solved:?} {found:?}");
            }
        }
        let most = |tension| curls.posture(&hand, &[tension; 5], 0.0);
        assert_eq!(most(TENSIONS.1), most(100.0));
    }
}
