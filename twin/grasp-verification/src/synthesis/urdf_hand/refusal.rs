//! Reasons to refuse a grasp that passed all three checks but is not possible with the hand as it is.

use dexterous_grasping::synthesis::energy::TablePlane;
use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::Serialize;
use sim::hand_scene::SceneContact;

use super::derived_surface::DerivedSurface;
use super::reach;
use crate::synthesis::closing::ClosedGrasp;
use crate::synthesis::grasping_hand::GraspingHand;
use crate::synthesis::subject::PreparedObject;

/// Largest share of all normal forces that fixed parts other than the palm may bear.
const MAX_FIXED_PART_SHARE: f64 = 0.05;
/// Largest distance of a contact from its link's own surface, m.
const MAX_SURFACE_GAP: f64 = 2e-3;
/// Cosine between the normals of two contacts below which they oppose each other.
const OPPOSED_COSINE: f64 = -0.5;

/// Reason to refuse a grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalReason {
    /// A fixed part other than the palm bears the object.
    Leans,
    /// A contact lies off its link's own surface.
    Floats,
    /// The open hand cannot reach the grasp.
    Unreachable,
}

/// Counts of refused grasps by reason.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct RefusalCounts {
    /// A fixed part other than the palm bears the object.
    pub leans_on_fixed_part: u64,
    /// A contact lies off its link's own surface.
    pub contact_off_surface: u64,
    /// The open hand cannot reach the grasp.
    pub unreachable: u64,
}

impl RefusalCounts {
    /// Returns the number of refused grasps.
    pub fn total(&self) -> u64 {
        self.leans_on_fixed_part + self.contact_off_surface + self.unreachable
    }

    /// Counts one more refused grasp.
    pub fn add(&mut self, refusal: RefusalReason) {
        match refusal {
            RefusalReason::Leans => self.leans_on_fixed_part += 1,
            RefusalReason::Floats => self.contact_off_surface += 1,
            RefusalReason::Unreachable => self.unreachable += 1,
        }
    }
}

/// Returns the reason to refuse a closed grasp, or `None`.
pub fn reason_to_refuse(
    hand: &GraspingHand,
    found: &DerivedSurface,
    subject: &PreparedObject,
    closed: &ClosedGrasp,
    table: Option<&TablePlane>,
) -> Option<RefusalReason> {
    if leans(found, &closed.touches) {
        return Some(RefusalReason::Leans);
    }
    let links = closed.scene.links();
    if closed.touches.iter().any(|touch| surface_gap(found, &links, touch) > MAX_SURFACE_GAP) {
        return Some(RefusalReason::Floats);
    }
    (!reach::reachable(hand, subject, &closed.start, &closed.open.joints, table)).then_some(RefusalReason::Unreachable)
}

fn leans(found: &DerivedSurface, touches: &[SceneContact]) -> bool {
    let total: f64 = touches.iter().map(|touch| touch.force).sum();
    let fixed = touches.iter().filter(|touch| touch.link.is_none() && !found.on_palm(&touch.point));
    fixed.map(|touch| touch.force).sum::<f64>() > MAX_FIXED_PART_SHARE * total
}

/// Returns the point of the link's own surface that is nearest to a contact, root frame.
pub fn on_surface(found: &DerivedSurface, links: &[Isometry3<f64>], touch: &SceneContact) -> Point3<f64> {
    let pose = touch.link.map_or(Isometry3::identity(), |link| links[link]);
    pose * found.on_surface(touch.link, &pose.inverse_transform_point(&touch.point))
}

/// Returns the distance of a contact from its link's own surface, m.
pub fn surface_gap(found: &DerivedSurface, links: &[Isometry3<f64>], touch: &SceneContact) -> f64 {
    (on_surface(found, links, touch) - touch.point).norm()
}

/// True if two digits press against each other.
pub fn has_opposed_digits(hand: &GraspingHand, touches: &[SceneContact]) -> bool {
    let digit = |link: Option<usize>| link.map(|link| hand.sampled.tree.chain(link)[0]);
    touches.iter().enumerate().any(|(n, one)| {
        touches[n + 1..].iter().any(|other| {
            let (a, b) = (digit(one.link), digit(other.link));
            a.is_some() && b.is_some() && a != b && one.normal.dot(&other.normal) < OPPOSED_COSINE
        })
    })
}
