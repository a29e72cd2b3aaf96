//! `ftac grasps show`: shows the best grasp of each kind in Rerun, as pictures and in words.

use std::path::PathBuf;

use anyhow::{Context, Result};
use bench::recording::drawn_object;
use clap::Args;
use dexterous_grasping::synthesis::diversity::{self, Diversity};
use dexterous_grasping::synthesis::kind::{self, GraspKind};
use grasp_verification::synthesis::grasp_file::GraspFile;
use grasp_verification::synthesis::parts::table;
use grasp_verification::synthesis::subject::TEST_FRICTION;
use hand_model::RobotModel;
use report::grasp_gallery;
use schemars::JsonSchema;
use serde::Serialize;
use telemetry::RecordingTarget;
use telemetry::gallery::{self, GalleryGrasp};

use crate::options::object_name::object_name;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Object to show; default: a table of all objects.
    #[arg(value_parser = object_name)]
    pub object: Option<String>,
    /// Grasp file of `collection` or `generate`; default: the built-in collection.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Maximum number of kinds, the most frequent first.
    #[arg(long, default_value_t = 12)]
    pub kinds: usize,
    /// Recording file; default: recordings/grasps_OBJECT.rrd, which is then opened in the Rerun viewer.
    #[arg(long, requires = "object")]
    pub out: Option<PathBuf>,
    /// Folder for grasps.html with pictures of objects and grasps, instead of a recording.
    #[arg(long, conflicts_with = "out")]
    pub report: Option<PathBuf>,
}

/// Kinds of grasps of an object.
#[derive(Debug, Serialize, JsonSchema)]
struct ObjectKinds<'a> {
    /// Name of the object.
    object: &'a str,
    /// Diversity of the grasps, for a hand whose digits have names.
    #[serde(skip_serializing_if = "Option::is_none")]
    diversity: Option<Diversity>,
    kinds: &'a [GraspKind<'a>],
}

/// JSON output of `grasps show`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ShowOutput<'a> {
    /// Name of the hand, if it comes from a URDF.
    #[serde(skip_serializing_if = "Option::is_none")]
    hand: Option<&'a str>,
    /// One entry per object.
    objects: Vec<ObjectKinds<'a>>,
}

/// Runs `ftac grasps show`.
pub fn show(terminal: &Terminal, args: &ShowArgs) -> Outcome {
    let file = GraspFile::read_or_built_in(args.grasps.as_deref(), RobotModel::ftac_gen3().hand)?;
    let (object, hand) = (args.object.as_deref(), &file.hand);
    let entries = file.objects(object)?;
    let by_object: Vec<(&str, Vec<GraspKind<'_>>)> =
        entries.iter().map(|entry| (entry.summary.object.as_str(), file.kinds(entry))).collect();
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).with_context(|| format!("--report {}", folder.display()))?;
        grasp_gallery::write(&file, object, args.kinds, folder)?;
        eprintln!("{}: grasps.html with its pictures", folder.display());
    }
    let own = hand.named_hand.is_some();
    let text = if own && object.is_none() {
        table(&file.collection)
    } else {
        let title = |name: &str| if own { String::new() } else { format!("{} on {name}\n", hand.name()) };
        by_object.iter().map(|(name, kinds)| title(name) + &kind::table(kinds)).collect()
    };
    let objects = entries.iter().zip(&by_object).map(|(entry, (object, kinds))| ObjectKinds {
        object,
        diversity: own.then(|| diversity::describe(&entry.grasps)),
        kinds,
    });
    let answer = ShowOutput { hand: (!own).then(|| hand.name()), objects: objects.collect() };
    terminal.print(&answer, &text)?;
    if let (Some(_), [(name, kinds)], None) = (object, &by_object[..], &args.report) {
        let shown: Vec<GalleryGrasp> =
            kinds.iter().take(args.kinds).map(|kind| grasp_gallery::gallery_grasp(hand, kind)).collect();
        // All grasps of a file come from one search, with one friction coefficient.
        let friction = kinds.first().map_or(TEST_FRICTION, grasp_gallery::friction);
        record(terminal, args, &file, name, friction, &shown)?;
    }
    Ok(None)
}

fn record(
    terminal: &Terminal,
    args: &ShowArgs,
    grasps: &GraspFile,
    name: &str,
    friction: f64,
    shown: &[GalleryGrasp],
) -> Result<()> {
    let model = grasps.model(name)?;
    let file = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("recordings/grasps_{name}.rrd")));
    gallery::write(
        &[RecordingTarget::File(file.clone())],
        &RobotModel::ftac_gen3().hand,
        &drawn_object(&model, name),
        friction,
        shown,
    )?;
    if !terminal.quiet {
        eprintln!("{}: {} kinds; see it with `ftac view {0}`", file.display(), shown.len());
    }
    // A user who names no file wants to see the recording.
    if args.out.is_none() {
        let program = telemetry::viewer::find_viewer().ok_or(telemetry::TelemetryError::NoViewer)?;
        telemetry::viewer::open(&program, &[file])?;
    }
    Ok(())
}
