//! Verified grasps, read and classified, with the models of their objects.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use dexterous_grasping::synthesis::collection::Collection;
use dexterous_grasping::synthesis::held::HeldGrasp;
use dexterous_grasping::taxonomy::attributes::{FORM_POINTS, ObjectForm};
use grasp_analysis::classification::Classification;
use grasp_verification::synthesis::grasp_file;
use hand_model::{Hand, RobotModel};
use world::objects::{ObjectModel, ObjectSet};

/// Grasps with their hand and objects.
pub struct GraspSource {
    pub hand: Arc<Hand>,
    /// Objects with grasps, in the order of the set.
    pub objects: Vec<Arc<ObjectModel>>,
    /// Classified grasps, object by object in the same order.
    pub classification: Classification,
}

/// Lists the files of `paths`: each path itself, or the .jsonl files of a folder, sorted by name.
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

impl GraspSource {
    /// Reads and classifies the grasps of `paths`; without paths, those of the built-in collection.
    pub fn read(paths: &[PathBuf]) -> Result<Self> {
        let set = ObjectSet::repertoire();
        let mut grasps: Vec<(HeldGrasp, PathBuf)> = Vec::new();
        let mut take = |collection: Collection, from: &Path| {
            let own = collection.objects.into_iter().flat_map(|entry| entry.grasps);
            grasps.extend(own.map(|grasp| (grasp, from.to_owned())));
        };
        if paths.is_empty() {
            take(grasp_file::built_in()?, Path::new("built in"));
        }
        for file in files(paths)? {
            take(grasp_file::read(&file).context("--grasps")?, &file);
        }
        if let Some((grasp, file)) = grasps.iter().find(|(grasp, _)| set.get(&grasp.object).is_none()) {
            let (file, known) = (file.display(), set.names().join(", "));
            bail!("--grasps {file}: object: found `{}`, expected one of {known}", grasp.object);
        }
        let hand = RobotModel::ftac_gen3().hand;
        let is_held = |object: &&Arc<ObjectModel>| grasps.iter().any(|(grasp, _)| grasp.object == object.name);
        let objects: Vec<Arc<ObjectModel>> = set.iter().filter(is_held).cloned().collect();
        let mut classification = Classification::default();
        for object in &objects {
            let form = ObjectForm::from_points(&object.shape.surface_samples(FORM_POINTS));
            classification.add_object(&object.name);
            for (grasp, file) in grasps.iter().filter(|(grasp, _)| grasp.object == object.name) {
                let added = classification.add(&hand, &form, grasp.clone());
                added.with_context(|| format!("--grasps {}", file.display()))?;
            }
        }
        Ok(Self { hand, objects, classification })
    }
}

/// Returns an error if the folder of an output file does not exist, before any work is done.
pub fn check_output_folder(out: &Path) -> Result<()> {
    if let Some(folder) = out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        anyhow::ensure!(folder.is_dir(), "--out {}: found no folder {}, expected one", out.display(), folder.display());
    }
    Ok(())
}
