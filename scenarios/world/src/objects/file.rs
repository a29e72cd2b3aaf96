//! Data file of an object.
//!
//! ```toml
//! name = "my_mug"            # unique; small letters, digits and _
//! mass = 0.31                # kg
//! friction = 0.6             # Coulomb coefficient against the hand's elastomer
//! color = [200, 60, 60]      # RGB; grey if left out
//! rest = "upright"           # or "lying" (a lathe's), or { turned = [roll, pitch, yaw] } in rad. Default: upright if
//!                            # that is stable, otherwise the pose that is hardest to tip over
//! symmetry = "none"          # or "full", "cube", { axis = { flip = true } }, { fold = { n = 4, flip = false } }
//! [shape.mesh]
//! file = "my_mug.obj"        # OBJ, STL, PLY or glTF, relative to this file, z up; faults are mended
//! unit = 0.001               # m, the mesh's unit; default 1
//! tolerance = 0.001          # m, protrusion of the convex parts used in physics; default 1 mm
//! ```
//!
//! Other shapes, lengths in m:
//! - `[shape.sphere]` with `diameter`;
//! - `[shape.cylinder]` with `diameter` and `height`, along z;
//! - `[shape.box]` with `size = [x, y, z]` and `rounding`, the radius of its edges;
//! - `[shape.lathe]`, a surface of revolution about z, with `outline = [[radius, z], ...]` from bottom to top. With
//!   `spline = n`, a smooth curve goes through the points in n steps between two. `unit` is the outline's unit in m,
//!   default 1;
//! - `[shape.hull]`, the convex hull of `corners = [[x, y, z], ...]`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ftac_platform::data::{DataError, parse_toml, read_text};
use ftac_platform::file_access::FileAccess;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::lathe;
use super::model::ObjectModel;
use super::symmetry::Symmetry;
use crate::geometry::{
    GeometryError, MAX_EXTENT, Mesh, ObjectShape, RepairReport, Triangles, hull_mesh, read_triangles, revolve, to_obj,
};

/// Smallest length that the physics engine can handle, m.
const MIN_LENGTH: f64 = 0.005;
/// Smallest plausible mass, kg: that of a feather.
const MIN_MASS: f64 = 1e-4;
/// Greatest mass that the arm can lift with the hand on it, kg.
const MAX_MASS: f64 = 4.0;
/// Least and greatest tolerance of convex parts, m.
const PART_TOLERANCE_RANGE: (f64, f64) = (1e-4, 0.02);
/// Greatest order of rotational symmetry; beyond it, use a surface of revolution.
const MAX_FOLDS: u32 = 360;
/// Default colour.
const DEFAULT_COLOR: [u8; 3] = [160, 160, 160];

/// Contents of an object's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// Unique name.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand's elastomer.
    pub friction: f64,
    /// Colour, RGB.
    #[serde(default = "grey")]
    pub color: [u8; 3],
    /// Resting pose; if left out, that of [`ObjectModel::in_stable_pose`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<RestingPose>,
    /// Rotational symmetry.
    #[serde(default)]
    pub symmetry: Symmetry,
    pub shape: ShapeFile,
}

/// Resting pose of an object on the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestingPose {
    /// Upright: as its shape is given.
    Upright,
    /// On its side, where its centre is lowest; for surfaces of revolution.
    Lying,
    /// Rotated by roll, pitch and yaw, rad.
    Turned([f64; 3]),
}

/// A shape, lengths in m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeFile {
    /// A ball.
    Sphere {
        /// Diameter, m.
        diameter: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Diameter, m.
        diameter: f64,
        /// Height, m.
        height: f64,
    },
    /// A box with rounded edges.
    Box {
        /// Outer size including the rounding, m.
        size: [f64; 3],
        /// Radius of the edges, m.
        rounding: f64,
    },
    /// A surface of revolution about z.
    Lathe {
        /// Points (radius, z) from bottom to top, in `unit`.
        outline: Vec<[f64; 2]>,
        /// Steps of a smooth curve between two points; straight lines if none.
        spline: Option<usize>,
        /// Unit of the outline, m.
        #[serde(default = "one")]
        unit: f64,
    },
    /// The convex hull of points.
    Hull {
        /// Corner points, m.
        corners: Vec<[f64; 3]>,
    },
    /// A triangle mesh.
    Mesh {
        /// Path of the mesh file, relative to the object's file.
        file: PathBuf,
        /// Mesh that [`ObjectFile::read`] found there, mended if it was broken, as the text of an OBJ file.
        obj: Option<String>,
        /// Description of the repairs.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        mended: Option<String>,
        /// Unit of the mesh, m.
        #[serde(default = "one")]
        unit: f64,
        /// Greatest distance by which the convex parts used in physics may stand out of the mesh, m; 1 mm if left out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        tolerance: Option<f64>,
    },
}

fn grey() -> [u8; 3] {
    DEFAULT_COLOR
}

fn one() -> f64 {
    1.0
}

