//! `ftac grasps hands`: several hands on the same objects, by the same search and the same checks: rates side by side, a grasp of
//! each as a picture.
//!
//! Our own hand is the first row; others come as URDF with what pulls on them. A cell is one hand on one object; it is written
//! when it is done, and the same command goes on after the last one.

mod sheet;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use grasping::synthesis::held::{pose_from_array, pose_to_array};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::Point3;
use scenarios::objects::ObjectSet;
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest as _, Sha256};

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use proving::synthesis::any;
use proving::synthesis::any::describe::{self, Described};
use proving::synthesis::evaluation::Rate;
use proving::synthesis::search::{self, Start, Verified};
use proving::synthesis::subject::Subject;
use proving::synthesis::workshop::{Request, Workshop};
use report::write_whole;

/// Arguments of `grasps hands`.
#[derive(Debug, Args)]
pub struct HandsArgs {
    /// Another hand beside ours: its URDF (repeatable).
    #[arg(long)]
    pub hand: Vec<PathBuf>,
    /// What pulls on that hand's joints, TOML: one for each --hand, in the same order.
    #[arg(long)]
    pub pulls: Vec<PathBuf>,
    /// Objects, separated by commas.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "golf_ball,tennis_ball,box_50,can_66,pawn,vase,coke_can,multimeter"
    )]
    pub objects: Vec<String>,
    /// Chains for each hand and object, each of which may leave one grasp.
    #[arg(long, default_value_t = 12)]
    pub n: u64,
    /// Contact points of a sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "4")]
    pub contacts: String,
    /// Closings tried on each chain's posture until one is verified.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Folder for hands.json, hands.png and the cells; the same command goes on from it.
    #[arg(long, default_value = "recordings/study")]
    pub out: PathBuf,
}

/// A hand of the table.
enum Maker {
    /// Our own.
    Ours,
    /// From files.
    Any(Box<Described>),
}

impl Maker {
    fn name(&self) -> &str {
        match self {
            Self::Ours => "F-TAC",
            Self::Any(hand) => &hand.hand.name,
        }
    }
}

/// What decides a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Asked {
    hand: String,
    object: String,
    chains: u64,
    contacts: (usize, usize),
    closings: usize,
    seed: u64,
    /// SHA-256 of the hand's files.
    files: String,
}

/// A grasp that held, as it is drawn. Palm frame, m, rad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Shown {
    palm_from_object: [f64; 7],
    joints: Vec<f64>,
    contacts: Vec<[f64; 3]>,
    margin: f64,
}

/// One hand on one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Cell {
    asked: Asked,
    closed: u64,
    verified: Verified,
    /// Verified grasps that held when nothing pulled; not tried for our own hand here.
    held_without_tension: Option<u64>,
    best: Option<Shown>,
}

