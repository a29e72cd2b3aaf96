//! Reachability of a point by the thumb's tip if every joint could be set freely: the limit set by the hand's geometry,
//! without its cables, springs and servos.
//!
//! Random postures within the joints' limits are drawn, and the best of them are improved by random steps of shrinking
//! size.

use hand_model::{Digit, Hand, HandVector};
use nalgebra::Point3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use sim::test_stand::self_penetration_at;

use super::target::{KapandjiTarget, OVERLAP_TOLERANCE, distance};

/// Numbers of random postures, of those checked for overlap, and of those improved.
const POSTURE_SAMPLES: usize = 4000;
const CHECKED_POSTURES: usize = 120;
const IMPROVED_POSTURES: usize = 6;
/// Number of improvement steps, size of the first (rad), and shrink factor after each step without improvement.
const IMPROVEMENT_STEPS: usize = 250;
const FIRST_STEP: f64 = 0.25;
const STEP_SHRINKAGE: f64 = 0.97;
/// Penalty factor of overlap relative to distance.
const OVERLAP_PENALTY: f64 = 10.0;

/// Smallest distances of the thumb's tip from a point, m.
#[derive(Debug, Clone, Copy)]
pub struct Reach {
    /// Over all postures within the joints' limits, whether or not covers intersect.
    pub unconstrained: f64,
    /// Over the postures with no more overlap than the check allows.
    pub without_overlap: f64,
}

/// Searches for both distances. Joints that belong neither to the thumb nor to the target's finger stay at 0.
pub fn reach(hand: &Hand, target: &KapandjiTarget, tip: &[Point3<f64>], rng: &mut ChaCha8Rng) -> Reach {
    let mut joints = Digit::Thumb.ftac_joints().to_vec();
    joints.extend(target.link.into_iter().flat_map(|link| Digit::ALL[link / 3].ftac_joints()));
    let away = |angles: &[f64]| distance(target, tip, &hand.tree.forward(angles));
    let clear = |angles: &[f64]| {
        away(angles) + OVERLAP_PENALTY * (self_penetration_at(hand, angles) - OVERLAP_TOLERANCE).max(0.0)
    };
    let mut looks: Vec<(f64, HandVector)> = (0..POSTURE_SAMPLES)
        .map(|_| {
            let mut angles = hand.open_angles();
            for &joint in &joints {
                angles[joint] = rng.random_range(hand.tree.joints[joint].lower..hand.tree.joints[joint].upper);
            }
            (away(&angles), angles)
        })
        .collect();
    looks.sort_by(|a, b| a.0.total_cmp(&b.0));
    looks.truncate(CHECKED_POSTURES);
    let any = improve(hand, &joints, &looks, away, rng);
    for (cost, angles) in &mut looks {
        *cost = clear(angles);
    }
    looks.sort_by(|a, b| a.0.total_cmp(&b.0));
    Reach { unconstrained: any, without_overlap: improve(hand, &joints, &looks, clear, rng) }
}

/// Returns the smallest cost found from the first of `starts` (sorted by cost).
fn improve(
    hand: &Hand,
    joints: &[usize],
    starts: &[(f64, HandVector)],
    cost: impl Fn(&[f64]) -> f64,
    rng: &mut ChaCha8Rng,
) -> f64 {
    let mut least = f64::INFINITY;
    for (start, angles) in starts.iter().take(IMPROVED_POSTURES) {
        let (mut best, mut at, mut step) = (*start, *angles, FIRST_STEP);
        for _ in 0..IMPROVEMENT_STEPS {
            let mut tried = at;
            for &joint in joints {
                let limits = &hand.tree.joints[joint];
                tried[joint] = (at[joint] + step * rng.random_range(-1.0..1.0)).clamp(limits.lower, limits.upper);
            }
            let found = cost(&tried);
            if found < best {
                (best, at) = (found, tried);
            } else {
                step *= STEP_SHRINKAGE;
            }
        }
        least = least.min(best);
    }
    least
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use rand::SeedableRng;

    use super::super::target::thumb_tip;
    use super::*;

    fn target(point: Point3<f64>) -> KapandjiTarget {
        KapandjiTarget { name: "test", link: None, points: vec![point] }
    }

    /// A point that the tip touches in a known posture is reached, and a point far from the hand stays as far as it is.
    #[test]
    fn known_points() {
        let hand = Hand::ftac();
        let tip = thumb_tip(&hand);
        let mut angles = hand.open_angles();
        for (joint, angle) in Digit::Thumb.ftac_joints().into_iter().zip([0.9, 0.4, 0.3]) {
            angles[joint] = angle;
        }
        let link = hand.tree.forward(&angles)[Digit::Thumb.ftac_joints()[2]];
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let near = reach(&hand, &target(link * tip[0]), &tip, &mut rng);
        assert!(near.unconstrained < 1e-3 && near.without_overlap < 1.5e-3, "{near:?}");
        let far = reach(&hand, &target(Point3::from(Vector3::new(0.0, -1.0, 0.0))), &tip, &mut rng);
        assert!(far.unconstrained > 0.8 && far.without_overlap >= far.unconstrained - 1e-3, "{far:?}");
    }
}
