//! Closing of a digit, told by its cable: on what its grasp holds, and on nothing.
//!
//! Pads tell a hold where a digit bears them on all of its links. A digit with bare links often holds with those, and nothing feels it. Its
//! cable tells: a digit that holds something stops about where its grasp held when it was verified, and one that holds nothing goes on
//! until the hand itself stops it. Where that is follows from statics: from the measured posture the digit goes on under its tension until it
//! rests against palm and other digits. A thumb that lies on a closed finger is then behind it, not in its way.

use hand_model::robot::ServoState;
use hand_model::{Digit, Hand, statics};
use nalgebra::{Point3, Vector3};
use touch::posture::{cable_excursion, cable_tension};

/// Stiffness of a link that presses on another, Pa/m: no gel gives way where links are bare.
const RIGID: f64 = 2e9;
/// Share of a closing on nothing up to which a digit has something in its way whose grasp was never verified.
const UNVERIFIED: f64 = 0.9;

/// True if a digit bears pads on all of its links.
pub fn has_pads_throughout(hand: &Hand, digit: Digit) -> bool {
    hand.links(digit).iter().all(|link| hand.pads.iter().any(|pad| pad.link == Some(*link)))
}

/// Cable (m) that a digit takes up under `tension` (N) if nothing holds it at `q` (rad), the other joints at rest. `None` where statics
/// finds no posture at rest.
pub fn on_nothing(hand: &Hand, digit: Digit, tension: f64, q: &[f64]) -> Option<f64> {
    let links = hand.tree.forward(q);
    let others: Vec<usize> = (0..links.len()).filter(|link| hand.digit_of(Some(*link)) != Some(digit)).collect();
    let obstacle = |link: usize, point: &Point3<f64>| {
        // A joint connects palm and first link: their covers never touch.
        let palm = hand.tree.joints[link].parent.map(|_| hand.palm_cover.signed_distance(point));
        let other = others.iter().map(|other| {
            let (distance, outward) =
                hand.covers[*other].signed_distance(&links[*other].inverse_transform_point(point));
            (distance, links[*other] * outward)
        });
        other.chain(palm).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, Vector3::z()))
    };
    let closed = statics::closed(hand, (digit, tension), q, RIGID, obstacle).ok()?;
    Some(hand.transmission.cables[digit.index()].excursion(&closed))
}

/// True if a pulled digit has stopped earlier than on nothing: nearer to where it is when its grasp holds (`held`, all joints, rad), if that is known.
/// `q` are the joints as they are, rad; an excursion is known to `sigma`, m. A digit that the grasp leaves as near to a closing on nothing as can be
/// measured says nothing.
pub fn stops_early(
    hand: &Hand,
    (digit, servo): (Digit, &ServoState),
    q: &[f64],
    held: Option<&[f64]>,
    sigma: f64,
) -> bool {
    let tension = cable_tension(hand, digit.index(), servo);
    let Some(empty) = on_nothing(hand, digit, tension, q) else { return false };
    let path = &hand.transmission.cables[digit.index()];
    let between = held.map_or(UNVERIFIED * empty, |joints| 0.5 * (path.excursion(joints) + empty));
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

    /// The fingers of the F-TAC Hand bear pads all over; those of the Allegro Hand at their tips.
    #[test]
    fn pads_throughout() {
        assert!(Hand::ftac().digits().iter().all(|digit| has_pads_throughout(&Hand::ftac(), *digit)));
        assert!(!allegro().digits().iter().any(|digit| has_pads_throughout(&allegro(), *digit)));
    }

    /// An empty finger's tip comes to rest on the palm where it does in physics, as a share of a full closing (simulated trials in which
    /// the object was missed); a thumb that lies before the palm stops the index finger earlier.
    #[test]
    fn the_palm_stops_an_empty_finger() {
        let hand = allegro();
        let open = hand.open();
        for (digit, tension, seen) in [
            (Digit::Ring, 14.61, 0.936),
            (Digit::Ring, 15.48, 0.937),
            (Digit::Ring, 16.54, 0.935),
            (Digit::Index, 29.12, 0.938),
        ] {
            let share = on_nothing(&hand, digit, tension, &open).expect("at rest") / full(&hand, digit);
            assert!((share - seen).abs() < 0.003, "{digit:?} at {tension} N: {share}, in physics {seen}");
        }
        let mut opposed = open;
        for (joint, angle) in hand.links(Digit::Thumb).iter().zip([1.1, 0.9, 0.6]) {
            opposed[*joint] = angle;
        }
        let [free, met] = [&open, &opposed].map(|q| on_nothing(&hand, Digit::Index, 29.12, q).expect("at rest"));
        assert!(met < 0.95 * free, "{met} {free}");
    }

    /// Nearer to the verified hold than to a closing on nothing is early; a hold that cannot be told from nothing tells nothing.
    #[test]
    fn a_hold_lies_before_a_closing_on_nothing() {
        let hand = allegro();
        let (digit, tension) = (Digit::Ring, 15.0);
        let at = |share: f64| {
            let mut q = hand.open();
            for &joint in hand.links(digit) {
                q[joint] = share * hand.tree.joints[joint].upper;
            }
            q
        };
        let early = |share: f64, held: Option<f64>| {
            let held = held.map(at);
            let servo = servo(&hand, digit, tension, share);
            stops_early(&hand, (digit, &servo), &hand.open(), held.as_deref(), SIGMA)
        };
        assert!(early(0.72, Some(0.72)) && early(0.80, Some(0.72)) && early(0.60, Some(0.72)));
        assert!(!early(0.90, Some(0.72)) && !early(0.935, Some(0.72)));
        assert!(!early(0.72, Some(0.93)));
        assert!(early(0.72, None) && !early(0.92, None));
    }
}
