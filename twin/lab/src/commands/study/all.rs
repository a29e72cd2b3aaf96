//! `ftac study`: runs every part of the grasp study in order, and makes the page that compares them with the paper.
//!
//! Types and maps are computed again each time. Landscape and hands keep journals in the folder and resume from them.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use ftac::lab::arguments::grasps::{ClassifyArgs, HandsArgs, LandscapeArgs, MapArgs};
use ftac::lab::arguments::study::StudyArgs;
use ftac::options::renamed_options;
use ftac::terminal::{CommandOutput, Outcome, Terminal};
use indicatif::HumanDuration;

use super::source::GraspSource;
use super::{classify, hands, landscape, map, report};

/// Result of a part in words, and the reason why it falls short, if it does.
type PartResult = (String, Option<String>);

fn part_result<T>(made: CommandOutput<T>) -> PartResult {
    (made.text, made.shortfall)
}

/// A part of the study.
struct StudyPart {
    name: &'static str,
    /// Expected time on two idle cores, s: quick and full.
    expected: [f64; 2],
    make: fn(&Terminal, &StudyArgs, PathBuf) -> Result<PartResult>,
}

/// Parts in order. The times are for the built-in grasps and hand; they only weight the parts relative to each other.
const PARTS: [StudyPart; 4] = [
    StudyPart { name: "types of grasps", expected: [1.0, 1.0], make: classify_types },
    StudyPart { name: "contact maps", expected: [30.0, 30.0], make: draw_maps },
    StudyPart { name: "energy landscape", expected: [60.0, 2500.0], make: map_basins },
    StudyPart { name: "hands compared", expected: [60.0, 200.0], make: compare_hands },
];

/// Runs `ftac study`.
pub fn run(terminal: &Terminal, args: &StudyArgs) -> Outcome {
    renamed_options::note_renamed_options();
    let standard = if args.full { "recordings/study-full" } else { "recordings/study" };
    let out = args.out.clone().unwrap_or_else(|| standard.into());
    // Checks the hands first, so that an error in the last part appears at once.
    hands::compared_hands(&hands_args(args, out.clone())?)?;
    std::fs::create_dir_all(&out).with_context(|| format!("--out {}", out.display()))?;
    let expected = |part: &StudyPart| part.expected[usize::from(args.full)];
    let began = Instant::now();
    let mut shortfalls = Vec::new();
    for (n, part) in PARTS.iter().enumerate() {
        let (before, left): (f64, f64) = (PARTS[..n].iter().map(expected).sum(), PARTS[n..].iter().map(expected).sum());
        // The finished parts show whether the machine is slower or busier.
        let pace = if n == 0 { 1.0 } else { began.elapsed().as_secs_f64() / before };
        if !terminal.quiet {
            let left = HumanDuration(Duration::from_secs_f64(pace * left));
            eprintln!("part {} of {}: {}; about {left:#} left", n + 1, PARTS.len(), part.name);
        }
        let (text, shortfall) = (part.make)(terminal, args, out.clone()).with_context(|| part.name)?;
        if !terminal.json && !terminal.quiet {
            println!("{text}");
        }
        shortfalls.extend(shortfall);
    }
    shortfalls.extend(report::report_folders(terminal, &[out])?);
    Ok((!shortfalls.is_empty()).then(|| shortfalls.join("; ")))
}

fn classify_types(_: &Terminal, args: &StudyArgs, out: PathBuf) -> Result<PartResult> {
    let grasps = args.grasps.clone();
    let args =
        ClassifyArgs { grasps, explain: None, labels: Vec::new(), out: Some(out), like_people: None, pairs: None };
    classify::make(&args).map(part_result)
}

fn draw_maps(terminal: &Terminal, args: &StudyArgs, out: PathBuf) -> Result<PartResult> {
    let grasps = args.grasps.clone();
    map::make(terminal, &MapArgs { grasps, out, ..default_args()? }).map(part_result)
}

fn map_basins(terminal: &Terminal, args: &StudyArgs, out: PathBuf) -> Result<PartResult> {
    let standard: LandscapeArgs = default_args()?;
    let each = if args.full { standard.each } else { 24 };
    let sweep = args.full.then_some(24);
    let (grasps, out) = (args.grasps.clone(), out.join("landscape"));
    // The paper's objects with grasps.
    let known = GraspSource::read(&grasps.paths)?.classification.objects;
    let objects = standard.objects.into_iter().filter(|object| known.contains(object)).collect();
    landscape::make(terminal, &LandscapeArgs { grasps, objects, each, sweep, out, ..standard }).map(part_result)
}

fn compare_hands(terminal: &Terminal, args: &StudyArgs, out: PathBuf) -> Result<PartResult> {
    hands::make(terminal, &hands_args(args, out)?).map(part_result)
}

fn hands_args(args: &StudyArgs, out: PathBuf) -> Result<HandsArgs> {
    let standard: HandsArgs = default_args()?;
    let n = if args.full { standard.n } else { 4 };
    Ok(HandsArgs { hand: args.hand.clone(), pulls: args.pulls.clone(), n, out, ..standard })
}

/// Returns a command's default arguments.
fn default_args<A: Args>() -> Result<A> {
    let command = A::augment_args(clap::Command::new("ftac"));
    Ok(A::from_arg_matches(&command.try_get_matches_from(["ftac"])?)?)
}
