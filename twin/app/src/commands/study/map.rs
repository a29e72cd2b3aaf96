//! `ftac grasps map`: contact maps of all grasps on one sheet, and the boundary between power and precision.
//!
//! As the supplement has it: maps normalised, six principal components, 1,000 grasps by farthest-point sampling, t-SNE, a
//! support-vector boundary. Beside the accuracy on its own training data stands the one on objects left out.

use anyhow::{Context, Result, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use study::boundary::{Boundary, HeldOut, held_out};
use study::contact_map::{contact_map, hand_points, normalize};
use study::embedding::{farthest_points, pca, tsne};
use study::page::{hover, map};
use study::taxonomy::Category;

use super::source::GraspsArgs;
use super::source::Source;
use crate::terminal::Outcome;
use crate::terminal::Terminal;
use report::write_whole;

/// Arguments of `grasps map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Grasps on the map at most, by farthest-point sampling.
    #[arg(long, default_value_t = 1000)]
    pub n: usize,
    /// Maps from so many seeds, for the figures' stability; the first is drawn.
    #[arg(long, default_value_t = 5)]
    pub seeds: u64,
    /// Folder for map.html, map.svg and map.json.
    #[arg(long, default_value = "recordings/study")]
    pub out: PathBuf,
}

const COMPONENTS: usize = 6;
const PERPLEXITY: f64 = 30.0;
const ITERATIONS: usize = 1000;

/// A boundary in one space.
#[derive(Debug, Serialize)]
struct Fitted {
    training: f64,
    training_balanced: f64,
    support_vectors: usize,
    held_out: HeldOut,
}

/// One seed's map.
struct Drawn {
    sampled: Vec<usize>,
    places: Vec<[f64; 2]>,
    boundary: Boundary,
    plane: Fitted,
    components: Fitted,
}

/// `ftac grasps map`.
pub fn run(terminal: &Terminal, args: &MapArgs) -> Outcome {
    if args.n < 4 || args.seeds == 0 {
        bail!("--n and --seeds: found {} and {}, expected at least 4 and 1", args.n, args.seeds);
    }
    let source = Source::read(&args.grasps.paths)?;
    let category = |n: usize| source.taxonomy.types[source.entries[n].decision.kind].category;
    let count = |category_: Category| (0..source.entries.len()).filter(|n| category(*n) == category_).count();
    // What would fail at the end fails at once.
    if count(Category::Power) == 0 || count(Category::Precision) == 0 {
        Err(study::boundary::BoundaryError::OneClass {
            power: count(Category::Power),
            precision: count(Category::Precision),
        })?;
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let maps = contact_maps(&source, terminal.quiet || terminal.json)?;
    let found = pca(&maps, COMPONENTS, terminal.seed)?;
    let mut drawn: Vec<Drawn> = (0..args.seeds)
        .into_par_iter()
        .map(|n| draw(&source, &maps, &found.scores, args.n, terminal.seed + n))
        .collect::<Result<_>>()?;
    let figures: Vec<_> = drawn
        .iter()
        .enumerate()
        .map(|(n, drawn)| json!({ "seed": terminal.seed + n as u64, "map": drawn.plane, "components": drawn.components }))
        .collect();
    let (low, high) = drawn
        .iter()
        .map(|drawn| drawn.plane.training)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let first = drawn.remove(0);
    let answer = json!({
        "grasps": source.entries.len(), "sampled": first.sampled.len(), "points": study::contact_map::POINTS,
        "explained": found.explained, "power": count(Category::Power), "precision": count(Category::Precision),
        "intermediate": count(Category::Intermediate), "training_over_seeds": [low, high], "seeds": figures,
    });
    write(args, &source, &first)?;
    write_whole(&args.out.join("map.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    if terminal.json {
        println!("{answer}");
    } else {
        let explained: f64 = found.explained.iter().sum();
        println!(
            "{} of {} grasps; six components explain {:.1} % of the variance",
            first.sampled.len(),
            source.entries.len(),
            100.0 * explained
        );
        for (name, fitted) in [("t-SNE map", &first.plane), ("six components", &first.components)] {
            let out = &fitted.held_out;
            println!(
                "{name:15} training {:.2} % (paper 81.54 % on its map), balanced {:.2} %; objects left out {:.2} % [{:.2}, {:.2}], balanced {:.2} %; \
                 the larger class alone {:.2} %; {} support vectors",
                100.0 * fitted.training,
                100.0 * fitted.training_balanced,
                100.0 * out.accuracy,
                100.0 * out.interval[0],
                100.0 * out.interval[1],
                100.0 * out.balanced,
                100.0 * out.majority,
                fitted.support_vectors
            );
        }
        println!("training accuracy on the map over {} seeds: {:.2} to {:.2} %", args.seeds, 100.0 * low, 100.0 * high);
        println!("{0}/map.html, map.svg, map.json", args.out.display());
    }
    Ok(None)
}

/// Normalised contact maps of all grasps.
fn contact_maps(source: &Source, quiet: bool) -> Result<Vec<Vec<f64>>> {
    let points = hand_points(&source.hand);
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(source.entries.len() as u64) };
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} contact maps [{elapsed} < {eta}]")?);
    let mut maps: Vec<Vec<f64>> = source
        .entries
        .par_iter()
        .map(|entry| {
            bar.inc(1);
            let shape = &source.objects[entry.object].shape;
            contact_map(&source.hand, &points, &entry.grasp, |point| shape.signed_distance(point).0)
        })
        .collect();
    bar.finish_and_clear();
    normalize(&mut maps);
    Ok(maps)
}

