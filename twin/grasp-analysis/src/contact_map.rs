//! Contact maps: the distance of every part of the hand from the object, as one vector per grasp (supplement, "2D
//! cluster map").
//!
//! Omega = log(eps1 + min(D, eps2)) at 2,170 points all around the hand, with D the distance to the object's surface in
//! metres. The logarithm resolves small distances; eps2 clips large ones.

use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array};
use dexterous_grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use nalgebra::{Isometry3, Point3};

/// Number of points on the hand.
pub const HAND_POINT_COUNT: usize = 2170;
/// Offset that keeps the logarithm finite, m.
pub const LOG_OFFSET: f64 = 1e-4;
/// Distance at which larger distances are clipped, m.
pub const CLIP_DISTANCE: f64 = 0.05;

/// A point fixed to a link: 0 is the palm, i + 1 the link that joint i moves; m, link frame.
pub type HandPoint = (usize, Point3<f64>);

/// Returns [`HAND_POINT_COUNT`] points distributed evenly over the covers of `hand`.
pub fn hand_points(hand: &Hand) -> Vec<HandPoint> {
    let surface = HandSurface::new(hand, HAND_POINT_COUNT);
    let all: Vec<HandPoint> = surface
        .links
        .iter()
        .enumerate()
        .flat_map(|(link, own)| own.points.iter().map(move |point| (link, Point3::from(*point))))
        .collect();
    // The surface has a few points too many, so some are dropped evenly.
    (0..HAND_POINT_COUNT).map(|n| all[n * all.len() / HAND_POINT_COUNT]).collect()
}

/// Computes Omega of a signed distance, m.
pub fn omega(distance: f64) -> f64 {
    (LOG_OFFSET + distance.abs().min(CLIP_DISTANCE)).ln()
}

/// Computes the contact map of `grasp`: Omega at each of `points`. `distance` is the object's signed distance, m,
/// object frame.
pub fn contact_map(
    hand: &Hand,
    points: &[HandPoint],
    grasp: &HeldGrasp,
    distance: impl Fn(&Point3<f64>) -> f64,
) -> Vec<f64> {
    let object_from_palm = pose_from_array(&grasp.closed).inverse();
    let mut links = vec![Isometry3::identity()];
    links.extend(hand.tree.forward(&grasp.joints));
    let placed: Vec<Isometry3<f64>> = links.iter().map(|link| object_from_palm * link).collect();
    points.iter().map(|(link, point)| omega(distance(&(placed[*link] * point)))).collect()
}

/// Normalises every point's values to mean 0 and variance 1 over all maps. Constant values become 0.
pub fn normalize(maps: &mut [Vec<f64>]) {
    let n = maps.len() as f64;
    for point in 0..maps.first().map_or(0, Vec::len) {
        let mean = maps.iter().map(|map| map[point]).sum::<f64>() / n;
        let variance = maps.iter().map(|map| (map[point] - mean).powi(2)).sum::<f64>() / n;
        let scale = if variance > 1e-18 { variance.sqrt().recip() } else { 0.0 };
        maps.iter_mut().for_each(|map| map[point] = (map[point] - mean) * scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_grasp::grasp;

    #[test]
    fn omega_at_its_ends() {
        assert!((omega(0.0) - 1e-4_f64.ln()).abs() < 1e-12);
        assert!((omega(1.0) - 0.0501_f64.ln()).abs() < 1e-12 && omega(1.0) == omega(0.05));
        assert_eq!(omega(-0.003), omega(0.003));
    }

    /// A ball 40 mm in front of the palm's centre, with the hand open: every point has its distance in the palm frame.
    #[test]
    fn map_of_a_ball() {
        let hand = Hand::ftac();
        let points = hand_points(&hand);
        assert_eq!(points.len(), HAND_POINT_COUNT);
        let held = grasp(0.0, &[]);
        let map = contact_map(&hand, &points, &held, |p| p.coords.norm() - 0.02);
        let center = Point3::new(0.0, 0.0, -0.04);
        let links = hand.tree.forward(&held.joints);
        for ((link, point), found) in points.iter().zip(&map) {
            let in_palm = if *link == 0 { *point } else { links[link - 1] * point };
            assert!((found - omega((in_palm - center).norm() - 0.02)).abs() < 1e-9, "link {link}");
        }
        assert!(map.iter().any(|value| (value - omega(1.0)).abs() < 1e-12), "something is far");
    }

    #[test]
    fn normalized_values_have_mean_0_and_variance_1() {
        let mut maps = vec![vec![1.0, 5.0], vec![3.0, 5.0], vec![8.0, 5.0]];
        normalize(&mut maps);
        let (mean, square): (f64, f64) = maps.iter().fold((0.0, 0.0), |(m, s), map| (m + map[0], s + map[0] * map[0]));
        assert!(mean.abs() < 1e-12 && (square / 3.0 - 1.0).abs() < 1e-12);
        assert!(maps.iter().all(|map| map[1] == 0.0));
    }
}
