//! A calibrated real sensor, which renders the image of any object pressed into it, at the sensor's own image size.

use std::path::Path;

use hand_model::pads::PadCamera;
use nalgebra::{Point3, Vector3};

use crate::calibration::file::{SensorCalibration, VERSION};
use crate::calibration::photo::Photo;
use crate::calibration::profile::RoundSmoothing;
use crate::camera::ResponseTable;
use crate::error::{OpticsError, check_positive};
use crate::model::SensorModel;
use crate::shadows::{HeightField, Shadow};

/// A calibrated sensor with the image of its untouched gel. Frame: origin at the image centre on the untouched gel, x right,
/// y up, z towards the object.
///
/// ```
/// use tactile_optics::calibration::CalibratedSensor;
///
/// // With your own calibration: `CalibratedSensor::read(Path::new("sensor.toml"))?`.
/// let sensor = CalibratedSensor::nominal(64, 48, 0.2e-3)?;
/// let untouched = sensor.render(&vec![f32::NEG_INFINITY; 64 * 48])?;
///
/// // A ball of 6 mm diameter whose press is 8 pixels in radius.
/// let pressed = sensor.render(&sensor.ball_penetration([32.0, 24.0], 8.0, 6e-3))?;
/// assert_ne!(pressed.pixel(28, 24), untouched.pixel(28, 24));
/// assert_eq!(pressed.pixel(0, 0), untouched.pixel(0, 0));
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedSensor {
    file: SensorCalibration,
    /// Image of the untouched gel, row-major RGB, grey levels.
    background: Vec<f32>,
    /// Radiance of the background minus the model's radiance of the flat gel.
    beside_model: Vec<[f32; 3]>,
    responses: [ResponseTable; 3],
}

/// Share of every lamp above which a pixel on flat gel counts as unshadowed and shows the background.
const LIT_SHARE: f64 = 0.995;
const FLAT_DEPTH: f64 = 1e-6;
const FLAT_SLOPE: f64 = 2e-3;

impl CalibratedSensor {
    /// Reads a calibration file and the image beside it.
    pub fn read(path: &Path) -> Result<Self, OpticsError> {
        let (file, background) = SensorCalibration::read(path)?;
        Self::new(file, background)
    }

    /// Creates a sensor from its calibration and the image of its untouched gel (row-major RGB, grey levels).
    pub fn new(file: SensorCalibration, background: Vec<f32>) -> Result<Self, OpticsError> {
        let expected = 3 * file.columns * file.rows;
        if background.len() != expected {
            return Err(OpticsError::ImageSize { found: background.len(), expected });
        }
        let responses = std::array::from_fn(|c| ResponseTable::new(&file.model.response[c]));
        let mut sensor = Self { file, background, beside_model: Vec::new(), responses };
        let (w, response) = (sensor.file.columns, sensor.file.model.response);
        let beside = sensor.background.chunks_exact(3).enumerate().map(|(at, grey)| {
            let (x, y) = sensor.pixel_center((at % w) as f64, (at / w) as f64);
            let flat = sensor.radiance(&Point3::new(x, y, 0.0), [0.0; 2], |_| 1.0);
            std::array::from_fn(|c| (response[c].radiance(f64::from(grey[c]) / 255.0) - flat[c]) as f32)
        });
        sensor.beside_model = beside.collect();
        Ok(sensor)
    }

    /// Creates a synthetic sensor with the nominal lamps and a flat gel of `columns` x `rows` pixels of `pixel` m, without
    /// noise: a sensor of known parameters, for tests and first attempts.
    pub fn nominal(columns: usize, rows: usize, pixel: f64) -> Result<Self, OpticsError> {
        check_positive("columns", columns as f64)?;
        check_positive("rows", rows as f64)?;
        check_positive("pixel size", pixel)?;
        let (w, h) = (columns as f64 * pixel, rows as f64 * pixel);
        let model = SensorModel::nominal_of(&PadCamera { name: "nominal".into(), pad: 0, center_y: 0.0, h, w });
        let grey = |at: usize| {
            let (column, row) = ((at % columns) as f64, (at / columns) as f64);
            let (x, y) = (pixel * (column + 0.5) - 0.5 * w, 0.5 * h - pixel * (row + 0.5));
            model.grey(&Point3::new(x, y, 0.0), [0.0; 2]).map(|grey| grey.min(255.0) as f32)
        };
        let background = (0..columns * rows).flat_map(grey).collect();
        let file = SensorCalibration {
            version: VERSION,
            columns,
            rows,
            pixel_mm: 1e3 * pixel,
            pixel_interval_mm: None,
            contact_over_visible: 1.0,
            background: "background.png".into(),
            lens: None,
            model: SensorModel { noise: 0.0, ..model },
        };
        Self::new(file, background)
    }

