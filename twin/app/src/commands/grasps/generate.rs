//! `ftac grasps generate` and `ftac grasps eval`: grasps for any object, sampled, closed by cables and held in physics.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::{Args, ValueEnum};
use dexterous_grasping::synthesis::grasp_file::{GraspFileHeader, GraspWriter, HandSource};
use dexterous_grasping::synthesis::hand_use::HandUse;
use dexterous_grasping::taxonomy::{GraspType, Taxonomy};
use grasp_verification::synthesis::evaluation::{self, Evaluation};
use grasp_verification::synthesis::grasp_file::{GraspFile, source_file};
use grasp_verification::synthesis::grasping_hand::GraspingHand;
use grasp_verification::synthesis::reevaluation;
use grasp_verification::synthesis::search::{self, SearchStart};
use grasp_verification::synthesis::size::HandOpening;
use grasp_verification::synthesis::subject::{PreparedObject, TEST_FRICTION};
use grasp_verification::synthesis::synthesizer::{SynthesisRequest, Synthesizer};
use grasp_verification::synthesis::type_filter::GraspTypeFilter;
use grasp_verification::synthesis::urdf_hand::describe;
use hand_model::{Digit, RobotModel};

use crate::options::object_name::object_name;
use crate::options::renamed_options;
use crate::terminal::{Outcome, Terminal};

/// Limits of the object: mass from that of a feather on, kg; density, kg/m3; friction coefficient.
const MIN_MASS: f64 = 1e-4;
const MAX_MASS: f64 = 10.0;
const MIN_DENSITY: f64 = 1.0;
const MAX_DENSITY: f64 = 25_000.0;
const MIN_FRICTION: f64 = 0.01;
const MAX_FRICTION: f64 = 3.0;

/// A part of the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HandPart {
    Thumb,
    Index,
    Middle,
    Ring,
    Little,
    Palm,
}

impl HandPart {
    fn digit(self) -> Option<Digit> {
        Digit::ALL.get(self as usize).copied()
    }
}

/// Returns the built-in hand, restricted to the parts of the arguments and to its use in grasps of type `kind`.
fn built_in_hand(args: &SynthesisArgs, kind: Option<&str>) -> Result<GraspingHand> {
    let hand = GraspingHand::from_hand(RobotModel::ftac_gen3().hand);
    let is_wanted = |known: &GraspType| kind == Some(known.name.as_str());
    let form = Taxonomy::paper().types.into_iter().find(is_wanted).map(|kind| kind.form);
    if args.parts.is_empty() {
        return Ok(match form {
            Some(form) => hand.limited_to(&form),
            None => hand,
        });
    }
    let digits: Vec<Digit> = args.parts.iter().filter_map(|part| part.digit()).collect();
    let palm = args.parts.contains(&HandPart::Palm);
    anyhow::ensure!(
        digits.len() + usize::from(palm) > 1 && !digits.is_empty(),
        "--parts: found one part, expected a digit and another part"
    );
    let parts = HandUse::with_digits(digits, palm);
    let in_use = match form {
        Some(form) => HandUse { digits: parts.digits, palm, ..form },
        None => parts,
    };
    Ok(hand.limited_to(&in_use))
}

/// Parses the name of a grasp type of the taxonomy, whatever its case and separators.
fn grasp_type(text: &str) -> Result<String, String> {
    let folded = |name: &str| name.trim().to_lowercase().replace(['_', '-'], " ");
    let names: Vec<String> = Taxonomy::paper().types.into_iter().map(|kind| kind.name).collect();
    let found = names.iter().find(|name| folded(name) == folded(text));
    found.cloned().ok_or_else(|| format!("expected one of {}", names.join(", ")))
}

