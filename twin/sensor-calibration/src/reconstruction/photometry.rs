//! Photometry: the mapping from a real sensor's colours to slopes, learned from presses of a ball and stored in a file
//! beside the calibration.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ftac_platform::file::write_atomically;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tactile_optics::calibration::{CalibratedSensor, Photo};
use tactile_perception::network::NetworkKind;
use tactile_perception::{Network, PhotometricModel};

use super::accuracy::Accuracy;
use super::range::CalibrationRange;

/// Placeholder for the only sensor, in place of a pad's configuration.
pub const CONFIGURATION: char = 'a';
/// Version of the file format.
pub(super) const VERSION: u32 = 2;

/// Method to estimate slopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SlopeMethod {
    /// Regression from the colour change at a position to the slope.
    LookUp,
    /// Perceptron with the same inputs.
    Network,
}

impl SlopeMethod {
    pub const ALL: [Self; 2] = [Self::LookUp, Self::Network];

    /// Returns the name of the method.
    pub fn name(self) -> &'static str {
        match self {
            Self::LookUp => "look-up",
            Self::Network => "network",
        }
    }
}

/// Learned mapping from colours to slopes, with its accuracy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photometry {
    pub(super) version: u32,
    /// Image size and pixel size of the calibration to which it belongs.
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) pixel_mm: f64,
    /// Number of presses from which it was learned.
    pub presses: usize,
    pub(super) look_up: PhotometricModel,
    pub(super) network: Network,
    /// Range of colours and slopes of the presses.
    pub(super) range: CalibrationRange,
    /// Contact threshold: share of the largest indentation above which the gel counts as lying on the pressed object.
    pub(super) contact_share: f32,
    /// Gains on heights, by look-up and by the network, that correct the mean depth of the training presses: a
    /// regression on noisy colours underestimates slopes.
    pub(super) gains: [f32; 2],
    /// Accuracy from cross-validation: each press was held out once and evaluated with a mapping learned from the
    /// others. This file itself is learned from all presses.
    pub(super) accuracy: [Accuracy; 2],
}

impl Photometry {
    /// Returns the path of the file beside a calibration.
    pub fn path(calibration: &Path) -> PathBuf {
        calibration.with_extension("normals.json")
    }

    pub fn accuracy(&self, method: SlopeMethod) -> &Accuracy {
        &self.accuracy[method as usize]
    }

    pub(super) fn gain(&self, method: SlopeMethod) -> f32 {
        self.gains[method as usize]
    }

    pub fn range(&self) -> &CalibrationRange {
        &self.range
    }

    /// Returns the method whose normals have the smaller mean error on held-out presses; if only one method is of use,
    /// returns that one.
    pub fn better_method(&self) -> SlopeMethod {
        let [look_up, network] = SlopeMethod::ALL.map(|method| self.accuracy(method));
        match (look_up.fault().is_some(), network.fault().is_some()) {
            (false, true) => SlopeMethod::LookUp,
            (true, false) => SlopeMethod::Network,
            _ if network.normals_deg.mean < look_up.normals_deg.mean => SlopeMethod::Network,
            _ => SlopeMethod::LookUp,
        }
    }

    /// Sets the accuracy measured on held-out presses, by look-up and by the network.
    pub fn with_accuracy(self, accuracy: [Accuracy; 2]) -> Self {
        Self { accuracy, ..self }
    }

    /// Writes the file beside a calibration.
    pub fn write(&self, calibration: &Path) -> Result<()> {
        let path = Self::path(calibration);
        write_atomically(&path, &serde_json::to_vec(self)?).with_context(|| path.display().to_string())
    }

    /// Reads the file beside a calibration, and checks that it belongs to it.
    pub fn read(calibration: &Path, sensor: &CalibratedSensor) -> Result<Self> {
        let path = Self::path(calibration);
        let name = || path.display().to_string();
        let text = std::fs::read(&path).with_context(|| {
            format!(
                "{}: mapping from colours to slopes of `optics calibrate`, beside {}",
                name(),
                calibration.display()
            )
        })?;
        /// Field that every version of the file has.
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let Versioned { version } = serde_json::from_slice(&text).with_context(name)?;
        if version != VERSION {
            bail!("{}: version: found {version}, expected {VERSION}; calibrate again", name());
        }
        let found: Self = serde_json::from_slice(&text).with_context(name)?;
        found.range.check().map_err(anyhow::Error::msg).with_context(name)?;
        found.look_up.check().with_context(name)?;
        let network = serde_json::to_string(&found.network)?;
        Network::parse(&network, &path)?;
        if found.network.kind != NetworkKind::PerPixel {
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

/// Returns the image of the untouched gel as a photo.
pub fn untouched_photo(sensor: &CalibratedSensor) -> Photo {
    let (width, height) = sensor.size();
    Photo { width, height, rgb: sensor.background().iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect() }
}
