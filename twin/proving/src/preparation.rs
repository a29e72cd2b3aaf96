//! Preparation: grasps and plans for a scenario that has objects or pairs of a user's own.
//!
//! What comes with the program is used where it fits. Objects of the user's own are searched for pick-ups in physics, for the roles in
//! which the scenario names them, and pairs without a plan are planned and tried under errors, both by the rules of the benchmark
//! itself. Each result is kept in a [`Cache`], so that an interrupted preparation goes on where it was, and a second run begins at once.

use std::time::Instant;

use anyhow::{Context, Result};
use grasping::{Grasp, Repertoire, Role};
use scenarios::Scenario;
use scenarios::combination::Combination;
use scenarios::effects::Effect;
use scenarios::geometry::Shape;
use scenarios::objects::ObjectModel;
use serde::Serialize;
use sim::tactile::TactileBoard;

use crate::cache::{Cache, Key};
use crate::pick_ups::{self, Effort};
use crate::plan::{self, Plan, Plans, other_order, outcomes};
use crate::world::World;

/// Rises when a rule of the search changes, or the engine does: what was kept is then searched anew.
const RULES: u32 = 2;
/// Draws the proposals of pick-ups: they do not depend on a run's own seed.
const SEED: u64 = 1;
/// The work that goes into each object and role, as for the benchmark's own.
pub const EFFORT: Effort = Effort { proposals: 128, variations: 64, keep_first: 4, keep_second: 14 };

/// What trials of a scenario choose from.
pub struct Prepared {
    pub repertoire: Repertoire,
    pub plans: Plans,
}

/// Grasps and plans for `count` combinations of the world's scenario, drawn by `seed`.
pub fn prepare(world: &World, count: usize, seed: u64, cache: &Cache, quiet: bool) -> Result<Prepared> {
    let mut repertoire = crate::builtin::repertoire()?;
    repertoire.seed = SEED;
    let own = searches(world);
    if !own.is_empty() && !quiet {
        eprintln!(
            "looking for grasps of the scenario's own objects, some minutes each; what is found is kept in {}",
            cache.folder().display()
        );
    }
    let begun = Instant::now();
    for (n, (object, role)) in own.iter().enumerate() {
        let grasps = pick_up(world, &repertoire, (object, *role), cache, quiet)?;
        if !quiet {
            let minutes = begun.elapsed().as_secs_f64() / 60.0;
            eprintln!("{:3} of {}  {}  {minutes:5.1} min", n + 1, own.len(), found(object, *role, grasps.len()));
        }
        for grasp in grasps {
            repertoire.insert(grasp);
        }
    }
    let known = known_plans(&world.scenario)?;
    let planned = known.as_ref().map_or(0, |known| known.plans.len());
    if !quiet && (count > planned || !own.is_empty()) {
        eprintln!(
            "planning combinations that are not among the {planned} that come with the program, in physics, about half a minute each; what is found is kept in {}",
            cache.folder().display()
        );
    }
    let board = TactileBoard::unit(&world.cell.hand, 0);
    let plans = plan::make_plans(&world.scenario, count, seed, quiet, |pair| {
        if let Some(known) = &known
            && let Some(decided) = known.of(pair)
        {
            return Ok(decided.cloned());
        }
        cache.get_or(&pair_key(world, &repertoire, pair)?, || plan_with_odds(world, &repertoire, &board, pair))
    });
    let plans = plans.with_context(|| unpickable(world, &repertoire))?;
    Ok(Prepared { repertoire, plans })
}

/// What was found of an object in a role, in words.
fn found(object: &ObjectModel, role: Role, count: usize) -> String {
    let (order, digits) = match role {
        Role::First => ("first", "ring and little finger"),
        Role::Second => ("second", "thumb, index and middle finger"),
    };
    if count > 0 {
        return format!("{}: {count} grasps by {digits}", object.name);
    }
    let (low, high) = object.shape.aabb();
    let [x, y, z] = (high - low).map(|side| (1e3 * side).round()).into();
    format!(
        "{} ({x} x {y} x {z} mm, {} kg): none of {} tries by {digits} held it, so it cannot come {order}",
        object.name, object.mass, EFFORT.proposals
    )
}

/// The scenario's own objects and the ways in which they can have fallen, with the roles in which they are to be picked up.
fn searches(world: &World) -> Vec<(&ObjectModel, Role)> {
    let scenario = &world.scenario;
    let mut searches = Vec::new();
    for file in &scenario.object {
        let Some(object) = world.objects.get(&file.name) else { continue };
        if scenario.first.contains(&file.name) {
            searches.push((&**object, Role::First));
        }
        if scenario.second.contains(&file.name) {
            searches.push((&**object, Role::Second));
            searches.extend(world.objects.fallen_of(object).map(|fallen| (fallen, Role::Second)));
        }
    }
    // Second grasps are proven beside the smallest thing that can be held: first grasps come first.
    searches.sort_by_key(|(_, role)| *role as u8);
    searches
}