/// `ftac grasps hands`.
pub fn run(terminal: &Terminal, args: &HandsArgs) -> Outcome {
    let contacts = search::parse_contacts(&args.contacts)?;
    if args.n == 0 || args.closings == 0 {
        bail!("--n and --closings: found {} and {}, expected at least 1 of each", args.n, args.closings);
    }
    let (urdfs, pulls) = (args.hand.len(), args.pulls.len());
    ensure!(urdfs == pulls, "--pulls: found {pulls} for {urdfs} --hand, expected one for each, in the same order");
    let set = ObjectSet::repertoire();
    for (n, name) in args.objects.iter().enumerate() {
        ensure!(set.get(name).is_some(), "--objects: found `{name}`, expected one of {}", set.names().join(", "));
        ensure!(!args.objects[..n].contains(name), "--objects: found `{name}` twice, expected each once");
    }
    let request = Request {
        chains: args.n,
        enough: usize::MAX,
        contacts,
        closings: args.closings,
        seed: terminal.seed,
        table: false,
    };
    let mut makers = vec![(Maker::Ours, String::new())];
    for (urdf, pulls) in args.hand.iter().zip(&args.pulls) {
        let hand = Maker::Any(Box::new(describe::read(urdf, pulls)?));
        let known = makers.iter().any(|(maker, _)| maker.name() == hand.name());
        ensure!(!known, "--hand {}: found the name `{}` twice, expected each once", urdf.display(), hand.name());
        makers.push((hand, digest(urdf, pulls)?));
    }
    let folder = args.out.join("hands");
    std::fs::create_dir_all(&folder).with_context(|| format!("--out {}", folder.display()))?;
    let quiet = terminal.quiet || terminal.json;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new((makers.len() * args.objects.len()) as u64) };
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} [{elapsed} < {eta}]")?);
    let mut cells = Vec::new();
    for (maker, files) in &makers {
        for object in &args.objects {
            bar.set_message(format!("{} on {object}", maker.name()));
            let asked = Asked {
                hand: maker.name().into(),
                object: object.clone(),
                chains: args.n,
                contacts,
                closings: args.closings,
                seed: terminal.seed,
                files: files.clone(),
            };
            cells.push(cell(maker, asked, &request, &folder)?);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    sheet::write(&makers.iter().map(|(maker, _)| maker).collect::<Vec<_>>(), &cells, &args.out.join("hands.png"))?;
    let answer = describe_cells(&cells);
    write_whole(&args.out.join("hands.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    if terminal.json {
        println!("{answer}");
    } else {
        tell(&makers, &cells, args);
    }
    let nothing = makers.iter().find(|(maker, _)| total(&cells, maker.name()).count == 0);
    Ok(nothing.map(|(maker, _)| format!("no grasp of {} was verified on any object", maker.name())))
}

fn digest(urdf: &Path, pulls: &Path) -> Result<String> {
    let mut all = Sha256::new();
    for path in [urdf, pulls] {
        all.update(std::fs::read(path).with_context(|| path.display().to_string())?);
    }
    Ok(all.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The cell as an earlier run left it, or made now.
fn cell(maker: &Maker, asked: Asked, request: &Request, folder: &Path) -> Result<Cell> {
    let plain = |name: &str| name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect::<String>();
    let path = folder.join(format!("{}-{}.json", plain(&asked.hand), plain(&asked.object)));
    match std::fs::read_to_string(&path) {
        Ok(text) => {
            let known: Cell = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
            let (found, expected) = (&known.asked, &asked);
            ensure!(
                found == expected,
                "{}: asked: found {found:?}, expected {expected:?}; take another --out",
                path.display()
            );
            return Ok(known);
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
        Err(error) => return Err(error).with_context(|| path.display().to_string()),
    }
    let subject = Subject::named(&asked.object)?;
    let made = match maker {
        Maker::Ours => ours(subject, asked, request)?,
        Maker::Any(hand) => other(hand, &subject, asked, request)?,
    };
    write_whole(&path, serde_json::to_string(&made)?.as_bytes())?;
    Ok(made)
}

fn ours(subject: Subject, asked: Asked, request: &Request) -> Result<Cell> {
    let (report, held) = search::search(&Workshop::new(subject, *request), Start::default(), None, true)?;
    let best = held.iter().max_by(|a, b| a.margin.total_cmp(&b.margin)).map(|grasp| Shown {
        palm_from_object: grasp.palm_from_object,
        joints: grasp.joints.to_vec(),
        contacts: grasp.contacts.iter().map(|contact| contact.point).collect(),
        margin: grasp.margin,
    });
    Ok(Cell { asked, closed: report.found, verified: report.verified, held_without_tension: None, best })
}

fn other(hand: &Described, subject: &Subject, asked: Asked, request: &Request) -> Result<Cell> {
    let (report, held) = any::search(hand, subject, request)?;
    let best = held.iter().max_by(|a, b| a.margin.total_cmp(&b.margin)).map(|grasp| Shown {
        palm_from_object: pose_to_array(&(hand.palm_from_root * pose_from_array(&grasp.root_from_object))),
        joints: grasp.joints.iter().map(|(_, angle)| *angle).collect(),
        contacts: grasp
            .contacts
            .iter()
            .map(|(_, point, ..)| (hand.palm_from_root * Point3::from(*point)).coords.into())
            .collect(),
        margin: grasp.margin,
    });
    let slack = Some(report.held_without_tension);
    Ok(Cell { asked, closed: report.found, verified: report.verified, held_without_tension: slack, best })
}

fn rate(cell: &Cell) -> Rate {
    Rate::new(cell.verified.all, cell.asked.chains)
}

/// All of a hand's cells together.
fn total(cells: &[Cell], hand: &str) -> Rate {
    let own = cells.iter().filter(|cell| cell.asked.hand == hand);
    let (count, of) = own.fold((0, 0), |(count, of), cell| (count + cell.verified.all, of + cell.asked.chains));
    Rate::new(count, of)
}

fn describe_cells(cells: &[Cell]) -> serde_json::Value {
    let rows: Vec<_> = cells
        .iter()
        .map(|cell| {
            let Rate { count, of, low, high, .. } = rate(cell);
            json!({
                "hand": cell.asked.hand, "object": cell.asked.object, "verified": count, "of": of, "low": low, "high": high,
                "closed": cell.closed, "checks": cell.verified, "held_without_tension": cell.held_without_tension,
            })
        })
        .collect();
    let hands: BTreeMap<&str, Rate> =
        cells.iter().map(|cell| (cell.asked.hand.as_str(), total(cells, &cell.asked.hand))).collect();
    json!({ "rows": rows, "hands": hands })
}

fn tell(makers: &[(Maker, String)], cells: &[Cell], args: &HandsArgs) {
    let percent = |rate: &Rate| {
        let (low, high) = (100.0 * rate.low, 100.0 * rate.high);
        format!("{}/{} [{low:.0}, {high:.0}] %", rate.count, rate.of)
    };
    let widths: Vec<usize> = makers.iter().map(|(maker, _)| maker.name().len().max(18)).collect();
    let line = |first: &str, words: &[String]| {
        let rest: String = words.iter().zip(&widths).map(|(word, width)| format!("  {word:>width$}")).collect();
        println!("{first:14}{rest}");
    };
    println!("grasps that pass all three checks, of chains, with Wilson 95 % intervals");
    line("object", &makers.iter().map(|(maker, _)| maker.name().to_owned()).collect::<Vec<_>>());
    for object in &args.objects {
        let own = cells.iter().filter(|cell| cell.asked.object == *object);
        line(object, &own.map(|cell| percent(&rate(cell))).collect::<Vec<_>>());
    }
    line("all", &makers.iter().map(|(maker, _)| percent(&total(cells, maker.name()))).collect::<Vec<_>>());
    println!("{0}/hands.png, hands.json", args.out.display());
}
