//! `ftac grasps landscape`: the energy landscape of several objects' grasps by attraction and diffusion, as a tree.
//!
//! Every verified grasp cools to its local minimum; the pull is calibrated to the metastability threshold of pairs of minima;
//! minima are sorted into basins, barriers measured, and all of it journalled, so that the same command goes on after an
//! interruption.

use std::path::Path;

use anyhow::{Context, Result, bail};
use grasping::synthesis::energy::{GraspEnergy, Weights};
use grasping::synthesis::surface::HandSurface;
use indicatif::{ProgressBar, ProgressStyle};
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use study::landscape::attraction::{Attraction, stream};
use study::landscape::disconnectivity::{Tree, tree};
use study::landscape::grasps::{GraspLandscape, GraspState};
use study::landscape::mapping::{Mapping, Plan};
use study::landscape::metastability::thresholds;
use study::page::{hover, tree as picture};
use study::taxonomy::Category;

use super::LandscapeArgs;
use super::source::{Entry, Source};
use crate::cli::Cli;
use crate::commands::Outcome;
use crate::report::write_whole;
use crate::synthesis::subject::Subject;

/// Points on the hand's surface: coarser than for synthesis, whose energy this is.
const SURFACE_POINTS: usize = 1000;
/// Steps of a grasp's way to its minimum.
const COOLING: usize = 800;
/// A calibration begins with this pull.
const STRONGEST: f64 = 40.0;
/// Pairs and trials of the calibration.
const PAIRS: usize = 16;
const TRIALS: usize = 6;
/// Distances that count as arrived: see [`GraspState`]'s distance; 0.7 is 0.15 rad in every joint with 12 mm of the object's place.
const NEAR: f64 = 0.7;
const PATIENCE: usize = 120;
const CHAINS: usize = 2;
const DOUBLINGS: u32 = 5;
const NEIGHBORS: usize = 6;

/// What the calibration found; kept, so that going on does not repeat it.
#[derive(Debug, Serialize, Deserialize)]
struct Calibration {
    subject: String,
    thresholds: Vec<f64>,
    pairs: usize,
}