/// Object, friction and hand parts for which grasps are synthesized.
#[derive(Debug, Args)]
pub struct SynthesisArgs {
    /// An object of the set.
    #[arg(long, conflicts_with = "mesh", value_parser = object_name)]
    pub object: Option<String>,
    /// Mesh of another object: OBJ, STL, PLY, glTF or COLLADA, in metres; defects are repaired and reported.
    #[arg(long)]
    pub mesh: Option<PathBuf>,
    /// Contact points per sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "5")]
    pub contacts: String,
    /// Mass of the object with which grasps are verified, kg; default: the object's own, 0.1 for a mesh.
    #[arg(long)]
    pub mass: Option<f64>,
    /// Density of the object instead of its mass, kg/m3; multiplied by the volume of its shape.
    #[arg(long, conflicts_with = "mass")]
    pub density: Option<f64>,
    /// Coulomb friction coefficient between hand and object.
    #[arg(long, default_value_t = TEST_FRICTION)]
    pub friction: f64,
    /// Avoid collisions of the hand with the table on which the object rests.
    #[arg(long)]
    pub table: bool,
    /// Parts of the hand that may touch the object, of thumb, index, middle, ring, little and palm; default: all. The
    /// other digits stay open.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PARTS")]
    pub parts: Vec<HandPart>,
    /// Number of closings tried on the posture of each chain until one is verified: the plain one first, then varied
    /// tensions and small offsets.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
}

/// Arguments of `grasps generate`.
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// Object and conditions of the synthesis.
    #[command(flatten)]
    pub synthesis: SynthesisArgs,
    /// Number of chains, each of which may yield one grasp.
    #[arg(long, default_value_t = 512)]
    pub n: u64,
    /// Synthesize only grasps of this type of the taxonomy, such as "Pincer" or "Heavy Wrap": chains use the hand as
    /// the type does, and verified grasps that do not meet its conditions are dropped. With --parts, those digits
    /// replace the type's own.
    #[arg(long = "type", value_name = "TYPE", value_parser = grasp_type)]
    pub kind: Option<String>,
    /// Stop after this many different verified grasps.
    #[arg(long, conflicts_with = "hand")]
    pub keep: Option<usize>,
    /// File for the verified grasps, JSON lines; it grows during the search.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// URDF of another hand.
    #[arg(long = "urdf", alias = "hand", value_name = "URDF", requires = "pulls", conflicts_with_all = ["parts", "kind"])]
    pub hand: Option<PathBuf>,
    /// Transmission of that hand: actuators and their moment arms at the joints (TOML).
    #[arg(long, alias = "transmission", requires = "hand")]
    pub pulls: Option<PathBuf>,
}

/// Applies mass and friction of the arguments to the subject.
fn with_mass_and_friction(subject: PreparedObject, args: &SynthesisArgs) -> Result<PreparedObject> {
    let check = |name: &str, value: f64, least: f64, most: f64| {
        anyhow::ensure!((least..=most).contains(&value), "--{name}: found {value}, expected {least} to {most}");
        Ok(value)
    };
    let mass = match (args.mass, args.density) {
        (Some(mass), _) => check("mass", mass, MIN_MASS, MAX_MASS)?,
        (None, Some(density)) => {
            let volume = subject.model.shape.volume();
            let mass = check("density", density, MIN_DENSITY, MAX_DENSITY)? * volume;
            anyhow::ensure!(
                (MIN_MASS..=MAX_MASS).contains(&mass),
                "--density: found an object of {mass:.2e} kg ({:.3} cm3), expected {MIN_MASS} to {MAX_MASS} kg",
                1e6 * volume
            );
            mass
        }
        (None, None) => subject.model.mass,
    };
    Ok(subject.tested_at(mass, check("friction", args.friction, MIN_FRICTION, MAX_FRICTION)?))
}

