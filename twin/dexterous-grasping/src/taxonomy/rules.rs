//! Rules that assign a type to a grasp. They are data (`data/rules.toml`): each names a type, and conditions with an
//! attribute, bounds and a reason.
//!
//! A condition's *margin* is the distance of the attribute inside the bounds in units of the condition's width, at most
//! 1, negative outside. A rule's margin is that of its worst condition, so every rule gives each grasp a number up to
//! 1, possibly far below 0. The best rule decides. If its margin is below [`TypeRules::clear`], or another type's margin is
//! within [`TypeRules::clear`] of it, the grasp is *ambiguous*, and both types are named.

use std::collections::BTreeSet;
use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use serde::{Deserialize, Serialize};

use super::Taxonomy;
use super::attributes::{ATTRIBUTES, Attributes};

/// One condition of a rule.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// Name of an attribute.
    pub attribute: String,
    /// Lower bound, in the attribute's unit.
    pub at_least: Option<f64>,
    /// Upper bound.
    pub at_most: Option<f64>,
    /// Distance inside a bound at which the condition is clearly met.
    pub width: f64,
    /// Reason why the type requires it.
    pub reason: String,
}

impl Condition {
    /// Returns the distance of `value` inside the bounds in widths, at most 1.
    fn margin(&self, value: f64) -> f64 {
        let above = self.at_least.map_or(f64::INFINITY, |bound| value - bound);
        let below = self.at_most.map_or(f64::INFINITY, |bound| bound - value);
        (above.min(below) / self.width).min(1.0)
    }

    /// Formats the bounds as text.
    fn bounds(&self) -> String {
        match (self.at_least, self.at_most) {
            (Some(low), Some(high)) => format!("{low} to {high}"),
            (Some(low), None) => format!("at least {low}"),
            (None, Some(high)) => format!("at most {high}"),
            (None, None) => "anything".into(),
        }
    }
}

/// One rule for a type. A type may have several rules.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TypeRule {
    /// Name of the type.
    #[serde(rename = "type")]
    pub kind: String,
    /// Conditions that must all hold.
    pub when: Vec<Condition>,
    /// More specific types. This type does not fit if one of them does.
    #[serde(default)]
    pub unless: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    clear: f64,
    rule: Vec<TypeRule>,
}

/// The rules of all types of a taxonomy.
///
/// ```
/// use dexterous_grasping::synthesis::held::HeldContact;
/// use dexterous_grasping::taxonomy::Taxonomy;
/// use dexterous_grasping::taxonomy::attributes::{Attributes, HoldingState, ObjectForm};
/// use dexterous_grasping::taxonomy::rules::TypeRules;
/// use hand_model::{Digit, Hand};
/// use nalgebra::{Isometry3, Vector3};
///
/// let hand = Hand::ftac();
/// let (taxonomy, mut joints) = (Taxonomy::paper(), vec![0.0; 15]);
/// // Four bent fingers carry a bar across the hand; the thumb stays clear.
/// let mut contacts = Vec::new();
/// for digit in [Digit::Index, Digit::Middle, Digit::Ring, Digit::Little] {
///     let links = hand.links(digit);
///     for &link in &links[1..] {
///         joints[link] = 1.2;
///     }
///     contacts.push(HeldContact { link: Some(links[1]), point: [0.0; 3], normal: [0.0, 0.0, 1.0], force: 2.0 });
/// }
/// let bar = ObjectForm { axis: Some(Vector3::x()), extents: [0.2, 0.02, 0.02], roundness: 0.1 };
/// let held = HoldingState { palm_from_object: Isometry3::translation(0.0, 0.0, -0.03), joints: &joints, contacts: &contacts };
///
/// let attributes = Attributes::measure(&hand, &bar, held);
/// let decision = TypeRules::builtin(&taxonomy).decide(&taxonomy, &attributes);
/// assert_eq!(taxonomy.types[decision.kind].name, "Fixed Hook");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TypeRules {
    /// Margins, and differences of margins, below this are ambiguous.
    pub clear: f64,
    rules: Vec<TypeRule>,
    resolved: Vec<ResolvedRule>,
}

