//! Recovery test of the fit: presses are generated from a known model, with noise, and fitted like real ones.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use serde::Serialize;

use crate::calibration::assumptions::Assumptions;
use crate::calibration::fit::{FitEffort, solve};
use crate::calibration::parameters::{self as at};
use crate::calibration::samples::{FitSamples, PixelSample, PressCircle};
use crate::calibration::scene::CalibrationScene;

/// Errors of a fit to `presses` presses.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct RecoveryErrors {
    /// Number of presses that were fitted.
    pub presses: usize,
    /// True if an image of each lamp alone was fitted too.
    pub single_lamps: bool,
    /// Root mean square error on held-out presses against their noiseless images, grey levels.
    pub held_out_grey: f64,
    /// Mean angle between true and fitted directions from the middle of the gel to the lamps, degrees.
    pub lamp_degrees: f64,
    /// Mean distance between true and fitted lamps, mm.
    pub lamp_mm: f64,
    /// Error of the roughness, rad.
    pub roughness: f64,
    /// Root mean square error of the responses G over grey levels 40 to 220, fraction of full scale.
    pub response: f64,
    /// Relative error of the widest kernel.
    pub kernel: f64,
}

// The known sensor: 320 x 240 pixels of 0.06 mm, a ball of 6 mm diameter.
const TEST_IMAGE_SIZE: [usize; 2] = [320, 240];
const PIXEL_SIZE: f64 = 0.06e-3;
const BALL_RADIUS: f64 = 3e-3;
const VISIBLE_RADIUS: f64 = 28.0;
const HELD_OUT_PRESSES: usize = 6;

fn true_parameters() -> Vec<f64> {
    let mut p = at::start(PIXEL_SIZE, 3, 0.1);
    p[at::CONTACT] = 1.1;
    p[at::KERNEL] = 1.0e-3;
    p[at::KERNEL_RATIO] = 0.45;
    p[at::COATING] = 0.2e-3;
    (p[at::CAMERA_X], p[at::CAMERA_Y], p[at::CAMERA_Z]) = (0.5e-3, -0.4e-3, 22e-3);
    p[at::ROUGHNESS] = 0.4;
    for (k, (mu, color)) in
        [(2.0, [1.3, 0.1, 0.05]), (1.5, [0.1, 1.2, 0.1]), (2.5, [0.05, 0.15, 1.5])].iter().enumerate()
    {
        let lamp =
            &mut p[at::FIRST_LAMP + at::PARAMETERS_PER_LAMP * k..at::FIRST_LAMP + at::PARAMETERS_PER_LAMP * (k + 1)];
        lamp[0] *= 0.85 + 0.1 * k as f64;
        lamp[2] = (5.0 + k as f64) * 1e-3;
        lamp[5] = *mu;
        lamp[at::COLOR_OFFSET..].copy_from_slice(color);
    }
    p
}

/// Number and kind of the generated presses.
struct PressOptions<'a> {
    assumptions: &'a Assumptions,
    count: usize,
    per_press: usize,
    noise: f64,
    single_lamps: bool,
    seed: u64,
}

