//! Classification: a set of verified grasps, each with its measured attributes and the type that the rules assign.

use dexterous_grasping::synthesis::held::HeldGrasp;
use hand_model::Hand;

use dexterous_grasping::taxonomy::attributes::{Attributes, ObjectForm};
use dexterous_grasping::taxonomy::rules::{RuleDecision, TypeRules};
use dexterous_grasping::taxonomy::{Category, Taxonomy};

/// A grasp with its type.
pub struct ClassifiedGrasp {
    /// Name, `object/chain`.
    pub id: String,
    /// Index of the object in [`Classification::objects`].
    pub object: usize,
    /// The grasp as it was held.
    pub grasp: HeldGrasp,
    /// Attributes on which the rules decide.
    pub attributes: Attributes,
    /// Decision of the rules.
    pub decision: RuleDecision,
}

/// Error: the same grasp was added twice.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("chain: found {0} twice, expected each grasp once")]
pub struct DuplicateGrasp(pub String);

/// Classified grasps, object by object.
pub struct Classification {
    /// The 19 types.
    pub taxonomy: Taxonomy,
    /// The rules that decide.
    pub rules: TypeRules,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// The grasps of the first object, then those of the second, and so on.
    pub grasps: Vec<ClassifiedGrasp>,
}

impl Default for Classification {
    /// Starts without grasps, with the paper's types and the built-in rules.
    fn default() -> Self {
        let taxonomy = Taxonomy::paper();
        let rules = TypeRules::builtin(&taxonomy);
        Self { taxonomy, rules, objects: Vec::new(), grasps: Vec::new() }
    }
}

impl Classification {
    /// Adds an object. Grasps that are added later are of this object.
    pub fn add_object(&mut self, name: &str) {
        self.objects.push(name.to_owned());
    }

    /// Classifies `grasp` of the object added last, whose form is `form`.
    pub fn add(&mut self, hand: &Hand, form: &ObjectForm, grasp: HeldGrasp) -> Result<(), DuplicateGrasp> {
        let object = self.objects.len().saturating_sub(1);
        let id = format!("{}/{}", self.objects.get(object).map_or("", String::as_str), grasp.chain);
        if self.find(&id).is_some() {
            return Err(DuplicateGrasp(id));
        }
        let attributes = Attributes::measure(hand, form, &grasp);
        let decision = self.rules.decide(&self.taxonomy, &attributes);
        self.grasps.push(ClassifiedGrasp { id, object, grasp, attributes, decision });
        Ok(())
    }

    /// Returns the grasp called `id`.
    pub fn find(&self, id: &str) -> Option<&ClassifiedGrasp> {
        self.grasps.iter().find(|grasp| grasp.id == id)
    }

    /// Returns the name of a grasp's object.
    pub fn object(&self, grasp: &ClassifiedGrasp) -> &str {
        &self.objects[grasp.object]
    }

    /// Returns the name of a grasp's type.
    pub fn type_name(&self, grasp: &ClassifiedGrasp) -> &str {
        &self.taxonomy.types[grasp.decision.kind].name
    }

    /// Returns the broad type of a grasp.
    pub fn category(&self, grasp: &ClassifiedGrasp) -> Category {
        self.taxonomy.types[grasp.decision.kind].category
    }

    /// Returns the number of grasps of a broad type.
    pub fn count(&self, category: Category) -> usize {
        self.grasps.iter().filter(|grasp| self.category(grasp) == category).count()
    }
}
