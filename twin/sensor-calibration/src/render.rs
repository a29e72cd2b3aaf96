//! Renders of a mesh pressed into a pad along its normal, as viewed by the pad's cameras. [`real_sensor`] does the same
//! for a calibrated real sensor. [`views`] writes the files.

pub mod real_sensor;
mod views;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::pads::PadOptics;
use tactile_optics::{CurvedSensor, GelFoundation, IndentationMap, PadCover, SensorModel};
use world::geometry::Mesh;

use self::views::{Views, normals};
use super::sensor_serial;

/// Start of the rays, m below the pad's plane. This is below everything, since the mesh's lowest point is put on the
/// plane.
const RAY_START: f64 = 1e-3;

/// Render of one camera of a pad.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CameraRender {
    camera: String,
    /// Image file (PNG).
    image: PathBuf,
    /// Number of pixels in contact.
    contact_pixels: usize,
    /// Largest indentation, mm.
    deepest_mm: f64,
    /// Bounding box of the gel's deformation in the image: left, top, right, bottom, pixels; null if there is none.
    rectangle: Option<[usize; 4]>,
    /// Time of the render, ms.
    pub render_ms: f64,
}

impl CameraRender {
    /// Describes the written files in a line.
    pub fn text(&self) -> String {
        format!(
            "{}, camera {}: {}",
            self.image.display(),
            self.camera,
            describe_contact(self.contact_pixels, self.deepest_mm)
        )
    }
}

/// Describes a contact (pixels, mm) and the files beside its image.
fn describe_contact(pixels: usize, deepest_mm: f64) -> String {
    format!(
        "{pixels} pixels in contact, {deepest_mm:.2} mm deep at most; height map and normals are beside it as PNG, EXR and NPY\n"
    )
}

/// Pose of a mesh over a pad.
#[derive(Debug, Clone, Copy)]
pub struct MeshPose {
    /// Position of its centre over the pad, m. Its lowest point is put on the pad's plane.
    pub middle: [f64; 2],
    /// Roll, pitch and yaw about the pad's axes, rad.
    pub turn: [f64; 3],
}

impl MeshPose {
    fn pad_from_mesh(&self, mesh: &Mesh) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.turn;
        let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let turned: Vec<Point3<f64>> = mesh.vertices().iter().map(|vertex| turn * vertex).collect();
        let range = |axis: usize| {
            let all = turned.iter().map(|vertex| vertex[axis]);
            (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
        };
        let (wide, long, tall) = (range(0), range(1), range(2));
        let [x, y] = self.middle;
        let shift = Translation3::new(x - 0.5 * (wide.0 + wide.1), y - 0.5 * (long.0 + long.1), -tall.0);
        Isometry3::from_parts(shift, turn)
    }
}

/// Source of a pad's sensors.
pub enum SensorSource<'a> {
    /// Sensors of the hand with this serial number.
    Hand(u64),
    /// Sensors of a calibration file of `optics pads`.
    Calibration(&'a Path),
}

/// A pad, its cameras and their sensors.
pub struct PadView<'a> {
    hand: &'a Hand,
    pad: &'a Pad,
    cameras: Vec<&'a PadCamera>,
    cover: PadCover,
    sensors: Vec<CurvedSensor>,
}

/// Result of pressing a mesh into a pad.
pub struct PressedMesh {
    /// Normal force that the gel bears, N; less than requested if the gel is pressed flat.
    pub force: f64,
    /// Displacement of the mesh along the pad's normal, m.
    pub shift: f64,
    maps: Vec<IndentationMap>,
}

impl<'a> PadView<'a> {
    /// Creates the view of pad number `pad` with this cover. `seed` draws the dust of sensors from a file.
    pub fn new(hand: &'a Hand, pad: usize, cover: PadCover, source: &SensorSource, seed: u64) -> Result<Self> {
        let pad = &hand.pads[pad];
        let cameras: Vec<&PadCamera> = pad.cameras.iter().map(|&camera| &hand.cameras[camera]).collect();
        let sensors = match source {
            SensorSource::Hand(unit) => {
                let sensor = |camera: &&PadCamera| {
                    let serial = sensor_serial(hand, *unit, camera);
                    CurvedSensor::new(pad, camera, SensorModel::unit(pad, camera, serial), cover, serial)
                };
                cameras.iter().map(sensor).collect::<Result<_, _>>()?
            }
            SensorSource::Calibration(path) => {
                let name = || format!("--sensor {}", path.display());
                let text = std::fs::read_to_string(path).with_context(name)?;
                let models = PadOptics::parse(&text).and_then(|file| file.models(hand, pad)).with_context(name)?;
                let sensor = |(camera, model)| CurvedSensor::new(pad, camera, model, cover, seed).with_context(name);
                cameras.iter().copied().zip(models).map(sensor).collect::<Result<_>>()?
            }
        };
        Ok(Self { hand, pad, cameras, cover, sensors })
    }