fn request(
    terminal: &Terminal,
    args: &SynthesisArgs,
    n: u64,
    enough: usize,
) -> Result<(PreparedObject, SynthesisRequest)> {
    if n == 0 {
        bail!("--n: found 0, expected at least 1");
    }
    let contacts = search::parse_contacts(&args.contacts)?;
    let subject = match (&args.object, &args.mesh) {
        (Some(name), _) => PreparedObject::from_set(name)?,
        (None, Some(path)) => {
            let (subject, note) = PreparedObject::from_mesh(path)?;
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
    let subject = with_mass_and_friction(subject, args)?;
    let request = SynthesisRequest {
        chains: n,
        max_grasps: enough,
        contacts,
        closings: args.closings,
        seed: terminal.seed,
        table: args.table,
    };
    Ok((subject, request))
}

/// Runs `ftac grasps generate`.
pub fn generate(terminal: &Terminal, args: &GenerateArgs) -> Outcome {
    if let Some(out) = &args.out {
        search::check_writable(out)?;
        if out.exists() {
            bail!("--out {}: found a file, expected none; name another one or remove it", out.display());
        }
    }
    renamed_options::note_renamed_options();
    let (subject, request) = request(terminal, &args.synthesis, args.n, args.keep.unwrap_or(usize::MAX))?;
    let hand = match (&args.hand, &args.pulls) {
        (Some(urdf), Some(pulls)) => describe::read(urdf, pulls)?,
        _ => built_in_hand(&args.synthesis, args.kind.as_deref())?,
    };
    let subject = fit_to_hand(subject, &args.synthesis, &hand.opening)?;
    if !terminal.json {
        hand.notes.iter().for_each(|line| eprintln!("{line}"));
    }
    let writer = writer(terminal, args, hand.name().into())?;
    let mut synthesizer = Synthesizer::new(&hand, subject, request);
    synthesizer.type_filter = args.kind.as_ref().and_then(|kind| GraspTypeFilter::new(kind, &synthesizer.subject));
    let (report, _) = search::search(&synthesizer, SearchStart::default(), writer, &terminal.progress())?;
    terminal.print(&report, &report.text())?;
    let found = report.of_type.unwrap_or(report.verified.all);
    let kind = args.kind.as_ref().map_or(String::new(), |kind| format!(" of type {kind}"));
    if let Some(out) = args.out.as_ref().filter(|_| found == 0) {
        // It holds nothing but its header.
        std::fs::remove_file(out).with_context(|| out.display().to_string())?;
    }
    Ok((found == 0).then(|| format!("no grasp{kind} of {} was verified in {} chains", report.object, args.n)))
}

/// Fits a user's mesh to a hand of this opening. The objects of the set are known to fit.
fn fit_to_hand(subject: PreparedObject, args: &SynthesisArgs, opening: &HandOpening) -> Result<PreparedObject> {
    let Some(mesh) = &args.mesh else { return Ok(subject) };
    let subject = subject.for_opening(opening).with_context(|| format!("--mesh {}", mesh.display()))?;
    if !subject.start_points.is_empty() {
        eprintln!(
            "{}: wider than {} opens ({:.0} mm); grasps are searched at its thin parts",
            subject.model.name,
            opening.hand,
            1e3 * opening.width
        );
    }
    Ok(subject)
}

/// Creates the file of `--out` with its header; `name` is the hand's.
fn writer(terminal: &Terminal, args: &GenerateArgs, name: String) -> Result<Option<GraspWriter>> {
    let Some(path) = &args.out else { return Ok(None) };
    let hand = match (&args.hand, &args.pulls) {
        (Some(urdf), Some(pulls)) => Some(HandSource { name, urdf: source_file(urdf)?, pulls: source_file(pulls)? }),
        _ => None,
    };
    let mesh = args.synthesis.mesh.as_deref().map(source_file).transpose()?;
    let header =
        GraspFileHeader { hand, mesh, ..GraspFileHeader::new(generate_command(terminal, args), terminal.seed) };
    Ok(Some(GraspWriter::create(path, &header)?))
}

/// Returns the command that makes the same file again.
fn generate_command(terminal: &Terminal, args: &GenerateArgs) -> String {
    let GenerateArgs { synthesis, n, keep, kind, .. } = args;
    let what = match (&synthesis.object, &synthesis.mesh) {
        (Some(name), _) => format!("--object {name}"),
        (None, mesh) => format!("--mesh {}", mesh.as_deref().unwrap_or(Path::new("")).display()),
    };
    let mut options = keep.map_or(String::new(), |keep| format!(" --keep {keep}"));
    if let (Some(hand), Some(pulls)) = (&args.hand, &args.pulls) {
        options += &format!(" --urdf {} --pulls {}", hand.display(), pulls.display());
    }
    if let Some(kind) = kind {
        options += &format!(" --type \"{kind}\"");
    }
    if !synthesis.parts.is_empty() {
        let names = synthesis.parts.iter().filter_map(|part| Some(part.to_possible_value()?.get_name().to_owned()));
        options += &format!(" --parts {}", names.collect::<Vec<_>>().join(","));
    }
    options += if synthesis.table { " --table" } else { "" };
    options += &format!(" --closings {}", synthesis.closings);
    options += &synthesis.mass.map_or(String::new(), |mass| format!(" --mass {mass}"));
    options += &synthesis.density.map_or(String::new(), |density| format!(" --density {density}"));
    if synthesis.friction != TEST_FRICTION {
        options += &format!(" --friction {}", synthesis.friction);
    }
    format!("ftac grasps generate {what} --n {n} --contacts {}{options} --seed {}", synthesis.contacts, terminal.seed)
}

/// Arguments of `grasps eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Object and conditions of the synthesis.
    #[command(flatten)]
    pub synthesis: SynthesisArgs,
    /// Number of chains.
    #[arg(long, default_value_t = 128)]
    pub n: u64,
    /// Close and check the grasps of this file again, of this hand or another, instead of searching; with --object,
    /// those of one object.
    #[arg(
        long,
        conflicts_with_all = ["mesh", "mass", "density", "table", "friction", "parts", "contacts", "closings", "n"]
    )]
    pub grasps: Option<PathBuf>,
}

