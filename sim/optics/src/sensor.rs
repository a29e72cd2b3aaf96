//! A camera unit that renders: caches of everything that does not depend on the contact, and the steps from an
//! indentation to an image.

pub mod curved;
pub mod reduced;

use std::sync::Arc;

use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use hand_model::robot::TactileImage;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::camera::ResponseTable;
use crate::elastomer::DeformedGel;
use crate::error::OpticsError;
#[cfg(feature = "gpu")]
use crate::indentation::Rectangle;
use crate::indentation::{IndentationMap, PIXEL_COUNT};
use crate::lamps::Lamp;
use crate::model::SensorModel;
use crate::noise::{ReadOutNoise, quantise, texture};
use crate::raster::Raster;
use crate::shading::{Shading, SurfaceRow};
use crate::shadows::{HeightField, Shadow};
use crate::wide::widest;

// Depth (m) and slope below which the gel counts as flat and the background is shown.
const FLAT_DEPTH: f32 = 1e-6;
const FLAT_SLOPE: f32 = 2e-3;
/// Limit of the rest surface's slope in the background: the clear body under the gel is moulded with softer edges.
const MAX_REST_SLOPE: f64 = 0.6;

/// One camera unit of a pad.
#[derive(Debug, Clone)]
pub struct Sensor {
    model: SensorModel,
    camera: PadCamera,
    shading: Shading,
    response: [ResponseTable; 3],
    noise: ReadOutNoise,
    background: Arc<TactileImage>,
    /// Grey levels of the background before quantisation, row-major RGB.
    background_grey: Vec<f32>,
    /// Radiance of the background minus that of the model's flat gel, row-major RGB: added to the model's where the gel
    /// is deformed.
    correction: Vec<f32>,
}

impl Sensor {
    /// Creates the design unit: no variation between units, no texture, but read-out noise.
    pub fn nominal(pad: &Pad, camera: &PadCamera) -> Self {
        Self::build(pad, camera, crate::pads::design(pad, camera).0, 0)
    }

    /// Creates one unit of a series; the seed is its serial number.
    pub fn unit(pad: &Pad, camera: &PadCamera, seed: u64) -> Self {
        Self::build(pad, camera, SensorModel::unit(pad, camera, seed), seed)
    }

    /// Creates a sensor with a calibrated model; `seed` determines its background's texture.
    pub fn with_model(pad: &Pad, camera: &PadCamera, model: SensorModel, seed: u64) -> Result<Self, OpticsError> {
        model.check()?;
        Ok(Self::build(pad, camera, model, seed))
    }

