//! Preparation: grasps and plans for a scenario that has objects or pairs of a user's own.
//!
//! The grasps and plans that come with the program are used where they fit. The user's own objects are searched for
//! pick-ups in physics, at the places in which the scenario names them. Pairs without a plan are planned and tried
//! under errors. Both follow the rules of the benchmark itself. Each result is kept in a [`Cache`], and so are the
//! finished steps of a search under way. An interrupted preparation resumes where it stopped, and a second run begins
//! at once. Anything that cannot be played is reported ([`left_out`]), never replaced silently.

mod forecast;
mod left_out;

use std::collections::BTreeSet;
use std::sync::Once;
use std::time::Instant;

use anyhow::{Result, ensure};
use dexterous_grasping::digit_sets::in_words;
use dexterous_grasping::{Grasp, Repertoire};
use hand_model::Digit;
use scenarios::Scenario;
use scenarios::combination::{Combination, draw_combinations};
use scenarios::effects::Effect;
use serde::Serialize;
use sim::tactile::TactileBoard;
use world::geometry::Shape;
use world::objects::ObjectModel;
use world::phase::ordinal;

pub use self::left_out::NotPlayable;
use crate::cache::{Cache, Key, Steps};
use crate::pick_ups::{self, Effort, Progress};
use crate::plan::{self, Plans, stepwise};
use crate::rehearsal::{FirstRehearsal, rehearse_first, try_second};
use crate::simulated_world::World;
use crate::skills;

/// Version of the search rules. It rises when a rule of the search or the engine changes, so that everything kept is
/// searched anew.
const RULES: u32 = 3;
/// Seed of the proposals of pick-ups. They do not depend on a run's own seed.
const SEED: u64 = 1;
/// Search effort for each object and place, the same as for the benchmark's own objects.
pub const EFFORT: Effort = Effort { proposals: 128, variations: 64, keep_first: 4, keep_second: 14 };

/// Grasps and plans from which the trials of a scenario choose.
pub struct Prepared {
    pub repertoire: Repertoire,
    /// Plans, as many as were asked for or as can be done.
    pub plans: Plans,
    /// Deviations from the files of the scenario's own objects, and requests that cannot be met with them.
    pub notes: Vec<String>,
    /// Objects of the scenario that are not played at all, with the reasons.
    pub left_out: Vec<String>,
}

/// Prepares grasps and plans for `count` combinations of the world's scenario, drawn by `seed`, or for as many as can
/// be done. Returns [`NotPlayable`] if the scenario has objects of its own and none of them can be played.
pub fn prepare(world: &World, count: usize, seed: u64, cache: &Cache, quiet: bool) -> Result<Prepared> {
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
    let builtin = crate::builtin::fits(robot)?;
    let mut repertoire = if builtin { crate::builtin::repertoire()? } else { Repertoire::default() };
    if let [(_, first), (_, second), (_, third)] = &world.scenario.lists()[..] {
        ensure!(
            builtin && world.scenario.object.is_empty(),
            "{}: third: found {} objects, expected none: pick-ups by one finger each are known of the built-in hand and objects alone",
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
            "looking for grasps of {whose} objects in physics; each finished step is kept in {}: after an interruption the same \
             command goes on there",
            cache.folder().display()
        ));
    }
    let begun = Instant::now();
    for (n, search) in own.iter().enumerate() {
        let grasps = pick_up(world, &repertoire, search, &own[n + 1..], cache, quiet)?;
        let line = found(search, grasps.len());
        say(&format!("{:3} of {}  {line}  {:5.1} min", n + 1, own.len(), begun.elapsed().as_secs_f64() / 60.0));
        if grasps.is_empty() {
            notes.push(line);
        }
        for grasp in grasps {
            repertoire.insert(grasp);
        }
    }
    left_out::refuse_unpickable(world, &repertoire)?;
    let known = if builtin { known_plans(&world.scenario)? } else { None };
    let decided = |pair: &Combination| known.as_ref().and_then(|known| known.of(pair));
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let mut open = Vec::new();
    for pair in draw_combinations(&world.scenario, count, seed) {
        let key = plan_key(world, &repertoire, &pair)?;
        let key = if world.scenario.effort == 0 { key } else { key.with(&("proof", world.scenario.effort))? };
        if decided(&pair).is_none() && !cache.has(&key) {
            open.push(pair);
        }
    }
    if !open.is_empty() && !quiet {
        say(&forecast::of_plans(open.len(), pace(world, &repertoire, &board, &open)?, world.scenario.effort));
    }
    let plans = plan::make_plans(&world.scenario, count, seed, quiet, |pair| {
        if let Some(decided) = decided(pair) {
            return Ok(decided.cloned());
        }
        let key = plan_key(world, &repertoire, pair)?;
        let mut planned = cache.get_or(&key, |steps| stepwise::plan(world, &repertoire, &board, pair, steps))?;
        for level in 1..=if pair.objects.len() == 2 { world.scenario.effort } else { 0 } {
            let Some(plan) = planned.take() else { break };
            let key = key.clone().with(&("proof", level))?;
            planned = cache.get_or(&key, |steps| stepwise::prove(world, &repertoire, plan, level, steps))?;
        }
        Ok(planned)
    })?;
    let said = notes.len();
    notes.extend(forecast::of_proofs(plans.plans.iter().filter(|plan| {
        let pair = Combination { id: 0, objects: plan.objects().into_iter().map(str::to_owned).collect() };
        decided(&pair).is_none()
    })));
    let left_out = left_out::of(world, &repertoire, &plans, count, &mut notes)?;
    left_out.iter().chain(&notes[said..]).for_each(|line| say(line));
    Ok(Prepared { repertoire, plans, notes, left_out })
}

