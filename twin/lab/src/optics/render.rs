//! What a pad's cameras see of a mesh that is pressed into the pad along its normal.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use hand_model::pads::{Camera, IMAGE_SIZE, Pad};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use optics::pads::PadOptics;
use optics::{Cover, CurvedSensor, Foundation, IndentationMap, SensorModel};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use scenarios::geometry::Mesh;
use serde_json::{Value, json};

use super::{exr, npy, sensor_serial};

/// Where rays start, m under the pad's plane: below everything, since the mesh's lowest point is put on the plane.
const RAY_START: f64 = 1e-3;

/// Where a mesh lies over a pad.
#[derive(Debug, Clone, Copy)]
pub struct MeshPose {
    /// Its middle over the pad, m. Its lowest point is put on the pad's plane.
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

/// The sensors of a pad.
pub enum SensorSource<'a> {
    /// Those of the hand with this serial number.
    Hand(u64),
    /// Those of a calibration file as `optics pads` writes it.
    Calibration(&'a Path),
}

/// A pad, its cameras and their sensors.
pub struct PadView<'a> {
    hand: &'a Hand,
    pad: &'a Pad,
    cameras: Vec<&'a Camera>,
    cover: Cover,
    sensors: Vec<CurvedSensor>,
}

/// A mesh pressed into a pad.
pub struct PressedMesh {
    /// Normal force that the gel bears, N; less than asked for where the gel is pressed flat.
    pub force: f64,
    /// How far the mesh was moved along the pad's normal, m.
    pub shift: f64,
    maps: Vec<IndentationMap>,
}

