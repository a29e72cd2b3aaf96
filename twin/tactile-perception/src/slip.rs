//! Slip detection from the motion of a camera's contact patches between two images.
//!
//! A contact that rolls or is pressed harder changes its size; one that slides keeps its size and moves. The indicator is
//! the displacement of a patch's centre along the pad less what the change of its size explains.

use nalgebra::Vector2;

use crate::contacts::ContactPatch;

/// Largest displacement (m) of the same contact between two images.
const MAX_CONTACT_SHIFT: f64 = 4e-3;

/// Motion of a patch between two images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchMotion {
    /// Index of the patch in the earlier and in the later list.
    pub patches: [usize; 2],
    /// Displacement of the patch's centre in the pad's plane, m.
    pub shift: Vector2<f64>,
    /// Length of the displacement less the part that the change of size explains, m.
    pub unexplained: f64,
    /// Change of the normal force, N.
    pub force: f64,
}

impl PatchMotion {
    /// True if the unexplained displacement exceeds `threshold` (m).
    pub fn slides(&self, threshold: f64) -> bool {
        self.unexplained > threshold
    }
}

/// Matches patches of `before` and `now` on the same camera (each at most once, nearest pairs first).
pub fn match_patches(before: &[ContactPatch], now: &[ContactPatch]) -> Vec<PatchMotion> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, old) in before.iter().enumerate() {
        for (j, new) in now.iter().enumerate().filter(|(_, new)| new.camera == old.camera) {
            let distance = (new.centroid.xy() - old.centroid.xy()).norm();
            if distance < MAX_CONTACT_SHIFT {
                pairs.push((distance, i, j));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut used_before, mut used_now) = (vec![false; before.len()], vec![false; now.len()]);
    let mut slips = Vec::new();
    for (distance, i, j) in pairs {
        if used_before[i] || used_now[j] {
            continue;
        }
        (used_before[i], used_now[j]) = (true, true);
        let (old, new) = (&before[i], &now[j]);
        // A contact that grows on one side only moves its centre by up to the change of its radius.
        let radius = |patch: &ContactPatch| (patch.area / std::f64::consts::PI).sqrt();
        slips.push(PatchMotion {
            patches: [i, j],
            shift: new.centroid.xy() - old.centroid.xy(),
            unexplained: (distance - (radius(new) - radius(old)).abs()).max(0.0),
            force: new.force - old.force,
        });
    }
    slips.sort_by_key(|slip| slip.patches[0]);
    slips
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contacts::{ContactOptions, find_contacts};
    use crate::{IMAGE_SIZE as N, PIXELS};
    use hand_model::Hand;

    /// Patches of a ball of 8 mm radius pressed `depth` (m) deep at `x` on the distal pad of the index finger.
    fn ball(hand: &Hand, x: f64, depth: f64) -> Vec<ContactPatch> {
        let index = hand.find_pad("index_distal").expect("pad");
        let pad = &hand.pads[index];
        let camera = &hand.cameras[pad.cameras[0]];
        let r: f64 = 0.008;
        let height: Vec<f32> = (0..PIXELS)
            .map(|i| {
                let (px, py) = camera.pixel_center(i % N, i / N);
                let inside = r * r - (px - x).powi(2) - (py + 0.002).powi(2);
                if inside > 0.0 { (inside.sqrt() - r + depth).max(0.0) as f32 } else { 0.0 }
            })
            .collect();
        find_contacts(pad, pad.cameras[0], camera, hand.gel(), &height, &ContactOptions::default())
    }

    #[test]
    fn sliding_and_pressing_differ() {
        let hand = Hand::ftac();
        let start = ball(&hand, -0.001, 6e-4);
        let slid = match_patches(&start, &ball(&hand, 0.0, 6e-4));
        assert_eq!(slid.len(), 1);
        assert!((slid[0].shift - Vector2::new(1e-3, 0.0)).norm() < 5e-5, "{:?}", slid[0]);
        assert!(slid[0].slides(5e-4) && slid[0].force.abs() < 0.02 * start[0].force);
        let pressed = match_patches(&start, &ball(&hand, -0.001, 9e-4));
        assert!(!pressed[0].slides(1e-4) && pressed[0].force > 0.5 * start[0].force, "{:?}", pressed[0]);
    }

    #[test]
    fn another_contact_is_not_a_slip() {
        let hand = Hand::ftac();
        assert!(match_patches(&ball(&hand, -0.005, 6e-4), &ball(&hand, 0.004, 6e-4)).is_empty());
    }
}