/// A rule with names resolved to indices.
#[derive(Debug, Clone, PartialEq)]
struct ResolvedRule {
    kind: usize,
    attributes: Vec<usize>,
    unless: Vec<usize>,
}

/// Result of one condition.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct CheckedCondition {
    /// Name of the attribute; `unless` for a more specific type.
    pub attribute: String,
    /// Meaning of the attribute.
    pub meaning: &'static str,
    /// Value of the attribute, in its unit.
    pub value: f64,
    /// Bounds as text.
    pub bounds: String,
    /// Margin, at most 1; negative outside the bounds.
    pub margin: f64,
    /// Reason why the type requires it.
    pub reason: String,
}

/// The decision on one grasp.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RuleDecision {
    /// Index of the best type in the taxonomy.
    pub kind: usize,
    /// Margin of the best type.
    pub margin: f64,
    /// Second best type and its margin.
    pub second: (usize, f64),
    /// True if the best margin, or its lead over the second, is below [`TypeRules::clear`].
    pub ambiguous: bool,
}

impl TypeRules {
    /// Returns the shipped rules, for the paper's types.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn builtin(taxonomy: &Taxonomy) -> Self {
        let path = Path::new("rules.toml");
        Self::parse(include_str!("../../data/rules.toml"), path, taxonomy).expect("the built-in rules are valid")
    }

    /// Parses rules. Every type of `taxonomy` needs at least one. `path` is used in errors.
    ///
    /// # Errors
    /// [`DataError`] for a text that is not TOML, an unknown type or attribute, a condition without bounds or with a
    /// width that is not positive, or a type without a rule.
    pub fn parse(text: &str, path: &Path, taxonomy: &Taxonomy) -> Result<Self, DataError> {
        let File { clear, rule: rules } = parse_toml(text, path)?;
        let fault = |field: String, found: String, expected: String| DataError::field(path, field, found, expected);
        if !(0.0..=1.0).contains(&clear) {
            return Err(fault("clear".into(), clear.to_string(), "0 to 1".into()));
        }
        let mut resolved = Vec::new();
        for (n, rule) in rules.iter().enumerate() {
            let kind = taxonomy.find(&rule.kind).ok_or_else(|| {
                fault(format!("rule[{n}].type"), format!("{:?}", rule.kind), "one of the types' names".into())
            })?;
            let mut attributes = Vec::new();
            for (m, condition) in rule.when.iter().enumerate() {
                let field = |name: &str| format!("rule[{n}].when[{m}].{name}");
                attributes.push(Attributes::index(&condition.attribute).ok_or_else(|| {
                    let known: Vec<&str> = ATTRIBUTES.iter().map(|(name, _)| *name).collect();
                    fault(field("attribute"), format!("{:?}", condition.attribute), known.join(", "))
                })?);
                if !(condition.width.is_finite() && condition.width > 0.0) {
                    return Err(fault(field("width"), condition.width.to_string(), "a positive number".into()));
                }
                if condition.at_least.is_none() && condition.at_most.is_none() {
                    return Err(fault(field("at_least"), "no bound".into(), "at_least or at_most".into()));
                }
            }
            if attributes.is_empty() {
                return Err(fault(format!("rule[{n}].when"), "no condition".into(), "at least one".into()));
            }
            let unless = rule.unless.iter().map(|name| {
                let known = taxonomy.find(name).filter(|other| *other != kind);
                known.ok_or_else(|| {
                    fault(format!("rule[{n}].unless"), format!("{name:?}"), "another of the types' names".into())
                })
            });
            resolved.push(ResolvedRule { kind, attributes, unless: unless.collect::<Result<_, _>>()? });
        }
        let ruled: BTreeSet<usize> = resolved.iter().map(|rule| rule.kind).collect();
        if let Some(missing) = (0..taxonomy.types.len()).find(|kind| !ruled.contains(kind)) {
            return Err(fault(
                "rule".into(),
                format!("none for {:?}", taxonomy.types[missing].name),
                "one a type".into(),
            ));
        }
        Ok(Self { clear, rules, resolved })
    }

    /// Returns the margin of a rule's own conditions.
    fn own_margin(&self, rule: usize, attributes: &Attributes) -> f64 {
        let conditions = self.rules[rule].when.iter().zip(&self.resolved[rule].attributes);
        conditions.map(|(condition, index)| condition.margin(attributes.0[*index])).fold(1.0, f64::min)
    }

    /// Returns the best margin of type `kind` by its rules' own conditions.
    fn type_margin(&self, kind: usize, attributes: &Attributes) -> f64 {
        let own = (0..self.rules.len()).filter(|rule| self.resolved[*rule].kind == kind);
        own.map(|rule| self.own_margin(rule, attributes)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the margin of a rule: the least of its own margin and of the negated margins of more specific types.
    fn rule_margin(&self, rule: usize, attributes: &Attributes) -> f64 {
        let unless = self.resolved[rule].unless.iter().map(|kind| -self.type_margin(*kind, attributes));
        unless.fold(self.own_margin(rule, attributes), f64::min)
    }

    /// Returns the best margin of every type.
    pub fn margins(&self, types: usize, attributes: &Attributes) -> Vec<f64> {
        let mut margins = vec![f64::NEG_INFINITY; types];
        for (rule, resolved) in self.resolved.iter().enumerate() {
            margins[resolved.kind] = margins[resolved.kind].max(self.rule_margin(rule, attributes));
        }
        margins
    }

    /// Classifies one grasp. If margins are equal, the first type in the table wins and the grasp is ambiguous.
    pub fn decide(&self, taxonomy: &Taxonomy, attributes: &Attributes) -> RuleDecision {
        let mut order: Vec<(usize, f64)> =
            self.margins(taxonomy.types.len(), attributes).into_iter().enumerate().collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let (best, second) = (order[0], order.get(1).copied().unwrap_or(order[0]));
        let ambiguous = best.1 < self.clear || best.1 - second.1 < self.clear;
        RuleDecision { kind: best.0, margin: best.1, second, ambiguous }
    }

    /// Explains a decision: returns every condition of the best rule for type `kind`.
    pub fn explain(&self, kind: usize, attributes: &Attributes) -> Vec<CheckedCondition> {
        let own = (0..self.rules.len()).filter(|rule| self.resolved[*rule].kind == kind);
        let best = own.max_by(|a, b| self.rule_margin(*a, attributes).total_cmp(&self.rule_margin(*b, attributes)));
        let Some(rule) = best else { return Vec::new() };
        let conditions = self.rules[rule].when.iter().zip(&self.resolved[rule].attributes);
        let own = conditions.map(|(condition, &index)| CheckedCondition {
            attribute: condition.attribute.clone(),
            meaning: ATTRIBUTES[index].1,
            value: attributes.0[index],
            bounds: condition.bounds(),
            margin: condition.margin(attributes.0[index]),
            reason: condition.reason.clone(),
        });
        let unless =
            self.rules[rule].unless.iter().zip(&self.resolved[rule].unless).map(|(name, &kind)| CheckedCondition {
                attribute: "unless".into(),
                meaning: "margin of a more specific type",
                value: self.type_margin(kind, attributes),
                bounds: "at most 0".into(),
                margin: -self.type_margin(kind, attributes),
                reason: format!("it is not {name}"),
            });
        own.chain(unless).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TYPES: &str = r#"
        [[type]]
        name = "A"
        includes = []
        category = "power"
        definition = ""
        form = { digits = ["index"] }
        [[type]]
        name = "B"
        includes = []
        category = "precision"
        definition = ""
        form = { digits = ["index"] }
    "#;
    const RULES: &str = r#"
        clear = 0.2
        [[rule]]
        type = "A"
        when = [{ attribute = "palm", at_least = 0.3, width = 0.1, reason = "palm" }]
        [[rule]]
        type = "B"
        when = [
            { attribute = "palm", at_most = 0.3, width = 0.1, reason = "no palm" },
            { attribute = "tips", at_least = 0.5, width = 0.2, reason = "tips" },
        ]
    "#;

    fn with(palm: f64, tips: f64) -> Attributes {
        let mut values = [0.0; ATTRIBUTES.len()];
        values[Attributes::index("palm").expect("known")] = palm;
        values[Attributes::index("tips").expect("known")] = tips;
        Attributes(values)
    }

    fn small() -> (Taxonomy, TypeRules) {
        let taxonomy = Taxonomy::parse(TYPES, Path::new("t.toml")).expect("valid");
        let rules = TypeRules::parse(RULES, Path::new("r.toml"), &taxonomy).expect("valid");
        (taxonomy, rules)
    }

    #[test]
    fn clear_cases_ambiguous_ones_and_those_that_fit_nothing() {
        let (taxonomy, rules) = small();
        let decide = |palm, tips| rules.decide(&taxonomy, &with(palm, tips));
        let clear = decide(0.6, 0.1);
        assert!(clear.kind == 0 && !clear.ambiguous && clear.margin == 1.0);
        assert!(decide(0.0, 1.0).kind == 1 && !decide(0.0, 1.0).ambiguous);
        let between = decide(0.295, 0.9);
        assert!(between.kind == 1 && between.ambiguous && between.second.0 == 0, "{between:?}");
        let neither = decide(0.0, 0.0);
        assert!(neither.ambiguous && neither.margin < 0.0, "{neither:?}");
    }

    /// The more specific type has precedence over the general one if it fits.
    #[test]
    fn unless_a_more_specific_type_fits() {
        let (taxonomy, _) = small();
        let text = RULES
            .replace("{ attribute = \"palm\", at_most = 0.3, width = 0.1, reason = \"no palm\" },", "")
            .replace("type = \"A\"", "type = \"A\"\nunless = [\"B\"]");
        let rules = TypeRules::parse(&text, Path::new("r.toml"), &taxonomy).expect("valid");
        let special = rules.decide(&taxonomy, &with(0.6, 0.9));
        assert!(special.kind == 1 && !special.ambiguous && special.second == (0, -1.0), "{special:?}");
        let general = rules.decide(&taxonomy, &with(0.6, 0.1));
        assert!(general.kind == 0 && !general.ambiguous, "{general:?}");
    }

    #[test]
    fn explanation_names_value_bound_and_reason() {
        let (_, rules) = small();
        let why = rules.explain(1, &with(0.25, 0.9));
        assert_eq!(why.len(), 2);
        assert!((why[0].margin - 0.5).abs() < 1e-9 && why[0].bounds == "at most 0.3" && why[0].reason == "no palm");
        assert_eq!(why[1].margin, 1.0);
    }

    #[test]
    fn shipped_rules_cover_all_types() {
        let rules = TypeRules::builtin(&Taxonomy::paper());
        assert!(rules.rules.iter().flat_map(|rule| &rule.when).all(|condition| !condition.reason.is_empty()));
    }

    #[test]
    fn errors_name_the_field() {
        let (taxonomy, _) = small();
        for (from, to, named) in [
            ("\"tips\", at_least", "\"tops\", at_least", "rule[1].when[1].attribute"),
            ("width = 0.2", "width = 0.0", "rule[1].when[1].width"),
            ("type = \"B\"", "type = \"C\"", "rule[1].type"),
            ("type = \"B\"", "type = \"A\"", "none for \"B\""),
            ("at_least = 0.3, ", "", "rule[0].when[0].at_least"),
            ("type = \"B\"", "unless = [\"C\"]\ntype = \"B\"", "rule[1].unless"),
            ("clear = 0.2", "clear = 2.0", "clear"),
        ] {
            let error = TypeRules::parse(&RULES.replace(from, to), Path::new("r.toml"), &taxonomy).expect_err("bad");
            assert!(error.to_string().contains(named) && error.to_string().contains("r.toml"), "{error}");
        }
    }
}
