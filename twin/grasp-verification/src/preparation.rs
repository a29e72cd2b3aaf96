//! Preparation: grasps and grasp pairs for a scenario that has objects or pairs of a user's own.
//!
//! The grasps and grasp pairs that come with the program are used if they fit. Grasps of the user's own objects are
//! searched for in physics, at the places in which the scenario names them. Combinations without a grasp pair are
//! planned and tried under errors. Both follow the rules of the benchmark itself. Each result is kept in a
//! [`ResultCache`], and so are the finished steps of a search under way. An interrupted preparation resumes where it
//! stopped, and a second run begins at once. Anything that cannot be used is reported ([`left_out`]), never replaced
//! silently.

mod forecast;
mod left_out;

use std::collections::BTreeSet;
use std::sync::Once;
use std::time::Instant;

use anyhow::{Result, ensure};
use dexterous_grasping::digit_sets::describe_digits;
use dexterous_grasping::{Grasp, Repertoire};
use hand_model::Digit;
use scenarios::Scenario;
use scenarios::combination::{Combination, draw_combinations};
use scenarios::effects::Effect;
use serde::Serialize;
use sim::tactile::TactileBoard;
use world::geometry::ObjectShape;
use world::objects::ObjectModel;
use world::phase::ordinal;

pub use self::left_out::NotPlayable;
use crate::cache::{CacheKey, ResultCache, SearchSteps};
use crate::grasp_pair::{self, GraspPairTable, stepwise};
use crate::repertoire_search::{self, RepertoireEffort, SearchProgress};
use crate::rollout::{FirstGraspRollout, roll_out_first, try_second};
use crate::simulated_world::SimulatedWorld;
use crate::skills;

/// Version of the search rules. It rises when a rule of the search or the engine changes, so that everything kept is
/// searched anew.
const RULES_VERSION: u32 = 3;
/// Seed of the grasp proposals. They do not depend on a run's own seed.
const SEED: u64 = 1;
/// Search effort for each object and place, the same as for the benchmark's own objects.
pub const SEARCH_EFFORT: RepertoireEffort =
    RepertoireEffort { proposals: 128, variations: 64, keep_first: 4, keep_second: 14 };

/// Grasps and grasp pairs from which the trials of a scenario choose.
pub struct PreparedGrasps {
    pub repertoire: Repertoire,
    /// Grasp pairs, as many as were asked for or as can be done.
    pub pairs: GraspPairTable,
    /// Deviations from the files of the scenario's own objects, and requests that cannot be met with them.
    pub notes: Vec<String>,
    /// Objects of the scenario that are not used at all, with the reasons.
    pub left_out: Vec<String>,
}