    /// Returns the image-formation model.
    pub fn model(&self) -> &SensorModel {
        &self.file.model
    }

    /// Returns the content of the calibration file.
    pub fn calibration(&self) -> &SensorCalibration {
        &self.file
    }

    /// Returns the image of the untouched gel, row-major RGB, grey levels.
    pub fn background(&self) -> &[f32] {
        &self.background
    }

    /// Returns the number of columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.file.columns, self.file.rows)
    }

    /// Computes the position of a pixel's centre on the untouched gel, m.
    pub fn pixel_center(&self, column: f64, row: f64) -> (f64, f64) {
        let (pixel, (w, h)) = (1e-3 * self.file.pixel_mm, self.size());
        ((column - 0.5 * (w as f64 - 1.0)) * pixel, (0.5 * (h as f64 - 1.0) - row) * pixel)
    }

    /// Computes the depth of the gel (m, row-major) under an object. `penetration` is the depth of the object below the
    /// untouched surface at each pixel (m; negative above it, negative infinity without an object).
    pub fn gel_depth(&self, penetration: &[f32]) -> Result<Vec<f32>, OpticsError> {
        let (w, h) = self.size();
        if penetration.len() != w * h {
            return Err(OpticsError::ImageSize { found: penetration.len(), expected: w * h });
        }
        if let Some(at) = penetration.iter().position(|value| value.is_nan() || *value == f32::INFINITY) {
            let expected = "a number below infinity";
            return Err(OpticsError::MapValue { column: at % w, row: at / w, value: penetration[at], expected });
        }
        Ok(self.gel_depth_unchecked(penetration))
    }

    fn gel_depth_unchecked(&self, penetration: &[f32]) -> Vec<f32> {
        let (w, h) = self.size();
        let pixel = (1e-3 * self.file.pixel_mm, 1e-3 * self.file.pixel_mm);
        let elastomer = &self.file.model.elastomer;
        let grown = elastomer.dilate_by_coating(penetration, w, h, pixel);
        elastomer.smooth(grown.iter().map(|depth| depth.max(0.0)).collect(), w, h, pixel)
    }

    /// Renders the image of an object (see [`Self::gel_depth`] for `penetration`), without noise.
    pub fn render(&self, penetration: &[f32]) -> Result<Photo, OpticsError> {
        let gel = self.gel_depth(penetration)?;
        let grey = self.shade(&gel);
        let (width, height) = self.size();
        Ok(Photo { width, height, rgb: grey.into_iter().map(|grey| (grey + 0.5).clamp(0.0, 255.0) as u8).collect() })
    }

    /// Like [`Self::render`], but distorted by the camera's lens, if the calibration has one.
    pub fn render_raw(&self, penetration: &[f32]) -> Result<Photo, OpticsError> {
        let rectified = self.render(penetration)?;
        Ok(self.file.lens.map_or_else(|| rectified.clone(), |lens| lens.distort(&rectified)))
    }

    /// Renders a ball's press (see [`Self::ball_penetration`]): grey levels rounded to whole numbers, row-major RGB.
    pub fn render_ball(&self, center: [f64; 2], radius: f64, diameter: f64) -> Vec<f32> {
        // A ball's penetration needs no check: it has this sensor's size and no NaN.
        let penetration = self.ball_penetration(center, radius, diameter);
        let gel = self.gel_depth_unchecked(&penetration);
        self.shade(&gel).into_iter().map(|grey| grey.round().clamp(0.0, 255.0)).collect()
    }

    /// Computes the depth of a ball (m; `diameter` in m) from the `radius` of its visible circle (pixels), and the
    /// contact radius of that ball enlarged by the coating, m.
    pub fn ball_depth(&self, radius: f64, diameter: f64) -> (f64, f64) {
        let grown = 0.5 * diameter + self.file.model.elastomer.coating;
        let contact = (radius * 1e-3 * self.file.pixel_mm * self.file.contact_over_visible).min(0.999 * grown);
        (grown - (grown * grown - contact * contact).sqrt(), contact)
    }

    /// Computes the penetration map (m) of a ball (`diameter` in m) whose press has this visible circle (pixels).
    pub fn ball_penetration(&self, center: [f64; 2], radius: f64, diameter: f64) -> Vec<f32> {
        let (pixel, model) = (1e-3 * self.file.pixel_mm, &self.file.model);
        let (ball, grown) = (0.5 * diameter, 0.5 * diameter + model.elastomer.coating);
        let (deepest, contact) = self.ball_depth(radius, diameter);
        // The circle lies on the bump's flank, which relief moves away from the point below the camera.
        let profile = RoundSmoothing::new(&model.elastomer.kernels, 3.0 * grown, 0.02 * grown).press(grown, contact);
        let part = -profile.depth_and_slope(radius * pixel).0 / model.camera.position.z;
        let (x, y) = self.pixel_center(center[0], center[1]);
        let middle = (x + (model.camera.position.x - x) * part, y + (model.camera.position.y - y) * part);
        let (w, h) = self.size();
        (0..w * h)
            .map(|at| {
                let (x, y) = self.pixel_center((at % w) as f64, (at / w) as f64);
                let inside = ball * ball - (x - middle.0).powi(2) - (y - middle.1).powi(2);
                if inside > 0.0 { (inside.sqrt() - ball + deepest) as f32 } else { f32::NEG_INFINITY }
            })
            .collect()
    }

    /// Renders the grey levels, row-major RGB, of a gel of this depth.
    fn shade(&self, gel: &[f32]) -> Vec<f32> {
        let (w, h) = self.size();
        let (pixel, model) = (1e-3 * self.file.pixel_mm, &self.file.model);
        let field =
            HeightField { width: w, height: h, first: self.pixel_center(0.0, 0.0), pixel: (pixel, pixel), depth: gel };
        let shadows: Vec<Option<Shadow>> = field.shadows(&model.lamps);
        let camera = model.camera.position;
        // Bilinear depth at a fractional pixel.
        let depth = |column: f64, row: f64| {
            let (column, row) = (column.clamp(0.0, (w - 1) as f64), row.clamp(0.0, (h - 1) as f64));
            let (c, r) = ((column as usize).min(w.max(2) - 2), (row as usize).min(h.max(2) - 2));
            let (u, v) = (column - c as f64, row - r as f64);
            let at = |r: usize, c: usize| f64::from(gel[r.min(h - 1) * w + c.min(w - 1)]);
            (1.0 - v) * ((1.0 - u) * at(r, c) + u * at(r, c + 1))
                + v * ((1.0 - u) * at(r + 1, c) + u * at(r + 1, c + 1))
        };
        let foot = (camera.x / pixel + 0.5 * (w - 1) as f64, 0.5 * (h - 1) as f64 - camera.y / pixel);
        let mut grey = self.background.clone();
        let mut shares = vec![1.0; model.lamps.len()];
        for (at, grey) in grey.chunks_exact_mut(3).enumerate() {
            let (column, row) = ((at % w) as f64, (at / w) as f64);
            let (mut seen, mut deep) = ((column, row), 0.0);
            for _ in 0..5 {
                deep = depth(seen.0, seen.1);
                if deep < FLAT_DEPTH && seen == (column, row) {
                    break;
                }
                let part = -deep / camera.z;
                seen = (column + (foot.0 - column) * part, row + (foot.1 - row) * part);
            }
            let slope = [
                (depth(seen.0 - 1.0, seen.1) - depth(seen.0 + 1.0, seen.1)) / (2.0 * pixel),
                (depth(seen.0, seen.1 + 1.0) - depth(seen.0, seen.1 - 1.0)) / (2.0 * pixel),
            ];
            for (share, shadow) in shares.iter_mut().zip(&shadows) {
                *share = shadow.as_ref().map_or(1.0, |shadow| shadow.visible_share_at(seen.0, seen.1));
            }
            let deformed = deep > FLAT_DEPTH || slope[0].abs() > FLAT_SLOPE || slope[1].abs() > FLAT_SLOPE;
            if !deformed && shares.iter().all(|&share| share > LIT_SHARE) {
                continue;
            }
            let (x, y) = self.pixel_center(seen.0, seen.1);
            let radiance = self.radiance(&Point3::new(x, y, -deep), slope, |k| shares[k]);
            for c in 0..3 {
                grey[c] = self.responses[c].grey(self.beside_model[at][c] + radiance[c] as f32);
            }
        }
        grey
    }

    /// Computes the radiance of a point on the gel by the model, with the visible share of each lamp.
    fn radiance(&self, point: &Point3<f64>, slope: [f64; 2], share: impl Fn(usize) -> f64) -> [f64; 3] {
        let model = &self.file.model;
        let normal = Vector3::new(slope[0], slope[1], -1.0).normalize();
        let viewer = model.camera.direction_to_camera(point);
        let mut sum = model.ambient.map(|ambient| ambient * 0.5 * (1.0 - normal.z));
        for (k, lamp) in model.lamps.iter().enumerate() {
            let (s, kappa) = lamp.direction_and_irradiance(point);
            if kappa <= 0.0 {
                continue;
            }
            let light = share(k) * kappa * model.reflectance.factor(&normal, &s, &viewer);
            for (c, sum) in sum.iter_mut().enumerate() {
                *sum += model.gain[c] * lamp.color[c] * model.reflectance.albedo[c] * light;
            }
        }
        sum
    }
}
