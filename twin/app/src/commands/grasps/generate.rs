//! `ftac grasps generate` and `eval`: grasps for any object, sampled, closed by cables and held in physics.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use grasping::synthesis::held::{Header, HeldWriter, VERSION};
use proving::synthesis::evaluation::{self, Rate};
use proving::synthesis::search::{self, Start};
use proving::synthesis::subject::Subject;
use proving::synthesis::workshop::{Request, Workshop};

use super::other_hand;
use crate::terminal::{Outcome, Terminal};

/// What grasps are synthesized for.
#[derive(Debug, Args)]
pub struct SynthesisArgs {
    /// An object of the set.
    #[arg(long, required_unless_present = "mesh", conflicts_with = "mesh")]
    pub object: Option<String>,
    /// A mesh of your own: OBJ, in metres; one that is not watertight is rebuilt.
    #[arg(long)]
    pub mesh: Option<PathBuf>,
    /// Contact points of a sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "5")]
    pub contacts: String,
    /// Keep the hand out of the table on which the object rests.
    #[arg(long)]
    pub table: bool,
    /// Closings tried on each chain's posture until one is verified: the plain one, then varied tensions and small offsets.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
}

/// Arguments of `grasps generate`.
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// What for.
    #[command(flatten)]
    pub synthesis: SynthesisArgs,
    /// Chains, each of which may leave one grasp.
    #[arg(long, default_value_t = 512)]
    pub n: u64,
    /// Stop when so many different grasps are verified.
    #[arg(long, conflicts_with = "hand")]
    pub keep: Option<usize>,
    /// File for the verified grasps, JSON lines; it grows while the search runs.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Another hand: its URDF.
    #[arg(long, requires = "pulls", conflicts_with = "table")]
    pub hand: Option<PathBuf>,
    /// What pulls on that hand's joints: actuators and their moment arms, TOML.
    #[arg(long, requires = "hand")]
    pub pulls: Option<PathBuf>,
}

fn request(terminal: &Terminal, args: &SynthesisArgs, n: u64, enough: usize) -> Result<(Subject, Request)> {
    if n == 0 {
        bail!("--n: found 0, expected at least 1");
    }
    let contacts = search::parse_contacts(&args.contacts)?;
    let subject = match (&args.object, &args.mesh) {
        (Some(name), _) => Subject::named(name)?,
        (None, Some(path)) => {
            let (subject, note) = Subject::from_mesh(path)?;
            if let Some(note) = note {
                eprintln!("{}: {note}", path.display());
            }
            subject
        }
        (None, None) => bail!("--object: found none, expected an object's name or --mesh FILE"),
    };
    if args.closings == 0 {
        bail!("--closings: found 0, expected at least 1");
    }
    let request =
        Request { chains: n, enough, contacts, closings: args.closings, seed: terminal.seed, table: args.table };
    Ok((subject, request))
}

/// `ftac grasps generate`.
pub fn generate(terminal: &Terminal, args: &GenerateArgs) -> Outcome {
    let GenerateArgs { synthesis: args, n, keep, out, hand, pulls } = args;
    let (n, keep) = (*n, *keep);
    if let Some(out) = out {
        search::check_writable(out)?;
    }
    let (subject, request) = request(terminal, args, n, keep.unwrap_or(usize::MAX))?;
    if let (Some(hand), Some(pulls)) = (hand, pulls) {
        return other_hand::generate(terminal, (hand, pulls), &subject, &request, out.as_ref());
    }
    let workshop = Workshop::new(subject, request);
    let what = match (&args.object, &args.mesh) {
        (Some(name), _) => format!("--object {name}"),
        (None, mesh) => format!("--mesh {}", mesh.as_deref().unwrap_or(Path::new("")).display()),
    };
    let mut options = keep.map_or(String::new(), |keep| format!(" --keep {keep}"));
    options += if args.table { " --table" } else { "" };
    options += &format!(" --closings {}", args.closings);
    let command =
        format!("ftac grasps generate {what} --n {n} --contacts {}{options} --seed {}", args.contacts, terminal.seed);
    let header = Header { version: VERSION, command, seed: terminal.seed };
    let writer = out.as_ref().map(|path| HeldWriter::create(path, &header)).transpose()?;
    let (report, _) = search::search(&workshop, Start::default(), writer, terminal.quiet || terminal.json)?;
    if terminal.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        let share = |count: u64| format!("{count:5} ({:.1} %)", 100.0 * count as f64 / report.requested as f64);
        println!(
            "{}: {} chains, {:.1} s, {:.0} grasp-steps/s per thread",
            report.object, report.requested, report.wall_s, report.grasp_steps_per_s
        );
        println!("closed            {}", share(report.found));
        println!("  blocked         {}", share(report.blocked));
        println!("  pushed away     {}", share(report.pushed_away));
        println!("(a) cone program  {}", share(report.verified.a));
        println!("(b) penetration   {}", share(report.verified.b));
        println!("(c) held          {}", share(report.verified.c));
        println!("all three         {}", share(report.verified.all));
        println!("  at first closing{}; {} closings in all", share(report.plain), report.closings);
        println!("kept              {:5}, without {} near duplicates", report.kept, report.duplicates);
        let digits: Vec<String> = report.digits.iter().map(|(name, count)| format!("{name} {count}")).collect();
        println!("digits            {}", digits.join(", "));
    }
    Ok((report.verified.all == 0).then(|| format!("no grasp of {} was verified in {n} chains", report.object)))
}

/// `ftac grasps eval`.
pub fn eval(terminal: &Terminal, args: &SynthesisArgs, n: u64) -> Outcome {
    let (subject, request) = request(terminal, args, n, usize::MAX)?;
    let workshop = Workshop::new(subject, request);
    let evaluation = evaluation::evaluate(&workshop, n)?;
    if terminal.json {
        println!("{}", serde_json::to_string(&evaluation)?);
    } else {
        let row = |name: &str, rate: &Rate| match rate.rate {
            Some(p) => {
                let (p, low, high) = (100.0 * p, 100.0 * rate.low, 100.0 * rate.high);
                println!("{name:24} {:5} of {:5} = {p:5.1} % [{low:.1}, {high:.1}]", rate.count, rate.of);
            }
            None => println!("{name:24} nothing to count"),
        };
        println!("{}: rates with Wilson 95 % intervals, {:.1} s", evaluation.object, evaluation.wall_s);
        row("closed", &evaluation.found);
        for (name, rate) in &evaluation.verified {
            row(name, rate);
        }
        for (name, rate) in &evaluation.controls {
            row(&format!("control {name}: held"), rate);
        }
        for (name, area) in &evaluation.roc_area {
            println!("ROC area of {name:12} {}", area.map_or("-".into(), |area| format!("{area:.3}")));
        }
    }
    let fooled = evaluation.controls.iter().find(|(_, rate)| rate.low > 0.5);
    Ok(fooled.map(|(name, rate)| format!("the negative control {name} held {} of {}", rate.count, rate.of)))
}