impl ObjectFile {
    /// Parses a file's text. `path` is named in errors; a mesh file is looked up relative to it and must be within
    /// `reach`.
    pub fn parse(text: &str, path: &Path, reach: FileAccess) -> Result<Self, DataError> {
        let mut object: Self = parse_toml(text, path)?;
        if let ShapeFile::Mesh { file, obj: obj @ None, unit, mended, .. } = &mut object.shape {
            check_unit("shape.mesh.unit", *unit, path)?;
            let beside = reach.resolve(path, "shape.mesh.file", file)?;
            let expected = "a mesh file (.obj, .stl, .ply, .gltf, .glb), relative to this file";
            let found =
                read_triangles(&beside).map_err(|error| DataError::field(path, "shape.mesh.file", error, expected))?;
            let (triangles, repair) = repair_triangles(found, *unit).map_err(|error| {
                let found = format!("{}: {error}", file.display());
                DataError::field(path, "shape.mesh.file", found, "a closed triangle mesh in metres")
            })?;
            *obj = Some(to_obj(&triangles));
            *mended = (!repair.is_none()).then(|| repair.to_string());
        }
        Ok(object)
    }

    /// Reads an object's file and its mesh file, which must be within `reach`.
    pub fn read(path: &Path, reach: FileAccess) -> Result<Self, DataError> {
        Self::parse(&read_text(path)?, path, reach)
    }

    /// Returns the object if all its values are valid; `path` is named in errors.
    pub fn model(&self, path: &Path) -> Result<ObjectModel, DataError> {
        self.check(path)?;
        let shape = self.shape.build(path)?;
        let rest = match self.rest {
            None | Some(RestingPose::Upright) => UnitQuaternion::identity(),
            Some(RestingPose::Turned([roll, pitch, yaw])) => UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            Some(RestingPose::Lying) if matches!(self.shape, ShapeFile::Lathe { .. }) => lathe::lying_rotation(&shape),
            Some(RestingPose::Lying) => {
                let expected = "\"upright\" or { turned = [roll, pitch, yaw] }: only a [shape.lathe] can be laid down";
                return Err(DataError::field(path, "rest", "\"lying\"", expected));
            }
        };
        let Self { name, mass, friction, color, symmetry, .. } = self.clone();
        let object = ObjectModel { name, shape, mass, friction, color, rest, symmetry };
        if self.rest.is_some() && object.rests_stably() {
            return Ok(object);
        }
        let found = "a pose from which the object falls over";
        let stable = object.in_stable_pose();
        match (stable, self.rest) {
            (Some(stable), None) => Ok(stable),
            (Some(stable), Some(_)) => {
                let expected = format!("one that it stays in, such as {}; or leave it out", stable.rest_text());
                Err(DataError::field(path, "rest", found, expected))
            }
            (None, _) => Err(DataError::field(path, "rest", found, "a shape that stays in some pose")),
        }
    }

    /// Describes deviations from the file: repairs of the mesh, and a resting pose that was computed.
    pub fn notes(&self, model: &ObjectModel) -> Vec<String> {
        let mended = match &self.shape {
            ShapeFile::Mesh { file, mended: Some(mended), .. } => Some(format!("{}: {mended}", file.display())),
            _ => None,
        };
        let found = self.rest.is_none() && model.rest != UnitQuaternion::identity();
        let rest = found.then(|| format!("it would fall over as given and rests as with rest = {}", model.rest_text()));
        mended.into_iter().chain(rest).map(|note| format!("{}: {note}", self.name)).collect()
    }

    fn check(&self, path: &Path) -> Result<(), DataError> {
        let plain = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_';
        if self.name.is_empty() || !self.name.chars().all(plain) || self.name.contains("_fallen") {
            let expected = "small letters, digits and _, without \"_fallen\", which marks other resting poses";
            return Err(DataError::field(path, "name", format!("{:?}", self.name), expected));
        }
        if !(self.mass >= MIN_MASS && self.mass <= MAX_MASS) {
            let expected = format!("{MIN_MASS} to {MAX_MASS} kg");
            return Err(DataError::field(path, "mass", self.mass, expected));
        }
        if !(0.0..=2.0).contains(&self.friction) {
            return Err(DataError::field(path, "friction", self.friction, "0 to 2"));
        }
        if let Symmetry::Fold { n, .. } = self.symmetry
            && !(1..=MAX_FOLDS).contains(&n)
        {
            return Err(DataError::field(path, "symmetry.fold.n", n, format!("1 to {MAX_FOLDS}")));
        }
        if let Some(RestingPose::Turned(angles)) = self.rest
            && angles.iter().any(|angle| !angle.is_finite())
        {
            return Err(DataError::field(path, "rest.turned", format!("{angles:?}"), "three angles in rad"));
        }
        Ok(())
    }
}

