//! Grasps from a file, with their hand and objects.
//!
//! A file is the built-in collection of all objects, or the result of one search. A search may be of our own hand, or
//! of another hand, which is read from the files that the header names. Poses of an object from a mesh file are in that
//! file's frame on disk, and in a frame at the centre of mass here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use dexterous_grasping::synthesis::collection::{self, Collection, ObjectGrasps, SearchSummary};
use dexterous_grasping::synthesis::grasp_file::{self, GraspFileError, GraspFileHeader, HandSource, SourceFile};
use dexterous_grasping::synthesis::held::HeldGrasp;
use dexterous_grasping::synthesis::kind::GraspKind;
use ftac_platform::digest::sha256;
use hand_model::Hand;
use world::objects::{ObjectModel, ObjectSet};

use super::grasping_hand::GraspingHand;
use super::kinds;
use super::subject::PreparedObject;
use super::urdf_hand::describe;

/// Grasps of a file, with their hand and objects.
pub struct GraspFile {
    pub collection: Collection,
    /// The hand that found them.
    pub hand: GraspingHand,
    set: ObjectSet,
    /// Object from a mesh file.
    mesh_subject: Option<PreparedObject>,
}

impl GraspFile {
    /// Reads `file`, or the built-in collection. The grasps belong to the hand `ours` if the file names no other hand.
    pub fn read_or_built_in(file: Option<&Path>, ours: Arc<Hand>) -> Result<Self> {
        match file {
            Some(path) => Self::read(path, ours).with_context(|| format!("--grasps {}", path.display())),
            None => {
                let hand = GraspingHand::from_hand(ours);
                Ok(Self { collection: built_in()?, hand, set: ObjectSet::repertoire(), mesh_subject: None })
            }
        }
    }

    fn read(path: &Path, ours: Arc<Hand>) -> Result<Self> {
        let header = grasp_file::read_header(path).ok();
        let mesh = header.as_ref().and_then(|header| header.mesh.as_ref());
        let own = mesh
            .map(|mesh| Ok::<_, anyhow::Error>(PreparedObject::from_mesh(&locate_unchanged(mesh, path, "mesh")?)?.0));
        let own = own.transpose()?;
        let (mut collection, hand) = match header.and_then(|header| header.hand) {
            Some(source) => read_urdf_grasps(path, &source)?,
            None => (read(path)?, GraspingHand::from_hand(ours)),
        };
        if let Some(back) = own.as_ref().map(|subject| -subject.origin) {
            for grasp in collection.objects.iter_mut().flat_map(|entry| &mut entry.grasps) {
                *grasp = grasp.clone().with_frame_moved(&back);
            }
        }
        Ok(Self { collection, hand, set: ObjectSet::repertoire(), mesh_subject: own })
    }

    /// Returns the grasps of `object`, or of all objects. An unknown object is an error.
    pub fn objects(&self, object: Option<&str>) -> Result<Vec<&ObjectGrasps>> {
        let all = &self.collection.objects;
        let found: Vec<_> = all.iter().filter(|entry| object.is_none_or(|name| name == entry.summary.object)).collect();
        if let (true, Some(name)) = (found.is_empty(), object) {
            let names: Vec<&str> = all.iter().map(|entry| entry.summary.object.as_str()).collect();
            bail!("OBJECT: no grasps of `{name}`; there are some of: {}", names.join(", "));
        }
        Ok(found)
    }

    /// Returns the kinds among an object's grasps, the most frequent first.
    pub fn kinds<'a>(&self, entry: &'a ObjectGrasps) -> Vec<GraspKind<'a>> {
        kinds::kinds(&self.hand, &entry.grasps)
    }

    /// Returns the model of an object, from the set or from the file's own mesh.
    pub fn model(&self, name: &str) -> Result<Arc<ObjectModel>> {
        let own = self.mesh_subject.as_ref().filter(|own| own.model.name == name).map(|own| &own.model);
        own.or_else(|| self.set.get(name)).cloned().with_context(|| {
            format!("object: found `{name}`, expected an object of the set, or a file that names its mesh")
        })
    }

    /// Returns an object ready for closings, with the mass (kg) and friction for which the grasps were verified.
    pub fn subject(&self, name: &str, mass: f64, friction: f64) -> Result<PreparedObject> {
        let subject = match &self.mesh_subject {
            Some(own) if own.model.name == name => own.clone(),
            _ => PreparedObject::from_set(name)?,
        };
        Ok(subject.tested_at(mass, friction))
    }
}

/// Returns a file's path with the digest of its present content.
pub fn source_file(path: &Path) -> Result<SourceFile> {
    let bytes = ftac_platform::file::read_regular(path, ftac_platform::file::MAX_TEXT_SIZE)
        .with_context(|| path.display().to_string())?;
    Ok(SourceFile { path: path.into(), sha256: sha256(&bytes) })
}