/// `ftac grasps landscape`.
pub fn run(cli: &Cli, args: &LandscapeArgs) -> Outcome {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if args.each == 0 || !positive(args.temperature) || !args.pull.is_none_or(positive) {
        bail!(
            "--each, --temperature, --pull: found {}, {}, {:?}, expected positive numbers",
            args.each,
            args.temperature,
            args.pull
        );
    }
    let source = Source::read(&args.grasps.paths)?;
    let chosen = choose(&source, args)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let quiet = cli.quiet || cli.json;
    let subjects = args.objects.iter().map(|name| Subject::named(name)).collect::<Result<Vec<_>>>()?;
    let surface = HandSurface::new(&source.hand, SURFACE_POINTS);
    let energies = subjects
        .iter()
        .map(|subject| GraspEnergy::new(&source.hand, &surface, &subject.field, Weights::default(), None))
        .collect();
    let landscape = GraspLandscape::new(&source.hand, energies);
    // A grasp on which fewer than two links touch has no minimum of its own.
    let minima: Vec<(usize, GraspState)> = chosen
        .par_iter()
        .enumerate()
        .filter_map(|(n, &(object, entry))| {
            let mut rng = stream(cli.seed, [n as u64, 0, 0, 7]);
            let grasp = &source.entries[entry].grasp;
            Some((entry, landscape.minimum(object, grasp, args.temperature, COOLING, &mut rng)?))
        })
        .collect();
    if minima.len() < 2 {
        bail!("--objects: found {} grasps with two links that touch, expected at least 2", minima.len());
    }
    let subject = format!("{} from {} grasps, temperature {}", args.objects.join(","), minima.len(), args.temperature);
    let attraction =
        Attraction { pull: STRONGEST, temperature: args.temperature, near: NEAR, patience: PATIENCE, chains: CHAINS };
    let calibration = match args.pull {
        Some(_) => Calibration { subject: subject.clone(), thresholds: Vec::new(), pairs: 0 },
        None => calibrate(&landscape, &minima, &attraction, &subject, cli.seed, &args.out, quiet)?,
    };
    let middle = calibration.thresholds.get(calibration.thresholds.len() / 2).copied();
    let Some(pull) = args.pull.or(middle) else {
        bail!("--pull: no chain arrived in the calibration even at {STRONGEST}; give a pull");
    };
    let plan = Plan {
        attraction: Attraction { pull, ..attraction },
        doublings: DOUBLINGS,
        neighbors: NEIGHBORS,
        seed: cli.seed,
        subject,
    };
    let states: Vec<GraspState> = minima.iter().map(|(_, state)| state.clone()).collect();
    let map = explore(&landscape, &states, plan.clone(), &args.out.join("journal.jsonl"), quiet)?;
    let sweep = args.sweep.map(|n| sweep(&landscape, &states, &plan, n, quiet)).transpose()?;
    let energies: Vec<f64> = map.basins.iter().map(|basin| basin.energy).collect();
    let found = tree(&energies, &map.edges());
    let answer = describe(&source, &minima, &map, &found, &calibration, sweep);
    write(&args.out, &source, &minima, &map, &found)?;
    write_whole(&args.out.join("landscape.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    if cli.json {
        println!("{answer}");
    } else {
        tell(&answer, args);
    }
    Ok(None)
}

/// (place of the object on the command line, entry), one object after the other in turn.
fn choose(source: &Source, args: &LandscapeArgs) -> Result<Vec<(usize, usize)>> {
    let mut by_object = Vec::new();
    for (n, name) in args.objects.iter().enumerate() {
        let own: Vec<usize> =
            (0..source.entries.len()).filter(|k| source.object(&source.entries[*k]) == name).take(args.each).collect();
        if own.is_empty() {
            let known: Vec<&str> = source.objects.iter().map(|object| object.name.as_str()).collect();
            bail!("--objects: found no grasp of `{name}`, expected some of {}", known.join(", "));
        }
        if args.objects[..n].contains(name) {
            bail!("--objects: found `{name}` twice, expected each once");
        }
        by_object.push(own);
    }
    let longest = by_object.iter().map(Vec::len).max().unwrap_or(0);
    let in_turn = (0..longest).flat_map(|k| {
        by_object.iter().enumerate().filter_map(move |(object, own)| own.get(k).map(|entry| (object, *entry)))
    });
    Ok(in_turn.collect())
}

fn calibrate(
    landscape: &GraspLandscape,
    minima: &[(usize, GraspState)],
    attraction: &Attraction,
    subject: &str,
    seed: u64,
    folder: &Path,
    quiet: bool,
) -> Result<Calibration> {
    let path = folder.join("calibration.json");
    let subject = format!("{subject}, seed {seed}");
    if let Ok(text) = std::fs::read_to_string(&path) {
        let known: Calibration = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        if known.subject == subject {
            return Ok(known);
        }
    }
    if !quiet {
        eprintln!("calibrating the pull on {PAIRS} pairs of minima");
    }
    let mut rng = stream(seed, [0, 0, 0, 9]);
    let pairs: Vec<(GraspState, GraspState)> = (0..PAIRS)
        .map(|_| {
            let first = rng.random_range(0..minima.len());
            let second = (first + rng.random_range(1..minima.len())) % minima.len();
            (minima[first].1.clone(), minima[second].1.clone())
        })
        .collect();
    let found =
        Calibration { subject, thresholds: thresholds(landscape, &pairs, attraction, TRIALS, seed), pairs: PAIRS };
    write_whole(&path, serde_json::to_string_pretty(&found)?.as_bytes())?;
    Ok(found)
}

fn explore(
    landscape: &GraspLandscape,
    states: &[GraspState],
    plan: Plan,
    journal: &Path,
    quiet: bool,
) -> Result<Mapping<GraspState>> {
    use study::landscape::Landscape as _;
    let mut map = Mapping::resume(plan, journal, |state| landscape.energy(state))?;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(states.len() as u64) };
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} [{elapsed} < {eta}]")?);
    for state in states.iter().skip(map.sorted) {
        bar.set_position(map.sorted as u64);
        bar.set_message(format!("minima in {} basins", map.basins.len()));
        map.sort(landscape, state.clone())?;
    }
    bar.set_length(map.basins.len() as u64);
    while map.measure(landscape)? {
        bar.set_position(map.measured() as u64);
        bar.set_message("basins' barriers");
    }
    bar.finish_and_clear();
    Ok(map)
}

