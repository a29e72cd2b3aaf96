//! `ftac grasps collection`: verified grasps of every object of the set, in one compact file.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;
use grasping::synthesis::collection::{self, Collection, ObjectGrasps, Summary};
use grasping::synthesis::diversity::{self, Diversity};
use grasping::synthesis::grasp_file;
use hand_model::RobotModel;
use platform::data::write_whole;
use proving::synthesis::parts::{Part, table};
use proving::synthesis::search;
use proving::synthesis::synthesizer::Request;
use schemars::JsonSchema;
use serde::Serialize;
use world::objects::ObjectSet;

use crate::options::object_name::object_name;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps collection`.
#[derive(Debug, Args)]
pub struct CollectionArgs {
    /// Objects; default: all 23.
    #[arg(long, value_parser = object_name)]
    pub object: Vec<String>,
    /// Verified, different grasps of each object.
    #[arg(long, default_value_t = 150)]
    pub each: usize,
    /// Contact points of a sample, taken in turn.
    #[arg(long, default_value = "2-5")]
    pub contacts: String,
    /// Closings tried on each chain's posture.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Chains at most for each object.
    #[arg(long, default_value_t = 3000)]
    pub chains: u64,
    /// Folder of the parts, one file an object; they grow while the search runs, and the same command goes on from them.
    #[arg(long, default_value = "recordings/synthesis")]
    pub parts: PathBuf,
    /// Search no further: write what the parts hold.
    #[arg(long)]
    pub pack: bool,
    /// The file to write when all are done.
    #[arg(long)]
    pub out: PathBuf,
}

/// One object's line of the answer.
#[derive(Debug, Serialize, JsonSchema)]
struct Line {
    #[serde(flatten)]
    summary: Summary,
    diversity: Diversity,
}

/// What the command prints with `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Answer {
    grasps: usize,
    /// Grasps asked for.
    wanted: usize,
    /// Time on this machine, s.
    wall_s: f64,
    /// One entry an object.
    objects: Vec<Line>,
    all: Diversity,
}

/// `ftac grasps collection`.
pub fn make(terminal: &Terminal, args: &CollectionArgs) -> Outcome {
    let (each, chains, closings) = (args.each, args.chains, args.closings);
    ensure!(
        each > 0 && chains > 0 && closings > 0,
        "--each, --chains, --closings: found {each}, {chains}, {closings}, expected at least 1"
    );
    let contacts = search::parse_contacts(&args.contacts)?;
    search::check_writable(&args.out)?;
    let set = ObjectSet::repertoire();
    let known = set.names();
    let names: Vec<&str> =
        if args.object.is_empty() { known.clone() } else { args.object.iter().map(String::as_str).collect() };
    if let Some(unknown) = names.iter().find(|name| set.get(name).is_none()) {
        anyhow::bail!("--object: no object is called `{unknown}`; known are: {}", known.join(", "));
    }
    std::fs::create_dir_all(&args.parts).with_context(|| format!("--parts {}", args.parts.display()))?;
    let start = Instant::now();
    let request = Request { chains, enough: each, contacts, closings, seed: terminal.seed, table: false };
    let mut objects = Vec::new();
    for name in names {
        let entry = part(terminal, args, name, request)?;
        if !terminal.quiet {
            let Summary { object, kept, chains, short, .. } = &entry.summary;
            eprintln!("{object:16} {kept:4} grasps from {chains} chains {}", short.as_deref().unwrap_or(""));
        }
        objects.push(entry);
    }
    let header =
        collection::Header { version: collection::VERSION, command: command(terminal, args), seed: terminal.seed };
    let collection = Collection { header, objects };
    write_whole(&args.out, collection.to_text()?.as_bytes())?;
    tell(terminal, &collection, start.elapsed().as_secs_f64())
}

/// The command that makes the whole.
fn command(terminal: &Terminal, args: &CollectionArgs) -> String {
    let objects: String = args.object.iter().map(|name| format!(" --object {name}")).collect();
    format!(
        "ftac grasps collection{objects} --each {} --contacts {} --closings {} --chains {} --seed {}",
        args.each, args.contacts, args.closings, args.chains, terminal.seed
    )
}

/// The grasps of one object, found in its part or now.
fn part(terminal: &Terminal, args: &CollectionArgs, object: &str, request: Request) -> Result<ObjectGrasps> {
    let command = format!(
        "ftac grasps collection --object {object} --contacts {} --closings {} --seed {}",
        args.contacts, args.closings, terminal.seed
    );
    let file = args.parts.join(format!("{object}.jsonl"));
    let header = grasp_file::Header::new(command, terminal.seed);
    let part = Part { object, file: &file, header: &header };
    if args.pack {
        part.found(args.each)
    } else {
        part.fill(&RobotModel::ftac_gen3().hand, request, &terminal.progress())
    }
}

fn tell(terminal: &Terminal, collection: &Collection, wall_s: f64) -> Outcome {
    let line =
        |entry: &ObjectGrasps| Line { summary: entry.summary.clone(), diversity: diversity::describe(&entry.grasps) };
    let (grasps, wanted) =
        (collection.grasps().count(), collection.objects.iter().map(|entry| entry.summary.wanted).sum());
    let answer = Answer {
        grasps,
        wanted,
        wall_s,
        objects: collection.objects.iter().map(line).collect(),
        all: diversity::describe(collection.grasps()),
    };
    terminal.print(&answer, &format!("{}{grasps} of {wanted} grasps, {wall_s:.0} s\n", table(collection)))?;
    Ok((grasps < wanted).then(|| format!("{grasps} of {wanted} grasps were found")))
}