fn pick_up(
    world: &World,
    repertoire: &Repertoire,
    (object, role): (&ObjectModel, Role),
    cache: &Cache,
    quiet: bool,
) -> Result<Vec<Grasp>> {
    let names = [object.name.clone()];
    let reference = match role {
        Role::First => Vec::new(),
        Role::Second => pick_ups::reference_hold(world, &names, repertoire)?,
    };
    let label = format!("{}-{}", object.name, if role == Role::First { "first" } else { "second" });
    let key = ground(world, label)?.with(&Described::of(object))?.with(&(role, reference))?;
    let progress = progress::bar(u64::from(EFFORT.attempts()), &format!("tries of {} at most", object.name), quiet);
    let grasps = cache.get_or(&key, || {
        let mut own = repertoire.clone();
        own.grasps.remove(&object.name);
        pick_ups::generate(
            world,
            &pick_ups::Wanted { names: &names, roles: &[role], effort: EFFORT },
            &mut own,
            &progress,
            |_, _, _| Ok(()),
        )?;
        Ok(own.of(&object.name, role).cloned().collect())
    });
    progress.finish_and_clear();
    grasps
}

/// The plan of a pair with the odds of its grasps; none if nothing works without errors.
fn plan_with_odds(
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    pair: &Combination,
) -> Result<Option<Plan>> {
    let mut planned = plan::plan_pair(world, repertoire, board, pair)?;
    if let Some(plan) = &mut planned {
        outcomes::rehearse_one(world, repertoire, board, plan)?;
        other_order::rehearse_one(world, repertoire, board, plan)?;
    }
    Ok(planned)
}

/// The built-in plans, where the scenario's objects stand and start as in the benchmark.
fn known_plans(scenario: &Scenario) -> Result<Option<Plans>> {
    let benchmark = Scenario::benchmark();
    let placed = |scenario: &Scenario| (scenario.layout.first, scenario.layout.second, scenario.start);
    (placed(scenario) == placed(&benchmark)).then(crate::builtin::plans).transpose()
}

/// Which objects of the scenario no grasp is known of, for an error.
fn unpickable(world: &World, repertoire: &Repertoire) -> String {
    let without = |names: &[String], role: Role| -> Vec<String> {
        names.iter().filter(|name| repertoire.of(name, role).next().is_none()).cloned().collect()
    };
    let (first, second) = (without(&world.scenario.first, Role::First), without(&world.scenario.second, Role::Second));
    let listed = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    format!("objects without a grasp: first {}, second {}", listed(&first), listed(&second))
}

/// The key of a plan: its world, its objects and all grasps that it may name.
fn pair_key(world: &World, repertoire: &Repertoire, pair: &Combination) -> Result<Key> {
    let mut key = ground(world, format!("{}-{}", pair.first, pair.second))?;
    for (name, role) in [(&pair.first, Role::First), (&pair.second, Role::Second)] {
        let object = world.object(name)?;
        key = key.with(&Described::of(&object))?.with(&repertoire.of(name, role).collect::<Vec<_>>())?;
        for way in world.objects.fallen_of(&object).filter(|_| role == Role::Second) {
            key = key.with(&Described::of(way))?.with(&repertoire.of(&way.name, role).collect::<Vec<_>>())?;
        }
    }
    Ok(key)
}

/// What every rehearsal of a scenario depends on: the rules, hand and arm, where things stand, how a trial goes, and the effects that
/// are there without errors.
fn ground(world: &World, label: String) -> Result<Key> {
    let scenario = &world.scenario;
    let kept = [Effect::Pads, Effect::Gel, Effect::Cables, Effect::Floor, Effect::Time];
    let drawn = Effect::ALL.into_iter().filter(|effect| !kept.contains(effect));
    let effects = drawn.fold(scenario.effects, |effects, effect| effects.without(effect));
    Key::new(label)
        .with(&RULES)?
        .with(&format!("{:?}", world.cell.hand.parameters))?
        .with(&format!("{:?}", world.cell.arm))?
        .with(&(scenario.layout.first, scenario.layout.second, scenario.start, scenario.protocol))?
        .with(&effects)
}

/// An object as a key has it.
#[derive(Serialize)]
struct Described<'a> {
    name: &'a str,
    mass: f64,
    friction: f64,
    rest: [f64; 4],
    symmetry: String,
    /// Vertices of a mesh and the corners of its triangles, or the measures of a simple shape.
    shape: (Vec<[f64; 3]>, Vec<[u32; 3]>),
}

impl<'a> Described<'a> {
    fn of(object: &'a ObjectModel) -> Self {
        let shape = match &object.shape {
            Shape::Mesh(mesh) => {
                (mesh.vertices().iter().map(|vertex| vertex.coords.into()).collect(), mesh.triangles().to_vec())
            }
            Shape::Sphere { radius } => (vec![[*radius, 0.0, 0.0]], vec![[1; 3]]),
            Shape::Cylinder { radius, half_height } => (vec![[*radius, *half_height, 0.0]], vec![[2; 3]]),
            Shape::Cuboid { half, radius } => (vec![(*half).into(), [*radius, 0.0, 0.0]], vec![[3; 3]]),
        };
        Self {
            name: &object.name,
            mass: object.mass,
            friction: object.friction,
            rest: object.rest.coords.into(),
            symmetry: format!("{:?}", object.symmetry),
            shape,
        }
    }
}

#[cfg(test)]
mod tests;
