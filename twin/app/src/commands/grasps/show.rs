//! `ftac grasps show`: the best grasp of each kind, in Rerun, as pictures, and in words.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use bench::recording::drawn;
use clap::Args;
use grasping::synthesis::collection::Collection;
use grasping::synthesis::diversity;
use hand_model::Hand;
use proving::synthesis::collection;
use proving::synthesis::parts::table;
use proving::synthesis::subject::TEST_FRICTION;
use report::study_pages;
use scenarios::objects::ObjectSet;
use serde_json::{Value, json};
use stream::Target;
use stream::gallery::{self, ShownGrasp};
use study::kinds::{self, Kind, kinds};

use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Object; without one, a table of all.
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
    /// Folder for grasps.html with pictures of objects and grasps, instead of a recording.
    #[arg(long, conflicts_with = "out")]
    pub report: Option<PathBuf>,
}

/// `ftac grasps show`.
pub fn show(terminal: &Terminal, args: &ShowArgs) -> Outcome {
    let collection = collection::read_or_built_in(args.grasps.as_deref())?;
    let object = args.object.as_deref();
    if let Some(name) = object.filter(|name| collection.of(name).is_none()) {
        let known: Vec<&str> = collection.objects.iter().map(|entry| entry.summary.object.as_str()).collect();
        bail!("OBJECT: no grasps of `{name}`; there are some of: {}", known.join(", "));
    }
    let set = ObjectSet::repertoire();
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).with_context(|| format!("--report {}", folder.display()))?;
        study_pages::gallery::write(&collection, object, &set, &Hand::ftac(), folder)?;
        eprintln!("{}: grasps.html with its pictures", folder.display());
    }
    let own = object.and_then(|name| collection.of(name)).map(|entry| kinds(&entry.grasps));
    let text = own.as_ref().map_or_else(|| table(&collection), |own| kinds::table(own));
    terminal.print(&described(&collection, object), &text)?;
    if let (Some(name), Some(own), None) = (object, own, &args.report) {
        record(terminal, args, name, &own, &set)?;
    }
    Ok(None)
}

/// The kinds of all objects, or of one.
fn described(collection: &Collection, only: Option<&str>) -> Value {
    let entries = collection.objects.iter().filter(|entry| only.is_none_or(|name| name == entry.summary.object));
    let objects = entries.map(|entry| {
        let kinds: Vec<_> = kinds(&entry.grasps)
            .iter()
            .map(|kind| json!({"kind": kind.name, "count": kind.count, "best": kind.best}))
            .collect();
        json!({"object": entry.summary.object, "diversity": diversity::describe(&entry.grasps), "kinds": kinds})
    });
    json!({ "objects": objects.collect::<Vec<_>>() })
}

fn record(terminal: &Terminal, args: &ShowArgs, name: &str, kinds: &[Kind<'_>], set: &ObjectSet) -> Result<()> {
    let grasps: Vec<ShownGrasp> = kinds.iter().take(args.kinds).map(study_pages::gallery::shown).collect();
    let model =
        set.get(name).with_context(|| format!("`{name}` is not an object of the set: its shape is not known"))?;
    let file = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("recordings/grasps_{name}.rrd")));
    // All grasps of a file come from one search.
    let friction = kinds.first().map_or(TEST_FRICTION, study_pages::gallery::friction);
    gallery::write(&[Target::File(file.clone())], &Hand::ftac(), &drawn(model, name), friction, &grasps)?;
    if !terminal.quiet {
        eprintln!("{}: {} kinds; see it with `ftac view {0}`", file.display(), grasps.len());
    }
    // Who names a file wants the file; who does not wants to see it.
    if args.out.is_none() {
        let program = stream::viewer::find_viewer().ok_or(stream::StreamError::NoViewer)?;
        stream::viewer::open(&program, &[file])?;
    }
    Ok(())
}
