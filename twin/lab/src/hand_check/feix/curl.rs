//! How the digits curl: their postures at rest over the tension of their cables, closing, with friction in the guides.

use hand_model::hand::CoverShape;
use hand_model::statics::{self, Slid};
use hand_model::transmission::Crossing;
use hand_model::{Hand, HandVector};
use nalgebra::{Isometry3, Point3};
use sim::stand::Prop;

/// Tensions looked at and their range, N, evenly in the logarithm.
const LOOKED_AT: usize = 64;
const TENSIONS: (f64, f64) = (0.3, 24.0);

/// Size of a skin element's side, m.
const ELEMENT: f64 = 0.008;

/// The five digits' postures; joints beside the five cables' stand at 0. Besides, points of the hand's skin.
pub struct Curls {
    /// Rows of the table.
    postures: Vec<HandVector>,
    /// Points of each link's skin, link frame, and of the palm's, m.
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

    /// How deep the skin is at most in `prop` at `palm_from_prop`, m, with the links at `links`; 0 where it is nowhere.
    pub fn buried(&self, links: &[Isometry3<f64>], prop: &Prop, palm_from_prop: &Isometry3<f64>) -> f64 {
        let depth = |from_palm: &Isometry3<f64>, points: &[Point3<f64>]| {
            points.iter().map(|point| -prop.signed_distance(&(from_palm * point)).0).fold(0.0, f64::max)
        };
        let from_palm = palm_from_prop.inverse();
        let of_links = links.iter().zip(&self.skin).map(|(link, points)| depth(&(from_palm * link), points));
        of_links.fold(depth(&from_palm, &self.palm), f64::max)
    }

    /// Joint angles (rad) at cable `tensions` (N) with the opposition joint at `opposition` (rad).
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

/// Where in the row of postures a tension is; past its ends, the end.
fn place(tension: f64) -> f64 {
    let last = (LOOKED_AT - 1) as f64;
    ((tension.max(1e-9) / TENSIONS.0).ln() / (TENSIONS.1 / TENSIONS.0).ln() * last).clamp(0.0, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the table's tensions the postures are those of the statics, and beyond them the outermost.
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