    fn build(pad: &Pad, camera: &PadCamera, model: SensorModel, seed: u64) -> Self {
        let shading = Shading::new(&model.lamps, &model.reflectance, model.gain, model.ambient);
        let response = model.response.each_ref().map(ResponseTable::new);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7465_7874_7572_6573);
        let texture = texture(model.texture[0], model.texture[1], &mut rng);
        let (background_grey, correction) = widest(
            #[inline(always)]
            || untouched_gel(pad, camera, &model, &shading, &response, texture),
        );
        let rgb = background_grey.iter().map(|&grey| quantise(grey)).collect();
        Self {
            noise: ReadOutNoise::new(model.noise, seed ^ 0x7265_6164_6f75_7400),
            background: Arc::new(TactileImage { rgb }),
            camera: camera.clone(),
            model,
            shading,
            response,
            background_grey,
            correction,
        }
    }

    /// Returns the image-formation model.
    pub fn model(&self) -> &SensorModel {
        &self.model
    }

    /// Returns the rectangle of the pad that the sensor sees.
    pub fn camera(&self) -> &PadCamera {
        &self.camera
    }

    /// Returns the image of the untouched gel without read-out noise; cheap to clone.
    pub fn background(&self) -> &Arc<TactileImage> {
        &self.background
    }

    /// Computes the rectangle in which an indentation changes the image by deformation or shadows; `None` for an
    /// untouched pad.
    #[cfg(feature = "gpu")]
    pub(crate) fn gel_rectangle(&self, indentation: &IndentationMap) -> Option<Rectangle> {
        let reach = self.shadow_reach(f64::from(indentation.max_depth()));
        self.model.elastomer.rectangle(&self.camera, indentation, reach)
    }

    /// Returns the power of each lamp in each channel.
    #[cfg(feature = "gpu")]
    pub(crate) fn lamp_powers(&self) -> impl Iterator<Item = [f32; 3]> {
        self.shading.powers()
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn responses(&self) -> &[ResponseTable; 3] {
        &self.response
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn noise_table(&self) -> &[f32] {
        self.noise.table()
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn background_grey(&self) -> &[f32] {
        &self.background_grey
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn correction(&self) -> &[f32] {
        &self.correction
    }

    /// Renders the tactile image of an indentation, with read-out noise from `rng`.
    pub fn render(&self, indentation: &IndentationMap, rng: &mut impl Rng) -> TactileImage {
        self.render_with_brightness(indentation, 1.0, rng)
    }

    /// Like [`Self::render`], with all grey levels except the noise scaled by `brightness`, because lamps and exposure
    /// drift.
    pub fn render_with_brightness(
        &self,
        indentation: &IndentationMap,
        brightness: f32,
        rng: &mut impl Rng,
    ) -> TactileImage {
        let reach = self.shadow_reach(f64::from(indentation.max_depth()));
        let gel = self.model.elastomer.deform_over(&self.camera, indentation, reach);
        let shadows = gel.as_ref().map_or_else(Vec::new, |gel| self.shadows(gel));
        self.expose(gel.as_ref(), &shadows, brightness, rng)
    }

    /// Computes the longest shadow (m) that a bump of this depth (m) can cast within the camera's rectangle.
    fn shadow_reach(&self, depth: f64) -> f64 {
        let longest = |lamp: &Lamp| {
            let (x, y) = (lamp.position.x, lamp.position.y - self.camera.center_y);
            let distance = (x.abs() + 0.5 * self.camera.w).hypot(y.abs() + 0.5 * self.camera.h);
            distance * depth / (-lamp.position.z - depth).max(depth)
        };
        self.model.lamps.iter().map(longest).fold(0.0, f64::max)
    }

    /// Renders the tactile image of a given gel. Where the gel is flat and lit, the pixel is the background's;
    /// elsewhere the radiance model(deformed) - model(flat) is added to it.
    pub fn render_gel(&self, gel: Option<&DeformedGel>, rng: &mut impl Rng) -> TactileImage {
        let shadows = gel.map_or_else(Vec::new, |gel| self.shadows(gel));
        self.expose(gel, &shadows, 1.0, rng)
    }

    /// Like [`Self::render_gel`], without cast shadows.
    pub fn render_unshadowed(&self, gel: Option<&DeformedGel>, rng: &mut impl Rng) -> TactileImage {
        self.expose(gel, &[], 1.0, rng)
    }

    /// Computes the shadow of each lamp over the gel's rectangle; `None` for a lamp that casts none.
    pub fn shadows(&self, gel: &DeformedGel) -> Vec<Option<Shadow>> {
        self.shadows_on(&Raster::full(&self.camera), gel)
    }

    fn shadows_on(&self, raster: &Raster, gel: &DeformedGel) -> Vec<Option<Shadow>> {
        let area = &gel.rectangle;
        let field = HeightField {
            width: area.width(),
            height: area.height(),
            first: raster.pixel_center(area.left, area.top),
            pixel: raster.pixel_size(),
            depth: &gel.depth,
        };
        field.shadows(&self.model.lamps)
    }

    fn expose(
        &self,
        gel: Option<&DeformedGel>,
        shadows: &[Option<Shadow>],
        brightness: f32,
        rng: &mut impl Rng,
    ) -> TactileImage {
        widest(
            #[inline(always)]
            || self.render_rows(gel, shadows, brightness, rng),
        )
    }

    #[inline(always)]
    fn render_rows(
        &self,
        gel: Option<&DeformedGel>,
        shadows: &[Option<Shadow>],
        brightness: f32,
        rng: &mut impl Rng,
    ) -> TactileImage {
        let (mut rgb, raster) = (vec![0; 3 * PIXEL_COUNT], Raster::full(&self.camera));
        let mut row = SurfaceRow::new();
        let mut grey = [0.0f32; 3 * IMAGE_SIZE];
        for (index, bytes) in rgb.chunks_exact_mut(3 * IMAGE_SIZE).enumerate() {
            let background = &self.background_grey[3 * IMAGE_SIZE * index..3 * IMAGE_SIZE * (index + 1)];
            let span = gel.and_then(|gel| self.shade_row(&raster, gel, shadows, index, &mut row));
            let Some((left, right)) = span else {
                self.noise.expose(background, brightness, bytes, rng);
                continue;
            };
            grey.copy_from_slice(background);
            let correction = &self.correction[3 * (IMAGE_SIZE * index + left)..];
            let [red, green, blue] = &row.radiance;
            for (i, (pixel, correction)) in
                grey[3 * left..3 * right].chunks_exact_mut(3).zip(correction.chunks_exact(3)).enumerate()
            {
                pixel[0] = self.response[0].grey(red[i] + correction[0]);
                pixel[1] = self.response[1].grey(green[i] + correction[1]);
                pixel[2] = self.response[2].grey(blue[i] + correction[2]);
            }
            self.noise.expose(&grey, brightness, bytes, rng);
        }
        TactileImage { rgb }
    }

    /// Shades the deformed or shadowed part of a row of a gel on these pixels; returns its half-open range of columns.
    #[inline(always)]
    fn shade_row(
        &self,
        raster: &Raster,
        gel: &DeformedGel,
        shadows: &[Option<Shadow>],
        index: usize,
        row: &mut SurfaceRow,
    ) -> Option<(usize, usize)> {
        let area = &gel.rectangle;
        if index < area.top || index >= area.bottom {
            return None;
        }
        let (width, (dx, dy)) = (area.width(), raster.pixel_size());
        let line = |row: usize| &gel.depth[(row - area.top) * width..(row - area.top + 1) * width];
        let (above, here, below) =
            (line(index.max(area.top + 1) - 1), line(index), line((index + 1).min(area.bottom - 1)));
        let rows = if index == area.top || index + 1 == area.bottom { 1.0 } else { 2.0 };
        let (per_x, per_y) = ((0.5 / dx) as f32, (1.0 / (rows * dy)) as f32);
        let mut z = [0.0f32; IMAGE_SIZE];
        let mut slopes = [[0.0f32; IMAGE_SIZE]; 2];
        for i in 0..width {
            z[i] = -here[i];
            // Rows run against y; z is minus the depth.
            slopes[1][i] = (below[i] - above[i]) * per_y;
        }
        for i in 1..width.max(1) - 1 {
            slopes[0][i] = (here[i - 1] - here[i + 1]) * per_x;
        }
        if width > 1 {
            slopes[0][0] = (here[0] - here[1]) * 2.0 * per_x;
            slopes[0][width - 1] = (here[width - 2] - here[width - 1]) * 2.0 * per_x;
        }
        let deformed =
            |i: &usize| z[*i] < -FLAT_DEPTH || slopes[0][*i].abs() > FLAT_SLOPE || slopes[1][*i].abs() > FLAT_SLOPE;
        let mut span = (0..width).find(deformed).zip((0..width).rfind(deformed));
        for shadow in shadows.iter().flatten() {
            span = match (span, shadow.extent(index - area.top)) {
                (Some((first, last)), Some((left, right))) => Some((first.min(left), last.max(right))),
                (span, extent) => span.or(extent),
            };
        }
        let (first, last) = span.map(|(first, last)| (first, last.min(width - 1) + 1))?;
        let start = raster.pixel_center(area.left + first, index);
        row.set(&self.model.camera, start, dx, &z[first..last], [&slopes[0][first..last], &slopes[1][first..last]]);
        self.shading.shade(row, shadows, (first, index - area.top));
        Some((area.left + first, area.left + last))
    }
}

/// Computes the background of a pad (grey levels before quantisation) from its texture, and the radiance of the
/// background minus that of the model's flat gel; both row-major RGB.
#[inline(always)]
fn untouched_gel(
    pad: &Pad,
    camera: &PadCamera,
    model: &SensorModel,
    shading: &Shading,
    response: &[ResponseTable; 3],
    texture: Vec<f32>,
) -> (Vec<f32>, Vec<f32>) {
    let (mut background_grey, mut correction) = (texture, vec![0.0; 3 * PIXEL_COUNT]);
    let [mut curved, mut flat] = [SurfaceRow::new(), SurfaceRow::new()];
    let ((x0, _), (dx, dy)) = (camera.pixel_center(0, 0), camera.pixel_size());
    let height = |x, y| pad.surface_height(x, y);
    let zeros = [0.0; IMAGE_SIZE];
    let rows = background_grey.chunks_exact_mut(3 * IMAGE_SIZE).zip(correction.chunks_exact_mut(3 * IMAGE_SIZE));
    for (index, (line, correction)) in rows.enumerate() {
        let y = camera.pixel_center(0, index).1;
        let [mut rest, mut rest_x, mut rest_y] = [[0.0f32; IMAGE_SIZE]; 3];
        for (column, rest) in rest.iter_mut().enumerate() {
            let x = camera.pixel_center(column, index).0;
            let zx = (height(x + 0.5 * dx, y) - height(x - 0.5 * dx, y)) / dx;
            let zy = (height(x, y + 0.5 * dy) - height(x, y - 0.5 * dy)) / dy;
            let softer = (MAX_REST_SLOPE / zx.hypot(zy).max(MAX_REST_SLOPE)) as f32;
            *rest = height(x, y) as f32 * softer;
            (rest_x[column], rest_y[column]) = (zx as f32 * softer, zy as f32 * softer);
        }
        curved.set(&model.camera, (x0, y), dx, &rest, [&rest_x, &rest_y]);
        shading.shade(&mut curved, &[], (0, 0));
        flat.set(&model.camera, (x0, y), dx, &zeros, [&zeros, &zeros]);
        shading.shade(&mut flat, &[], (0, 0));
        for (at, (background, correction)) in line.iter_mut().zip(correction).enumerate() {
            let (channel, column) = (at % 3, at / 3);
            let grey = response[channel].grey(curved.radiance[channel][column]);
            *background = (*background + grey).clamp(0.0, 255.0);
            let seen = model.response[channel].radiance(f64::from(*background) / 255.0);
            *correction = seen as f32 - flat.radiance[channel][column];
        }
    }
    (background_grey, correction)
}
