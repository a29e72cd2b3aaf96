//! Accuracy of normals and heights by look-up, by a perceptron and by the network, on shapes, pads and a real sensor
//! that are not in the training data.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result};
use hand_model::pads::IMAGE_SIZE as N;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use schemars::JsonSchema;
use sensor_calibration::pressed_shapes::{HELD_OUT_SHAPES, PressPlace, make_each, press_into, relief_by_name};
use sensor_calibration::real_presses::{CONFIGURATION, RealPresses};
use serde::Serialize;
use tactile_perception::calibration::{angle, contact_pixels};
use tactile_perception::photometric_stereo::gradients;
use tactile_perception::{
    AngularError, CalibrationPress, Gradients, Network, PhotometricModel, StereoOptions, TouchPipeline,
};

use super::images::CameraUnit;
use crate::touch::networks::{Networks, NormalMethod};

/// Number of presses of each held-out shape, and of samples drawn from each press: 4 x 36 x 324 = 46,656.
const PRESSES_PER_SHAPE: usize = 36;
const SAMPLES_PER_PRESS: usize = 324;

/// A press of a held-out shape into a pad of a hand unit, with the evaluated pixels.
pub struct SampledPress {
    press: CalibrationPress,
    unit: usize,
    pixels: Vec<usize>,
}

/// Presses the unseen shapes into all cameras of the hand units `detector`.
pub fn press_unseen_shapes(detector: &[CameraUnit], seed: u64) -> Result<Vec<SampledPress>> {
    let drawn = make_each(HELD_OUT_SHAPES.len() * PRESSES_PER_SHAPE, |n| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x756e_7365_656e);
        rng.set_stream(n as u64);
        let relief = relief_by_name(HELD_OUT_SHAPES[n / PRESSES_PER_SHAPE]).context("an unseen shape has no relief")?;
        let hand = detector[0].hand();
        let (index, unit) = (n % hand.cameras.len(), n % PRESSES_PER_SHAPE / hand.cameras.len() % detector.len());
        let camera = &hand.cameras[index];
        let sensor = &detector[unit].board().sensors()[index];
        let place = PressPlace::draw([camera.w, camera.h], [0.0, camera.center_y], &mut rng);
        let force = rng.random_range(0.4..5.0);
        let press = press_into(detector[unit].hand(), (index, sensor), (&relief, &place), force, &mut rng)?;
        let touched: Vec<usize> = contact_pixels(&press).collect();
        if touched.is_empty() {
            return Ok(None);
        }
        let pixels = (0..SAMPLES_PER_PRESS).map(|_| touched[rng.random_range(0..touched.len())]).collect();
        Ok(Some(SampledPress { press, unit, pixels }))
    })?;
    Ok(drawn.into_iter().flatten().collect())
}

/// Errors of normals and heights.
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
pub struct NormalErrors {
    /// Mean angular error, degrees.
    pub mean_deg: f64,
    /// Median angular error, degrees.
    pub median_deg: f64,
    /// 95th percentile of the angular error, degrees.
    pub p95_deg: f64,
    pub samples: usize,
    /// Root-mean-square error of the height in contact, micrometres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_rms_um: Option<f64>,
}

impl NormalErrors {
    fn of(errors: Vec<f64>, height_rms_um: Option<f64>) -> Self {
        let AngularError { mean, median, p95, pixels } = AngularError::from_angles(errors);
        Self { mean_deg: mean, median_deg: median, p95_deg: p95, samples: pixels, height_rms_um }
    }
}

/// Evaluates `pipeline` on presses into the hand units `detector`.
pub fn evaluate_normals(
    sampled: &[SampledPress],
    detector: &[CameraUnit],
    pipeline: &TouchPipeline,
) -> Result<NormalErrors> {
    let pipelines: Vec<TouchPipeline> = detector
        .iter()
        .map(|detector| Ok(pipeline.with_backgrounds(detector.backgrounds())?))
        .collect::<Result<_>>()?;
    let parts: Vec<(Vec<f64>, f64, usize)> = sampled
        .par_iter()
        .map(|SampledPress { press, unit, pixels }| {
            let found = pipelines[*unit].height_map(press.camera, &press.image)?;
            let pixel = pipelines[*unit].hand().cameras[press.camera].pixel_size();
            let slopes = found.as_ref().map(|map| &map.gradients);
            let errors = pixels.iter().map(|&i| angle(press, i, pixel, slopes_at(slopes, i))).collect();
            let off = |i: usize| found.as_ref().map_or(0.0, |map| map.height[i]) - press.indentation[i];
            let (sum, count) =
                contact_pixels(press).fold((0.0, 0), |(sum, count), i| (sum + f64::from(off(i)).powi(2), count + 1));
            Ok((errors, sum, count))
        })
        .collect::<Result<_>>()?;
    let (sum, count) = parts.iter().fold((0.0, 0), |(sum, count), part| (sum + part.1, count + part.2));
    let errors = parts.into_iter().flat_map(|part| part.0).collect();
    Ok(NormalErrors::of(errors, (count > 0).then(|| 1e6 * (sum / count as f64).sqrt())))
}

