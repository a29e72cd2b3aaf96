//! Image formation of a curved pad.
//!
//! The gel's surface under the cover, pressed in along the cover's normals, becomes a relief over the pad's plane. Every
//! pixel's ray, from the pinhole through the pixel's position in that plane, is intersected with the relief, so that
//! relief is shifted sideways as in a real image. The lamps light the intersection, with shadows of the relief in
//! between. As on a flat pad, unchanged pixels show the background; elsewhere the model's change of radiance is added to
//! the background's.

use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use hand_model::robot::TactileImage;
use nalgebra::Point3;
use rand::Rng;
use rayon::prelude::*;

use crate::cover::PadCover;
use crate::error::OpticsError;
use crate::indentation::{IndentationMap, PIXEL_COUNT};
use crate::model::SensorModel;
use crate::noise::quantise;
use crate::sensor::Sensor;
use crate::shadows::{HeightField, Shadow};

/// One camera unit of a pad with any cover. With [`PadCover::FLAT`] its images are bit-identical to those of [`Sensor`].
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use tactile_optics::hand_model::Hand;
/// use tactile_optics::{CurvedSensor, PadCover, SensorModel, press};
///
/// let hand = Hand::ftac();
/// let (pad, camera) = (&hand.pads[0], &hand.cameras[hand.pads[0].cameras[0]]);
/// let cover = PadCover::cylinder(0.03)?;
/// let sensor = CurvedSensor::new(pad, camera, SensorModel::nominal(pad, camera), cover, 7)?;
/// let pressed = press(pad, &[camera], &hand.parameters.gel, 2.0, |x, y| Some(50.0 * (x * x + y * y)))?;
/// let image = sensor.render(&pressed.maps[0], &mut ChaCha8Rng::seed_from_u64(1));
/// assert_ne!(image, sensor.background());
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct CurvedSensor {
    sensor: Sensor,
    cover: PadCover,
    /// The model's radiance of the untouched gel, row-major RGB.
    untouched: Vec<f32>,
    /// Grey levels of the untouched gel.
    background: Vec<f32>,
}

/// Largest number of iterations of the ray intersection.
const MAX_ITERATIONS: usize = 8;
/// Smallest change of radiance, as a fraction of full scale, for which a pixel is shaded again.
const MIN_RADIANCE_CHANGE: f32 = 1e-4;

impl CurvedSensor {
    /// Like [`Sensor::with_model`], under a cover.
    pub fn new(
        pad: &Pad,
        camera: &PadCamera,
        model: SensorModel,
        cover: PadCover,
        seed: u64,
    ) -> Result<Self, OpticsError> {
        cover.check(pad)?;
        Ok(Self::from_sensor(Sensor::with_model(pad, camera, model, seed)?, cover))
    }

    fn from_sensor(sensor: Sensor, cover: PadCover) -> Self {
        if cover.is_flat() {
            return Self { sensor, cover, untouched: Vec::new(), background: Vec::new() };
        }
        let mut curved = Self { sensor, cover, untouched: Vec::new(), background: Vec::new() };
        curved.untouched = curved.radiance(&vec![0.0; PIXEL_COUNT]);
        curved.background = (0..3 * PIXEL_COUNT).map(|at| curved.grey(at, curved.untouched[at])).collect();
        curved
    }

    /// Returns the same unit with a flat pad.
    pub fn flat_sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Returns the image of the untouched gel, without read-out noise.
    pub fn background(&self) -> TactileImage {
        if self.cover.is_flat() {
            return (**self.sensor.background()).clone();
        }
        TactileImage { rgb: self.background.iter().map(|&grey| quantise(grey)).collect() }
    }

    /// Computes the deformed gel (m along the cover's normals, row-major) of an indentation.
    pub fn gel(&self, indentation: &IndentationMap) -> Vec<f32> {
        let gel = self.sensor.model.elastomer.deform(&self.sensor.camera, indentation);
        let depth = |at: usize| gel.as_ref().map_or(0.0, |gel| gel.depth(at % IMAGE_SIZE, at / IMAGE_SIZE));
        (0..PIXEL_COUNT).map(depth).collect()
    }

    /// Computes the surface's depth (m, row-major) under the pad's plane, for a gel given along the cover's normals.
    pub fn relief(&self, gel: &[f32]) -> Vec<f32> {
        if self.cover.is_flat() {
            return gel.to_vec();
        }
        let camera = &self.sensor.camera;
        let (dx, _) = camera.pixel_size();
        (0..PIXEL_COUNT)
            .map(|at| {
                let (column, row) = (at % IMAGE_SIZE, at / IMAGE_SIZE);
                let (x, _) = camera.pixel_center(column, row);
                let line = &gel[row * IMAGE_SIZE..(row + 1) * IMAGE_SIZE];
                // Find the point on the cover that is displaced to above this one.
                let (mut from, mut deep) = (x, 0.0);
                for _ in 0..MAX_ITERATIONS {
                    deep = interpolate_column(line, column as f64 + (from - x) / dx);
                    let next = x + deep * self.cover.normal(from).x;
                    if (next - from).abs() < 1e-7 {
                        break;
                    }
                    from = next;
                }
                (deep * self.cover.normal(from).z - self.cover.height(from)) as f32
            })
            .collect()
    }