impl ShapeFile {
    fn build(&self, path: &Path) -> Result<ObjectShape, DataError> {
        let length = |field: &str, value: f64| {
            let good = (MIN_LENGTH..=MAX_EXTENT).contains(&value);
            let expected = || format!("{MIN_LENGTH} to {MAX_EXTENT} m");
            if good { Ok(value) } else { Err(DataError::field(path, format!("shape.{field}"), value, expected())) }
        };
        let mesh = |field: &str, mesh: Result<Mesh, GeometryError>, expected: &str| {
            mesh.and_then(Mesh::centered)
                .map(|mesh| ObjectShape::Mesh(Arc::new(mesh)))
                .map_err(|error| DataError::field(path, format!("shape.{field}"), error, expected))
        };
        match self {
            Self::Sphere { diameter } => {
                Ok(ObjectShape::Sphere { radius: 0.5 * length("sphere.diameter", *diameter)? })
            }
            Self::Cylinder { diameter, height } => Ok(ObjectShape::Cylinder {
                radius: 0.5 * length("cylinder.diameter", *diameter)?,
                half_height: 0.5 * length("cylinder.height", *height)?,
            }),
            Self::Box { size, rounding } => {
                for side in size {
                    length("box.size", *side)?;
                }
                let half = Vector3::from(*size) * 0.5;
                if !(0.0..half.min()).contains(rounding) {
                    let expected = format!("0 to less than half the smallest side, {} m", half.min());
                    return Err(DataError::field(path, "shape.box.rounding", rounding, expected));
                }
                Ok(ObjectShape::Cuboid { half, radius: *rounding })
            }
            Self::Lathe { outline, spline, unit } => {
                check_lathe(outline, *spline, *unit, path)?;
                let profile = match spline {
                    Some(steps) => lathe::smooth_profile(outline, *steps, *unit),
                    None => lathe::straight_profile(outline, *unit),
                };
                let expected = "(radius, z) from bottom to top, every radius but the ends' above 0, z never falling";
                mesh("lathe.outline", revolve(&profile, lathe::SEGMENTS), expected)
            }
            Self::Hull { corners } => {
                if let Some(corner) = corners.iter().find(|corner| corner.iter().any(|part| !part.is_finite())) {
                    return Err(DataError::field(
                        path,
                        "shape.hull.corners",
                        format!("{corner:?}"),
                        "finite lengths, m",
                    ));
                }
                let corners: Vec<Point3<f64>> = corners.iter().map(|corner| Point3::from(*corner)).collect();
                mesh("hull.corners", hull_mesh(&corners), "points that span a volume, m")
            }
            Self::Mesh { file, obj, unit, tolerance, .. } => {
                check_unit("shape.mesh.unit", *unit, path)?;
                if let Some(tolerance) =
                    tolerance.filter(|tolerance| !(PART_TOLERANCE_RANGE.0..=PART_TOLERANCE_RANGE.1).contains(tolerance))
                {
                    let expected = format!("{} to {} m", PART_TOLERANCE_RANGE.0, PART_TOLERANCE_RANGE.1);
                    return Err(DataError::field(path, "shape.mesh.tolerance", tolerance, expected));
                }
                let read = Mesh::parse_obj_in(obj.as_deref().unwrap_or_default(), *unit, file);
                let read = read.map(|mesh| match tolerance {
                    Some(tolerance) => mesh.with_tolerance(*tolerance),
                    None => mesh,
                });
                mesh("mesh.file", read, "a closed triangle mesh in metres")
            }
        }
    }
}

fn check_lathe(outline: &[[f64; 2]], spline: Option<usize>, unit: f64, path: &Path) -> Result<(), DataError> {
    if outline.len() < 2 || outline.iter().flatten().any(|number| !number.is_finite()) {
        let found = format!("{} points", outline.len());
        return Err(DataError::field(path, "shape.lathe.outline", found, "two points or more, finite numbers"));
    }
    if spline.is_some_and(|steps| !(1..=32).contains(&steps)) {
        return Err(DataError::field(path, "shape.lathe.spline", spline.unwrap_or_default(), "1 to 32 steps"));
    }
    check_unit("shape.lathe.unit", unit, path)
}

fn check_unit(field: &str, unit: f64, path: &Path) -> Result<(), DataError> {
    let expected = "more than 0 and at most 1 m";
    if unit > 0.0 && unit <= 1.0 { Ok(()) } else { Err(DataError::field(path, field, unit, expected)) }
}

/// Mends the triangles of a file whose lengths are in `unit` (m). The result is in the same unit.
fn repair_triangles(
    (mut vertices, triangles): Triangles,
    unit: f64,
) -> Result<(Triangles, RepairReport), GeometryError> {
    let original = vertices.clone();
    vertices.iter_mut().for_each(|vertex| vertex.coords *= unit);
    let (mesh, repair) = Mesh::repaired(&vertices, &triangles)?;
    if repair.is_none() {
        return Ok(((original, triangles), repair));
    }
    let vertices = mesh.vertices().iter().map(|vertex| vertex / unit).collect();
    Ok(((vertices, mesh.triangles().to_vec()), repair))
}

#[cfg(test)]
mod tests;