/// Prepares grasps and grasp pairs for `count` combinations of the world's scenario, drawn by `seed`, or for as many as
/// can be done. Returns [`NotPlayable`] if the scenario has objects of its own and none of them can be used.
pub fn prepare(
    world: &SimulatedWorld,
    count: usize,
    seed: u64,
    cache: &ResultCache,
    quiet: bool,
) -> Result<PreparedGrasps> {
    let say = |line: &str| {
        if !quiet {
            eprintln!("{line}");
        }
    };
    let robot = &world.cell.robot;
    ensure!(
        !digit_sets(world).iter().any(Vec::is_empty),
        "{}: hand: found {} digits, expected 4 or 5: thumb, index and middle finger take the second object while the others hold the first",
        robot.file().display(),
        robot.hand.digits().len()
    );
    let builtin = crate::builtin::fits_robot(robot)?;
    let mut repertoire = if builtin { crate::builtin::repertoire()? } else { Repertoire::default() };
    if let [(_, first), (_, second), (_, third)] = &world.scenario.object_lists()[..] {
        ensure!(
            builtin && world.scenario.object.is_empty(),
            "{}: third: found {} objects, expected none: grasps by one finger each exist for the built-in hand and objects alone",
            world.scenario.name,
            third.len()
        );
        for (names, digits) in [first, second].into_iter().zip(digit_sets(world)) {
            skills::by_digits(world, names, &digits)?.into_iter().for_each(|grasp| repertoire.insert(grasp));
        }
    }
    repertoire.seed = SEED;
    let mut notes = left_out::notes(world);
    notes.iter().for_each(|note| say(note));
    let own = searches(world, builtin);
    if !own.is_empty() {
        let whose = if builtin { "the scenario's own" } else { "this robot for all of the scenario's" };
        say(&format!(
            "searching for grasps of {whose} objects in physics; each finished step is kept in {}: after an interruption the same \
             command goes on there",
            cache.folder().display()
        ));
    }
    let begun = Instant::now();
    for (n, search) in own.iter().enumerate() {
        let grasps = find_grasps(world, &repertoire, search, &own[n + 1..], cache, quiet)?;
        let line = describe_found(search, grasps.len());
        say(&format!("{:3} of {}  {line}  {:5.1} min", n + 1, own.len(), begun.elapsed().as_secs_f64() / 60.0));
        if grasps.is_empty() {
            notes.push(line);
        }
        for grasp in grasps {
            repertoire.insert(grasp);
        }
    }
    left_out::refuse_unpickable(world, &repertoire)?;
    let known = if builtin { builtin_pairs(&world.scenario)? } else { None };
    let decided = |pair: &Combination| known.as_ref().and_then(|known| known.for_combination(pair));
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let mut open = Vec::new();
    for pair in draw_combinations(&world.scenario, count, seed) {
        let key = pair_key(world, &repertoire, &pair)?;
        let key = if world.scenario.effort == 0 { key } else { key.with_part(&("proof", world.scenario.effort))? };
        if decided(&pair).is_none() && !cache.has(&key) {
            open.push(pair);
        }
    }
    if !open.is_empty() && !quiet {
        say(&forecast::forecast_pairs(
            open.len(),
            measure_rollout_time(world, &repertoire, &board, &open)?,
            world.scenario.effort,
        ));
    }
    let plans = grasp_pair::make_pairs(&world.scenario, count, seed, quiet, |pair| {
        if let Some(decided) = decided(pair) {
            return Ok(decided.cloned());
        }
        let key = pair_key(world, &repertoire, pair)?;
        let mut planned =
            cache.get_or(&key, |steps| stepwise::plan_stepwise(world, &repertoire, &board, pair, steps))?;
        for level in 1..=if pair.objects.len() == 2 { world.scenario.effort } else { 0 } {
            let Some(plan) = planned.take() else { break };
            let key = key.clone().with_part(&("proof", level))?;
            planned = cache.get_or(&key, |steps| stepwise::verify_stepwise(world, &repertoire, plan, level, steps))?;
        }
        Ok(planned)
    })?;
    let said = notes.len();
    notes.extend(forecast::describe_verification(plans.pairs.iter().filter(|plan| {
        let pair = Combination { id: 0, objects: plan.objects().into_iter().map(str::to_owned).collect() };
        decided(&pair).is_none()
    })));
    let left_out = left_out::left_out_objects(world, &repertoire, &plans, count, &mut notes)?;
    left_out.iter().chain(&notes[said..]).for_each(|line| say(line));
    Ok(PreparedGrasps { repertoire, pairs: plans, notes, left_out })
}

/// Returns the digits that take each of the scenario's objects in turn.
fn digit_sets(world: &SimulatedWorld) -> Vec<Vec<Digit>> {
    dexterous_grasping::digit_sets(&world.cell.robot.hand, world.scenario.object_lists().len())
}

/// Returns the sets of digits for which grasps are searched. There are none in trials of more than two objects.
fn searched_sets(world: &SimulatedWorld) -> Vec<Vec<Digit>> {
    if world.scenario.object_lists().len() > 2 { Vec::new() } else { digit_sets(world) }
}