/// Basins over temperature and pull, and over seeds, on the first `n` minima.
fn sweep(
    landscape: &GraspLandscape,
    states: &[GraspState],
    plan: &Plan,
    n: usize,
    quiet: bool,
) -> Result<serde_json::Value> {
    let few = &states[..n.clamp(2, states.len())];
    let count = |temperature: f64, pull: f64, seed: u64| -> Result<usize> {
        let attraction = Attraction { temperature, pull, ..plan.attraction };
        let mut map = Mapping::new(Plan { attraction, seed, ..plan.clone() });
        for state in few {
            map.sort(landscape, state.clone())?;
        }
        if !quiet {
            eprintln!("temperature {temperature}, pull {pull:.3}, seed {seed}: {} basins", map.basins.len());
        }
        Ok(map.basins.len())
    };
    let Attraction { pull, temperature, .. } = plan.attraction;
    let mut grid = Vec::new();
    for heat in [0.5, 1.0, 2.0] {
        for weight in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let basins = count(heat * temperature, weight * pull, plan.seed)?;
            grid.push(json!({ "temperature": heat * temperature, "pull": weight * pull, "basins": basins }));
        }
    }
    let seeds = (0..5).map(|k| count(temperature, pull, plan.seed + k)).collect::<Result<Vec<_>>>()?;
    Ok(json!({ "minima": few.len(), "grid": grid, "over_seeds": seeds }))
}

/// The entries of a basin.
fn members<'a>(source: &'a Source, minima: &[(usize, GraspState)], members: &[usize]) -> Vec<&'a Entry> {
    members.iter().map(|n| &source.entries[minima[*n].0]).collect()
}

/// The majority's broad type; of equal counts the first in the table.
fn majority(source: &Source, entries: &[&Entry]) -> Category {
    let count = |category: &Category| {
        entries.iter().filter(|entry| source.taxonomy.types[entry.decision.kind].category == *category).count()
    };
    let best = Category::ALL.iter().rev().max_by_key(|category| count(category));
    best.copied().unwrap_or(Category::Power)
}

/// Basins after the first grasps, their number doubling: objects take turns, so that each has its share at any time.
fn growth(map: &Mapping<GraspState>) -> Vec<serde_json::Value> {
    let mut counts: Vec<usize> = (0..).map(|k| map.sorted >> k).take_while(|n| *n > 5).collect();
    counts.reverse();
    // A basin's first member founded it.
    let founded = |n: usize| map.basins.iter().filter(|basin| basin.members.first().is_some_and(|m| *m < n)).count();
    counts.into_iter().map(|n| json!({ "grasps": n, "basins": founded(n) })).collect()
}

fn describe(
    source: &Source,
    minima: &[(usize, GraspState)],
    map: &Mapping<GraspState>,
    found: &Tree,
    calibration: &Calibration,
    sweep: Option<serde_json::Value>,
) -> serde_json::Value {
    let basins: Vec<_> = map
        .basins
        .iter()
        .map(|basin| {
            let own = members(source, minima, &basin.members);
            let mut objects: Vec<&str> = own.iter().map(|entry| source.object(entry)).collect();
            objects.sort_unstable();
            objects.dedup();
            let ids: Vec<&String> = own.iter().map(|entry| &entry.id).collect();
            json!({ "energy": basin.energy, "members": ids, "objects": objects, "majority": majority(source, &own) })
        })
        .collect();
    let shared =
        basins.iter().filter(|basin| basin["objects"].as_array().is_some_and(|objects| objects.len() > 1)).count();
    let count = |category: Category| {
        let of = |basin: &&study::landscape::mapping::Basin<GraspState>| {
            majority(source, &members(source, minima, &basin.members)) == category
        };
        map.basins.iter().filter(of).count()
    };
    let singles = map.basins.iter().filter(|basin| basin.members.len() == 1).count();
    json!({
        "grasps": minima.len(), "basins": map.basins.len(), "growth": growth(map), "basins_of_one": singles, "basins_with_several_objects": shared,
        "power": count(Category::Power), "intermediate": count(Category::Intermediate),
        "precision": count(Category::Precision), "trees": found.roots.len(),
        "pull": map.plan.attraction.pull, "temperature": map.plan.attraction.temperature,
        "thresholds": calibration.thresholds, "pairs": calibration.pairs,
        "merges": found.merges, "barriers": map.edges(), "list": basins, "sweep": sweep,
    })
}

