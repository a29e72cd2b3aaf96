//! The jaws of a parallel gripper, derived from the poses of its pads.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{CoverShape, Hand};
use crate::kinematics::JointKind;

/// Largest cosine between the normals of two pads that count as opposed.
const MAX_OPPOSED_COSINE: f64 = -0.95;

/// Two pads that slide towards each other along the palm's x axis; the jaws extend along its y axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jaws {
    /// Midpoint between the pads of the open jaws, palm frame, m.
    pub center: Point3<f64>,
    /// Distance between the pads of the open jaws, m.
    pub opening: f64,
    /// Reach of the jaws beyond the pads' midpoint, m.
    pub tip_reach: f64,
    /// Distance from the pads' midpoint back to the front of the palm, m.
    pub depth: f64,
}

impl Hand {
    /// Returns the jaws if the hand is a parallel gripper: two digits with one sliding joint and one pad each, the pads
    /// facing each other.
    pub fn jaws(&self) -> Option<Jaws> {
        let sliding = self.tree.joints.iter().all(|joint| joint.kind == JointKind::Slide);
        if self.digits().len() != 2 || self.tree.len() != 2 || self.pads.len() != 2 || !sliding {
            return None;
        }
        let links = self.tree.forward(&self.open_angles());
        let [one, other] = <[_; 2]>::try_from(self.pad_poses(&links)).ok()?;
        let (facing, apart) = (one * Vector3::z(), other.translation.vector - one.translation.vector);
        if facing.dot(&(other * Vector3::z())) > MAX_OPPOSED_COSINE || facing.dot(&apart) <= 0.0 {
            return None;
        }
        let center = Point3::from(0.5 * (one.translation.vector + other.translation.vector));
        let front = |cover: &CoverShape, pose: &Isometry3<f64>| {
            let place = pose * cover.link_from_cover;
            let along = place.rotation.inverse() * Vector3::y();
            place.translation.y + along.abs().dot(&cover.half)
        };
        let tip = links.iter().zip(&self.covers).map(|(link, cover)| front(cover, link)).fold(f64::MIN, f64::max);
        let palm = front(&self.palm_cover, &Isometry3::identity());
        Some(Jaws { center, opening: facing.dot(&apart), tip_reach: tip - center.y, depth: center.y - palm })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn a_gripper_has_jaws_and_a_hand_has_none() {
        let text = include_str!("../../data/robots/franka_hand.toml");
        let jaws = Hand::parse(text, Path::new("franka_hand.toml")).expect("valid").jaws().expect("jaws");
        // 80 mm of stroke; pads 48 mm and tips 58.5 mm from the base of the fingers.
        assert!((jaws.opening - 0.08).abs() < 1e-12, "{jaws:?}");
        assert!((jaws.tip_reach - 0.0105).abs() < 1e-12 && (jaws.depth - 0.0404).abs() < 1e-12, "{jaws:?}");
        assert!((jaws.center - Point3::new(0.0, -0.0008, 0.0)).norm() < 1e-12, "{jaws:?}");
        assert_eq!(Hand::ftac().jaws(), None);
    }
}
