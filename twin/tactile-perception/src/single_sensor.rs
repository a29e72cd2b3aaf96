//! One sensor that is not part of a hand (GelSight, DIGIT): calibration by presses of a ball, surfaces and contacts, for
//! images of any size.
//!
//! Images are averaged onto the grid of 240 x 240 pixels on which this crate computes ([`PadGrid`]). Frame: origin at the
//! centre of the image on the untouched gel, x right, y up, z out of the gel.

use std::sync::Arc;

use hand_model::pads::{Pad, PadCamera};
use hand_model::parameters::Gel;
use hand_model::robot::TactileImage;
use nalgebra::Isometry3;

use crate::PIXELS;
use crate::calibration::{AngularError, CalibrationPress, PhotometricModel};
use crate::colour_change::StereoOptions;
use crate::contacts::{ContactOptions, ContactPatch, find_contacts};
use crate::error::TouchError;
use crate::grid::PadGrid;
use crate::pad_touch::HeightMap;
use crate::photometric_stereo::gradients;
use crate::poisson::{PoissonSolver, rest_level};

/// Letter that stands for the only configuration of a single sensor.
const CONFIGURATION: char = 'a';

/// Size of a sensor's images, and of their pixels on the gel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageGeometry {
    /// Columns of an image.
    pub columns: usize,
    /// Rows of an image.
    pub rows: usize,
    /// Size of a pixel on the gel, m.
    pub pixel: f64,
}

impl ImageGeometry {
    /// Position (m) of the centre of pixel (column, row), which may be fractional.
    pub fn position(&self, column: f64, row: f64) -> [f64; 2] {
        let middle = |size: usize| 0.5 * (size as f64 - 1.0);
        [(column - middle(self.columns)) * self.pixel, (middle(self.rows) - row) * self.pixel]
    }

    fn grid(&self) -> PadGrid {
        PadGrid { width: self.columns, height: self.rows }
    }

    fn check(&self) -> Result<(), TouchError> {
        let positive = [self.columns as f64, self.rows as f64, self.pixel].iter().all(|value| *value > 0.0);
        if positive && self.pixel.is_finite() { Ok(()) } else { Err(TouchError::Geometry(*self)) }
    }

    fn average(&self, what: &'static str, rgb: &[u8]) -> Result<Arc<TactileImage>, TouchError> {
        let (found, expected) = (rgb.len(), 3 * self.columns * self.rows);
        if found == expected { Ok(self.grid().image(rgb)) } else { Err(TouchError::Size { what, found, expected }) }
    }
}

/// An image of a ball pressed in at a known position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallImage<'a> {
    /// Row-major RGB.
    pub rgb: &'a [u8],
    /// Centre of the contact: column and row, pixels.
    pub center: [f64; 2],
    /// Radius of the contact, pixels.
    pub radius: f64,
    /// Diameter of the ball, m.
    pub diameter: f64,
}

/// An image of something pressed in whose depth is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthImage<'a> {
    /// Row-major RGB.
    pub rgb: &'a [u8],
    /// Indentation of the gel's surface at each pixel, m, row-major; 0 where it is at rest.
    pub depth: &'a [f32],
}

