//! The fit of a sensor's model to presses of a ball.
//!
//! The search goes from simple to detailed. It starts with three lamps on a ring and fits their colours, then all
//! parameters. The best of several such starts continues: its lamps are split in two and all parameters are fitted again.
//! With images of single lamps the search starts with that many lamps in the directions that these images show, and fits
//! those images as well: because light adds up, they separate the response from the lamps.

use crate::calibration::assumptions::Assumptions;
use crate::calibration::background::estimate_background;
use crate::calibration::folder::PressFolder;
use crate::calibration::lens::Lens;
use crate::calibration::parameters::{self as at, PARAMETERS_PER_LAMP};
use crate::calibration::samples::{FitSamples, estimate_noise};
use crate::calibration::scene::CalibrationScene;
use crate::error::{OpticsError, check_positive};
use crate::model::SensorModel;
use ftac_least_squares::{FitProblem, FitResult, FittedParameter, SolverOptions};

/// Computational effort of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitEffort {
    /// Number of pixels sampled from each press.
    pub per_press: usize,
    /// Number of rotations of the ring of lamps to start from.
    pub starts: usize,
    /// Largest number of steps of each start, and of the final search.
    pub steps: [usize; 2],
    /// True if the three lamps are split into six.
    pub split: bool,
}

impl Default for FitEffort {
    fn default() -> Self {
        Self { per_press: 350, starts: 2, steps: [10, 20], split: true }
    }
}

/// Scale of the robust loss, grey levels: larger residuals count as outliers (dirt, a mark on the gel).
const LOSS_SCALE: f64 = 8.0;
/// Number of background pixels in a fit.
const BACKGROUND_SAMPLES: usize = 400;
/// Distance from a press within which samples lie, visible radii.
const SAMPLE_REACH: f64 = 2.5;
/// Lamps of the first searches: one per side of a sensor lit in red, green and blue.
const INITIAL_LAMP_COUNT: usize = 3;
/// Initial ratio of the visible circle's radius to the ball's, used if the pixel size is not given.
const INITIAL_VISIBLE_RATIO: f64 = 0.7;

/// A fitted sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct BallFit {
    /// The model; its frame's origin is the image's middle.
    pub model: SensorModel,
    /// Size of a pixel, m.
    pub pixel: f64,
    /// 95 % interval of the size of a pixel, m; none if it was not measured.
    pub pixel_interval: Option<[f64; 2]>,
    /// Ratio of a press's contact radius to its visible radius.
    pub contact: f64,
    /// The untouched gel, row-major RGB, grey levels.
    pub background: Vec<f32>,
    /// Columns and rows of an image.
    pub size: [usize; 2],
    /// The lens by which the presses were rectified, if any.
    pub lens: Option<Lens>,
    /// All fitted parameters.
    pub parameters: Vec<FittedParameter>,
    /// Assumptions under which the parameters were fitted.
    pub assumptions: Assumptions,
    /// Root mean square residual over the samples, grey levels.
    pub residual: f64,
    vector: Vec<f64>,
}

impl BallFit {
    /// Fits all presses of a folder. `seed` determines the sampled pixels.
    pub fn new(
        folder: &PressFolder,
        assumptions: Assumptions,
        effort: &FitEffort,
        seed: u64,
    ) -> Result<Self, OpticsError> {
        let background = estimate_background(folder);
        let samples = FitSamples::draw(folder, &background, effort.per_press, BACKGROUND_SAMPLES, SAMPLE_REACH, seed);
        let pixel = starting_pixel(folder, &assumptions)?;
        let found = solve(&samples, &assumptions, pixel, effort);
        let scene = CalibrationScene { samples: &samples, assumptions: &assumptions };
        Ok(Self::from_solution(folder, background, &scene, found))
    }

    /// Fits again under other assumptions, starting from this fit.
    pub fn refit(&self, folder: &PressFolder, assumptions: Assumptions, effort: &FitEffort, seed: u64) -> Self {
        let samples =
            FitSamples::draw(folder, &self.background, effort.per_press, BACKGROUND_SAMPLES, SAMPLE_REACH, seed);
        let scene = CalibrationScene { samples: &samples, assumptions: &assumptions };
        let mut start = self.vector.clone();
        if !assumptions.near_field && self.assumptions.near_field {
            at::move_far(&mut start);
        }
        let lit = search(&scene, &start, true, 6);
        let found = search(&scene, &lit.parameters, false, effort.steps[1]);
        Self::from_solution(folder, self.background.clone(), &scene, found)
    }

