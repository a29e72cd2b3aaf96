//! Files of verified grasps: the collection of all objects that comes with the program, and the file of one search.

use std::path::Path;

use anyhow::{Context, Result, bail};
use grasping::synthesis::collection::{self, Collection, ObjectGrasps, Summary};
use grasping::synthesis::held::{self, HeldError, HeldGrasp};

/// The grasps that one search left, as a collection.
fn of_one_search(header: &held::Header, grasps: Vec<HeldGrasp>) -> Collection {
    let mut objects: Vec<ObjectGrasps> = Vec::new();
    for grasp in grasps {
        let object = grasp.object.clone();
        let place = objects.iter().position(|entry| entry.summary.object == object).unwrap_or_else(|| {
            let summary = Summary { object, wanted: 0, kept: 0, chains: 0, short: None };
            objects.push(ObjectGrasps { summary, grasps: Vec::new() });
            objects.len() - 1
        });
        let entry = &mut objects[place];
        entry.summary.kept += 1;
        entry.summary.wanted += 1;
        entry.summary.chains = entry.summary.chains.max(grasp.chain + 1);
        entry.grasps.push(grasp);
    }
    let (command, seed) = (header.command.clone(), header.seed);
    Collection { header: collection::Header { version: collection::VERSION, command, seed }, objects }
}

/// Reads a collection, or the file of one search; which it is shows in the line after the header.
pub fn read(path: &Path) -> Result<Collection> {
    let line = |error: &HeldError| if let HeldError::Line { line, .. } = error { *line } else { 0 };
    let found = match (Collection::read(path), held::read(path)) {
        (Ok(collection), _) if !collection.objects.is_empty() => collection,
        (_, Ok((header, grasps))) => of_one_search(&header, grasps),
        // The reader that got further is the one that was meant.
        (Err(compact), Err(single)) if line(&compact) >= line(&single) => Err(compact).context("--grasps")?,
        (_, Err(error)) => Err(error).context("--grasps")?,
    };
    if found.grasps().next().is_none() {
        bail!("--grasps {}: found no grasp, expected at least one", path.display());
    }
    Ok(found)
}

/// The collection that comes with the program.
pub fn built_in() -> Result<Collection> {
    Ok(Collection::parse(include_str!("../../data/synthesized.jsonl"), Path::new("data/synthesized.jsonl"))?)
}

/// The grasps of `file`, or of the collection that comes with the program.
pub fn read_or_built_in(file: Option<&Path>) -> Result<Collection> {
    file.map_or_else(built_in, read)
}
