//! Object prepared for sampling: its distance field, its surface, and its model for the holding test.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use dexterous_grasping::synthesis::field::DistanceField;
use dexterous_grasping::synthesis::held::HeldGrasp;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use world::geometry::{Mesh, ObjectShape};
use world::objects::{ObjectModel, ObjectSet, Symmetry};

use super::size::{self, HandOpening};

/// Default mass of a mesh in the holding test, kg (DexGraspBench).
pub const TEST_MASS: f64 = 0.1;
/// Default friction coefficient in the holding test (DexGraspBench). The objects' own are larger.
pub const TEST_FRICTION: f64 = 0.6;
/// Returns the mass (kg) and friction for which a grasp was verified. Files without a verified load were verified for
/// [`TEST_MASS`] and [`TEST_FRICTION`].
pub fn verified_for(grasp: &HeldGrasp) -> (f64, f64) {
    grasp.verified_load.map_or((TEST_MASS, TEST_FRICTION), |verification| (verification.mass, verification.friction))
}

/// Smallest cell of the distance field, m, and largest number of cells along the object's longest side.
const MIN_CELL: f64 = 2.0e-3;
const MAX_CELLS: f64 = 80.0;
/// Margin of the field around the object, m.
const FIELD_MARGIN: f64 = 0.02;
/// Number of points on the object's surface, for measuring penetration.
const SURFACE_POINTS: usize = 800;
/// Least value of the object's largest extent, m: a fingertip's width.
const MIN_OBJECT_EXTENT: f64 = 0.008;

/// Object prepared for sampling.
#[derive(Clone)]
pub struct PreparedObject {
    /// The object as it is tested, with the mass and friction of the test.
    pub model: Arc<ObjectModel>,
    pub field: DistanceField,
    pub surface: Vec<Point3<f64>>,
    /// Origin of the frame of the object's file, in the object's own frame, m. A mesh is tested in a frame at its
    /// centre of mass.
    pub origin: Vector3<f64>,
    /// Start points of a search, object frame, m: places where the object is thin enough. Empty if the object is thin
    /// enough as a whole.
    pub start_points: Vec<Vector3<f64>>,
}

impl PreparedObject {
    /// Prepares an object of the set, with its own mass.
    pub fn from_set(name: &str) -> Result<Self> {
        let set = ObjectSet::repertoire();
        let Some(object) = set.get(name) else {
            bail!("--object: found `{name}`, expected one of {}", set.names().join(", "));
        };
        Self::new(ObjectModel { friction: TEST_FRICTION, ..(**object).clone() })
    }

    /// Prepares a user's mesh, in metres, with the mass [`TEST_MASS`]. A broken mesh is repaired, and the second value
    /// describes the repair.
    pub fn from_mesh(path: &Path) -> Result<(Self, Option<String>)> {
        let refuse =
            |found: String, expected: &str| bail!("--mesh {}: found {found}, expected {expected}", path.display());
        // The text of these errors already contains their cause.
        let (mesh, repair) = Mesh::load(path).map_err(|error| anyhow!("--mesh: {error}"))?;
        let note = (!repair.is_none()).then(|| repair.to_string());
        let (low, high) = mesh.aabb();
        let extent = high - low;
        if extent.max() < MIN_OBJECT_EXTENT {
            return refuse(
                format!("a largest extent of {:.2} mm", 1e3 * extent.max()),
                "at least 8 mm: it would vanish between two fingertips (is the file in metres?)",
            );
        }
        // The frame moves to the centre of mass, as for all objects.
        let origin = -mesh.center_of_mass().coords;
        let mesh = mesh.centered().with_context(|| format!("--mesh {}", path.display()))?;
        let name = path.file_stem().map_or("mesh".into(), |stem| stem.to_string_lossy().into_owned());
        let model = ObjectModel {
            name,
            shape: ObjectShape::Mesh(Arc::new(mesh)),
            mass: TEST_MASS,
            friction: TEST_FRICTION,
            color: [160, 160, 160],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::None,
        };
        // An object that would fall over as given is placed on the table as it would come to rest.
        let mut subject = Self::new(model.clone().in_stable_pose().unwrap_or(model))?;
        subject.origin = origin;
        Ok((subject, note))
    }

    /// Returns the object for a hand of this opening. An object that the hand can take nowhere is an error.
    pub fn for_opening(mut self, opening: &HandOpening) -> Result<Self> {
        self.start_points = size::graspable_places(&self.model, opening)?;
        Ok(self)
    }

    /// Returns the object with another mass (kg) and friction coefficient.
    pub fn tested_at(mut self, mass: f64, friction: f64) -> Self {
        self.model = Arc::new(ObjectModel { mass, friction, ..(*self.model).clone() });
        self
    }

    fn new(model: ObjectModel) -> Result<Self> {
        let field = field(&model)?;
        let surface = model.shape.surface_samples(SURFACE_POINTS);
        Ok(Self { model: Arc::new(model), field, surface, origin: Vector3::zeros(), start_points: Vec::new() })
    }
}

/// Computes the distance field of an object, in its frame.
pub fn field(model: &ObjectModel) -> Result<DistanceField> {
    let (low, high) = model.shape.aabb();
    let cell = MIN_CELL.max((high - low).max() / MAX_CELLS);
    let (center, _) = model.shape.inertia(model.mass);
    DistanceField::sample(&low, &high, &center, cell, FIELD_MARGIN, |point| model.shape.signed_distance(point))
        .with_context(|| format!("the distance field of {}", model.name))
}
