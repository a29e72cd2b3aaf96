//! Objects of a scenario that are not used, with the reasons. Another benchmark never takes their place silently.

use std::fmt;

use anyhow::{Result, bail};
use dexterous_grasping::Repertoire;
use hand_model::Digit;
use world::objects::ObjectFile;

use crate::grasp_pair::GraspPairTable;
use crate::simulated_world::SimulatedWorld;

/// Error: none of the scenario's own objects can be used. Holds the reasons.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotPlayable(pub String);

impl fmt::Display for NotPlayable {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for NotPlayable {}

/// Returns the deviations of the own objects from their files.
pub fn notes(world: &SimulatedWorld) -> Vec<String> {
    let notes = |file: &ObjectFile| world.objects.get(&file.name).map(|model| file.notes(model)).unwrap_or_default();
    world.scenario.object.iter().flat_map(notes).collect()
}

/// Returns the sets of digits that would take an object in the lists that name it, with the name of each list.
fn places(world: &SimulatedWorld, name: &str) -> Vec<(Vec<Digit>, &'static str)> {
    let lists = world.scenario.object_lists().into_iter().zip(super::searched_sets(world));
    lists
        .filter(|((_, names), _)| names.iter().any(|other| other == name))
        .map(|((list, _), set)| (set, list))
        .collect()
}

/// Returns the reason why no grasp of an own object can be used in any combination, or `None` if one can.
fn unpickable(world: &SimulatedWorld, repertoire: &Repertoire, name: &str) -> Option<String> {
    let sets = places(world, name);
    if sets.is_empty() {
        return Some(format!("{name} is not used: the scenario names it neither in first nor in second"));
    }
    let places: Vec<&str> = sets.iter().map(|(_, list)| *list).collect();
    let none = sets.iter().all(|(digits, _)| repertoire.for_digits(name, digits).next().is_none());
    none.then(|| format!("{name} is not used: no grasp was found that holds it as {} object", places.join(" or ")))
}

/// Returns an error if none of the own objects can be picked up, before anything is planned.
pub fn refuse_unpickable(world: &SimulatedWorld, repertoire: &Repertoire) -> Result<()> {
    let own = &world.scenario.object;
    let reasons: Vec<String> = own.iter().filter_map(|file| unpickable(world, repertoire, &file.name)).collect();
    if own.is_empty() || reasons.len() < own.len() {
        return Ok(());
    }
    bail!(NotPlayable(format!("none of the scenario's own objects can be used: {}", reasons.join("; "))))
}

/// Returns the own objects that cannot be in any combination, with the reasons. Adds the other requests that were not
/// met to `notes`.
pub fn left_out_objects(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &GraspPairTable,
    count: usize,
    notes: &mut Vec<String>,
) -> Result<Vec<String>> {
    let scenario = &world.scenario;
    let combinations = if scenario.object_lists().len() == 1 { "objects" } else { "pairs" };
    let mut left_out = Vec::new();
    let own = scenario.object.len();
    for name in scenario.object.iter().map(|file| &file.name) {
        if plans.pairs.iter().any(|plan| plan.objects().contains(&name.as_str())) {
            continue;
        }
        let rejected = plans.rejected.iter().filter(|objects| objects.contains(name)).count();
        match unpickable(world, repertoire, name) {
            Some(reason) => left_out.push(reason),
            None if plans.pairs.len() >= count && rejected == 0 => {
                notes.push(format!("{name} is in none of the combinations: only {count} were asked for"));
            }
            None => left_out.push(format!(
                "{name} is not used: none of its {rejected} {combinations} can be done by this hand, even without errors"
            )),
        }
    }
    if own > 0 && left_out.len() == own {
        bail!(NotPlayable(format!("none of the scenario's own objects can be used: {}", left_out.join("; "))));
    }
    if plans.pairs.is_empty() {
        bail!(
            "none of the scenario's {} {combinations} can be done by this hand without noise",
            scenario.combination_count()
        );
    }
    if plans.pairs.len() < count {
        let pairs: Vec<String> = plans.rejected.iter().map(|objects| objects.join(" + ")).collect();
        notes.push(format!(
            "{} of the {} {combinations} cannot be done by this hand, even without errors: {}",
            pairs.len(),
            scenario.combination_count(),
            pairs.join(", ")
        ));
    }
    Ok(left_out)
}