/// Measures the time of one rollout on this machine on one thread, s, with the first of these pairs that has grasps.
/// Returns `None` if no pair has any.
fn measure_rollout_time(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    pairs: &[Combination],
) -> Result<Option<f64>> {
    let sets = digit_sets(world);
    for pair in pairs {
        let ([one, other], [first, second]) = (&pair.objects[..], &sets[..]) else { continue };
        let (first, second) = (repertoire.for_digits(one, first).next(), repertoire.for_digits(other, second).next());
        let Some((first, second)) = first.zip(second) else { continue };
        let begun = Instant::now();
        let grasps = [first, second];
        let hold = roll_out_first(world, &FirstGraspRollout::ideal(world, &grasps), board)?;
        let Some((hold, _)) = hold else { continue };
        try_second(&hold, second)?;
        return Ok(Some(0.5 * begun.elapsed().as_secs_f64()));
    }
    Ok(None)
}

/// Search for grasps of an object.
struct GraspSearch<'a> {
    object: &'a ObjectModel,
    /// Number of objects that are already held when it is taken.
    place: usize,
    /// Digits that take it.
    digits: Vec<Digit>,
}

/// Describes the result of a search.
fn describe_found(search: &GraspSearch, count: usize) -> String {
    let (object, order, digits) = (search.object, ordinal(search.place), describe_digits(&search.digits));
    if count > 0 {
        return format!("{}: {count} grasps by {digits}", object.name);
    }
    let (low, high) = object.shape.aabb();
    let [x, y, z] = (high - low).map(|side| (1e3 * side).round()).into();
    format!(
        "{} ({x} x {y} x {z} mm, {} kg): none of {} tries by {digits} held it, so it cannot come {order}",
        object.name, object.mass, SEARCH_EFFORT.proposals
    )
}

/// Returns the searches for the objects whose grasps are not known, and for the fallen poses of those that are taken
/// beside others. These are the scenario's own objects if the robot is `builtin`, and all objects otherwise.
fn searches(world: &SimulatedWorld, builtin: bool) -> Vec<GraspSearch<'_>> {
    let scenario = &world.scenario;
    let mut searches = Vec::new();
    let own: BTreeSet<&String> = scenario.object.iter().map(|file| &file.name).collect();
    let all = scenario.object_names();
    for name in all.iter().filter(|name| !builtin || own.contains(name)) {
        let Some(object) = world.objects.get(name) else { continue };
        let lists = scenario.object_lists().into_iter().zip(searched_sets(world)).enumerate();
        for (place, (_, digits)) in lists.filter(|(_, ((_, names), _))| names.contains(name)) {
            let search = |object| GraspSearch { object, place, digits: digits.clone() };
            searches.push(search(object));
            if place > 0 {
                searches.extend(world.objects.fallen_of(object).map(search));
            }
        }
    }
    // Second grasps are verified beside the smallest object that can be held, so first grasps come first.
    searches.sort_by_key(|search| search.place);
    searches
}

/// Returns the grasps of an object, kept or searched. `after` are the searches that follow.
fn find_grasps(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    GraspSearch { object, place, digits }: &GraspSearch,
    after: &[GraspSearch],
    cache: &ResultCache,
    quiet: bool,
) -> Result<Vec<Grasp>> {
    let names = [object.name.clone()];
    let reference =
        if *place == 0 { Vec::new() } else { repertoire_search::reference_hold(world, &names, repertoire)? };
    let label = format!("{}-{}", object.name, ordinal(*place));
    let key = base_key(world, label)?
        .with_part(&ObjectDescription::from_object(object))?
        .with_part(&(ordinal(*place), reference))?;
    cache.get_or(&key, |steps: &SearchSteps<Option<Grasp>>| {
        let what = format!("rollouts of {} at most", object.name);
        let bar = progress::resumed_bar(
            SEARCH_EFFORT.max_rollouts(*place),
            repertoire_search::kept_rollouts(steps),
            &what,
            quiet,
        );
        let told = Once::new();
        let tell = |seconds: f64| {
            told.call_once(|| {
                if !quiet {
                    let left: Vec<usize> = after.iter().map(|search| search.place).collect();
                    bar.suspend(|| eprintln!("{}", forecast::forecast_search(&object.name, *place, &left, seconds)));
                }
            });
        };
        let mut own = repertoire.clone();
        own.grasps.remove(&object.name);
        repertoire_search::fill_repertoire(
            world,
            &repertoire_search::RepertoireRequest { names: &names, places: &[*place], effort: SEARCH_EFFORT },
            &mut own,
            &SearchProgress { bar: &bar, steps, report_pace: &tell },
            |_, _, _, _| Ok(()),
        )?;
        bar.finish_and_clear();
        Ok(own.for_digits(&object.name, digits).cloned().collect())
    })
}