/// A calibrated sensor: reconstructs the gel's surface from an image, and finds the contacts in it.
///
/// ```
/// use tactile_perception::single_sensor::{BallImage, ImageGeometry, SingleSensor};
///
/// // Images of a gel lit from three sides, in place of a camera's: 160 x 120 pixels of 0.1 mm.
/// let geometry = ImageGeometry { columns: 160, rows: 120, pixel: 0.1e-3 };
/// let image = |depth: &dyn Fn(f64, f64) -> f64| -> Vec<u8> {
///     let pixel = |at: usize| {
///         let [x, y] = geometry.position((at % 160) as f64, (at / 160) as f64);
///         let gx = (depth(x + 1e-5, y) - depth(x - 1e-5, y)) / 2e-5;
///         let gy = (depth(x, y + 1e-5) - depth(x, y - 1e-5)) / 2e-5;
///         [0.5_f64, 2.6, 4.7].map(|lamp| {
///             let light = 1.0 + 0.8 * (lamp.cos() * gx + lamp.sin() * gy);
///             (110.0 * light / (1.0 + gx * gx + gy * gy).sqrt()) as u8
///         })
///     };
///     (0..160 * 120).flat_map(pixel).collect()
/// };
/// // Depth (m) of a ball of 8 mm diameter with a contact of 1.5 mm radius at (x, y).
/// let ball = |x: f64, y: f64| {
///     move |u: f64, v: f64| {
///         let square = (u - x).powi(2) + (v - y).powi(2);
///         if square < 1.5e-3_f64.powi(2) { (4e-3_f64.powi(2) - square).sqrt() - 13.75e-6_f64.sqrt() } else { 0.0 }
///     }
/// };
///
/// let background = image(&|_, _| 0.0);
/// let centers = [[40.0, 40.0], [80.0, 35.0], [120.0, 45.0], [50.0, 80.0], [90.0, 85.0], [115.0, 75.0]];
/// let images = centers.map(|[column, row]| {
///     let [x, y] = geometry.position(column, row);
///     image(&ball(x, y))
/// });
/// let press = |(rgb, center)| BallImage { rgb, center, radius: 15.0, diameter: 8e-3 };
/// let presses: Vec<BallImage> = images.iter().map(Vec::as_slice).zip(centers).map(press).collect();
/// let sensor = SingleSensor::calibrate(geometry, &background, &presses)?;
///
/// let surface = sensor.reconstruct(&image(&ball(1e-3, -0.5e-3)))?.ok_or("nothing was felt")?;
/// let deepest = sensor.depths(&surface).into_iter().fold(0.0, f32::max);
/// assert!((deepest - 0.292e-3).abs() < 0.06e-3, "{deepest} m");
/// assert!(sensor.reconstruct(&background)?.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SingleSensor {
    geometry: ImageGeometry,
    pad: Pad,
    camera: PadCamera,
    background: Arc<TactileImage>,
    model: PhotometricModel,
    poisson: PoissonSolver,
    /// Thresholds for an image to count as touched.
    pub stereo: StereoOptions,
    /// Thresholds of contact patches.
    pub contacts: ContactOptions,
}

