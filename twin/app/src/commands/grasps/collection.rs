//! `ftac grasps repertoire`: verified grasps for every object of the set, in one compact file.
//!
//! Objects are searched one after the other, each into a file of its own in the folder of parts, which grows by a line as each
//! grasp is found. The same command goes on where an interrupted one was; the grasps are the same either way, because a
//! chain is its number and grasps are taken in the order of their chains. A run that wants more goes on from one that wanted fewer.

use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use grasping::synthesis::collection::{self, Collection, ObjectGrasps, Summary};
use grasping::synthesis::diversity::{self, Diversity};
use grasping::synthesis::held::{self, HeldWriter};
use scenarios::objects::ObjectSet;
use serde::Serialize;

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use proving::synthesis::search::{self, Report, Start};
use proving::synthesis::subject::Subject;
use proving::synthesis::workshop::{Request, Workshop};
use report::write_whole;

/// Arguments of `grasps repertoire`.
#[derive(Debug, Args)]
pub struct RepertoireArgs {
    /// Objects; default: all 23.
    #[arg(long)]
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
#[derive(Debug, Serialize)]
struct Line {
    #[serde(flatten)]
    summary: Summary,
    diversity: Diversity,
}

/// What the command prints with `--json`.
#[derive(Debug, Serialize)]
struct Answer {
    grasps: usize,
    wanted: usize,
    wall_s: f64,
    objects: Vec<Line>,
    all: Diversity,
}

/// `ftac grasps repertoire`.
pub fn make(terminal: &Terminal, args: &RepertoireArgs) -> Outcome {
    if args.each == 0 || args.chains == 0 || args.closings == 0 {
        bail!(
            "--each, --chains, --closings: found {}, {}, {}, expected at least 1",
            args.each,
            args.chains,
            args.closings
        );
    }
    let contacts = search::parse_contacts(&args.contacts)?;
    search::check_writable(&args.out)?;
    let set = ObjectSet::repertoire();
    let names: Vec<String> =
        if args.object.is_empty() { set.names().into_iter().map(str::to_owned).collect() } else { args.object.clone() };
    if let Some(unknown) = names.iter().find(|name| set.get(name).is_none()) {
        bail!("--object: no object is called `{unknown}`; known are: {}", set.names().join(", "));
    }
    std::fs::create_dir_all(&args.parts).with_context(|| format!("--parts {}", args.parts.display()))?;
    let start = Instant::now();
    let request = Request {
        chains: args.chains,
        enough: args.each,
        contacts,
        closings: args.closings,
        seed: terminal.seed,
        table: false,
    };
    let mut objects = Vec::new();
    for name in &names {
        let entry = one(name, request, args, terminal.quiet || terminal.json)?;
        if !terminal.quiet {
            let Summary { object, kept, chains, short, .. } = &entry.summary;
            eprintln!("{object:16} {kept:4} grasps from {chains} chains {}", short.as_deref().unwrap_or(""));
        }
        objects.push(entry);
    }
    let command = command(&request, args);
    let header = collection::Header { version: collection::VERSION, command, seed: terminal.seed };
    let collection = Collection { header, objects };
    write_whole(&args.out, collection.to_text()?.as_bytes())?;
    tell(terminal, &collection, start.elapsed().as_secs_f64())
}

/// What decides the grasps of an object; how many of them are wanted does not.
fn part_command(object: &str, request: &Request, args: &RepertoireArgs) -> String {
    let Request { closings, seed, .. } = request;
    format!("ftac grasps repertoire --object {object} --contacts {} --closings {closings} --seed {seed}", args.contacts)
}

/// The command that makes the whole.
fn command(request: &Request, args: &RepertoireArgs) -> String {
    let objects: String = args.object.iter().map(|name| format!(" --object {name}")).collect();
    format!(
        "ftac grasps repertoire{objects} --each {} --contacts {} --closings {} --chains {} --seed {}",
        args.each, args.contacts, request.closings, request.chains, request.seed
    )
}

fn one(name: &str, request: Request, args: &RepertoireArgs, quiet: bool) -> Result<ObjectGrasps> {
    let path = args.parts.join(format!("{name}.jsonl"));
    let header =
        held::Header { version: held::VERSION, command: part_command(name, &request, args), seed: request.seed };
    if args.pack && !path.exists() {
        let short = Some("not searched yet".into());
        let summary = Summary { object: name.into(), wanted: request.enough, kept: 0, chains: 0, short };
        return Ok(ObjectGrasps { summary, grasps: Vec::new() });
    }
    let (writer, kept) = if path.exists() {
        HeldWriter::resume(&path, &header)?
    } else {
        (HeldWriter::create(&path, &header)?, Vec::new())
    };
    let chain = kept.last().map_or(0, |grasp| grasp.chain + 1);
    let (report, grasps) = if kept.len() < request.enough && !args.pack {
        let workshop = Workshop::new(Subject::named(name)?, request);
        search::search(&workshop, Start { chain, kept }, Some(writer), quiet)?
    } else {
        (Report::default(), kept.into_iter().take(request.enough).collect())
    };
    let full = grasps.len() >= request.enough;
    let last = grasps.last().map_or(0, |grasp| grasp.chain + 1);
    let chains = if full || args.pack { last } else { request.chains };
    let short = (!full).then(|| {
        if args.pack {
            return "the search is not finished".to_owned();
        }
        format!(
            "{} chains from number {chain} on: {} blocked, {} pushed away, {} closed but not verified, {} near duplicates",
            report.requested,
            report.blocked,
            report.pushed_away,
            report.found - report.verified.all,
            report.duplicates
        )
    });
    let summary = Summary { object: name.into(), wanted: request.enough, kept: grasps.len(), chains, short };
    Ok(ObjectGrasps { summary, grasps })
}

fn tell(terminal: &Terminal, collection: &Collection, wall_s: f64) -> Outcome {
    let wanted = collection.objects.iter().map(|entry| entry.summary.wanted).sum();
    let objects: Vec<Line> = collection
        .objects
        .iter()
        .map(|entry| Line { summary: entry.summary.clone(), diversity: diversity::describe(&entry.grasps) })
        .collect();
    let answer = Answer {
        grasps: collection.grasps().count(),
        wanted,
        wall_s,
        objects,
        all: diversity::describe(collection.grasps()),
    };
    if terminal.json {
        println!("{}", serde_json::to_string(&answer)?);
    } else {
        print!("{}", table(collection));
        println!("{} of {wanted} grasps, {wall_s:.0} s", answer.grasps);
    }
    Ok((answer.grasps < wanted).then(|| format!("{} of {wanted} grasps were found", answer.grasps)))
}

/// One line an object and one for all: how many, from how many chains, and how different they are.
pub fn table(collection: &Collection) -> String {
    let mut text = format!(
        "{:16} {:>6} {:>6} {:>4}  {:>4} {:>4} {:>4} {:>4} {:>4} {:>4}  {:>4} {:>4} {:>4} {:>4}  {:>6} {:>4} {:>4} {:>4}\n",
        "%",
        "grasps",
        "chains",
        "sets",
        "T",
        "I",
        "M",
        "R",
        "L",
        "palm",
        "pad",
        "palm",
        "side",
        "fing",
        "abduct",
        "PC1",
        "PC3",
        "PC6"
    );
    let mut line = |name: &str, chains: u64, d: &Diversity| {
        let percent = |share: f64| format!("{:4.0}", 100.0 * share);
        let kind = |name: &str| percent(d.opposition.get(name).copied().unwrap_or(0) as f64 / d.grasps.max(1) as f64);
        let explained = |n: usize| d.explained.get(n - 1).map_or("   -".into(), |share| percent(*share));
        let digits: Vec<String> = d.digits.iter().map(|share| percent(*share)).collect();
        text += &format!(
            "{name:16} {:6} {chains:6} {:4}  {} {}  {} {} {} {}  {:>6} {} {} {}\n",
            d.grasps,
            d.sets.len(),
            digits.join(" "),
            percent(d.palm),
            kind("pad"),
            kind("palm"),
            kind("side"),
            kind("fingers"),
            percent(d.thumb[2]),
            explained(1),
            explained(3),
            explained(6)
        );
    };
    for entry in &collection.objects {
        line(&entry.summary.object, entry.summary.chains, &diversity::describe(&entry.grasps));
    }
    let chains = collection.objects.iter().map(|entry| entry.summary.chains).sum();
    line("all", chains, &diversity::describe(collection.grasps()));
    text
}