impl<'a> PadView<'a> {
    /// Pad number `pad` with this cover; `seed` draws the dust of sensors from a file.
    pub fn new(hand: &'a Hand, pad: usize, cover: Cover, source: &SensorSource, seed: u64) -> Result<Self> {
        let pad = &hand.pads[pad];
        let cameras: Vec<&Camera> = pad.cameras.iter().map(|&camera| &hand.cameras[camera]).collect();
        let sensors = match source {
            SensorSource::Hand(unit) => {
                let sensor = |camera: &&Camera| {
                    let serial = sensor_serial(hand, *unit, camera);
                    CurvedSensor::new(pad, camera, SensorModel::unit(pad, camera, serial), cover, serial)
                };
                cameras.iter().map(sensor).collect::<Result<_, _>>()?
            }
            SensorSource::Calibration(path) => {
                let name = || format!("--calibration {}", path.display());
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
        let gel = Foundation::winkler(&self.hand.gel());
        let pressed = self.cover.press(self.pad, &self.cameras, &gel, force, lowest)?;
        if pressed.maps.iter().all(|map| map.contact().is_none()) {
            bail!("--pose: nothing touches pad `{}`; expected the mesh over it and a force above 0", self.pad.name);
        }
        Ok(PressedMesh { force: pressed.force, shift: pressed.shift, maps: pressed.maps })
    }

    /// Writes what every camera sees: `out` and the files beside it, numbered where there are several cameras. Returns an
    /// object a camera; `seed` draws the read-out noise.
    pub fn write(&self, pressed: &PressedMesh, seed: u64, out: &Path) -> Result<Vec<Value>> {
        let mut rows = Vec::new();
        for (n, (camera, map)) in self.cameras.iter().zip(&pressed.maps).enumerate() {
            let out = if self.cameras.len() == 1 { out.to_owned() } else { out.with_extension(format!("{n}.png")) };
            let views = CameraViews::new(&self.sensors[n], map, seed);
            views.write(self.hand.gel().thickness as f32, &out)?;
            let gel = self.sensors[n].flat().model().elastomer.deform(camera, map);
            let rectangle = gel.map(|gel| gel.rectangle).map(|r| [r.left, r.top, r.right, r.bottom]);
            rows.push(json!({
                "camera": camera.name,
                "image": out,
                "contact_pixels": map.contact_pixels(),
                "deepest_mm": 1e3 * f64::from(map.deepest()),
                "rectangle": rectangle,
            }));
        }
        Ok(rows)
    }
}

/// What one camera sees, row-major.
struct CameraViews {
    /// RGB.
    image: Vec<u8>,
    /// The gel's indentation along the cover's normals, m.
    depths: Vec<f32>,
    /// Pad frame, out of the gel; x, y, z of each pixel.
    normals: Vec<f32>,
}

impl CameraViews {
    fn new(sensor: &CurvedSensor, map: &IndentationMap, seed: u64) -> Self {
        let image = sensor.render(map, &mut ChaCha8Rng::seed_from_u64(seed));
        let depths = sensor.gel(map);
        let normals = normals(&sensor.relief(&depths), sensor.flat().camera().pixel_size());
        Self { image: image.rgb.to_vec(), depths, normals }
    }

    /// Image, indentation and normals as PNG, NPY and EXR; `white` is the indentation (m) that the PNG shows white.
    fn write(&self, white: f32, out: &Path) -> Result<()> {
        let side = IMAGE_SIZE as u32;
        let beside = |ending: &str| -> PathBuf { out.with_extension(ending) };
        let save = |path: &Path, bytes: &[u8], color| {
            image::save_buffer(path, bytes, side, side, color).with_context(|| format!("--out {}", path.display()))
        };
        save(out, &self.image, image::ColorType::Rgb8)?;
        let greys: Vec<f32> = self.image.iter().map(|&value| f32::from(value) / 255.0).collect();
        npy::write(&beside("height.npy"), &self.depths, &[IMAGE_SIZE, IMAGE_SIZE])?;
        npy::write(&beside("normals.npy"), &self.normals, &[IMAGE_SIZE, IMAGE_SIZE, 3])?;
        npy::write(&beside("npy"), &greys, &[IMAGE_SIZE, IMAGE_SIZE, 3])?;
        let channel = |values: &[f32], c: usize| values.iter().skip(c).step_by(3).copied().collect::<Vec<f32>>();
        let colors = |values: &[f32]| [("R", channel(values, 0)), ("G", channel(values, 1)), ("B", channel(values, 2))];
        exr::write(&beside("exr"), IMAGE_SIZE, &colors(&greys))?;
        exr::write(&beside("normals.exr"), IMAGE_SIZE, &colors(&self.normals))?;
        exr::write(&beside("height.exr"), IMAGE_SIZE, &[("Y", self.depths.clone())])?;
        let grey: Vec<u8> = self.depths.iter().map(|depth| (255.0 * depth / white).clamp(0.0, 255.0) as u8).collect();
        save(&beside("height.png"), &grey, image::ColorType::L8)?;
        let color: Vec<u8> = self.normals.iter().map(|value| (127.5 * (value + 1.0)) as u8).collect();
        save(&beside("normals.png"), &color, image::ColorType::Rgb8)
    }
}

/// Normals of a surface at z = -`depth` (m) by central differences; `pixel` is a pixel's size (m).
fn normals(depth: &[f32], pixel: (f64, f64)) -> Vec<f32> {
    let depth = |column: usize, row: usize| depth[row * IMAGE_SIZE + column];
    let last = IMAGE_SIZE - 1;
    let normal = |at: usize| {
        let (column, row) = (at % IMAGE_SIZE, at / IMAGE_SIZE);
        let (left, right) = (column.saturating_sub(1), (column + 1).min(last));
        let (above, below) = (row.saturating_sub(1), (row + 1).min(last));
        // Rows run against y; the normal points out of the gel.
        let zx = (depth(left, row) - depth(right, row)) / ((right - left) as f32 * pixel.0 as f32);
        let zy = (depth(column, below) - depth(column, above)) / ((below - above) as f32 * pixel.1 as f32);
        let normal = Vector3::new(-zx, -zy, 1.0).normalize();
        [normal.x, normal.y, normal.z]
    };
    (0..IMAGE_SIZE * IMAGE_SIZE).flat_map(normal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane that gets deeper by 0.1 to the right and by 0.2 upwards.
    #[test]
    fn a_tilted_plane_has_one_normal() {
        let pixel = (1e-4, 2e-4);
        let depth: Vec<f32> = (0..IMAGE_SIZE * IMAGE_SIZE)
            .map(|at| (0.1 * 1e-4 * (at % IMAGE_SIZE) as f64 - 0.2 * 2e-4 * (at / IMAGE_SIZE) as f64) as f32)
            .collect();
        let expected = Vector3::new(0.1f32, 0.2, 1.0).normalize();
        for found in normals(&depth, pixel).chunks_exact(3) {
            assert!((Vector3::from_column_slice(found) - expected).norm() < 1e-3, "{found:?}");
        }
    }

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