fn draw(source: &Source, maps: &[Vec<f64>], scores: &[Vec<f64>], n: usize, seed: u64) -> Result<Drawn> {
    let first = seed as usize % maps.len();
    let sampled = farthest_points(maps, n, first);
    let rows: Vec<Vec<f64>> = sampled.iter().map(|row| scores[*row].clone()).collect();
    // Few grasps have fewer neighbours.
    let perplexity = PERPLEXITY.min((sampled.len() as f64 - 1.0) / 3.5);
    let places = tsne(&rows, perplexity, ITERATIONS, seed)?;
    let category = |row: usize| source.taxonomy.types[source.entries[row].decision.kind].category;
    let of_two: Vec<usize> = (0..sampled.len()).filter(|k| category(sampled[*k]) != Category::Intermediate).collect();
    let power: Vec<bool> = of_two.iter().map(|k| category(sampled[*k]) == Category::Power).collect();
    let objects: Vec<&str> = of_two.iter().map(|k| source.object(&source.entries[sampled[*k]])).collect();
    let fit = |points: Vec<Vec<f64>>| -> Result<(Boundary, Fitted)> {
        let boundary = Boundary::fit(&points, &power)?;
        let fitted = Fitted {
            training: boundary.accuracy(&points, &power),
            training_balanced: boundary.balanced(&points, &power),
            support_vectors: boundary.support(),
            held_out: held_out(&points, &power, &objects, seed)?,
        };
        Ok((boundary, fitted))
    };
    let (boundary, plane) = fit(of_two.iter().map(|k| places[*k].to_vec()).collect())?;
    let (_, components) = fit(of_two.iter().map(|k| rows[*k].clone()).collect())?;
    Ok(Drawn { sampled, places, boundary, plane, components })
}

fn write(args: &MapArgs, source: &Source, drawn: &Drawn) -> Result<()> {
    let dots: Vec<map::Dot> = drawn
        .sampled
        .iter()
        .enumerate()
        .map(|(n, row)| {
            let entry = &source.entries[*row];
            let kind = &source.taxonomy.types[entry.decision.kind];
            let doubt = if entry.decision.ambiguous { " (ambiguous)" } else { "" };
            let text = format!("{}: {}{doubt}", entry.id, kind.name);
            map::Dot { at: drawn.places[n], category: kind.category, grasp: n, text }
        })
        .collect();
    let title = format!("Contact maps of {} grasps", dots.len());
    let picture = map::svg(&dots, |at| drawn.boundary.power(&at), &title);
    write_whole(&args.out.join("map.svg"), picture.as_bytes())?;
    let scene = source.scene(drawn.sampled.iter().map(|row| &source.entries[*row]));
    let introduction = "Each dot is a grasp; near ones touch with the same parts of the hand. Shading: the side of the boundary \
                        between power and precision. Point at a dot to see the grasp.";
    let page = hover::page(&title, introduction, &format!("<div style=\"max-width:900px\">{picture}</div>"), &scene)?;
    write_whole(&args.out.join("map.html"), page.as_bytes())
}