/// Returns the slopes at a pixel; level if nothing was perceived.
fn slopes_at(slopes: Option<&Gradients>, i: usize) -> [f64; 2] {
    slopes.map_or([0.0; 2], |slopes| [f64::from(slopes.gx[i]), f64::from(slopes.gy[i])])
}

/// A row of the table of the real sensor.
#[derive(Serialize, JsonSchema)]
pub struct RealRow {
    /// Method for the normals.
    pub method: NormalMethod,
    /// True if trained on renders of the sensor, not on its even-numbered presses.
    pub simulated: bool,
    /// Error on the odd-numbered presses.
    #[serde(flatten)]
    pub error: NormalErrors,
}

/// Source of real presses: a ball pressed into a real sensor.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct RealSource {
    pub folder: PathBuf,
    /// Diameter of the ball, mm.
    pub ball_diameter_mm: f64,
    /// Size of a pixel on the gel, mm.
    pub pixel_mm: f64,
}

/// Evaluates every method on the real sensor's odd-numbered presses, at all pixels inside the ball's circle. The
/// look-up table is fitted to the even-numbered ones; the networks are those given, whatever their training sensor.
pub fn evaluate_real_presses(source: &RealSource, networks: &Networks) -> Result<Vec<RealRow>> {
    let presses = RealPresses::read(&source.folder, 1e-3 * source.ball_diameter_mm, 1e-3 * source.pixel_mm)?;
    let pixel = presses.pixel;
    let [even, odd] = presses.even_odd();
    let even: Vec<(&CalibrationPress, (f64, f64))> = even.iter().map(|press| (press, pixel)).collect();
    let fitted = PhotometricModel::fit(CONFIGURATION, &even)?;
    let options = StereoOptions::default();
    let by_model = |model: &PhotometricModel| {
        let model = model.clone();
        Box::new(move |press: &CalibrationPress| gradients(&press.image, &press.background, &model, &options))
            as SlopeReader
    };
    let by_network = |network: &Network| {
        let (prepared, model) = (network.prepare(), network.conditioning.clone().unwrap_or_else(|| fitted.clone()));
        Box::new(move |press: &CalibrationPress| {
            prepared.gradients(&press.image, &press.background, (CONFIGURATION, &model), &options)
        }) as SlopeReader
    };
    let rendered = networks.gelsight_simulated.conditioning.as_ref();
    let rendered = rendered.context("gelsight_simulated.json: found no photometric model, expected one")?;
    let rows = [
        (NormalMethod::LookUp, false, by_model(&fitted)),
        (NormalMethod::PerPixel, false, by_network(&networks.gelsight_per_pixel)),
        (NormalMethod::Network, false, by_network(&networks.gelsight_fitted)),
        (NormalMethod::LookUp, true, by_model(rendered)),
        (NormalMethod::Network, true, by_network(&networks.gelsight_simulated)),
    ];
    Ok(rows
        .into_iter()
        .map(|(method, simulated, read)| {
            let errors = odd.iter().flat_map(|press| {
                let slopes = read(press);
                contact_pixels(press)
                    .map(move |i| angle(press, i, pixel, slopes_at(slopes.as_ref(), i)))
                    .collect::<Vec<_>>()
            });
            RealRow { method, simulated, error: NormalErrors::of(errors.collect(), None) }
        })
        .collect())
}

type SlopeReader = Box<dyn Fn(&CalibrationPress) -> Option<Gradients>>;

/// Renders normals as colours: x and y as red and green, the component out of the pad as blue.
pub fn normal_picture(slopes: &Gradients) -> Arc<[u8]> {
    let colour = |i: usize| {
        let (gx, gy) = (slopes.gx[i], slopes.gy[i]);
        let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
        [gx * nz, gy * nz, nz].map(|part| (127.5 * (1.0 + part)).round() as u8)
    };
    (0..N * N).flat_map(colour).collect()
}
