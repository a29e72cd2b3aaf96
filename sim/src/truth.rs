//! Ground truth of a scene, for the referee and the recorder only.

use hand_model::DigitVector;
use nalgebra::{Isometry3, Vector3};
use world::holding::SupportState;

/// A contact of an object with the hand, for the referee and the recording.
#[derive(Debug, Clone, Copy)]
pub struct HandContact {
    /// Index of the object.
    pub object: usize,
    /// Link of the hand; `None` for the palm.
    pub link: Option<usize>,
    /// Contact point, world, m.
    pub point: nalgebra::Point3<f64>,
    /// Normal force on the object, world frame, N.
    pub force: Vector3<f64>,
}

/// A contact between two objects, for the referee.
#[derive(Debug, Clone, Copy)]
pub struct ObjectContact {
    /// Indices of the objects, the lower one first.
    pub objects: (usize, usize),
    /// Contact point, world, m.
    pub point: nalgebra::Point3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// Ground truth of one tick. Only the referee and the recorder may see it.
#[derive(Debug, Clone, Default)]
pub struct GroundTruth {
    /// Time, s.
    pub time: f64,
    /// `world_from_object`.
    pub objects: Vec<Isometry3<f64>>,
    /// Linear velocity of each object, m/s.
    pub velocities: Vec<Vector3<f64>>,
    /// `world_from_palm`.
    pub palm: Isometry3<f64>,
    /// World poses of the arm's links.
    pub arm_links: Vec<Isometry3<f64>>,
    /// World poses of the hand's links.
    pub hand_links: Vec<Isometry3<f64>>,
    /// Finger angles, rad.
    pub hand: Vec<f64>,
    /// Cable tensions, N.
    pub tensions: DigitVector,
    /// Contacts between hand and objects at the last step of the tick.
    pub contacts: Vec<HandContact>,
    /// Contacts between objects at the last step of the tick.
    pub object_contacts: Vec<ObjectContact>,
    /// Links that touched each object at any step of the tick, as bits: bit i for link i, bit
    /// [`hand_model::hand::MAX_HAND_JOINTS`] for the palm.
    pub touched_by: Vec<u32>,
    /// Pairs of objects that touched at any step of the tick.
    pub object_pairs: Vec<(usize, usize)>,
    /// Objects that touched the table at any step of the tick.
    pub on_table: Vec<bool>,
    /// True if hand or wrist touched table or floor, or the wrist an object, at any step of the tick.
    pub collides: bool,
    /// Normal force on each pad, N.
    pub pad_forces: Vec<f64>,
}

impl GroundTruth {
    /// Returns the support of object `index`, for [`world::holding::HoldingRule`].
    pub fn support(&self, index: usize) -> SupportState {
        let at = self.objects[index].translation.vector;
        SupportState {
            held: self.touched_by[index] != 0,
            on_table: self.on_table[index],
            distance: (at - self.palm.translation.vector).norm(),
            height: at.z,
        }
    }
}

#[cfg(test)]
mod tests {
    use hand_model::hand::MAX_HAND_JOINTS;

    use super::*;
    use world::holding::{GRIPPED_RULE, LIFTED_RULE};

    /// A palm 20 cm over the table with an object 5 cm under it.
    fn held() -> GroundTruth {
        GroundTruth {
            objects: vec![Isometry3::translation(0.5, 0.0, 0.15)],
            palm: Isometry3::translation(0.5, 0.0, 0.2),
            touched_by: vec![1 << MAX_HAND_JOINTS],
            on_table: vec![false],
            ..GroundTruth::default()
        }
    }

    #[test]
    fn an_object_under_the_palm_is_held() {
        let support = held().support(0);
        assert!((support.distance - 0.05).abs() < 1e-12 && (support.height - 0.15).abs() < 1e-12);
        assert!(LIFTED_RULE.holds(&support));
    }

    #[test]
    fn what_is_untouched_on_the_table_or_far_is_not() {
        let change = |by: fn(&mut GroundTruth)| {
            let mut truth = held();
            by(&mut truth);
            GRIPPED_RULE.holds(&truth.support(0))
        };
        assert!(change(|_| ()));
        assert!(!change(|truth| truth.touched_by[0] = 0));
        assert!(!change(|truth| truth.on_table[0] = true));
        assert!(!change(|truth| truth.palm.translation.z = 0.4));
    }
}