/// Locates a file that `field` of a header names: at the header's path, or beside the grasps. A file that has changed
/// is an error.
fn locate_unchanged(named: &SourceFile, grasps: &Path, field: &str) -> Result<PathBuf> {
    let beside = named.path.file_name().map(|name| grasps.with_file_name(name));
    let path = [Some(named.path.clone()), beside].into_iter().flatten().find(|path| path.exists());
    let Some(path) = path else {
        bail!(
            "{}:1: {field}: found no {}, expected it there or beside the grasps",
            grasps.display(),
            named.path.display()
        );
    };
    let found = source_file(&path)?.sha256;
    ensure!(
        found == named.sha256,
        "{}:1: {field}: found {} with SHA-256 {found}, expected {}: it has changed since these grasps were found",
        grasps.display(),
        path.display(),
        named.sha256
    );
    Ok(path)
}

fn read_urdf_grasps(path: &Path, source: &HandSource) -> Result<(Collection, GraspingHand)> {
    let hand = describe::read(
        &locate_unchanged(&source.urdf, path, "hand.urdf")?,
        &locate_unchanged(&source.pulls, path, "hand.pulls")?,
    )?;
    let (header, grasps) = grasp_file::read(path)?;
    ensure!(!grasps.is_empty(), "{}: found no grasp, expected at least one", path.display());
    let joints = hand.sampled.tree.joints.iter().map(|joint| joint.name.as_str());
    let pulls = hand.mechanism().actuators.iter().map(|pull| pull.name.as_str());
    let (joints, pulls): (Vec<&str>, Vec<&str>) = (joints.collect(), pulls.collect());
    for (n, grasp) in grasps.iter().enumerate() {
        let named = [
            ("joints", Some(&grasp.joints), &joints),
            ("open_joints", Some(&grasp.open_joints), &joints),
            ("open_tensions", grasp.open_tensions.as_ref(), &pulls),
            ("tensions", Some(&grasp.tensions), &pulls),
        ];
        for (field, found, expected) in named {
            let found = found.map_or(&[][..], |found| &found.names);
            ensure!(
                found == *expected,
                "{}:{}: {field}: found {}, expected {}",
                path.display(),
                n + 2,
                found.join(", "),
                expected.join(", ")
            );
        }
        if let Some(link) = grasp.contacts.iter().filter_map(|contact| contact.link).find(|link| *link >= joints.len())
        {
            bail!("{}:{}: contacts.link: found {link}, expected less than {}", path.display(), n + 2, joints.len());
        }
    }
    Ok((collection_of_search(&header, grasps), hand))
}

/// Returns the grasps of one search as a collection.
fn collection_of_search(header: &GraspFileHeader, grasps: Vec<HeldGrasp>) -> Collection {
    let mut objects: Vec<ObjectGrasps> = Vec::new();
    for grasp in grasps {
        let object = grasp.object.clone();
        let place = objects.iter().position(|entry| entry.summary.object == object).unwrap_or_else(|| {
            let summary = SearchSummary { object, requested: 0, kept: 0, chains: 0, short: None };
            objects.push(ObjectGrasps { summary, grasps: Vec::new() });
            objects.len() - 1
        });
        let entry = &mut objects[place];
        entry.summary.kept += 1;
        entry.summary.requested += 1;
        entry.summary.chains = entry.summary.chains.max(grasp.chain + 1);
        entry.grasps.push(grasp);
    }
    let (command, seed) = (header.command.clone(), header.seed);
    Collection { header: collection::CollectionHeader { version: collection::VERSION, command, seed }, objects }
}

/// Reads our own hand's grasps from a collection or from the file of one search. The line after the header shows which
/// of the two it is.
pub fn read(path: &Path) -> Result<Collection> {
    if let Some(hand) = grasp_file::read_header(path).ok().and_then(|header| header.hand) {
        bail!(
            "{}:1: hand: found {}, expected grasps of the F-TAC Hand, by whose digits they are judged",
            path.display(),
            hand.name
        );
    }
    let line = |error: &GraspFileError| if let GraspFileError::Line { line, .. } = error { *line } else { 0 };
    let found = match (Collection::read(path), grasp_file::read(path)) {
        (Ok(collection), _) if !collection.objects.is_empty() => collection,
        (_, Ok((header, grasps))) => collection_of_search(&header, grasps),
        // The reader that got further is the intended one.
        (Err(compact), Err(single)) if line(&compact) >= line(&single) => Err(compact)?,
        (_, Err(error)) => Err(error)?,
    };
    ensure!(found.grasps().next().is_some(), "{}: found no grasp, expected at least one", path.display());
    if let Some(grasp) = found.grasps().find(|grasp| !collection::is_complete(grasp)) {
        let chain = grasp.chain;
        bail!(
            "{}: the grasp of chain {chain}: found another's, expected {}",
            path.display(),
            collection::EXPECTED_FIELDS
        );
    }
    Ok(found)
}

/// Returns the built-in collection.
pub fn built_in() -> Result<Collection> {
    Ok(Collection::parse(include_str!("../../data/synthesized.jsonl"), Path::new("data/synthesized.jsonl"))?)
}
