//! Training data of the network for photometric stereo: rendered presses of known shapes, or presses of a ball into a
//! real sensor, cut into squares.

use std::path::Path;

use anyhow::{Context, Result};
use bench::builtin::robot_calibration;
use hand_model::RobotModel;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use report::plot::Plot;
use sensor_calibration::pressed_shapes::{make_each, random_press, training_reliefs};
use sensor_calibration::real_presses::{CONFIGURATION, RealPresses, SimulatedSensor};
use sim::tactile::TactileBoard;
use tactile_perception::{CalibrationPress, PhotometricModel};

use super::network_training::{Training, TrainingSchedule};
use super::samples::{TrainingSquare, cut_squares};

/// First of the hand units used for training, and their number.
const TRAINING_UNITS: (u64, u64) = (100, 6);
/// White noise of the training images: 0.01 of full scale, grey levels.
const IMAGE_NOISE: f64 = 2.55;
/// Interval of held-out presses.
const HELD_OUT_INTERVAL: usize = 10;

/// Source of training images.
#[derive(Debug, Clone, Copy)]
pub enum TrainingSource<'a> {
    /// Renders of this number of presses into the hand's pads.
    Pads { robot: &'a RobotModel, presses: usize },
    /// Renders of this number of presses into the sensor of a calibration file.
    Sensor { file: &'a Path, presses: usize },
    /// Even-numbered presses of a ball into a real sensor; the ball's diameter and a pixel's size in m.
    RealPresses { folder: &'a Path, ball_diameter: f64, pixel: f64 },
}

/// Training squares with held-out ones.
pub struct TrainingSet {
    pub samples: Vec<TrainingSquare>,
    /// Squares of held-out presses.
    pub held_out: Vec<TrainingSquare>,
    /// Photometric model of a sensor other than the hand's pads.
    pub conditioning: Option<PhotometricModel>,
}

impl TrainingSet {
    /// Cuts `crops` squares from each press; `rendered` is called after each rendered press.
    pub fn make(
        source: TrainingSource<'_>,
        crops: usize,
        seed: u64,
        rendered: impl Fn() + Send + Sync,
    ) -> Result<Self> {
        match source {
            TrainingSource::RealPresses { folder, ball_diameter, pixel } => {
                let real = RealPresses::read(folder, ball_diameter, pixel)?;
                let size = real.pixel;
                let [even, _] = real.even_odd();
                Self::of_sensor(even, size, crops, seed)
            }
            TrainingSource::Sensor { file, presses } => {
                let reliefs = training_reliefs();
                let likeness = SimulatedSensor::read(file)?;
                let presses = make_each(presses, |n| {
                    rendered();
                    likeness.press(&reliefs, n, IMAGE_NOISE, seed)
                })?;
                Self::of_sensor(presses, likeness.pixel, crops, seed)
            }
            TrainingSource::Pads { robot, presses } => Self::of_pads(robot, presses, crops, seed, rendered),
        }
    }

    fn of_pads(
        robot: &RobotModel,
        presses: usize,
        crops: usize,
        seed: u64,
        rendered: impl Fn() + Send + Sync,
    ) -> Result<Self> {
        let reliefs = training_reliefs();
        let hand = &robot.hand;
        let calibration = robot_calibration(robot)?;
        let boards: Vec<TactileBoard> = (TRAINING_UNITS.0..TRAINING_UNITS.0 + TRAINING_UNITS.1)
            .map(|serial| TactileBoard::with_models(hand, serial, |_, model| model.noise = IMAGE_NOISE))
            .collect::<Result<_, _>>()?;
        let cuts = make_each(presses, |n| {
            let press = random_press(hand, &boards, &reliefs, n, seed)?;
            let camera = &hand.cameras[press.camera];
            let configuration = hand.pads[camera.pad].configuration;
            let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6375_7473 ^ (n as u64) << 32);
            rendered();
            let model = calibration.model(configuration)?;
            Ok(cut_squares(&press, (configuration, model), camera.pixel_size(), crops, &mut rng))
        })?;
        Ok(Self::split(cuts, None))
    }

    /// Makes the set for a separate sensor, whose photometric model is fitted to the same presses.
    fn of_sensor(presses: Vec<CalibrationPress>, pixel: (f64, f64), crops: usize, seed: u64) -> Result<Self> {
        let labelled: Vec<(&CalibrationPress, (f64, f64))> = presses.iter().map(|press| (press, pixel)).collect();
        let model = PhotometricModel::fit(CONFIGURATION, &labelled)?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6375_7473);
        let cuts =
            presses.iter().map(|press| cut_squares(press, (CONFIGURATION, &model), pixel, crops, &mut rng)).collect();
        Ok(Self::split(cuts, Some(model)))
    }

    fn split(cuts: Vec<Vec<TrainingSquare>>, conditioning: Option<PhotometricModel>) -> Self {
        let (mut samples, mut held_out) = (Vec::new(), Vec::new());
        for (n, cuts) in cuts.into_iter().enumerate() {
            if n % HELD_OUT_INTERVAL == HELD_OUT_INTERVAL - 1 { held_out.extend(cuts) } else { samples.extend(cuts) }
        }
        Self { samples, held_out, conditioning }
    }
}

/// Reads the state of a training to resume.
pub fn resume(state: &Path, schedule: &TrainingSchedule) -> Result<Training> {
    let text = std::fs::read(state).with_context(|| format!("--resume: {}", state.display()))?;
    let training: Training =
        serde_json::from_slice(&text).with_context(|| format!("--resume: {}: not a training", state.display()))?;
    training.check(schedule).with_context(|| format!("--resume: {}", state.display()))?;
    Ok(training)
}

/// Plots the loss against epochs, on the training squares and on the held-out ones.
pub fn loss_curves(training: &Training) -> Plot {
    let line = |k: usize| training.losses.iter().enumerate().map(|(n, loss)| [1.0 + n as f64, loss[k]]).collect();
    Plot {
        title: "photometric stereo network".into(),
        x: "epoch".into(),
        y: "mean error of the normal (1 = 57 deg)".into(),
        lines: vec![("learned from".into(), line(0)), ("held out".into(), line(1))],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tenth_press_is_held_out() {
        let robot = RobotModel::ftac_gen3();
        let presses = TrainingSource::Pads { robot: &robot, presses: 10 };
        let set = TrainingSet::make(presses, 2, 5, || ()).expect("squares");
        assert!(set.held_out.len() <= 2 && !set.samples.is_empty() && set.samples.len() <= 18);
        assert!(set.conditioning.is_none(), "the pads' photometric models are those that come with the program");
    }
}
