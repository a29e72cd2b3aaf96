//! Reasons to refuse a grasp that passed all three checks but is not possible with the hand as it is.

use dexterous_grasping::synthesis::energy::Plane;
use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::Serialize;
use sim::hand_scene::Touch;

use super::found_surface::FoundSurface;
use super::reach;
use crate::synthesis::closing::Closed;
use crate::synthesis::grasping_hand::GraspingHand;
use crate::synthesis::subject::Subject;

/// Largest share of all normal forces that fixed parts other than the palm may bear.
const MOST_LEANING: f64 = 0.05;
/// Largest distance of a contact from its link's own surface, m.
const MOST_GAP: f64 = 2e-3;
/// Cosine between the normals of two contacts below which they oppose each other.
const OPPOSED: f64 = -0.5;

/// Reason to refuse a grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// A fixed part other than the palm bears the object.
    Leans,
    /// A contact lies off its link's own surface.
    Floats,
    /// The open hand cannot reach the grasp.
    Unreachable,
}

/// Counts of refused grasps by reason.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct Refused {
    /// A fixed part other than the palm bears the object.
    pub leans_on_fixed_part: u64,
    /// A contact lies off its link's own surface.
    pub contact_off_surface: u64,
    /// The open hand cannot reach the grasp.
    pub unreachable: u64,
}

impl Refused {
    /// Returns the number of refused grasps.
    pub fn all(&self) -> u64 {
        self.leans_on_fixed_part + self.contact_off_surface + self.unreachable
    }

    /// Counts one more refused grasp.
    pub fn add(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::Leans => self.leans_on_fixed_part += 1,
            Refusal::Floats => self.contact_off_surface += 1,
            Refusal::Unreachable => self.unreachable += 1,
        }
    }
}

/// Returns the reason to refuse a closed grasp, or `None`.
pub fn of(
    hand: &GraspingHand,
    found: &FoundSurface,
    subject: &Subject,
    closed: &Closed,
    table: Option<&Plane>,
) -> Option<Refusal> {
    if leans(found, &closed.touches) {
        return Some(Refusal::Leans);
    }
    let links = closed.scene.links();
    if closed.touches.iter().any(|touch| gap(found, &links, touch) > MOST_GAP) {
        return Some(Refusal::Floats);
    }
    (!reach::reachable(hand, subject, &closed.start, &closed.open.joints, table)).then_some(Refusal::Unreachable)
}

fn leans(found: &FoundSurface, touches: &[Touch]) -> bool {
    let total: f64 = touches.iter().map(|touch| touch.force).sum();
    let fixed = touches.iter().filter(|touch| touch.link.is_none() && !found.on_palm(&touch.point));
    fixed.map(|touch| touch.force).sum::<f64>() > MOST_LEANING * total
}

/// Returns the point of the link's own surface that is nearest to a contact, root frame.
pub fn on_surface(found: &FoundSurface, links: &[Isometry3<f64>], touch: &Touch) -> Point3<f64> {
    let pose = touch.link.map_or(Isometry3::identity(), |link| links[link]);
    pose * found.on_surface(touch.link, &pose.inverse_transform_point(&touch.point))
}

/// Returns the distance of a contact from its link's own surface, m.
pub fn gap(found: &FoundSurface, links: &[Isometry3<f64>], touch: &Touch) -> f64 {
    (on_surface(found, links, touch) - touch.point).norm()
}

/// True if two digits press against each other.
pub fn opposes(hand: &GraspingHand, touches: &[Touch]) -> bool {
    let digit = |link: Option<usize>| link.map(|link| hand.sampled.tree.chain(link)[0]);
    touches.iter().enumerate().any(|(n, one)| {
        touches[n + 1..].iter().any(|other| {
            let (a, b) = (digit(one.link), digit(other.link));
            a.is_some() && b.is_some() && a != b && one.normal.dot(&other.normal) < OPPOSED
        })
    })
}
