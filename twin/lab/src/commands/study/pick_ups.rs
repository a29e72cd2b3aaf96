//! `ftac grasps classify --pairs`: types of the benchmark's grasps, by the position of their object in the combination.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use dexterous_grasping::taxonomy::attributes::{Attributes, FORM_POINTS, HoldingState, ObjectForm};
use dexterous_grasping::taxonomy::rules::TypeRules;
use dexterous_grasping::taxonomy::{Category, Taxonomy};
use ftac::lab::arguments::grasps::BUILT_IN_PLANS;
use ftac::terminal::{CommandOutput, Terminal};
use grasp_analysis::people::{self, HoldingWayShare, HumanGraspShares};
use grasp_analysis::summary::round_margin;
use grasp_verification::grasp_pair::{GraspPairTable, holds};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::RobotModel;
use scenarios::Scenario;
use schemars::JsonSchema;
use serde::Serialize;

/// A grasp with its type.
#[derive(Debug, Serialize, JsonSchema)]
struct TypedGrasp {
    /// Names of the objects of its combination.
    combination: [String; 2],
    /// Position of its object in the combination, from 1.
    place: usize,
    grasp: u32,
    /// Grasp type of the paper.
    #[serde(rename = "type")]
    kind: String,
    /// Margin by which all conditions of the type are met; negative if they are not.
    margin: f64,
    /// True if the type is ambiguous.
    ambiguous: bool,
}

/// Grasps of one type.
#[derive(Debug, Serialize, JsonSchema)]
struct TypeRow {
    name: String,
    category: Category,
    /// Numbers of grasps of first and of second objects.
    places: [usize; 2],
    /// Number of those that meet all conditions of the type.
    fit: usize,
}

/// Grasp types of the grasp pair table.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RepertoireTypes {
    /// Grasp types of the paper.
    types: Vec<TypeRow>,
    /// Comparison with the shares in which people use each way of holding.
    people: Vec<HoldingWayShare>,
    pick_ups: Vec<TypedGrasp>,
}

impl RepertoireTypes {
    fn text(&self) -> String {
        let present = self.types.iter().filter(|kind| kind.places != [0, 0]).count();
        let mut text = format!("{} grasps of {present} of {} types\n", self.pick_ups.len(), self.types.len());
        text += &format!("{:24} {:13} {:>7} {:>7} {:>7}\n", "type", "category", "first", "second", "fit");
        for TypeRow { name, category, places: [first, second], fit } in &self.types {
            text += &format!("{name:24} {:13} {first:>7} {second:>7} {fit:>7}\n", category.name());
        }
        text + &people::table(&self.people)
    }
}

/// Simulates the grasps of the grasp pair table in the file, or of the built-in one, and assigns each its type.
pub fn make(terminal: &Terminal, file: &Path) -> Result<CommandOutput<RepertoireTypes>> {
    let plans = if file == Path::new(BUILT_IN_PLANS) {
        grasp_verification::builtin::grasp_pairs()?
    } else {
        GraspPairTable::read(file)?
    };
    let robot = RobotModel::ftac_gen3();
    let world = SimulatedWorld::new(&robot, Scenario::benchmark())?;
    let quiet = terminal.quiet || terminal.json;
    let held = holds::holds_of_pairs(&world, &grasp_verification::builtin::repertoire()?, &plans, quiet)?;
    let taxonomy = Taxonomy::paper();
    let rules = TypeRules::builtin(&taxonomy);
    let mut forms: BTreeMap<&str, ObjectForm> = BTreeMap::new();
    let mut pick_ups = Vec::new();
    let mut types: Vec<TypeRow> = taxonomy
        .types
        .iter()
        .map(|kind| TypeRow { name: kind.name.clone(), category: kind.category, places: [0; 2], fit: 0 })
        .collect();
    for one in &held {
        let object = one.grasp.object.as_str();
        if !forms.contains_key(object) {
            forms.insert(object, ObjectForm::from_points(&world.object(object)?.shape.surface_samples(FORM_POINTS)));
        }
        let hold =
            HoldingState { palm_from_object: one.palm_from_object, joints: &one.joints, contacts: &one.contacts };
        let decision = rules.decide(&taxonomy, &Attributes::measure(&robot.hand, &forms[object], hold));
        let row = &mut types[decision.kind];
        row.places[one.place] += 1;
        row.fit += usize::from(decision.margin >= 0.0);
        pick_ups.push(TypedGrasp {
            combination: one.combination.clone(),
            place: one.place + 1,
            grasp: one.grasp.id,
            kind: row.name.clone(),
            margin: round_margin(decision.margin),
            ambiguous: decision.ambiguous,
        });
    }
    let counts: Vec<usize> = types.iter().map(|kind| kind.places.iter().sum()).collect();
    let answer = RepertoireTypes { types, people: HumanGraspShares::builtin(&taxonomy).compare(&counts), pick_ups };
    Ok(CommandOutput { text: answer.text(), json: answer, shortfall: None })
}
