//! `ftac grasps collection`: verified grasps of every object of the set, in one compact file.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;
use dexterous_grasping::synthesis::collection::{self, Collection, ObjectGrasps, SearchSummary};
use dexterous_grasping::synthesis::diversity::{self, Diversity};
use dexterous_grasping::synthesis::grasp_file;
use ftac_platform::data::write_atomically;
use grasp_verification::synthesis::parts::{CollectionPart, table};
use grasp_verification::synthesis::search;
use grasp_verification::synthesis::synthesizer::SynthesisRequest;
use hand_model::RobotModel;
use schemars::JsonSchema;
use serde::Serialize;
use world::objects::ObjectSet;

use crate::options::object_name::object_name;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps collection`.
#[derive(Debug, Args)]
pub struct CollectionArgs {
    /// Object (repeatable); default: all 23.
    #[arg(long, value_parser = object_name)]
    pub object: Vec<String>,
    /// Number of verified, different grasps per object.
    #[arg(long, default_value_t = 150)]
    pub each: usize,
    /// Contact points per sample: a number, or a range taken in turn.
    #[arg(long, default_value = "2-5")]
    pub contacts: String,
    /// Number of closings tried on the posture of each chain.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Maximum number of chains per object.
    #[arg(long, default_value_t = 3000)]
    pub chains: u64,
    /// Folder of the parts, one file per object. They grow during the search, and the same command resumes from them.
    #[arg(long, default_value = "recordings/synthesis")]
    pub parts: PathBuf,
    /// Do not search; write the grasps that the parts hold.
    #[arg(long)]
    pub pack: bool,
    /// File to write when all objects are done.
    #[arg(long)]
    pub out: PathBuf,
}

/// Result for one object.
#[derive(Debug, Serialize, JsonSchema)]
struct CollectionRow {
    #[serde(flatten)]
    summary: SearchSummary,
    diversity: Diversity,
}

/// JSON output of `grasps collection`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CollectionOutput {
    grasps: usize,
    /// Number of grasps asked for.
    requested: usize,
    /// Wall time, s.
    wall_s: f64,
    /// One entry per object.
    objects: Vec<CollectionRow>,
    all: Diversity,
}

/// Runs `ftac grasps collection`.
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
        anyhow::bail!("--object: found `{unknown}`, expected one of {}", known.join(", "));
    }
    if args.pack && !args.parts.is_dir() {
        anyhow::bail!("--parts: found no folder {}, expected the parts to pack", args.parts.display());
    }
    std::fs::create_dir_all(&args.parts).with_context(|| format!("--parts {}", args.parts.display()))?;
    let start = Instant::now();
    let request = SynthesisRequest { chains, max_grasps: each, contacts, closings, seed: terminal.seed, table: false };
    let mut objects = Vec::new();
    for name in names {
        let entry = object_grasps(terminal, args, name, request)?;
        if !terminal.quiet {
            let SearchSummary { object, kept, chains, short, .. } = &entry.summary;
            eprintln!("{object:16} {kept:4} grasps from {chains} chains {}", short.as_deref().unwrap_or(""));
        }
        objects.push(entry);
    }
    let header = collection::CollectionHeader {
        version: collection::VERSION,
        command: collection_command(terminal, args),
        seed: terminal.seed,
    };
    let collection = Collection { header, objects };
    if collection.grasps().next().is_none() {
        // An earlier collection stays.
        anyhow::bail!("--parts: found no grasp in {}, expected some; nothing was written", args.parts.display());
    }
    write_atomically(&args.out, collection.to_text()?.as_bytes())?;
    print_output(terminal, &collection, start.elapsed().as_secs_f64())
}

/// Returns the command that makes the whole collection.
fn collection_command(terminal: &Terminal, args: &CollectionArgs) -> String {
    let objects: String = args.object.iter().map(|name| format!(" --object {name}")).collect();
    format!(
        "ftac grasps collection{objects} --each {} --contacts {} --closings {} --chains {} --seed {}",
        args.each, args.contacts, args.closings, args.chains, terminal.seed
    )
}

/// Returns the grasps of one object, from its part or from a search now.
fn object_grasps(
    terminal: &Terminal,
    args: &CollectionArgs,
    object: &str,
    request: SynthesisRequest,
) -> Result<ObjectGrasps> {
    let command = format!(
        "ftac grasps collection --object {object} --contacts {} --closings {} --seed {}",
        args.contacts, args.closings, terminal.seed
    );
    let file = args.parts.join(format!("{object}.jsonl"));
    let header = grasp_file::GraspFileHeader::new(command, terminal.seed);
    let part = CollectionPart { object, file: &file, header: &header };
    if args.pack {
        part.found_so_far(args.each)
    } else {
        part.fill(&RobotModel::ftac_gen3().hand, request, &terminal.progress())
    }
}

fn print_output(terminal: &Terminal, collection: &Collection, wall_s: f64) -> Outcome {
    let line = |entry: &ObjectGrasps| CollectionRow {
        summary: entry.summary.clone(),
        diversity: diversity::describe(&entry.grasps),
    };
    let (grasps, wanted) =
        (collection.grasps().count(), collection.objects.iter().map(|entry| entry.summary.requested).sum());
    let answer = CollectionOutput {
        grasps,
        requested: wanted,
        wall_s,
        objects: collection.objects.iter().map(line).collect(),
        all: diversity::describe(collection.grasps()),
    };
    terminal.print(&answer, &format!("{}{grasps} of {wanted} grasps, {wall_s:.0} s\n", table(collection)))?;
    Ok((grasps < wanted).then(|| format!("{grasps} of {wanted} grasps were found")))
}
