//! An object made ready for sampling: its distance field, its surface, and its stand-in for the holding test.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use grasping::synthesis::field::DistanceField;
use grasping::synthesis::held::HeldGrasp;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use scenarios::geometry::{GeometryError, MAX_EXTENT, Mesh, Shape, read_triangles};
use scenarios::objects::{ObjectModel, ObjectSet, Symmetry};

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
/// A mesh with more triangles is rebuilt on a grid: its field and its convex parts would take minutes.
const MOST_TRIANGLES: usize = 40_000;
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

    /// A user's mesh, in metres, of the mass [`TEST_MASS`]. One that is not watertight, or has
    /// very many triangles, is rebuilt around its winding number; the second answer says so.
    pub fn from_mesh(path: &Path) -> Result<(Self, Option<String>)> {
        // The errors' own text has their cause in it already.
        let (vertices, triangles) = read_triangles(path).map_err(|error| anyhow!("--mesh: {error}"))?;
        let refuse =
            |found: String, expected: &str| bail!("--mesh {}: found {found}, expected {expected}", path.display());
        let used = triangles.iter().flatten().filter_map(|index| vertices.get(*index as usize));
        let (low, high) = used
            .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), vertex| {
                (low.inf(&vertex.coords), high.sup(&vertex.coords))
            });
        let extent = high - low;
        if triangles.is_empty() {
            return refuse("0 triangles".into(), "a surface");
        }
        if extent.max() > MAX_EXTENT {
            let error = GeometryError::Units { found: extent.max() };
            bail!("--mesh: {}: {error}", path.display());
        }
        if extent.max() < SMALLEST {
            return refuse(
                format!("a largest extent of {:.2} mm", 1e3 * extent.max()),
                "at least 8 mm: it would vanish between two fingertips (is the file in metres?)",
            );
        }
        let (mesh, note) =
            watertight(vertices, triangles).map_err(|error| anyhow!("--mesh: {}: {error}", path.display()))?;
        // The frame moves to the centre of mass, as it is for all objects.
        let origin = -mesh.center_of_mass().coords;
        let mesh = mesh.centered().with_context(|| format!("--mesh {}", path.display()))?;
        let name = path.file_stem().map_or("mesh".into(), |stem| stem.to_string_lossy().into_owned());
        let mut subject = Self::new(ObjectModel {
            name,
            shape: Shape::Mesh(Arc::new(mesh)),
            mass: TEST_MASS,
            friction: TEST_FRICTION,
            color: [160, 160, 160],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::None,
        })?;
        subject.origin = origin;
        Ok((subject, note))
    }

    /// The same object for a hand of this opening; refused if the hand can take it nowhere.
    pub fn for_opening(mut self, opening: &Opening) -> Result<Self> {
        self.places = size::graspable(&self, opening)?;
        Ok(self)
    }

    /// The same object of another mass (kg) and friction coefficient.
    pub fn tested_at(mut self, mass: f64, friction: f64) -> Self {
        self.model = Arc::new(ObjectModel { mass, friction, ..(*self.model).clone() });
        self
    }

    fn new(model: ObjectModel) -> Result<Self> {
        let (low, high) = model.shape.aabb();
        let cell = FINEST_CELL.max((high - low).max() / MOST_CELLS);
        let (center, _) = model.shape.inertia(model.mass);
        let field =
            DistanceField::sample(&low, &high, &center, cell, MARGIN, |point| model.shape.signed_distance(point))
                .with_context(|| format!("the distance field of {}", model.name))?;
        let surface = model.shape.surface_samples(SURFACE_POINTS);
        Ok(Self { model: Arc::new(model), field, surface, origin: Vector3::zeros(), places: Vec::new() })
    }
}

/// The triangles as a watertight mesh, and what had to be done to them.
fn watertight(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Result<(Mesh, Option<String>), GeometryError> {
    let count = triangles.len();
    let reason = if count > MOST_TRIANGLES {
        format!("{count} triangles")
    } else {
        match Mesh::new(vertices.clone(), triangles.clone()) {
            Ok(mesh) => return Ok((mesh, None)),
            Err(fault) => fault.to_string(),
        }
    };
    let (mesh, cell) = Mesh::mended(&vertices, &triangles)?;
    let (after, cell) = (mesh.triangles().len(), 1e3 * cell);
    Ok((mesh, Some(format!("{reason}: rebuilt with the winding number's sign, {after} triangles, {cell:.1} mm cells"))))
}