    /// Presses a mesh into the pad with a normal force (N).
    pub fn press(&self, mesh: &Mesh, pose: &MeshPose, force: f64) -> Result<PressedMesh> {
        let mesh_from_pad = pose.pad_from_mesh(mesh).inverse();
        let up = Unit::new_unchecked(mesh_from_pad * Vector3::z());
        let lowest = |x: f64, y: f64| {
            mesh.ray(&(mesh_from_pad * Point3::new(x, y, -RAY_START)), &up).map(|distance| distance - RAY_START)
        };
        let gel = GelFoundation::winkler(&self.hand.gel());
        let pressed = self.cover.press(self.pad, &self.cameras, &gel, force, lowest)?;
        if pressed.maps.iter().all(|map| map.contact().is_none()) {
            bail!("--pose: nothing touches pad `{}`; expected the mesh over it and a force above 0", self.pad.name);
        }
        Ok(PressedMesh { force: pressed.force, shift: pressed.shift, maps: pressed.maps })
    }

    /// Writes every camera's image to `out` with its accompanying files, numbered if there are several cameras. Returns
    /// one object per camera; `seed` draws the read-out noise.
    pub fn write(&self, pressed: &PressedMesh, seed: u64, out: &Path) -> Result<Vec<CameraRender>> {
        let mut rows = Vec::new();
        for (n, (camera, map)) in self.cameras.iter().zip(&pressed.maps).enumerate() {
            let out = if self.cameras.len() == 1 { out.to_owned() } else { out.with_extension(format!("{n}.png")) };
            let sensor = &self.sensors[n];
            let started = Instant::now();
            let image = sensor.render(map, &mut ChaCha8Rng::seed_from_u64(seed)).rgb.to_vec();
            let render_ms = 1e3 * started.elapsed().as_secs_f64();
            let depths = sensor.gel(map);
            let size = [IMAGE_SIZE, IMAGE_SIZE];
            let normals = normals(&sensor.relief(&depths), size, sensor.flat_sensor().camera().pixel_size());
            let views = Views { size, image, depths, normals };
            views.write(self.hand.gel().thickness as f32, &out)?;
            let gel = self.sensors[n].flat_sensor().model().elastomer.deform(camera, map);
            let rectangle = gel.map(|gel| gel.rectangle).map(|r| [r.left, r.top, r.right, r.bottom]);
            rows.push(CameraRender {
                camera: camera.name.clone(),
                image: out,
                contact_pixels: map.contact_pixels(),
                deepest_mm: 1e3 * f64::from(map.max_depth()),
                rectangle,
                render_ms,
            });
        }
        Ok(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_stands_on_the_pad_over_its_place() {
        let points = [[0.1, 0.2, 0.3], [0.2, 0.2, 0.3], [0.1, 0.3, 0.3], [0.1, 0.2, 0.4]].map(Point3::from);
        let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let mesh = Mesh::new(points.to_vec(), faces).expect("a tetrahedron");
        let pose = MeshPose { middle: [0.01, -0.02], turn: [0.0, 0.0, std::f64::consts::FRAC_PI_2] };
        let placed: Vec<Point3<f64>> = points.iter().map(|point| pose.pad_from_mesh(&mesh) * point).collect();
        let middle = |axis: usize| {
            let all = placed.iter().map(|point| point[axis]);
            0.5 * (all.clone().fold(f64::INFINITY, f64::min) + all.fold(f64::NEG_INFINITY, f64::max))
        };
        assert!((middle(0) - 0.01).abs() < 1e-12 && (middle(1) + 0.02).abs() < 1e-12);
        assert!(placed.iter().map(|point| point.z).fold(f64::INFINITY, f64::min).abs() < 1e-12);
    }
}