impl SingleSensor {
    /// Calibrates the sensor by presses of a ball; `background` is the image of the untouched gel (row-major RGB). A dozen
    /// presses spread over the gel are enough; with too few contact pixels there is an error.
    ///
    /// The gel is taken to lie on the ball inside the contact and to be flat outside. Around shallow contacts it is not:
    /// gel that leaves the ball gradually makes slopes near the rim, and with them all depths, too large. Where a model of
    /// the gel is known, [`Self::calibrate_with_depths`] is more accurate.
    pub fn calibrate(
        geometry: ImageGeometry,
        background: &[u8],
        presses: &[BallImage<'_>],
    ) -> Result<Self, TouchError> {
        geometry.check()?;
        let before = geometry.average("bytes of a background", background)?;
        Self::fitted(geometry, background, &labelled(&geometry, &before, presses)?)
    }

    /// Like [`Self::calibrate`], by presses of anything whose depths are known, such as those that
    /// `CalibratedSensor::gel_depth` of the crate `tactile-optics` computes.
    pub fn calibrate_with_depths(
        geometry: ImageGeometry,
        background: &[u8],
        presses: &[DepthImage<'_>],
    ) -> Result<Self, TouchError> {
        geometry.check()?;
        let before = geometry.average("bytes of a background", background)?;
        let label = |press: &DepthImage<'_>| {
            let (found, expected) = (press.depth.len(), geometry.columns * geometry.rows);
            if found != expected {
                return Err(TouchError::Size { what: "depths of a press", found, expected });
            }
            if press.depth.iter().any(|depth| !depth.is_finite()) {
                return Err(TouchError::NotFinite("a depth of a press"));
            }
            Ok(CalibrationPress {
                camera: 0,
                image: geometry.average("bytes of a press image", press.rgb)?,
                background: before.clone(),
                indentation: geometry.grid().averaged(press.depth, 1),
            })
        };
        Self::fitted(geometry, background, &presses.iter().map(label).collect::<Result<Vec<_>, _>>()?)
    }

    fn fitted(geometry: ImageGeometry, background: &[u8], labelled: &[CalibrationPress]) -> Result<Self, TouchError> {
        let pixel = geometry.grid().pixel(geometry.pixel);
        let with_pixel: Vec<_> = labelled.iter().map(|press| (press, pixel)).collect();
        let model = PhotometricModel::fit(CONFIGURATION, &with_pixel)?;
        Self::with_model(geometry, background, model)
    }

    /// Creates the sensor with a model that is known, as from a file.
    pub fn with_model(geometry: ImageGeometry, background: &[u8], model: PhotometricModel) -> Result<Self, TouchError> {
        geometry.check()?;
        model.check()?;
        let (w, h) = (geometry.columns as f64 * geometry.pixel, geometry.rows as f64 * geometry.pixel);
        Ok(Self {
            background: geometry.average("bytes of a background", background)?,
            pad: Pad {
                name: "sensor".into(),
                link: None,
                configuration: CONFIGURATION,
                link_from_pad: Isometry3::identity(),
                h,
                w,
                edge_radius: 0.0,
                cameras: vec![0],
            },
            camera: PadCamera { name: "sensor".into(), pad: 0, center_y: 0.0, h, w },
            geometry,
            model,
            poisson: PoissonSolver::new(),
            stereo: StereoOptions::default(),
            contacts: ContactOptions::default(),
        })
    }

    /// The relation between colour change and slope, which can be serialised and given to [`Self::with_model`].
    pub fn model(&self) -> &PhotometricModel {
        &self.model
    }

    /// Size of the images.
    pub fn geometry(&self) -> ImageGeometry {
        self.geometry
    }

    /// Angular error of the normals in the contacts of presses that were not calibrated with.
    pub fn evaluate(&self, held_out: &[BallImage<'_>]) -> Result<AngularError, TouchError> {
        let presses = labelled(&self.geometry, &self.background, held_out)?;
        Ok(AngularError::from_angles(
            presses.iter().flat_map(|press| self.model.angles(press, self.camera.pixel_size())).collect(),
        ))
    }

    /// Reconstructs the surface from an image (row-major RGB), on the grid of 240 x 240 pixels; `None` if it shows an
    /// untouched gel.
    pub fn reconstruct(&self, rgb: &[u8]) -> Result<Option<HeightMap>, TouchError> {
        let image = self.geometry.average("bytes of an image", rgb)?;
        let Some(gradients) = gradients(&image, &self.background, &self.model, &self.stereo) else { return Ok(None) };
        let mut height = self.poisson.solve(&gradients.gx, &gradients.gy, self.camera.pixel_size());
        let level = rest_level(&height, gradients.region);
        height.iter_mut().for_each(|value| *value -= level);
        Ok(Some(HeightMap { camera: 0, height, gradients }))
    }

    /// Indentation at the pixels of the sensor's own images, m, row-major.
    pub fn depths(&self, surface: &HeightMap) -> Vec<f32> {
        self.geometry.grid().interpolated(&surface.height)
    }

    /// Contacts in a surface, strongest first, in the sensor's frame. Forces are those of columns of gel of this
    /// stiffness; positions, areas and normals do not depend on it.
    pub fn contacts(&self, surface: &HeightMap, gel: Gel) -> Vec<ContactPatch> {
        find_contacts(&self.pad, 0, &self.camera, gel, &surface.height, &self.contacts)
    }
}

/// Presses on the grid, with the depth of the ball at each pixel.
fn labelled(
    geometry: &ImageGeometry,
    background: &Arc<TactileImage>,
    presses: &[BallImage<'_>],
) -> Result<Vec<CalibrationPress>, TouchError> {
    let grid = geometry.grid();
    let label = |press: &BallImage<'_>| {
        let (ball, contact) = (0.5 * press.diameter, press.radius * geometry.pixel);
        if !(contact > 0.0 && contact < ball && ball.is_finite()) {
            return Err(TouchError::Ball { radius: contact, diameter: press.diameter });
        }
        let depth = |i: usize| {
            let (column, row) = grid.center(i);
            let r = (column - press.center[0]).hypot(row - press.center[1]) * geometry.pixel;
            if r < contact {
                ((ball * ball - r * r).sqrt() - (ball * ball - contact * contact).sqrt()) as f32
            } else {
                0.0
            }
        };
        Ok(CalibrationPress {
            camera: 0,
            image: geometry.average("bytes of a press image", press.rgb)?,
            background: background.clone(),
            indentation: (0..PIXELS).map(depth).collect(),
        })
    };
    presses.iter().map(label).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::IMAGE_SIZE as N;

    const GEOMETRY: ImageGeometry = ImageGeometry { columns: 96, rows: 64, pixel: 0.2e-3 };

    #[test]
    fn input_that_cannot_be_used_is_refused_with_numbers() {
        let model: PhotometricModel =
            serde_json::from_value(serde_json::json!({ "weights": vec![[[0.1, 0.1]; 6]; 19] })).expect("a model");
        let grey = vec![100; 3 * 96 * 64];
        let refusal = |found: Result<SingleSensor, TouchError>| found.expect_err("a refusal").to_string();
        let flat = ImageGeometry { rows: 0, ..GEOMETRY };
        assert!(refusal(SingleSensor::with_model(flat, &[], model.clone())).contains("96 x 0"));
        let short = refusal(SingleSensor::with_model(GEOMETRY, &grey[1..], model.clone()));
        assert!(short.contains("18431") && short.contains("18432"), "{short}");
        let ball = BallImage { rgb: &grey, center: [40.0, 30.0], radius: 25.0, diameter: 8e-3 };
        assert!(refusal(SingleSensor::calibrate(GEOMETRY, &grey, &[ball])).contains("0.008"));
        let small = BallImage { radius: 5.0, ..ball };
        assert!(refusal(SingleSensor::calibrate(GEOMETRY, &grey, &[small])).contains("press more often"));
        let sensor = SingleSensor::with_model(GEOMETRY, &grey, model).expect("a sensor");
        assert!(sensor.reconstruct(&grey).expect("a result").is_none());
        assert!(sensor.reconstruct(&grey[3..]).is_err());
        let depth = vec![f32::NAN; 96 * 64];
        let press = |depth| [DepthImage { rgb: &grey, depth }];
        let short = SingleSensor::calibrate_with_depths(GEOMETRY, &grey, &press(&depth[1..]));
        assert!(refusal(short).contains("6143"));
        assert!(refusal(SingleSensor::calibrate_with_depths(GEOMETRY, &grey, &press(&depth))).contains("not finite"));
    }

    #[test]
    fn a_position_lies_in_the_frame_of_the_contacts() {
        let (x, y) = PadCamera { name: String::new(), pad: 0, center_y: 0.0, h: 64.0 * 0.2e-3, w: 96.0 * 0.2e-3 }
            .pixel_center(17, 200);
        let (column, row) = GEOMETRY.grid().center(200 * N + 17);
        let [u, v] = GEOMETRY.position(column, row);
        assert!((x - u).abs() < 1e-12 && (y - v).abs() < 1e-12, "{x} {u} {y} {v}");
    }
}