fn write(
    folder: &Path,
    source: &Source,
    minima: &[(usize, GraspState)],
    map: &Mapping<GraspState>,
    found: &Tree,
) -> Result<()> {
    let shown: Vec<&Entry> =
        map.basins.iter().map(|basin| &source.entries[minima[lowest(minima, map, &basin.members)].0]).collect();
    let leaves: Vec<picture::Leaf> = map
        .basins
        .iter()
        .enumerate()
        .map(|(n, basin)| {
            let own = members(source, minima, &basin.members);
            let category = majority(source, &own);
            let text = format!(
                "basin {n}: {} grasps, mostly {}; shown {} ({})",
                own.len(),
                category.name(),
                shown[n].id,
                source.taxonomy.types[shown[n].decision.kind].name
            );
            picture::Leaf { members: own.len(), category, grasp: n, text }
        })
        .collect();
    let title = format!("{} basins of {} grasps", map.basins.len(), minima.len());
    let drawing = picture::svg(found, &leaves, &title);
    write_whole(&folder.join("landscape.svg"), drawing.as_bytes())?;
    let mut largest: Vec<usize> = (0..leaves.len()).collect();
    largest.sort_by_key(|n| (std::cmp::Reverse(leaves[*n].members), *n));
    largest.truncate(12);
    let gallery: Vec<(usize, String)> = largest.iter().map(|n| (*n, leaves[*n].text.clone())).collect();
    let introduction = "Circles are basins: as large as they have grasps, coloured by the broad type of most of them, at the height \
                        of their lowest energy. Bars join basins at the energy over which one leads to the other. Point at a \
                        circle to see a grasp of it. Below: the largest basins.";
    let body = format!(
        "<div style=\"overflow-x:auto\">{drawing}</div>\n<h2>The largest basins</h2>\n{}",
        hover::gallery(&gallery)
    );
    let page = hover::page(&title, introduction, &body, &source.scene(shown.into_iter()))?;
    write_whole(&folder.join("landscape.html"), page.as_bytes())
}

/// The member whose minimum is the basin's.
fn lowest(minima: &[(usize, GraspState)], map: &Mapping<GraspState>, members: &[usize]) -> usize {
    let own = members.iter().copied();
    let is_minimum = |n: &usize| map.basins.iter().any(|basin| basin.minimum == minima[*n].1);
    own.clone().find(is_minimum).or(own.min()).unwrap_or(0)
}

fn tell(answer: &serde_json::Value, args: &LandscapeArgs) {
    println!(
        "{} grasps in {} basins (paper 79 over six objects): {} power, {} intermediate, {} precision; {} hold several objects",
        answer["grasps"],
        answer["basins"],
        answer["power"],
        answer["intermediate"],
        answer["precision"],
        answer["basins_with_several_objects"]
    );
    println!(
        "pull {}, temperature {}; trees without a known way between them: {}",
        answer["pull"], answer["temperature"], answer["trees"]
    );
    if let Some(rows) = answer["growth"].as_array() {
        let told: Vec<String> = rows.iter().map(|row| format!("{} of {}", row["basins"], row["grasps"])).collect();
        println!("basins of the first grasps: {}; of one grasp only: {}", told.join(", "), answer["basins_of_one"]);
    }
    if let Some(grid) = answer["sweep"]["grid"].as_array() {
        println!("basins of {} minima:", answer["sweep"]["minima"]);
        println!("{:>12} {:>10} {:>7}", "temperature", "pull", "basins");
        for row in grid {
            let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            println!("{:12.3} {:10.3} {:>7}", number("temperature"), number("pull"), row["basins"]);
        }
        println!("over seeds: {}", answer["sweep"]["over_seeds"]);
    }
    println!("{0}/landscape.html, landscape.svg, landscape.json", args.out.display());
}
