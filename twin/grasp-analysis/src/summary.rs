//! Summary of the rules' decisions on a set of grasps: the number of grasps of each type and the number that are clear,
//! as JSON and as a table.

use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::Serialize;

use crate::classification::{Classification, ClassifiedGrasp};
use crate::distribution::Distribution;
use crate::people::{self, HoldingWayShare, HumanGraspShares};
use crate::raters::RaterPair;
use dexterous_grasping::taxonomy::{Category, GraspType, Taxonomy};

/// A type with its counts.
#[derive(Debug, Serialize, JsonSchema)]
struct TypeRow {
    /// Name of the type.
    name: String,
    category: Category,
    /// Number of grasps for which it is the best type.
    grasps: usize,
    /// Number of these that meet all of its conditions.
    fit: usize,
    /// Number of these for which the decision is not ambiguous.
    clear: usize,
}

/// Type of a grasp.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TypeDecision {
    /// Name of the grasp.
    id: String,
    /// Grasp type of the paper.
    #[serde(rename = "type")]
    kind: String,
    category: Category,
    /// Margin by which all of its conditions are met. Negative if they are not.
    margin: f64,
    /// True if the type is not clear.
    ambiguous: bool,
    /// Second best type.
    second: String,
    second_margin: f64,
}

/// Counts of the three broad types.
#[derive(Debug, Serialize, JsonSchema)]
struct CategoryCounts {
    /// Number of power grasps.
    power: usize,
    /// Number of intermediate grasps.
    intermediate: usize,
    /// Number of precision grasps.
    precision: usize,
}

/// Figures of a classification, as written to `classes.json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ClassificationFigures {
    grasps: usize,
    objects: usize,
    /// Number of types with a grasp.
    types_present: usize,
    /// Number of types with a grasp that meets all conditions.
    types_fitted: usize,
    /// Number of types with a grasp that is not ambiguous.
    types_clear: usize,
    /// Number of grasps whose type is not clear.
    ambiguous: usize,
    /// Number of grasps that meet no type's conditions.
    fit_no_type: usize,
    categories: CategoryCounts,
    /// Counts of the paper's grasp types.
    types: Vec<TypeRow>,
    by_object: Distribution,
    /// Comparison with the shares of the ways in which people hold things.
    people: Vec<HoldingWayShare>,
    /// Agreement with people's labels.
    agreement: Vec<RaterPair>,
    /// Decisions, one per grasp.
    pub decisions: Vec<TypeDecision>,
}

/// Counts of one type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TypeCount {
    /// Number of grasps for which it is the best type.
    pub grasps: usize,
    /// Number of these that meet all of its conditions.
    pub fit: usize,
    /// Number of these for which the decision is not ambiguous.
    pub clear: usize,
}

/// Counts of a classification.
pub struct ClassificationSummary {
    /// Counts by object and type.
    pub distribution: Distribution,
    /// Counts by type, in the order of the taxonomy.
    pub types: Vec<TypeCount>,
    /// Numbers of power, intermediate and precision grasps.
    pub categories: [usize; 3],
    pub grasps: usize,
    /// Number of grasps whose type is ambiguous.
    pub ambiguous: usize,
    /// Number of grasps that meet no type's conditions.
    pub unfit: usize,
}

impl ClassificationSummary {
    /// Counts `classification`.
    pub fn from_classification(classification: &Classification) -> Self {
        let (taxonomy, grasps) = (&classification.taxonomy, &classification.grasps);
        let decisions = grasps.iter().map(|grasp| (classification.object(grasp), &grasp.decision));
        let distribution = Distribution::from_decisions(taxonomy, decisions);
        let totals = distribution.totals();
        let types = (0..taxonomy.types.len()).map(|kind| {
            let own = || grasps.iter().map(|grasp| &grasp.decision).filter(|decision| decision.kind == kind);
            TypeCount {
                grasps: totals.get(kind).copied().unwrap_or(0),
                fit: own().filter(|decision| decision.margin >= 0.0).count(),
                clear: own().filter(|decision| !decision.ambiguous).count(),
            }
        });
        Self {
            types: types.collect(),
            categories: distribution.categories(taxonomy),
            grasps: grasps.len(),
            ambiguous: distribution.ambiguous.iter().sum(),
            unfit: grasps.iter().filter(|grasp| grasp.decision.margin < 0.0).count(),
            distribution,
        }
    }