/// Returns the digits that take each of the scenario's objects in turn.
fn digit_sets(world: &World) -> Vec<Vec<Digit>> {
    dexterous_grasping::digit_sets(&world.cell.robot.hand, world.scenario.lists().len())
}

/// Returns the sets of digits for which grasps are searched by pick-ups. There are none in trials of more than two
/// objects.
fn searched_sets(world: &World) -> Vec<Vec<Digit>> {
    if world.scenario.lists().len() > 2 { Vec::new() } else { digit_sets(world) }
}

/// Measures the time of one rehearsal on this machine on one thread, s, with the first of these pairs that has grasps.
/// Returns `None` if no pair has any.
fn pace(world: &World, repertoire: &Repertoire, board: &TactileBoard, pairs: &[Combination]) -> Result<Option<f64>> {
    let sets = digit_sets(world);
    for pair in pairs {
        let ([one, other], [first, second]) = (&pair.objects[..], &sets[..]) else { continue };
        let (first, second) = (repertoire.of(one, first).next(), repertoire.of(other, second).next());
        let Some((first, second)) = first.zip(second) else { continue };
        let begun = Instant::now();
        let grasps = [first, second];
        let hold = rehearse_first(world, &FirstRehearsal::ideal(world, &grasps), board)?;
        let Some((hold, _)) = hold else { continue };
        try_second(&hold, second)?;
        return Ok(Some(0.5 * begun.elapsed().as_secs_f64()));
    }
    Ok(None)
}

/// Search for grasps of an object.
struct Search<'a> {
    object: &'a ObjectModel,
    /// Number of objects that are already held when it is taken.
    place: usize,
    /// Digits that take it.
    digits: Vec<Digit>,
}

/// Describes the result of a search.
fn found(search: &Search, count: usize) -> String {
    let (object, order, digits) = (search.object, ordinal(search.place), in_words(&search.digits));
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

/// Returns the searches for the objects whose grasps are not known, and for the fallen poses of those that are taken
/// beside others. These are the scenario's own objects if the robot is `builtin`, and all objects otherwise.
fn searches(world: &World, builtin: bool) -> Vec<Search<'_>> {
    let scenario = &world.scenario;
    let mut searches = Vec::new();
    let own: BTreeSet<&String> = scenario.object.iter().map(|file| &file.name).collect();
    let all = scenario.objects();
    for name in all.iter().filter(|name| !builtin || own.contains(name)) {
        let Some(object) = world.objects.get(name) else { continue };
        let lists = scenario.lists().into_iter().zip(searched_sets(world)).enumerate();
        for (place, (_, digits)) in lists.filter(|(_, ((_, names), _))| names.contains(name)) {
            let search = |object| Search { object, place, digits: digits.clone() };
            searches.push(search(object));
            if place > 0 {
                searches.extend(world.objects.fallen_of(object).map(search));
            }
        }
    }
    // Second grasps are proven beside the smallest object that can be held, so first grasps come first.
    searches.sort_by_key(|search| search.place);
    searches
}

