//! Verified grasps with everything the study asks of them: the object's shape and form, and what the rules say.

use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use grasping::synthesis::collection::Collection;
use grasping::synthesis::held::HeldGrasp;
use hand_model::Hand;
use scenarios::objects::{ObjectModel, ObjectSet};
use study::attributes::{Attributes, ObjectForm};
use study::page::scene::{DrawnGrasp, DrawnObject, Mesh, Scene};
use study::rules::{Decision, Rules};
use study::taxonomy::Taxonomy;

use proving::synthesis::repertoire;

/// Where the grasps come from.
#[derive(Debug, Args)]
pub struct GraspsArgs {
    /// Verified grasps: a file of `grasps repertoire` or `generate`, or a folder of such files (repeatable); default: the
    /// built-in repertoire.
    #[arg(long = "grasps", value_name = "PATH")]
    pub paths: Vec<PathBuf>,
}

/// Points on an object's surface from which its form is read.
const FORM_POINTS: usize = 1500;

/// One grasp.
pub struct Entry {
    /// `object/chain`.
    pub id: String,
    /// Index of the object.
    pub object: usize,
    /// As it was held.
    pub grasp: HeldGrasp,
    /// What the rules see.
    pub attributes: Attributes,
    /// What they say.
    pub decision: Decision,
}

/// All grasps and their objects.
pub struct Source {
    /// The hand.
    pub hand: Hand,
    /// The 19 types.
    pub taxonomy: Taxonomy,
    /// The rules.
    pub rules: Rules,
    /// Objects in the order of the set.
    pub objects: Vec<Arc<ObjectModel>>,
    /// Grasps, object by object.
    pub entries: Vec<Entry>,
}

/// The files that `paths` name: themselves, or what ends in .jsonl within a folder, by name.
fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if !path.is_dir() {
            found.push(path.clone());
            continue;
        }
        let listed = std::fs::read_dir(path).with_context(|| format!("--grasps {}", path.display()))?;
        let mut inside = listed.map(|entry| Ok(entry?.path())).collect::<Result<Vec<PathBuf>>>()?;
        inside.retain(|file| file.extension().is_some_and(|extension| extension == "jsonl"));
        if inside.is_empty() {
            bail!("--grasps {}: found no .jsonl file in it, expected files of `ftac grasps generate`", path.display());
        }
        inside.sort();
        found.extend(inside);
    }
    Ok(found)
}

impl Source {
    /// Reads and classifies the grasps of `paths`; without any, those of the built-in repertoire.
    pub fn read(paths: &[PathBuf]) -> Result<Self> {
        let set = ObjectSet::repertoire();
        let mut grasps: Vec<(HeldGrasp, PathBuf)> = Vec::new();
        let mut take = |collection: Collection, from: &Path| {
            let own = collection.objects.into_iter().flat_map(|entry| entry.grasps);
            grasps.extend(own.map(|grasp| (grasp, from.to_owned())));
        };
        if paths.is_empty() {
            take(repertoire::built_in()?, Path::new("built in"));
        }
        for file in files(paths)? {
            take(repertoire::read(&file)?, &file);
        }
        if let Some((grasp, file)) = grasps.iter().find(|(grasp, _)| set.get(&grasp.object).is_none()) {
            bail!(
                "--grasps {}: object: found `{}`, expected one of {}",
                file.display(),
                grasp.object,
                set.names().join(", ")
            );
        }
        let hand = Hand::ftac();
        let taxonomy = Taxonomy::paper();
        let rules = Rules::shipped(&taxonomy);
        let objects: Vec<Arc<ObjectModel>> =
            set.iter().filter(|object| grasps.iter().any(|(grasp, _)| grasp.object == object.name)).cloned().collect();
        let mut entries: Vec<Entry> = Vec::new();
        for (index, object) in objects.iter().enumerate() {
            let form = ObjectForm::of(&object.shape.surface_samples(FORM_POINTS));
            for (grasp, file) in grasps.iter().filter(|(grasp, _)| grasp.object == object.name) {
                let id = format!("{}/{}", object.name, grasp.chain);
                if entries.iter().any(|entry| entry.id == id) {
                    bail!("--grasps {}: chain: found {id} twice, expected each grasp once", file.display());
                }
                let attributes = Attributes::of(&hand, &form, grasp);
                let decision = rules.decide(&taxonomy, &attributes);
                entries.push(Entry { id, object: index, grasp: grasp.clone(), attributes, decision });
            }
        }
        Ok(Self { hand, taxonomy, rules, objects, entries })
    }

    /// The entry called `id`.
    pub fn find(&self, id: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.id == id)
    }

    /// Name of an entry's object.
    pub fn object(&self, entry: &Entry) -> &str {
        &self.objects[entry.object].name
    }

    /// What a page draws of `entries`.
    pub fn scene<'a>(&self, entries: impl Iterator<Item = &'a Entry>) -> Scene {
        let objects = self.objects.iter().map(|object| {
            let (points, triangles, _) = object.shape.triangles();
            DrawnObject { name: object.name.clone(), mesh: Mesh::new(&points, &triangles) }
        });
        let grasps = entries.map(|entry| DrawnGrasp::new(entry.id.clone(), entry.object, &entry.grasp));
        Scene::new(&self.hand, objects.collect(), grasps.collect())
    }
}

/// Refuses a file whose folder is not there, before any work is done.
pub fn writable(out: &Path) -> Result<()> {
    if let Some(folder) = out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        anyhow::ensure!(folder.is_dir(), "--out {}: found no folder {}, expected one", out.display(), folder.display());
    }
    Ok(())
}