/// Returns the built-in grasp pairs if the scenario's places and start are those of the benchmark.
fn builtin_pairs(scenario: &Scenario) -> Result<Option<GraspPairTable>> {
    let benchmark = Scenario::benchmark();
    let placed = |scenario: &Scenario| (scenario.layout.first, scenario.layout.second, scenario.start);
    let same = scenario.object_lists().len() == 2 && placed(scenario) == placed(&benchmark);
    same.then(crate::builtin::grasp_pairs).transpose()
}

/// Returns the key of a grasp pair: its world, its objects and all grasps that it may name.
fn pair_key(world: &SimulatedWorld, repertoire: &Repertoire, pair: &Combination) -> Result<CacheKey> {
    let mut key = base_key(world, pair.objects.join("-"))?;
    let sets = digit_sets(world);
    for (place, (name, digits)) in pair.objects.iter().zip(&sets).enumerate() {
        let object = world.object(name)?;
        let grasps = |name: &str| repertoire.for_digits(name, digits).collect::<Vec<_>>();
        key = key.with_part(&ObjectDescription::from_object(&object))?.with_part(&grasps(name))?;
        for way in world.objects.fallen_of(&object).filter(|_| place > 0 && place + 1 == sets.len()) {
            key = key.with_part(&ObjectDescription::from_object(way))?.with_part(&grasps(&way.name))?;
        }
    }
    Ok(key)
}

/// Returns a key with all inputs of the rollouts of a scenario: the rules, hand and arm, the layout, the protocol of a
/// trial, and the disturbances that are present without errors.
fn base_key(world: &SimulatedWorld, label: String) -> Result<CacheKey> {
    let scenario = &world.scenario;
    let kept = [Effect::Pads, Effect::Gel, Effect::Cables, Effect::Floor, Effect::Time];
    let drawn = Effect::ALL.into_iter().filter(|effect| !kept.contains(effect));
    let effects = drawn.fold(scenario.effects, |effects, effect| effects.without(effect));
    let key = CacheKey::new(label)
        .with_part(&RULES_VERSION)?
        .with_part(&world.cell.robot.mechanics_text())?
        .with_part(&(scenario.layout.first, scenario.layout.second, scenario.start, scenario.protocol))?
        .with_part(&effects)?;
    match scenario.layout.third.filter(|_| !scenario.third.is_empty()) {
        Some(third) => key.with_part(&third),
        None => Ok(key),
    }
}

/// Description of an object in a key.
#[derive(Serialize)]
struct ObjectDescription<'a> {
    name: &'a str,
    mass: f64,
    friction: f64,
    rest: [f64; 4],
    symmetry: String,
    /// Vertices and triangles of a mesh, or the dimensions of a simple shape.
    shape: (Vec<[f64; 3]>, Vec<[u32; 3]>),
}

impl<'a> ObjectDescription<'a> {
    fn from_object(object: &'a ObjectModel) -> Self {
        let shape = match &object.shape {
            ObjectShape::Mesh(mesh) => {
                (mesh.vertices().iter().map(|vertex| vertex.coords.into()).collect(), mesh.triangles().to_vec())
            }
            ObjectShape::Sphere { radius } => (vec![[*radius, 0.0, 0.0]], vec![[1; 3]]),
            ObjectShape::Cylinder { radius, half_height } => (vec![[*radius, *half_height, 0.0]], vec![[2; 3]]),
            ObjectShape::Cuboid { half, radius } => (vec![(*half).into(), [*radius, 0.0, 0.0]], vec![[3; 3]]),
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