    fn types_with(&self, count: impl Fn(&TypeCount) -> usize) -> usize {
        self.types.iter().filter(|kind| count(kind) > 0).count()
    }

    /// Returns the number of types with a grasp.
    pub fn present(&self) -> usize {
        self.types_with(|kind| kind.grasps)
    }

    /// Returns the ways in which people hold things, with the shares of these grasps.
    fn people(&self, taxonomy: &Taxonomy) -> Vec<HoldingWayShare> {
        HumanGraspShares::builtin(taxonomy).compare(&self.distribution.totals())
    }

    /// Returns the summary, every decision and the raters' agreement.
    pub fn figures(&self, classification: &Classification, agreement: Vec<RaterPair>) -> ClassificationFigures {
        let kinds = &classification.taxonomy.types;
        let row = |(kind, count): (&GraspType, &TypeCount)| TypeRow {
            name: kind.name.clone(),
            category: kind.category,
            grasps: count.grasps,
            fit: count.fit,
            clear: count.clear,
        };
        let decision = |grasp: &ClassifiedGrasp| TypeDecision {
            id: grasp.id.clone(),
            kind: classification.type_name(grasp).to_owned(),
            category: classification.category(grasp),
            margin: round_margin(grasp.decision.margin),
            ambiguous: grasp.decision.ambiguous,
            second: kinds[grasp.decision.second.0].name.clone(),
            second_margin: round_margin(grasp.decision.second.1),
        };
        let [power, intermediate, precision] = self.categories;
        ClassificationFigures {
            grasps: self.grasps,
            objects: self.distribution.objects.len(),
            types_present: self.present(),
            types_fitted: self.types_with(|kind| kind.fit),
            types_clear: self.types_with(|kind| kind.clear),
            ambiguous: self.ambiguous,
            fit_no_type: self.unfit,
            categories: CategoryCounts { power, intermediate, precision },
            types: kinds.iter().zip(&self.types).map(row).collect(),
            by_object: self.distribution.clone(),
            people: self.people(&classification.taxonomy),
            agreement,
            decisions: classification.grasps.iter().map(decision).collect(),
        }
    }

    /// Formats the counts as a table with a line per type.
    pub fn table(&self, classification: &Classification) -> String {
        let mut text = format!(
            "{} grasps of {} objects: {} of 19 types present, {} by grasps that meet all conditions, {} by clear ones\n",
            self.grasps,
            self.distribution.objects.len(),
            self.present(),
            self.types_with(|kind| kind.fit),
            self.types_with(|kind| kind.clear)
        );
        let _ = writeln!(text, "{:24} {:13} {:>7} {:>7} {:>7}", "type", "category", "grasps", "fit", "clear");
        for (kind, count) in classification.taxonomy.types.iter().zip(&self.types) {
            let (name, category) = (&kind.name, kind.category.name());
            let _ = writeln!(text, "{name:24} {category:13} {:>7} {:>7} {:>7}", count.grasps, count.fit, count.clear);
        }
        let share = |count: usize| 100.0 * count as f64 / self.grasps as f64;
        for (category, count) in Category::ALL.iter().zip(self.categories) {
            let _ = writeln!(text, "{:24} {:13} {count:>7} ({:.1} %)", "all", category.name(), share(count));
        }
        let (ambiguous, unfit) = (self.ambiguous, self.unfit);
        let _ = writeln!(
            text,
            "ambiguous {ambiguous} ({:.1} %), of them {unfit} fit no type's conditions",
            share(ambiguous)
        );
        text + &people::table(&self.people(&classification.taxonomy))
    }
}

/// Rounds a margin to three digits. A type that is far from fitting has -99.
pub fn round_margin(margin: f64) -> f64 {
    (margin.max(-99.0) * 1e3).round() / 1e3
}
