//! The way from a real sensor's colours to slopes, learned from presses of a ball: the file beside a calibration.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use hand_model::file::write_whole;
use hand_model::robot::TactileImage;
use optics::calibration::{CalibratedSensor, Photo, PressFolder};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use touch::network::Kind;
use touch::network::samples::{Sample, cut};
use touch::network::train::{Schedule, Training};
use touch::{AngularError, CalibrationPress, Network, PhotometricModel};

use super::accuracy::{Accuracy, contact_share, measure};
use super::known_ball::KnownPresses;
use super::surface::Reconstructor;
use crate::optics::grid::Grid;

/// Stands for "the only sensor there is" where a pad's configuration is asked for.
pub const CONFIGURATION: char = 'a';
const VERSION: u32 = 1;
// Squares cut from each press, passes over them, squares a step, and the learning rate at the start.
const CROPS: usize = 40;
const EPOCHS: usize = 20;
const BATCH: usize = 32;
const RATE: f64 = 0.01;

/// How slopes are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Regression from the colour change at a place to the slope.
    LookUp,
    /// A perceptron of the same inputs.
    Network,
}

impl Method {
    pub const ALL: [Self; 2] = [Self::LookUp, Self::Network];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::LookUp => "look-up",
            Self::Network => "network",
        }
    }
}

/// What was learned, and how good it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photometry {
    version: u32,
    /// Image size and pixel size of the calibration that it belongs to.
    columns: usize,
    rows: usize,
    pixel_mm: f64,
    pub(super) look_up: PhotometricModel,
    pub(super) network: Network,
    /// Share of the largest indentation above which the gel lies on what presses.
    pub(super) contact_share: f32,
    /// Factors on heights, by look-up and by the network, that make the mean depth of the presses learned from right: a
    /// regression on noisy colours finds slopes too small.
    gains: [f32; 2],
    look_up_accuracy: Accuracy,
    network_accuracy: Accuracy,
    /// Whether the accuracies are of presses that what is in this file learned from nothing of; otherwise they are of what the
    /// even-numbered presses alone teach, on the odd-numbered ones.
    pub held_out: bool,
}

impl Photometry {
    /// The file beside a calibration.
    pub fn path(calibration: &Path) -> PathBuf {
        calibration.with_extension("normals.json")
    }

    pub fn accuracy(&self, method: Method) -> &Accuracy {
        match method {
            Method::LookUp => &self.look_up_accuracy,
            Method::Network => &self.network_accuracy,
        }
    }

    pub(super) fn gain(&self, method: Method) -> f32 {
        match method {
            Method::LookUp => self.gains[0],
            Method::Network => self.gains[1],
        }
    }

    /// The method with the smaller mean error of normals.
    pub fn better(&self) -> Method {
        let error = |method| self.accuracy(method).normals_deg.mean;
        if error(Method::Network) < error(Method::LookUp) { Method::Network } else { Method::LookUp }
    }

    /// Learns from the presses of `fitted` and measures on those of `held_out`, or, where there are none, learns from half of
    /// `fitted` first to measure on the other half. `step` is called at each of [`Self::STEPS`] steps of a training.
    pub fn learn(
        fitted: &PressFolder,
        held_out: &PressFolder,
        sensor: &CalibratedSensor,
        seed: u64,
        step: impl Fn(),
    ) -> Result<Self> {
        if held_out.presses.is_empty() {
            let (even, odd) = fitted.even_odd();
            if odd.presses.is_empty() {
                bail!("found a single press; expected at least two, to learn from one and measure on another");
            }
            let part = Self::learn_from(&even, Some(&odd), sensor, seed, &step)?;
            let whole = Self::learn_from(fitted, None, sensor, seed, &step)?;
            return Ok(Self {
                look_up_accuracy: part.look_up_accuracy,
                network_accuracy: part.network_accuracy,
                held_out: false,
                ..whole
            });
        }
        Self::learn_from(fitted, Some(held_out), sensor, seed, &step)
    }

    /// Passes over the presses that a training of [`Self::learn`] takes.
    pub const STEPS: u64 = EPOCHS as u64;

