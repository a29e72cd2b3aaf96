//! Grasp proposals for one object: drawn from the ranges of the hand's file, or synthesized by Langevin sampling above
//! the table.

use anyhow::Result;
use dexterous_grasping::Grasp;
use dexterous_grasping::sampler::{self, HandForm, ObjectExtent};
use dexterous_grasping::synthesis::field::DistanceField;
use dexterous_grasping::synthesis::tabletop::{CarriedObject, RestingObject, TabletopProposer};
use hand_model::{Digit, Hand};
use rand::{Rng, RngExt};
use world::objects::ObjectModel;

use crate::repertoire_search::object_extent;
use crate::rollout::RolloutSnapshot;
use crate::synthesis::subject;
use crate::synthesis::synthesizer::table;

/// Number of points on the surface of the held object.
const HELD_POINTS: usize = 80;
/// Share of the synthesized proposals that leave a digit out, if that is allowed.
const FEWER_DIGITS_SHARE: f64 = 0.4;

/// Source of grasp proposals for an object with some digits.
pub struct GraspProposals<'a> {
    form: HandForm,
    digits: &'a [Digit],
    object: &'a ObjectModel,
    extent: ObjectExtent,
    field: DistanceField,
    /// One sampler for each set of digits that may take the object, the full set first. Empty for a hand with jaws.
    tabletops: Vec<TabletopProposer<'a>>,
}

impl<'a> GraspProposals<'a> {
    /// Creates proposals with `digits` of a hand that is empty or holds the `carried` object. If `fewer` is true, the
    /// synthesis leaves a digit out now and then.
    pub fn new(
        hand: &'a Hand,
        object: &'a ObjectModel,
        digits: &'a [Digit],
        carried: Option<&CarriedObject>,
        fewer: bool,
    ) -> Result<Self> {
        let sets = std::iter::once(digits.to_vec()).chain(if fewer { without_one(digits) } else { Vec::new() });
        Ok(Self {
            form: HandForm::from_hand(hand),
            digits,
            object,
            extent: object_extent(object),
            field: subject::field(object)?,
            tabletops: sets.filter_map(|digits| TabletopProposer::new(hand, digits, carried)).collect(),
        })
    }

    /// Returns the name of the object.
    pub fn object(&self) -> &str {
        &self.extent.name
    }

    /// Draws a grasp from the hand's ranges. Returns `None` if its file has no ranges for these digits.
    pub fn drawn(&self, id: u32, rng: &mut impl Rng) -> Option<Grasp> {
        sampler::propose(&self.form, &self.extent, self.digits, id, rng)
    }

    /// Synthesizes a grasp. Returns `None` if none is found.
    pub fn synthesized(&self, id: u32, rng: &mut impl Rng) -> Option<Grasp> {
        let all = self.tabletops.first()?;
        let fewer = self.tabletops.len() > 1 && rng.random::<f64>() < FEWER_DIGITS_SHARE;
        let tabletop = if fewer { &self.tabletops[rng.random_range(1..self.tabletops.len())] } else { all };
        let (table, rest) = (table(self.object), self.object.rest);
        tabletop.propose(&RestingObject { extent: &self.extent, field: &self.field, table, rest }, id, rng)
    }
}

/// Returns the sets with one digit less that can still hold: a thumb stays in the set, and so does at least one finger.
fn without_one(digits: &[Digit]) -> Vec<Vec<Digit>> {
    let left_out = digits.iter().filter(|digit| **digit != Digit::Thumb);
    let sets = left_out.map(|out| digits.iter().copied().filter(|digit| digit != out).collect::<Vec<_>>());
    sets.filter(|set| set.iter().any(|digit| *digit != Digit::Thumb)).collect()
}

/// Returns the first object as it is held in a snapshot.
pub fn carried_object(hold: &RolloutSnapshot, object: &ObjectModel) -> CarriedObject {
    let truth = hold.robot.truth();
    let palm_from_object = truth.palm.inverse() * truth.objects[0];
    let points = object.shape.surface_samples(HELD_POINTS);
    CarriedObject { points: points.iter().map(|point| (palm_from_object * point).coords).collect(), joints: truth.hand }
}

#[cfg(test)]
mod tests {
    use Digit::{Index, Little, Middle, Ring, Thumb};

    use super::*;

    /// A pinch stays a pinch. A finger alone has no digit to leave out.
    #[test]
    fn digits_that_can_be_left_out() {
        assert_eq!(without_one(&[Thumb, Index, Middle]), [[Thumb, Middle], [Thumb, Index]]);
        assert_eq!(without_one(&[Ring, Little]), [[Little], [Ring]]);
        assert!(without_one(&[Little]).is_empty() && without_one(&[Thumb, Index]).is_empty());
    }
}
