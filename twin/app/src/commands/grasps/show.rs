//! `ftac grasps show`: the best grasp of each kind, in Rerun, as pictures, and in words.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use bench::recording::drawn;
use clap::Args;
use grasping::synthesis::collection::Collection;
use grasping::synthesis::diversity::{self, Diversity};
use grasping::synthesis::kind::{self, HandKind, hand_kinds};
use hand_model::RobotModel;
use proving::synthesis::grasp_file::{GraspFile, Grasps, UrdfGrasps};
use proving::synthesis::parts::table;
use proving::synthesis::subject::TEST_FRICTION;
use proving::synthesis::urdf_hand::kinds::{self as urdf_kinds, UrdfKind};
use report::{grasp_gallery, urdf_hand};
use schemars::JsonSchema;
use serde::Serialize;
use stream::Target;
use stream::gallery::{self, ShownGrasp};

use crate::options::object_name::object_name;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Object; without one, a table of all.
    #[arg(value_parser = object_name)]
    pub object: Option<String>,
    /// File of grasps, from `collection` or `generate`; default: the built-in collection.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Kinds at most, the most frequent first.
    #[arg(long, default_value_t = 12)]
    pub kinds: usize,
    /// Recording file; default: recordings/grasps_OBJECT.rrd, which is then opened in the Rerun viewer.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Folder for grasps.html with pictures of objects and grasps, instead of a recording; of a hand from a URDF, a picture sheet an object.
    #[arg(long, conflicts_with = "out")]
    pub report: Option<PathBuf>,
}

/// Kinds of grasps of an object by our own hand.
#[derive(Debug, Serialize, JsonSchema)]
struct OwnObject<'a> {
    /// Name of the object.
    object: &'a str,
    diversity: Diversity,
    kinds: Vec<HandKind<'a>>,
}

/// Printed of our own hand.
#[derive(Debug, Serialize, JsonSchema)]
pub struct OwnGrasps<'a> {
    /// One entry an object.
    objects: Vec<OwnObject<'a>>,
}

/// Kinds of grasps of an object by a hand from a URDF.
#[derive(Debug, Serialize, JsonSchema)]
struct OtherObject<'a> {
    /// Name of the object.
    object: &'a str,
    kinds: &'a [UrdfKind<'a>],
}

/// Printed of a hand from a URDF.
#[derive(Debug, Serialize, JsonSchema)]
pub struct OtherGrasps<'a> {
    /// Name of the hand.
    hand: &'a str,
    /// One entry an object.
    objects: Vec<OtherObject<'a>>,
}

/// `ftac grasps show`.
pub fn show(terminal: &Terminal, args: &ShowArgs) -> Outcome {
    let file = GraspFile::read_or_built_in(args.grasps.as_deref())?;
    match &file.grasps {
        Grasps::Ours(collection) => ours(terminal, args, &file, collection),
        Grasps::Urdf(of_urdf) => by_urdf(terminal, args, &file, of_urdf),
    }
}

fn ours(terminal: &Terminal, args: &ShowArgs, file: &GraspFile, collection: &Collection) -> Outcome {
    let object = args.object.as_deref();
    known(object, &collection.objects.iter().map(|entry| entry.summary.object.as_str()).collect::<Vec<_>>())?;
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).with_context(|| format!("--report {}", folder.display()))?;
        grasp_gallery::write(file, collection, object, &RobotModel::ftac_gen3().hand, folder)?;
        eprintln!("{}: grasps.html with its pictures", folder.display());
    }
    let own = object.and_then(|name| collection.of(name)).map(|entry| hand_kinds(&entry.grasps));
    let text = own.as_ref().map_or_else(|| table(collection), |own| kind::table(own));
    terminal.print(&described(collection, object), &text)?;
    if let (Some(name), Some(own), None) = (object, own, &args.report) {
        let shown: Vec<ShownGrasp> = own.iter().take(args.kinds).map(grasp_gallery::shown).collect();
        // All grasps of a file come from one search.
        let friction = own.first().map_or(TEST_FRICTION, grasp_gallery::friction);
        record(terminal, args, file, name, friction, &shown)?;
    }
    Ok(None)
}

/// Grasps of a hand from a URDF.
fn by_urdf(terminal: &Terminal, args: &ShowArgs, file: &GraspFile, other: &UrdfGrasps) -> Outcome {
    let by_object = other.by_object();
    let object = args.object.as_deref();
    known(object, &by_object.keys().copied().collect::<Vec<_>>())?;
    let wanted = by_object.iter().filter(|(name, _)| object.is_none_or(|object| object == **name));
    let all: Vec<(&str, Vec<UrdfKind<'_>>)> =
        wanted.map(|(name, grasps)| (*name, urdf_kinds::kinds(&other.hand, grasps))).collect();
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).with_context(|| format!("--report {}", folder.display()))?;
        for (name, kinds) in &all {
            let sheet = folder.join(format!("{name}.png"));
            let shown = &kinds[..kinds.len().min(args.kinds)];
            urdf_hand::sheet(&other.hand, &*file.model(name)?, shown, &sheet)?;
            eprintln!("{}", sheet.display());
        }
    }
    let hand = &other.hand.hand.name;
    let objects = all.iter().map(|(object, kinds)| OtherObject { object, kinds }).collect();
    let text: String =
        all.iter().map(|(name, kinds)| format!("{hand} on {name}\n{}", urdf_kinds::table(kinds))).collect();
    terminal.print(&OtherGrasps { hand, objects }, &text)?;
    if let (Some(_), [(name, kinds)], None) = (object, &all[..], &args.report) {
        let shown: Vec<ShownGrasp> =
            kinds.iter().take(args.kinds).map(|kind| urdf_hand::shown(&other.hand, kind)).collect();
        let friction = kinds.first().map_or(TEST_FRICTION, |kind| kind.best.proof.friction);
        record(terminal, args, file, name, friction, &shown)?;
    }
    Ok(None)
}

/// Refuses an object of which there is no grasp.
fn known(object: Option<&str>, names: &[&str]) -> Result<()> {
    if let Some(name) = object.filter(|name| !names.contains(name)) {
        bail!("OBJECT: no grasps of `{name}`; there are some of: {}", names.join(", "));
    }
    Ok(())
}

/// The kinds of all objects, or of one.
fn described<'a>(collection: &'a Collection, only: Option<&str>) -> OwnGrasps<'a> {
    let entries = collection.objects.iter().filter(|entry| only.is_none_or(|name| name == entry.summary.object));
    let objects = entries.map(|entry| OwnObject {
        object: &entry.summary.object,
        diversity: diversity::describe(&entry.grasps),
        kinds: hand_kinds(&entry.grasps),
    });
    OwnGrasps { objects: objects.collect() }
}

fn record(
    terminal: &Terminal,
    args: &ShowArgs,
    grasps: &GraspFile,
    name: &str,
    friction: f64,
    shown: &[ShownGrasp],
) -> Result<()> {
    let model = grasps.model(name)?;
    let file = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("recordings/grasps_{name}.rrd")));
    gallery::write(
        &[Target::File(file.clone())],
        &RobotModel::ftac_gen3().hand,
        &drawn(&model, name),
        friction,
        shown,
    )?;
    if !terminal.quiet {
        eprintln!("{}: {} kinds; see it with `ftac view {0}`", file.display(), shown.len());
    }
    // Who names a file wants the file; who does not wants to see it.
    if args.out.is_none() {
        let program = stream::viewer::find_viewer().ok_or(stream::StreamError::NoViewer)?;
        stream::viewer::open(&program, &[file])?;
    }
    Ok(())
}