    fn learn_from(
        fitted: &PressFolder,
        unseen: Option<&PressFolder>,
        sensor: &CalibratedSensor,
        seed: u64,
        step: &dyn Fn(),
    ) -> Result<Self> {
        let (width, height) = sensor.size();
        let grid = Grid { width, height };
        let photo_pixel = 1e-3 * sensor.calibration().pixel_mm;
        let pixel = grid.pixel(photo_pixel);
        let background: Arc<TactileImage> = grid.image(&fitted.background.rgb);
        let known = KnownPresses::new(fitted, sensor, &background);
        let labelled: Vec<(&CalibrationPress, (f64, f64))> = known.presses.iter().map(|press| (press, pixel)).collect();
        let look_up = PhotometricModel::fit(CONFIGURATION, &labelled)?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6375_7473);
        let samples: Vec<Sample> = known
            .presses
            .iter()
            .flat_map(|press| cut(press, (CONFIGURATION, &look_up), pixel, CROPS, &mut rng))
            .collect();
        let schedule = Schedule { kind: Kind::PerPixel, epochs: EPOCHS, batch: BATCH, rate: RATE, halving: 5, seed };
        let mut training = Training::new(schedule);
        while !training.done() {
            training.epoch(&samples, &samples[..samples.len().min(BATCH)], || {})?;
            step();
        }
        let recipe = format!("ftac optics calibrate, {} presses, --seed {seed}", fitted.presses.len());
        let nothing = Accuracy {
            presses: 0,
            normals_deg: AngularError { mean: 0.0, median: 0.0, p95: 0.0, pixels: 0 },
            depth_ratio: 0.0,
            depth_relative: 0.0,
            height: 0.0,
            contact_overlap: 0.0,
            by_slope_deg: Default::default(),
        };
        let mut photometry = Self {
            version: VERSION,
            columns: width,
            rows: height,
            pixel_mm: sensor.calibration().pixel_mm,
            look_up,
            network: training.network(recipe)?,
            contact_share: 0.35,
            gains: [1.0; 2],
            look_up_accuracy: nothing.clone(),
            network_accuracy: nothing,
            held_out: true,
        };
        let reader = |photometry: &Self, method| Reconstructor::new(sensor, photometry, &fitted.background, method);
        let area = (grid, photo_pixel);
        let gains = Method::ALL.map(|method| {
            let ratio = measure(&reader(&photometry, method), &known, area, 0.35).0.depth_ratio;
            if ratio.is_finite() && ratio > 0.0 { (1.0 / ratio) as f32 } else { 1.0 }
        });
        photometry.gains = gains;
        photometry.contact_share = contact_share(&reader(&photometry, Method::Network), &known, grid, photo_pixel);
        if let Some(unseen) = unseen {
            let unseen = KnownPresses::new(unseen, sensor, &background);
            let [look_up, network] = Method::ALL
                .map(|method| measure(&reader(&photometry, method), &unseen, area, photometry.contact_share).0);
            (photometry.look_up_accuracy, photometry.network_accuracy) = (look_up, network);
        }
        Ok(photometry)
    }

    /// Writes the file beside a calibration.
    pub fn write(&self, calibration: &Path) -> Result<()> {
        let path = Self::path(calibration);
        write_whole(&path, &serde_json::to_vec(self)?).with_context(|| path.display().to_string())
    }

    /// Reads the file beside a calibration, and checks that it belongs to it.
    pub fn read(calibration: &Path, sensor: &CalibratedSensor) -> Result<Self> {
        let path = Self::path(calibration);
        let name = || path.display().to_string();
        let text = std::fs::read(&path).with_context(|| {
            format!(
                "{}: what `optics calibrate` learned of the way from colours to slopes, beside {}",
                name(),
                calibration.display()
            )
        })?;
        let found: Self = serde_json::from_slice(&text).with_context(name)?;
        if found.version != VERSION {
            bail!("{}: version: found {}, expected {VERSION}", name(), found.version);
        }
        found.look_up.check().with_context(name)?;
        let network = serde_json::to_string(&found.network)?;
        Network::parse(&network, &path)?;
        if found.network.kind != Kind::PerPixel {
            bail!("{}: network: found an encoder-decoder, expected a per-pixel network", name());
        }
        if !(found.contact_share > 0.0 && found.gains.iter().all(|gain| *gain > 0.0 && gain.is_finite())) {
            bail!(
                "{}: contact_share, gains: found {} and {:?}, expected positive numbers",
                name(),
                found.contact_share,
                found.gains
            );
        }
        let (columns, rows) = sensor.size();
        let pixel_mm = sensor.calibration().pixel_mm;
        if (found.columns, found.rows) != (columns, rows) || found.pixel_mm != pixel_mm {
            bail!(
                "{}: found {} x {} pixels of {} mm, expected the calibration's {columns} x {rows} of {pixel_mm} mm",
                name(),
                found.columns,
                found.rows,
                found.pixel_mm
            );
        }
        Ok(found)
    }
}

/// The untouched gel as a photo.
pub fn untouched(sensor: &CalibratedSensor) -> Photo {
    let (width, height) = sensor.size();
    Photo { width, height, rgb: sensor.background().iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect() }
}