    /// Renders the tactile image of an indentation along the cover's normals (see [`PadCover::press`]); `rng` generates
    /// the read-out noise.
    pub fn render(&self, indentation: &IndentationMap, rng: &mut impl Rng) -> TactileImage {
        if self.cover.is_flat() {
            return self.sensor.render(indentation, rng);
        }
        let mut grey = self.background.clone();
        if indentation.contact().is_some() {
            let pressed = self.radiance(&self.gel(indentation));
            for (at, (grey, radiance)) in grey.iter_mut().zip(pressed).enumerate() {
                if (radiance - self.untouched[at]).abs() > MIN_RADIANCE_CHANGE {
                    *grey = self.grey(at, radiance);
                }
            }
        }
        let mut rgb = vec![0; 3 * PIXEL_COUNT];
        for (bytes, grey) in rgb.chunks_exact_mut(3 * IMAGE_SIZE).zip(grey.chunks_exact(3 * IMAGE_SIZE)) {
            self.sensor.noise.expose(grey, 1.0, bytes, rng);
        }
        TactileImage { rgb }
    }

    /// Computes the grey level of image value `at` for a radiance of the model.
    fn grey(&self, at: usize, radiance: f32) -> f32 {
        self.sensor.response[at % 3].grey(radiance + self.sensor.correction[at])
    }

    /// Computes the model's radiance of every pixel, row-major RGB.
    fn radiance(&self, gel: &[f32]) -> Vec<f32> {
        let (camera, model) = (&self.sensor.camera, &self.sensor.model);
        let (dx, dy) = camera.pixel_size();
        let relief = self.relief(gel);
        let side = IMAGE_SIZE;
        let first = camera.pixel_center(0, 0);
        let field = HeightField { width: side, height: side, first, pixel: (dx, dy), depth: &relief };
        let shadows: Vec<Option<Shadow>> = field.shadows(&model.lamps);
        let depth = |column: f64, row: f64| {
            let last = (side - 1) as f64;
            let (column, row) = (column.clamp(0.0, last), row.clamp(0.0, last));
            let above = (row as usize).min(side - 2);
            let line = |row: usize| interpolate_column(&relief[row * side..(row + 1) * side], column);
            let part = row - above as f64;
            (1.0 - part) * line(above) + part * line(above + 1)
        };
        // Mean slope over one pixel to either side, clipped to the image.
        let slope = |low: f64, high: f64, at: &dyn Fn(f64) -> f64, pixel: f64| {
            let (low, high) = (low.max(0.0), high.min((side - 1) as f64));
            (at(low) - at(high)) / ((high - low) * pixel)
        };
        let eye = model.camera.position;
        let foot = ((eye.x - first.0) / dx, (first.1 - eye.y) / dy);
        let mut radiance = vec![0.0; 3 * PIXEL_COUNT];
        radiance.par_chunks_exact_mut(3 * side).enumerate().for_each(|(row, line)| {
            for (column, pixel) in line.chunks_exact_mut(3).enumerate() {
                let place = (column as f64, row as f64);
                let (mut seen, mut deep) = (place, 0.0);
                for _ in 0..MAX_ITERATIONS {
                    let next = depth(seen.0, seen.1);
                    if next == deep {
                        break;
                    }
                    deep = next;
                    let part = -deep / eye.z;
                    seen = (place.0 + (foot.0 - place.0) * part, place.1 + (foot.1 - place.1) * part);
                }
                let zx = slope(seen.0 - 1.0, seen.0 + 1.0, &|column| depth(column, seen.1), dx);
                let zy = -slope(seen.1 - 1.0, seen.1 + 1.0, &|row| depth(seen.0, row), dy);
                let point = Point3::new(first.0 + seen.0 * dx, first.1 - seen.1 * dy, -deep);
                let share = |k: usize| {
                    shadows
                        .get(k)
                        .and_then(Option::as_ref)
                        .map_or(1.0, |shadow| shadow.visible_share_at(seen.0, seen.1))
                };
                for (value, radiance) in pixel.iter_mut().zip(model.radiance_with_shadows(&point, [zx, zy], share)) {
                    *value = radiance as f32;
                }
            }
        });
        radiance
    }
}

/// Interpolates linearly in a row, constant beyond its ends.
fn interpolate_column(line: &[f32], column: f64) -> f64 {
    let column = column.clamp(0.0, (line.len() - 1) as f64);
    let left = (column as usize).min(line.len() - 2);
    let part = column - left as f64;
    (1.0 - part) * f64::from(line[left]) + part * f64::from(line[left + 1])
}
