//! Grasps between opposed digits: a posture whose skin meets the object as the type requires, and the object's pose in
//! it.
//!
//! Each digit is to touch with a point of its pad (or of its side), whose outward normal is known. The object's centre
//! lies half its size in front of each such point: for a ball these centres coincide, for a rod they lie on one line,
//! for a slab in one plane. Thumb and fingers must face each other, and no other skin may be inside the object. The
//! posture with the smallest misfit is searched among random commands, and improved by random steps.

use hand_model::{Digit, DigitVector, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::attempt::{
    GraspAttempt, MAX_TENSION, aligning_rotation, draw_in_range, draw_opposition, draw_tension, jitter,
    opposition_range,
};
use super::free_postures::FreePostureTable;
use super::types::{GraspType, Opposition};

/// Number of random commands evaluated for a proposal, and of steps that improve the best one.
const COMMAND_SAMPLES: usize = 150;
const IMPROVEMENT_STEPS: usize = 150;
/// Size of the first step, and shrink factor after each step without improvement.
const FIRST_STEP: f64 = 0.35;
const STEP_SHRINKAGE: f64 = 0.98;
/// Range of tensions at which a digit meets the object, N.
const MEETING_TENSIONS: (f64, f64) = (0.7, 14.0);
/// Misfit that costs as much as normals that miss each other by a right angle, m.
const MISFIT_SCALE: f64 = 0.003;
/// Ranges of a contact on a flank: position along it, as a share of its half length, and angle from its middle towards
/// pad or back, rad.
const FLANK_POSITION_RANGE: (f64, f64) = (-0.9, 0.9);
const FLANK_ANGLE_RANGE: (f64, f64) = (-0.9, 0.9);
/// Angle within which the flat part of a flank is traversed, rad.
const EDGE_ANGLE: f64 = 0.1;
/// Probability that three digits opposing sideways take the object on the middle finger's flank.
const FLANK_PROBABILITY: f64 = 0.85;
/// Range of tension of a finger in excess of meeting, N.
const PRESS_TENSIONS: (f64, f64) = (1.5, 30.0);
/// Factor on that excess for two digits, which hold light objects.
const LIGHT_OBJECT_FACTOR: f64 = 0.3;
/// Range of the share of the meeting tension that remains in a finger that presses by its springs.
const REMAINING_TENSION_SHARES: (f64, f64) = (0.0, 0.7);
/// Minimum distance between the contact centres that determine a rod's direction, m.
const MIN_CONTACT_SPREAD: f64 = 0.01;

/// Part of a digit that is to touch.
#[derive(Debug, Clone, Copy)]
enum DigitPart {
    /// Its pad, at this position along it.
    Pad(f64),
    Flank(Flank),
}

/// A point on the side of a finger.
#[derive(Debug, Clone, Copy)]
struct Flank {
    phalanx: usize,
    /// Position along the flank, as a share of its half length, and angle towards the pad, rad.
    along: f64,
    round: f64,
    /// -1 faces the thumb, 1 faces away from it.
    side: f64,
}

impl Flank {
    fn draw(side: f64, rng: &mut ChaCha8Rng) -> Self {
        Self {
            phalanx: rng.random_range(1..3),
            along: draw_in_range(rng, FLANK_POSITION_RANGE),
            round: draw_in_range(rng, FLANK_ANGLE_RANGE),
            side,
        }
    }
}

/// Contact points of the digits, and the command that brings them there.
#[derive(Debug, Clone)]
struct ContactGuess {
    opposition: f64,
    tensions: DigitVector,
    parts: Vec<(Digit, DigitPart)>,
}

/// A point of the skin and its outward normal, palm frame, m.
struct SkinPoint {
    at: Vector3<f64>,
    out: Vector3<f64>,
}

impl ContactGuess {
    fn draw(kind: &GraspType, rng: &mut ChaCha8Rng) -> Self {
        let common = draw_tension(rng, MEETING_TENSIONS.0, MEETING_TENSIONS.1);
        let mut tensions = [0.0; 5];
        for digit in Digit::ALL {
            tensions[digit.index()] = common * draw_in_range(rng, (-0.5, 0.5)).exp();
        }
        tensions[0] = draw_tension(rng, MEETING_TENSIONS.0, MEETING_TENSIONS.1);
        let along = draw_in_range(rng, kind.along);
        let thumb = (Digit::Thumb, DigitPart::Pad(draw_in_range(rng, kind.along)));
        let pad = |digit: &Digit| (*digit, DigitPart::Pad(along));
        let parts = match (kind.opposition, kind.digits) {
            // On the middle finger's side, with the index finger's pad on top.
            (Opposition::Side, [Digit::Thumb, index, middle]) if rng.random_bool(FLANK_PROBABILITY) => {
                vec![thumb, pad(index), (*middle, DigitPart::Flank(Flank::draw(-1.0, rng)))]
            }
            // At the index finger's side, with the other fingers around the object if they take part.
            (Opposition::Side, [Digit::Thumb, index, others @ ..]) => {
                let flank = (*index, DigitPart::Flank(Flank::draw(-1.0, rng)));
                let around = if others.len() > 1 { others } else { &[] };
                [thumb, flank].into_iter().chain(around.iter().map(pad)).collect()
            }
            // Between two fingers.
            (Opposition::Side, fingers) => {
                let sides = fingers.iter().zip([1.0, -1.0]);
                sides.map(|(digit, side)| (*digit, DigitPart::Flank(Flank::draw(side, rng)))).collect()
            }
            (_, digits) => {
                let fingers = digits.iter().filter(|digit| **digit != Digit::Thumb);
                let pads = fingers.map(|digit| (*digit, DigitPart::Pad(along + draw_in_range(rng, (-0.1, 0.1)))));
                std::iter::once(thumb).chain(pads).collect()
            }
        };
        Self { opposition: draw_opposition(kind, rng), tensions: tensions.into(), parts }
    }

    /// Draws a neighbour at distance `step`.
    fn vary(&self, kind: &GraspType, step: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut next = self.clone();
        for tension in &mut next.tensions {
            *tension = (*tension * (step * draw_in_range(rng, (-1.0, 1.0))).exp())
                .clamp(MEETING_TENSIONS.0, MEETING_TENSIONS.1);
        }
        for (_, part) in &mut next.parts {
            match part {
                DigitPart::Pad(along) => {
                    *along = (*along + step * draw_in_range(rng, (-1.0, 1.0))).clamp(kind.along.0, kind.along.1)
                }
                DigitPart::Flank(flank) => {
                    flank.along = (flank.along + step * draw_in_range(rng, (-1.0, 1.0)))
                        .clamp(FLANK_POSITION_RANGE.0, FLANK_POSITION_RANGE.1);
                    flank.round = (flank.round + step * draw_in_range(rng, (-1.0, 1.0)))
                        .clamp(FLANK_ANGLE_RANGE.0, FLANK_ANGLE_RANGE.1);
                }
            }
        }
        let (low, high) = opposition_range(kind);
        next.opposition = (next.opposition + step * draw_in_range(rng, (-1.0, 1.0))).clamp(low, high);
        next
    }

    /// Returns the link poses that result from the command without the object, palm frame. Unused fingers stay open.
    fn links(&self, hand: &Hand, curls: &FreePostureTable, kind: &GraspType) -> Vec<Isometry3<f64>> {
        let mut tensions = [0.0; 5];
        for digit in kind.digits.iter().chain(kind.helpers) {
            tensions[digit.index()] = self.tensions[digit.index()];
        }
        hand.tree.forward(&curls.posture(hand, &tensions, self.opposition.min(std::f64::consts::FRAC_PI_2)))
    }

    fn skin(&self, hand: &Hand, links: &[Isometry3<f64>]) -> Vec<SkinPoint> {
        let touch = |(digit, part): &(Digit, DigitPart)| {
            let phalanx = if let DigitPart::Flank(flank) = part { flank.phalanx } else { 2 };
            let link = digit.ftac_joints()[phalanx];
            let cover = &hand.covers[link];
            let inner = cover.half.add_scalar(-cover.radius);
            // Centre of the rounding, and its outward normal.
            let (core, out) = match part {
                DigitPart::Flank(Flank { along, round, side, .. }) => {
                    let (sin, cos) = round.sin_cos();
                    let edge = inner.y * (round / EDGE_ANGLE).clamp(-1.0, 1.0);
                    (Vector3::new(along * inner.x, edge, side * inner.z), Vector3::new(0.0, sin, side * cos))
                }
                // Beyond the flat part the contact moves around the edge between pad and fingertip.
                DigitPart::Pad(along) => {
                    let (sin, cos) = ((along - 1.0).max(0.0) * std::f64::consts::FRAC_PI_2).sin_cos();
                    (Vector3::new(along.min(1.0) * inner.x, inner.y, 0.0), Vector3::new(sin, cos, 0.0))
                }
            };
            let at = core + out * cover.radius;
            let frame = links[link] * cover.link_from_cover;
            SkinPoint { at: (frame * Point3::from(at)).coords, out: frame * out }
        };
        self.parts.iter().map(touch).collect()
    }
}

/// Returns the eigenvector of the largest (`true`) or smallest eigenvalue.
fn eigenvector(matrix: Matrix3<f64>, greatest: bool) -> Vector3<f64> {
    let eigen = matrix.symmetric_eigen();
    let value = |n: &usize| if greatest { eigen.eigenvalues[*n] } else { -eigen.eigenvalues[*n] };
    let found = (0..3).max_by(|a, b| value(a).total_cmp(&value(b))).unwrap_or(0);
    eigen.eigenvectors.column(found).into()
}

/// Returns the misfit of the object between these points, and its best pose. `lean` breaks ties in the orientation.
fn fit_object(kind: &GraspType, skin: &[SkinPoint], lean: &Vector3<f64>) -> (f64, Isometry3<f64>) {
    let fingers = (skin.len() - 1) as f64;
    let middles: Vec<Vector3<f64>> = skin.iter().map(|s| s.at + s.out * kind.half).collect();
    let centre = 0.5 * (middles[0] + middles[1..].iter().sum::<Vector3<f64>>() / fingers);
    let facing = skin[0].out - skin[1..].iter().map(|s| s.out).sum::<Vector3<f64>>() / fingers;
    let missed = (skin[0].out + skin[1..].iter().map(|s| s.out).sum::<Vector3<f64>>() / fingers).norm();
    let across = facing.try_normalize(1e-6).unwrap_or(Vector3::x());
    let outs: Matrix3<f64> = skin.iter().map(|s| s.out * s.out.transpose()).sum();
    let spread: Matrix3<f64> = middles.iter().map(|m| (m - centre) * (m - centre).transpose()).sum();
    let onto = |axis: &Vector3<f64>| axis * axis.transpose();
    // Projections that give the errors of a centre's offset and of a normal.
    let (off, askew, rotation) = match kind.prop.name.as_str() {
        "ball" => (Matrix3::identity(), Matrix3::zeros(), aligning_rotation(&across, lean)),
        "disk" => {
            let z = eigenvector(outs + spread / (kind.half * kind.half), false);
            (Matrix3::identity(), onto(&z), aligning_rotation(&across, &z))
        }
        "rod" => {
            let z = eigenvector(spread / (MIN_CONTACT_SPREAD * MIN_CONTACT_SPREAD) - outs + 0.1 * onto(lean), true);
            (Matrix3::identity() - onto(&z), onto(&z), aligning_rotation(&across, &z))
        }
        // A slab, or two rods side by side.
        _ => (onto(&across), Matrix3::identity() - onto(&across), aligning_rotation(&across, lean)),
    };
    let count = skin.len() as f64;
    let misfit: f64 = middles.iter().map(|middle| (off * (middle - centre)).norm()).sum();
    let turned: f64 = skin.iter().map(|s| (askew * s.out).norm()).sum();
    (misfit / count / MISFIT_SCALE + turned / count + missed, Isometry3::from_parts(centre.into(), rotation))
}

pub fn propose(hand: &Hand, curls: &FreePostureTable, kind: &GraspType, rng: &mut ChaCha8Rng) -> GraspAttempt {
    let side = kind.opposition == Opposition::Side;
    let lean = if side { jitter(rng, 1.0) } else { Vector3::x() + jitter(rng, 0.3) };
    let score = |guess: &ContactGuess, enough: f64| {
        let links = guess.links(hand, curls, kind);
        let (mut misfit, place) = fit_object(kind, &guess.skin(hand, &links), &lean);
        if misfit < enough {
            misfit += curls.penetration(&links, &kind.prop, &place) / MISFIT_SCALE;
        }
        (misfit, place)
    };
    let mut best = ContactGuess::draw(kind, rng);
    let mut least = score(&best, f64::INFINITY).0;
    let mut step = FIRST_STEP;
    for n in 1..COMMAND_SAMPLES + IMPROVEMENT_STEPS {
        let guess = if n < COMMAND_SAMPLES { ContactGuess::draw(kind, rng) } else { best.vary(kind, step, rng) };
        let found = score(&guess, least).0;
        if found < least {
            (best, least) = (guess, found);
        } else if n >= COMMAND_SAMPLES {
            step *= STEP_SHRINKAGE;
        }
    }
    let mut place = score(&best, 0.0).1;
    place.translation.vector += jitter(rng, 0.002);
    place.rotation = UnitQuaternion::from_scaled_axis(jitter(rng, 0.1)) * place.rotation;
    // The tension in excess of meeting presses; the thumb presses against all fingers together.
    let light = if kind.digits.len() == 2 { LIGHT_OBJECT_FACTOR } else { 1.0 };
    let press = draw_tension(rng, PRESS_TENSIONS.0 * light, PRESS_TENSIONS.1 * light);
    let fingers = kind.digits.iter().filter(|digit| **digit != Digit::Thumb).count() as f64;
    let mut strong = [0.0; 5];
    for digit in kind.digits {
        let share = if *digit == Digit::Thumb && !side { fingers } else { 1.0 };
        let pressed = press * share * draw_in_range(rng, (-0.4, 0.4)).exp();
        strong[digit.index()] = (best.tensions[digit.index()] + pressed).min(MAX_TENSION);
    }
    for digit in kind.helpers {
        strong[digit.index()] = strong[Digit::Index.index()];
    }
    let mut attempt = GraspAttempt::new(&place, strong.into(), best.opposition);
    if kind.digits[0] != Digit::Thumb {
        // One finger presses by its springs alone and would be pushed out of the way; a locked cable does not yield.
        attempt.locked = true;
        let skins = best.skin(hand, &best.links(hand, curls, kind));
        for (digit, skin) in kind.digits.iter().zip(skins) {
            let n = digit.index();
            attempt.before[n] = best.tensions[n];
            // A contact on the finger's back is pressed by its springs as its cable slackens.
            if skin.out.z > 0.0 {
                attempt.tensions[n] = best.tensions[n] * draw_in_range(rng, REMAINING_TENSION_SHARES);
            }
        }
    }
    attempt
}

#[cfg(test)]
mod tests {
    use super::super::types;
    use super::*;

    /// Returns skin points of a thumb on one side and of fingers on the other, at `apart` along y, all on the surface
    /// of an object of this half size.
    fn around(centre: &Vector3<f64>, half: f64, apart: &[f64]) -> Vec<SkinPoint> {
        let x = Vector3::x();
        let thumb = SkinPoint { at: centre - x * half, out: x };
        let fingers = apart.iter().map(|y| SkinPoint { at: centre + x * half + Vector3::y() * *y, out: -x });
        std::iter::once(thumb).chain(fingers).collect()
    }

    /// An object that lies properly between skin points has no misfit, and one finger with an error of MISFIT costs its
    /// share.
    #[test]
    fn a_rod_and_a_ball_between_opposed_skins() {
        let kinds = types::all_types();
        let centre = Vector3::new(0.02, -0.01, -0.05);
        let (rod, ball) = (&kinds[6], &kinds[13]);
        assert_eq!((rod.prop.name.as_str(), ball.prop.name.as_str()), ("rod", "ball"));
        let (cost, place) = fit_object(rod, &around(&centre, rod.half, &[-0.02, 0.0, 0.02]), &Vector3::x());
        assert!(cost < 1e-9 && (place.translation.vector - centre).norm() < 1e-9, "{cost} {place}");
        assert!((place * Vector3::z()).y.abs() > 1.0 - 1e-9, "the rod lies along the fingers' row: {place}");
        let (cost, place) = fit_object(ball, &around(&centre, ball.half, &[0.0, 0.0]), &Vector3::x());
        assert!(cost < 1e-9 && (place.translation.vector - centre).norm() < 1e-9, "{cost} {place}");
        let mut skins = around(&centre, ball.half, &[0.0]);
        skins[1].at.z += MISFIT_SCALE;
        let (cost, _) = fit_object(ball, &skins, &Vector3::x());
        assert!((cost - 0.5).abs() < 1e-9, "both middles are half of it off: {cost}");
    }

    /// Proposals stay within the limits of a type and are the same for the same seed.
    #[test]
    fn proposals_keep_to_the_type() {
        use rand::SeedableRng;
        let hand = Hand::ftac();
        let curls = FreePostureTable::new(&hand);
        let tripod = &types::all_types()[13];
        let propose = |seed| super::propose(&hand, &curls, tripod, &mut ChaCha8Rng::seed_from_u64(seed));
        let (one, same, other) = (propose(1), propose(1), propose(2));
        assert_eq!(one.position, same.position);
        assert_ne!(one.position, other.position);
        let (low, high) = opposition_range(tripod);
        assert!((low..=high).contains(&one.opposition));
        assert!(one.tensions[..3].iter().all(|tension| (MEETING_TENSIONS.0..=MAX_TENSION).contains(tension)));
        assert_eq!(one.tensions[3..], [0.0, 0.0]);
    }

    /// Every contact point of a guess lies on the digit's cover, except for the rounding of a flank's flat part.
    #[test]
    fn places_lie_on_covers() {
        use rand::SeedableRng;
        let hand = Hand::ftac();
        let curls = FreePostureTable::new(&hand);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for kind in types::all_types().iter().filter(|kind| kind.opposition != Opposition::Palm) {
            let guess = ContactGuess::draw(kind, &mut rng);
            let links = guess.links(&hand, &curls, kind);
            for ((digit, part), skin) in guess.parts.iter().zip(guess.skin(&hand, &links)) {
                let phalanx = if let DigitPart::Flank(flank) = part { flank.phalanx } else { 2 };
                let link = digit.ftac_joints()[phalanx];
                let cover = hand.covers[link];
                let at = (links[link] * cover.link_from_cover).inverse() * Point3::from(skin.at);
                let core = at.coords.zip_map(&cover.half.add_scalar(-cover.radius), |a, b| a.clamp(-b, b));
                assert!(((at.coords - core).norm() - cover.radius).abs() < 4e-5, "{}: {part:?}", kind.name);
            }
        }
    }

    /// Between two fingers: they are preshaped, then one pulls harder and the other slackens.
    #[test]
    fn two_fingers_press_against_each_other() {
        use rand::SeedableRng;
        let hand = Hand::ftac();
        let curls = FreePostureTable::new(&hand);
        let adduction = &types::all_types()[22];
        let attempt = propose(&hand, &curls, adduction, &mut ChaCha8Rng::seed_from_u64(4));
        let [index, middle] = [1, 2].map(|n| attempt.tensions[n] / attempt.before[n]);
        assert!(index.min(middle) < REMAINING_TENSION_SHARES.1 && index.max(middle) > 1.0, "{attempt:?}");
        assert!(attempt.before[0] == 0.0 && attempt.tensions[3..] == [0.0, 0.0]);
    }
}