/// Runs `ftac grasps eval`.
pub fn eval(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    if args.grasps.is_some() {
        return eval_again(terminal, args);
    }
    let (n, args) = (args.n, &args.synthesis);
    let (subject, request) = request(terminal, args, n, usize::MAX)?;
    let hand = built_in_hand(args, None)?;
    let subject = fit_to_hand(subject, args, &hand.opening)?;
    let evaluation = evaluation::evaluate(&Synthesizer::new(&hand, subject, request), n)?;
    terminal.print(&evaluation, &evaluation.text())?;
    let fooled = evaluation.controls.iter().find(|(_, rate)| rate.low > 0.5);
    Ok(fooled.map(|(name, rate)| format!("the negative control {name} held {} of {}", rate.count, rate.of)))
}

/// Closes and checks the grasps of a file again.
fn eval_again(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    let file = GraspFile::read_or_built_in(args.grasps.as_deref(), RobotModel::ftac_gen3().hand)?;
    let object = args.synthesis.object.as_deref();
    let evaluations = reevaluation::evaluate(&file, object)?;
    if let (true, Some(name)) = (evaluations.is_empty(), object) {
        bail!("--object: found no grasp of `{name}` in the file, expected some");
    }
    for evaluation in &evaluations {
        terminal.print(evaluation, &evaluation.text())?;
    }
    let all = |evaluation: &Evaluation| evaluation.verified.get("all").is_some_and(|rate| rate.count == rate.of);
    let lost = evaluations.iter().filter(|evaluation| !all(evaluation)).map(|evaluation| evaluation.object.as_str());
    let lost: Vec<&str> = lost.collect();
    Ok((!lost.is_empty()).then(|| format!("not every grasp is verified again: {}", lost.join(", "))))
}