    fn from_solution(
        folder: &PressFolder,
        background: Vec<f32>,
        scene: &CalibrationScene<'_>,
        found: FitResult,
    ) -> Self {
        let lamps = (found.parameters.len() - at::FIRST_LAMP) / PARAMETERS_PER_LAMP;
        let parameters = found.describe_parameters(at::names(lamps), &at::bounds(scene.assumptions, lamps));
        let p = found.parameters;
        let residuals = scene.residuals(&p);
        let touched = &residuals[..3 * scene.samples.touched.len()];
        let residual = (touched.iter().map(|r| r * r).sum::<f64>() / touched.len().max(1) as f64).sqrt();
        Self {
            model: at::model(&p, scene.assumptions.near_field, estimate_noise(folder).unwrap_or(0.0)),
            pixel: p[at::PIXEL],
            pixel_interval: None,
            contact: p[at::CONTACT],
            background,
            size: scene.samples.size,
            lens: None,
            parameters,
            assumptions: *scene.assumptions,
            residual,
            vector: p,
        }
    }

    /// Returns the same fit with another image of the untouched gel (row-major RGB, grey levels).
    pub fn with_background(&self, background: Vec<f32>) -> Self {
        Self { background, ..self.clone() }
    }

    pub(crate) fn vector(&self) -> &[f64] {
        &self.vector
    }
}

/// Runs the whole search.
pub(crate) fn solve(samples: &FitSamples, assumptions: &Assumptions, pixel: f64, effort: &FitEffort) -> FitResult {
    let scene = CalibrationScene { samples, assumptions };
    let from = |turn: f64| {
        let mut start = match lamp_directions(samples) {
            directions if directions.is_empty() => at::start(pixel, INITIAL_LAMP_COUNT, turn),
            directions => at::start_towards(pixel, &directions),
        };
        if !assumptions.near_field {
            at::move_far(&mut start);
        }
        let lit = search(&scene, &start, true, 6);
        search(&scene, &lit.parameters, false, effort.steps[0])
    };
    let mut best = from(0.0);
    // Images of single lamps give the directions: one start suffices.
    let starts = if samples.single_lamp_values.is_empty() { effort.starts } else { 1 };
    for turn in 1..starts {
        let found = from(turn as f64 / starts as f64);
        if found.cost < best.cost {
            best = found;
        }
    }
    let start = if effort.split { at::split_lamps(&best.parameters) } else { best.parameters };
    search(&scene, &start, false, effort.steps[1])
}

/// Estimates the direction of each lamp that has an image of its own (rad): the gel is brighter towards it.
fn lamp_directions(samples: &FitSamples) -> Vec<f64> {
    let middle = samples.size.map(|size| 0.5 * (size as f64 - 1.0));
    let towards = |seen: &Vec<[f64; 3]>| {
        let mean = seen.iter().flatten().sum::<f64>() / (3 * seen.len()).max(1) as f64;
        let pull = samples.flat.iter().zip(seen).fold([0.0; 2], |[x, y], (sample, seen)| {
            let brighter = seen.iter().sum::<f64>() / 3.0 - mean;
            [x + brighter * (sample.place[0] - middle[0]), y + brighter * (middle[1] - sample.place[1])]
        });
        pull[1].atan2(pull[0])
    };
    samples.single_lamp_values.iter().map(towards).collect()
}

/// Computes the initial pixel size, m. Returns an error for a folder without presses.
fn starting_pixel(folder: &PressFolder, assumptions: &Assumptions) -> Result<f64, OpticsError> {
    let mut ratios: Vec<f64> = folder.presses.iter().map(|press| 0.5 * press.diameter / press.radius).collect();
    ratios.sort_by(f64::total_cmp);
    let Some(middle) = ratios.get(ratios.len() / 2) else {
        return Err(OpticsError::NotPositive { what: "number of presses", value: 0.0 });
    };
    if let Some(pixel) = assumptions.pixel {
        return check_positive("pixel size", pixel).map(|()| pixel);
    }
    Ok((INITIAL_VISIBLE_RATIO * middle).clamp(10e-6, 200e-6))
}

/// Minimises over all parameters, or over the colours and the diffuse light only.
fn search(scene: &CalibrationScene<'_>, start: &[f64], colors_only: bool, steps: usize) -> FitResult {
    let lamps = (start.len() - at::FIRST_LAMP) / PARAMETERS_PER_LAMP;
    let mut bounds = at::bounds(scene.assumptions, lamps);
    if colors_only {
        for (i, bound) in bounds.iter_mut().enumerate() {
            let color = i >= at::FIRST_LAMP && (i - at::FIRST_LAMP) % PARAMETERS_PER_LAMP >= at::COLOR_OFFSET;
            if !color && !(at::AMBIENT..at::FIRST_LAMP).contains(&i) {
                let value = start[i].clamp(bound.0, bound.1);
                *bound = (value, value);
            }
        }
    }
    let limits = bounds.clone();
    let problem = FitProblem {
        residuals: |p: &[f64]| scene.residuals(p),
        jacobian: |p: &[f64], r: &[f64]| scene.jacobian(p, r, &limits),
        bounds,
        groups: scene.groups(),
    };
    problem.minimise(
        start,
        &SolverOptions { max_steps: steps, scale: LOSS_SCALE, tolerance: if colors_only { 1e-3 } else { 2e-4 } },
    )
}