/// Returns the grasps of an object, kept or searched. `after` are the searches that follow.
fn pick_up(
    world: &World,
    repertoire: &Repertoire,
    Search { object, place, digits }: &Search,
    after: &[Search],
    cache: &Cache,
    quiet: bool,
) -> Result<Vec<Grasp>> {
    let names = [object.name.clone()];
    let reference = if *place == 0 { Vec::new() } else { pick_ups::reference_hold(world, &names, repertoire)? };
    let label = format!("{}-{}", object.name, ordinal(*place));
    let key = ground(world, label)?.with(&Described::of(object))?.with(&(ordinal(*place), reference))?;
    cache.get_or(&key, |steps: &Steps<Option<Grasp>>| {
        let what = format!("rehearsals of {} at most", object.name);
        let bar = progress::resumed(EFFORT.rehearsals(*place), pick_ups::kept(steps), &what, quiet);
        let told = Once::new();
        let tell = |seconds: f64| {
            told.call_once(|| {
                if !quiet {
                    let left: Vec<usize> = after.iter().map(|search| search.place).collect();
                    bar.suspend(|| eprintln!("{}", forecast::of_search(&object.name, *place, &left, seconds)));
                }
            });
        };
        let mut own = repertoire.clone();
        own.grasps.remove(&object.name);
        pick_ups::generate(
            world,
            &pick_ups::Wanted { names: &names, places: &[*place], effort: EFFORT },
            &mut own,
            &Progress { bar: &bar, steps, pace: &tell },
            |_, _, _, _| Ok(()),
        )?;
        bar.finish_and_clear();
        Ok(own.of(&object.name, digits).cloned().collect())
    })
}

/// Returns the built-in plans if the scenario's places and start are those of the benchmark.
fn known_plans(scenario: &Scenario) -> Result<Option<Plans>> {
    let benchmark = Scenario::benchmark();
    let placed = |scenario: &Scenario| (scenario.layout.first, scenario.layout.second, scenario.start);
    let same = scenario.lists().len() == 2 && placed(scenario) == placed(&benchmark);
    same.then(crate::builtin::plans).transpose()
}

/// Returns the key of a plan: its world, its objects and all grasps that it may name.
fn plan_key(world: &World, repertoire: &Repertoire, pair: &Combination) -> Result<Key> {
    let mut key = ground(world, pair.objects.join("-"))?;
    let sets = digit_sets(world);
    for (place, (name, digits)) in pair.objects.iter().zip(&sets).enumerate() {
        let object = world.object(name)?;
        let grasps = |name: &str| repertoire.of(name, digits).collect::<Vec<_>>();
        key = key.with(&Described::of(&object))?.with(&grasps(name))?;
        for way in world.objects.fallen_of(&object).filter(|_| place > 0 && place + 1 == sets.len()) {
            key = key.with(&Described::of(way))?.with(&grasps(&way.name))?;
        }
    }
    Ok(key)
}

/// Returns a key with everything that each rehearsal of a scenario depends on: the rules, hand and arm, the layout, the
/// protocol of a trial, and the effects that are present without errors.
fn ground(world: &World, label: String) -> Result<Key> {
    let scenario = &world.scenario;
    let kept = [Effect::Pads, Effect::Gel, Effect::Cables, Effect::Floor, Effect::Time];
    let drawn = Effect::ALL.into_iter().filter(|effect| !kept.contains(effect));
    let effects = drawn.fold(scenario.effects, |effects, effect| effects.without(effect));
    let key = Key::new(label)
        .with(&RULES)?
        .with(&world.cell.robot.mechanics())?
        .with(&(scenario.layout.first, scenario.layout.second, scenario.start, scenario.protocol))?
        .with(&effects)?;
    match scenario.layout.third.filter(|_| !scenario.third.is_empty()) {
        Some(third) => key.with(&third),
        None => Ok(key),
    }
}

/// Description of an object in a key.
#[derive(Serialize)]
struct Described<'a> {
    name: &'a str,
    mass: f64,
    friction: f64,
    rest: [f64; 4],
    symmetry: String,
    /// Vertices and triangles of a mesh, or the dimensions of a simple shape.
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
