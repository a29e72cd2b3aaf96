//! Grasp type that a search is limited to.

use dexterous_grasping::synthesis::held::HeldGrasp;
use dexterous_grasping::taxonomy::Taxonomy;
use dexterous_grasping::taxonomy::attributes::{Attributes, FORM_POINTS, ObjectForm};
use dexterous_grasping::taxonomy::rules::TypeRules;
use hand_model::Hand;

use super::subject::PreparedObject;

/// A grasp type with the rules that decide on it.
pub struct GraspTypeFilter {
    taxonomy: Taxonomy,
    rules: TypeRules,
    kind: usize,
    object: ObjectForm,
}

impl GraspTypeFilter {
    /// Finds the type called `name`, for grasps of the `subject`. Returns `None` if there is no such type.
    pub fn new(name: &str, subject: &PreparedObject) -> Option<Self> {
        let taxonomy = Taxonomy::paper();
        let kind = taxonomy.find(name)?;
        let object = ObjectForm::from_points(&subject.model.shape.surface_samples(FORM_POINTS));
        Some(Self { rules: TypeRules::builtin(&taxonomy), taxonomy, kind, object })
    }

    pub fn name(&self) -> &str {
        &self.taxonomy.types[self.kind].name
    }

    /// True if a grasp is of this type and meets all of its conditions.
    pub fn matches(&self, hand: &Hand, grasp: &HeldGrasp) -> bool {
        let decision = self.rules.decide(&self.taxonomy, &Attributes::measure(hand, &self.object, grasp));
        decision.kind == self.kind && decision.margin >= 0.0
    }
}
