//! An object made ready for sampling: its distance field, its surface, and its stand-in for the holding test.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use grasping::synthesis::field::DistanceField;
use grasping::synthesis::held::HeldGrasp;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use world::geometry::{Mesh, Shape};
use world::objects::{ObjectModel, ObjectSet, Symmetry};

use super::size::{self, Opening};

/// Mass of a mesh in the holding test where none is given, kg (DexGraspBench).
pub const TEST_MASS: f64 = 0.1;
/// Friction coefficient in the holding test where none is given (DexGraspBench); the objects' own are larger.
pub const TEST_FRICTION: f64 = 0.6;
/// Mass (kg) and friction for which a grasp was verified; files that do not say are of [`TEST_MASS`] and [`TEST_FRICTION`].
pub fn verified_for(grasp: &HeldGrasp) -> (f64, f64) {
    grasp.proof.map_or((TEST_MASS, TEST_FRICTION), |proof| (proof.mass, proof.friction))
}

/// Cells of the distance field: this small where the object allows, m; never more than this many along its longest side.
const FINEST_CELL: f64 = 2.0e-3;
const MOST_CELLS: f64 = 80.0;
/// The field reaches this far beyond the object, m.
const MARGIN: f64 = 0.02;
/// Points on the object's surface, for measuring penetration.
const SURFACE_POINTS: usize = 800;
/// The largest extent is at least a fingertip's width, m.
const SMALLEST: f64 = 0.008;

/// An object ready for sampling.
#[derive(Clone)]
pub struct Subject {
    /// As it is tested, with the mass and the friction of the test.
    pub model: Arc<ObjectModel>,
    pub field: DistanceField,
    pub surface: Vec<Point3<f64>>,
    /// Origin of the frame of the object's file, in the object's own frame, m: a mesh is tested in a frame at its centre of mass.
    pub origin: Vector3<f64>,
    /// Starts of a search, object frame, m: places where the object is thin enough, of one that is not as a whole.
    pub places: Vec<Vector3<f64>>,
}

impl Subject {
    /// An object of the set, of its own mass.
    pub fn named(name: &str) -> Result<Self> {
        let set = ObjectSet::repertoire();
        let Some(object) = set.get(name) else {
            bail!("--object: no object is called `{name}`; known are: {}", set.names().join(", "));
        };
        Self::new(ObjectModel { friction: TEST_FRICTION, ..(**object).clone() })
    }

    /// A user's mesh, in metres, of the mass [`TEST_MASS`]; what is broken of it is mended, and the second answer says so.
    pub fn from_mesh(path: &Path) -> Result<(Self, Option<String>)> {
        let refuse =
            |found: String, expected: &str| bail!("--mesh {}: found {found}, expected {expected}", path.display());
        // The errors' own text has their cause in it already.
        let (mesh, repair) = Mesh::load(path).map_err(|error| anyhow!("--mesh: {error}"))?;
        let note = (!repair.is_none()).then(|| repair.to_string());
        let (low, high) = mesh.aabb();
        let extent = high - low;
        if extent.max() < SMALLEST {
            return refuse(
                format!("a largest extent of {:.2} mm", 1e3 * extent.max()),
                "at least 8 mm: it would vanish between two fingertips (is the file in metres?)",
            );
        }
        // The frame moves to the centre of mass, as it is for all objects.
        let origin = -mesh.center_of_mass().coords;
        let mesh = mesh.centered().with_context(|| format!("--mesh {}", path.display()))?;
        let name = path.file_stem().map_or("mesh".into(), |stem| stem.to_string_lossy().into_owned());
        let model = ObjectModel {
            name,
            shape: Shape::Mesh(Arc::new(mesh)),
            mass: TEST_MASS,
            friction: TEST_FRICTION,
            color: [160, 160, 160],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::None,
        };
        // What would fall over as it is given lies on the table as it would come to rest.
        let mut subject = Self::new(model.clone().at_rest().unwrap_or(model))?;
        subject.origin = origin;
        Ok((subject, note))
    }

    /// The same object for a hand of this opening; refused if the hand can take it nowhere.
    pub fn for_opening(mut self, opening: &Opening) -> Result<Self> {
        self.places = size::graspable(&self.model, opening)?;
        Ok(self)
    }

    /// The same object of another mass (kg) and friction coefficient.
    pub fn tested_at(mut self, mass: f64, friction: f64) -> Self {
        self.model = Arc::new(ObjectModel { mass, friction, ..(*self.model).clone() });
        self
    }

    fn new(model: ObjectModel) -> Result<Self> {
        let field = field(&model)?;
        let surface = model.shape.surface_samples(SURFACE_POINTS);
        Ok(Self { model: Arc::new(model), field, surface, origin: Vector3::zeros(), places: Vec::new() })
    }
}

/// The distance field of an object, in its frame.
pub fn field(model: &ObjectModel) -> Result<DistanceField> {
    let (low, high) = model.shape.aabb();
    let cell = FINEST_CELL.max((high - low).max() / MOST_CELLS);
    let (center, _) = model.shape.inertia(model.mass);
    DistanceField::sample(&low, &high, &center, cell, MARGIN, |point| model.shape.signed_distance(point))
        .with_context(|| format!("the distance field of {}", model.name))
}