/// Generates presses at random positions, rendered by the model of `p` with noise, and optionally an image of each lamp
/// alone.
fn presses(p: &[f64], options: &PressOptions) -> FitSamples {
    let PressOptions { assumptions, count, per_press, noise, single_lamps, seed } = *options;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |low: f64, high: f64| low + (high - low) * (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    let [w, h] = TEST_IMAGE_SIZE.map(|size| size as f64);
    let (mut marks, mut touched) = (Vec::new(), Vec::new());
    for press in 0..count {
        let radius = uniform(0.85, 1.1) * VISIBLE_RADIUS;
        let center = [uniform(radius, w - radius), uniform(radius, h - radius)];
        marks.push(PressCircle { center, radius, ball: BALL_RADIUS });
        for _ in 0..per_press {
            let place = center.map(|middle| (middle + uniform(-2.5, 2.5) * radius).round());
            if (0.0..w).contains(&place[0]) && (0.0..h).contains(&place[1]) {
                touched.push(PixelSample { press, place, value: [0.0; 3], background: [0.0; 3] });
            }
        }
    }
    let more = (0..300).map(|_| PixelSample {
        press: 0,
        place: [uniform(0.0, w - 1.0).round(), uniform(0.0, h - 1.0).round()],
        value: [0.0; 3],
        background: [0.0; 3],
    });
    let flat: Vec<PixelSample> = touched.iter().copied().chain(more).collect();
    let mut samples = FitSamples { size: TEST_IMAGE_SIZE, marks, touched, flat, single_lamp_values: Vec::new() };
    let flat = CalibrationScene { samples: &samples, assumptions }.predict_flat(p);
    let known = samples.touched.len();
    samples.touched.iter_mut().zip(&flat).for_each(|(sample, grey)| sample.background = *grey);
    samples.flat.iter_mut().zip(&flat).for_each(|(sample, grey)| sample.background = *grey);
    samples.flat.drain(..known);
    let seen = CalibrationScene { samples: &samples, assumptions }.predict(p);
    for (sample, grey) in samples.touched.iter_mut().zip(seen) {
        sample.value = grey.map(|grey| grey + noise / 255.0 * rng.sample::<f64, _>(StandardNormal));
    }
    if single_lamps {
        let mut alone = CalibrationScene { samples: &samples, assumptions }.predict_alone(p, 3);
        alone
            .iter_mut()
            .flatten()
            .flatten()
            .for_each(|grey| *grey += noise / 255.0 * rng.sample::<f64, _>(StandardNormal));
        samples.single_lamp_values = alone;
    }
    samples
}

/// Fits `count` generated presses (and images of single lamps) with `noise` grey levels of noise; returns the errors of
/// the result.
pub fn recover(count: usize, single_lamps: bool, noise: f64, effort: &FitEffort, seed: u64) -> RecoveryErrors {
    let assumptions = Assumptions::full(Some(PIXEL_SIZE));
    let known = true_parameters();
    let options =
        PressOptions { assumptions: &assumptions, count, per_press: effort.per_press, noise, single_lamps, seed };
    let samples = presses(&known, &options);
    let found = solve(&samples, &assumptions, PIXEL_SIZE, &FitEffort { split: false, ..*effort }).parameters;
    let seed = seed ^ 0x6865_6c64;
    let unseen =
        presses(&known, &PressOptions { count: HELD_OUT_PRESSES, noise: 0.0, single_lamps: false, seed, ..options });
    let residuals = CalibrationScene { samples: &unseen, assumptions: &assumptions }.residuals(&found);
    let touched = &residuals[..3 * unseen.touched.len()];
    let root = |sum: f64, count: usize| (sum / count.max(1) as f64).sqrt();
    // The order of the lamps is arbitrary: each true lamp is compared with the fitted one nearest in direction.
    let lamps = |p: &[f64]| [0, 1, 2].map(|k| at::lamp(p, k, true).position.coords);
    let (true_lamps, fitted) = (lamps(&known), lamps(&found));
    let nearest = true_lamps.map(|a| {
        let angle = |b: &nalgebra::Vector3<f64>| a.angle(b).to_degrees();
        let best = fitted.iter().min_by(|b, c| angle(b).total_cmp(&angle(c))).unwrap_or(&a);
        (angle(best), 1e3 * (a - best).norm())
    });
    let greys = 40..=220;
    let response: f64 = (0..3)
        .flat_map(|c| greys.clone().map(move |grey| (c, f64::from(grey) / 255.0)))
        .map(|(c, m)| (at::response(&known, c).radiance(m) - at::response(&found, c).radiance(m)).powi(2))
        .sum();
    RecoveryErrors {
        presses: count,
        single_lamps,
        held_out_grey: root(touched.iter().map(|r| r * r).sum(), touched.len()),
        lamp_degrees: nearest.iter().map(|(angle, _)| angle).sum::<f64>() / 3.0,
        lamp_mm: nearest.iter().map(|(_, distance)| distance).sum::<f64>() / 3.0,
        roughness: (known[at::ROUGHNESS] - found[at::ROUGHNESS]).abs(),
        response: root(response, 3 * 181),
        kernel: (found[at::KERNEL] / known[at::KERNEL] - 1.0).abs(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recovery_errors(
        assumptions: &Assumptions,
        count: usize,
        per_press: usize,
        single_lamps: bool,
        seed: u64,
    ) -> PressOptions<'_> {
        PressOptions { assumptions, count, per_press, noise: 0.0, single_lamps, seed }
    }

    #[test]
    fn images_of_single_lamps_make_up_for_presses() {
        let effort = FitEffort { per_press: 220, starts: 1, steps: [30, 20], split: false };
        let [without, with] = [false, true].map(|single_lamps| recover(1, single_lamps, 1.0, &effort, 5));
        println!("{without:?}\n{with:?}");
        assert!(with.response < 0.5 * without.response && with.response < 0.02, "{with:?} {without:?}");
        assert!(with.lamp_degrees < 2.0 && with.lamp_mm < without.lamp_mm, "{with:?} {without:?}");
        assert!(with.held_out_grey < without.held_out_grey, "{with:?} {without:?}");
    }

    #[test]
    fn four_presses_determine_the_sensor() {
        let effort = FitEffort { per_press: 220, starts: 1, steps: [30, 20], split: false };
        let found = recover(4, false, 1.0, &effort, 3);
        println!("{found:?}");
        assert!(found.held_out_grey < 0.8, "{found:?}");
        assert!(found.lamp_degrees < 6.0 && found.lamp_mm < 4.0, "{found:?}");
        assert!(found.response < 0.05, "{found:?}");
    }

    #[test]
    fn the_start_is_not_the_answer() {
        let assumptions = Assumptions::full(Some(PIXEL_SIZE));
        let unseen = presses(&true_parameters(), &recovery_errors(&assumptions, 2, 200, false, 1));
        let scene = CalibrationScene { samples: &unseen, assumptions: &assumptions };
        let residuals = scene.residuals(&at::start(PIXEL_SIZE, 3, 0.0));
        let rms = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
        assert!(rms > 4.0, "{rms}");
        assert!(scene.residuals(&true_parameters())[..3 * unseen.touched.len()].iter().all(|r| r.abs() < 1e-9));
    }

    #[test]
    fn the_jacobian_shares_lamps_but_is_that_of_the_residuals() {
        let assumptions = Assumptions::full(Some(PIXEL_SIZE));
        let samples = presses(&true_parameters(), &recovery_errors(&assumptions, 1, 60, true, 2));
        let scene = CalibrationScene { samples: &samples, assumptions: &assumptions };
        let p = true_parameters();
        let bounds = at::bounds(&assumptions, 3);
        let r = scene.residuals(&p);
        let fast = scene.jacobian(&p, &r, &bounds);
        let slow = ftac_least_squares::forward_differences(&p, &r, &bounds, 1e-6, |q, _| scene.residuals(q));
        assert!((fast - slow).abs().max() < 1e-9);
    }
}
