//! Cable evidence for a hold: distinguishes a digit that has closed on its object from one that has closed on nothing.
//!
//! If all links of a digit bear pads, the pads feel a hold. A digit with bare links often holds with those, and no pad
//! feels it; then the cable excursion gives the evidence. A digit that holds something stops near the excursion at
//! which its grasp held when it was verified. A digit that holds nothing closes until the hand itself stops it. That
//! stop follows from statics: starting from the measured posture, the digit closes under its tension until it rests
//! against the palm and other digits. A thumb that lies on a closed finger is then behind that finger, not in its way.

use hand_model::robot::ServoState;
use hand_model::{Digit, Hand, statics};
use nalgebra::{Point3, Vector3};
use tactile_perception::posture::{cable_excursion, cable_tension};

/// Contact stiffness between two links, Pa/m: where links are bare, no gel yields.
const RIGID_STIFFNESS: f64 = 2e9;
/// Threshold for a digit whose grasp was never verified: below this share of the empty closing, something is in its
/// way.
const UNVERIFIED_CLOSING_SHARE: f64 = 0.9;

/// True if every link of the digit bears a pad.
pub fn has_pads_throughout(hand: &Hand, digit: Digit) -> bool {
    hand.links(digit).iter().all(|link| hand.pads.iter().any(|pad| pad.link == Some(*link)))
}

/// Cable excursion (m) at which a digit comes to rest under `tension` (N) if nothing is in its grasp. It closes from
/// the joint angles `q` (rad) while the other joints stay at rest. `None` where statics finds no equilibrium.
pub fn free_excursion(hand: &Hand, digit: Digit, tension: f64, q: &[f64]) -> Option<f64> {
    let links = hand.tree.forward(q);
    let others: Vec<usize> = (0..links.len()).filter(|link| hand.digit_of(Some(*link)) != Some(digit)).collect();
    let obstacle = |link: usize, point: &Point3<f64>| {
        // A joint connects the palm to the first link, so their covers never touch.
        let palm = hand.tree.joints[link].parent.map(|_| hand.palm_cover.signed_distance(point));
        let other = others.iter().map(|other| {
            let (distance, outward) =
                hand.covers[*other].signed_distance(&links[*other].inverse_transform_point(point));
            (distance, links[*other] * outward)
        });
        other.chain(palm).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, Vector3::z()))
    };
    let closed = statics::close_digit(hand, (digit, tension), q, RIGID_STIFFNESS, obstacle).ok()?;
    Some(hand.transmission.cables[digit.index()].excursion(&closed))
}

/// True if a pulled digit has stopped earlier than it would on nothing: its excursion is closer to that of its verified
/// hold (`held`, all joints, rad; if known) than to that of an empty closing. `q` are the present joint angles, rad,
/// and `sigma` is the standard deviation of an excursion, m. False if hold and empty closing are too close together to
/// be distinguished.
pub fn stops_early(
    hand: &Hand,
    (digit, servo): (Digit, &ServoState),
    q: &[f64],
    held: Option<&[f64]>,
    sigma: f64,
) -> bool {
    let tension = cable_tension(hand, digit.index(), servo);
    let Some(empty) = free_excursion(hand, digit, tension, q) else { return false };
    let path = &hand.transmission.cables[digit.index()];
    let between = held.map_or(UNVERIFIED_CLOSING_SHARE * empty, |joints| 0.5 * (path.excursion(joints) + empty));
    empty - between > sigma && cable_excursion(hand, digit.index(), servo) < between
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use hand_model::RobotModel;

    use super::*;

    const SIGMA: f64 = 1.5e-4;

    fn allegro() -> Hand {
        let path = Path::new("../../hand-model/data/robots/allegro_gen3.toml");
        Hand::clone(&RobotModel::read(path).expect("a robot").hand)
    }

    fn full(hand: &Hand, digit: Digit) -> f64 {
        hand.transmission.cables[digit.index()].full_excursion()
    }

    /// A servo that pulls with `tension` (N) and has taken up this share of a full closing.
    fn servo(hand: &Hand, digit: Digit, tension: f64, share: f64) -> ServoState {
        let cable = &hand.cables[digit.index()];
        let wound = share * full(hand, digit) + tension / cable.stiffness;
        let current = tension * cable.spool_radius / hand.servos[digit.index()].torque_constant;
        ServoState { position: wound / cable.spool_radius, velocity: 0.0, current, temperature: 25.0 }
    }

    /// The fingers of the F-TAC Hand bear pads on all links, those of the Allegro Hand only at their tips.
    #[test]
    fn pads_throughout() {
        assert!(Hand::ftac().digits().iter().all(|digit| has_pads_throughout(&Hand::ftac(), *digit)));
        assert!(!allegro().digits().iter().any(|digit| has_pads_throughout(&allegro(), *digit)));
    }

    /// The tip of an empty finger comes to rest on the palm at the same share of a full closing as in physics
    /// (simulated trials in which the object was missed). A thumb in front of the palm stops the index finger earlier.
    #[test]
    fn the_palm_stops_an_empty_finger() {
        let hand = allegro();
        let open = hand.open_angles();
        for (digit, tension, seen) in [
            (Digit::Ring, 14.61, 0.936),
            (Digit::Ring, 15.48, 0.937),
            (Digit::Ring, 16.54, 0.935),
            (Digit::Index, 29.12, 0.938),
        ] {
            let share = free_excursion(&hand, digit, tension, &open).expect("at rest") / full(&hand, digit);
            assert!((share - seen).abs() < 0.003, "{digit:?} at {tension} N: {share}, in physics {seen}");
        }
        let mut opposed = open;
        for (joint, angle) in hand.links(Digit::Thumb).iter().zip([1.1, 0.9, 0.6]) {
            opposed[*joint] = angle;
        }
        let [free, met] = [&open, &opposed].map(|q| free_excursion(&hand, Digit::Index, 29.12, q).expect("at rest"));
        assert!(met < 0.95 * free, "{met} {free}");
    }

    /// An excursion closer to the verified hold than to an empty closing counts as early. A hold that cannot be
    /// distinguished from an empty closing gives no evidence.
    #[test]
    fn a_hold_lies_before_a_closing_on_nothing() {
        let hand = allegro();
        let (digit, tension) = (Digit::Ring, 15.0);
        let at = |share: f64| {
            let mut q = hand.open_angles();
            for &joint in hand.links(digit) {
                q[joint] = share * hand.tree.joints[joint].upper;
            }
            q
        };
        let early = |share: f64, held: Option<f64>| {
            let held = held.map(at);
            let servo = servo(&hand, digit, tension, share);
            stops_early(&hand, (digit, &servo), &hand.open_angles(), held.as_deref(), SIGMA)
        };
        assert!(early(0.72, Some(0.72)) && early(0.80, Some(0.72)) && early(0.60, Some(0.72)));
        assert!(!early(0.90, Some(0.72)) && !early(0.935, Some(0.72)));
        assert!(!early(0.72, Some(0.93)));
        assert!(early(0.72, None) && !early(0.92, None));
    }
}
