//! Built-in networks, and the method for normals used in trials.

use std::path::Path;

use anyhow::{Context, Result};
use schemars::JsonSchema;
use serde::Serialize;
use tactile_perception::{Network, TouchPipeline};

/// Method to compute normals from colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NormalMethod {
    /// Photometric model of each pixel's colour.
    LookUp,
    /// Per-pixel perceptron.
    PerPixel,
    /// Encoder-decoder network.
    Network,
}

impl NormalMethod {
    /// All methods, in the order of tables.
    pub const ALL: [Self; 3] = [Self::LookUp, Self::PerPixel, Self::Network];

    /// Returns the name of the method.
    pub fn name(self) -> &'static str {
        match self {
            Self::LookUp => "look-up",
            Self::PerPixel => "per-pixel perceptron",
            Self::Network => "network",
        }
    }
}

/// Method used in trials: the best on held-out shapes and pads, within the available time.
pub const METHOD_IN_USE: NormalMethod = NormalMethod::LookUp;

/// Networks that are evaluated.
pub struct Networks {
    /// Network for the hand's pads.
    pub pads: Network,
    /// Perceptron for the hand's pads.
    pub pads_per_pixel: Network,
    /// Network for the real sensor, trained on renders of it.
    pub gelsight_simulated: Network,
    /// Network for the real sensor, trained on its even-numbered presses.
    pub gelsight_fitted: Network,
    /// Perceptron trained on the same presses.
    pub gelsight_per_pixel: Network,
}

impl Networks {
    /// Loads the built-in networks.
    pub fn builtin() -> Result<Self> {
        macro_rules! builtin {
            ($name:literal) => {
                Network::parse(include_str!(concat!("../../data/networks/", $name)), Path::new($name))?
            };
        }
        Ok(Self {
            pads: builtin!("pads.json"),
            pads_per_pixel: builtin!("pads_per_pixel.json"),
            gelsight_simulated: builtin!("gelsight_simulated.json"),
            gelsight_fitted: builtin!("gelsight_fitted.json"),
            gelsight_per_pixel: builtin!("gelsight_per_pixel.json"),
        })
    }

    /// Reads files of the same names from a folder.
    pub fn read(folder: &Path) -> Result<Self> {
        let network = |name: &str| Network::read(&folder.join(name)).with_context(|| "--networks");
        Ok(Self {
            pads: network("pads.json")?,
            pads_per_pixel: network("pads_per_pixel.json")?,
            gelsight_simulated: network("gelsight_simulated.json")?,
            gelsight_fitted: network("gelsight_fitted.json")?,
            gelsight_per_pixel: network("gelsight_per_pixel.json")?,
        })
    }

    /// Returns the pipeline with `method`; `look_up` is the pipeline of the calibration only.
    pub fn pipeline(&self, look_up: &TouchPipeline, method: NormalMethod) -> TouchPipeline {
        match method {
            NormalMethod::LookUp => look_up.clone(),
            NormalMethod::PerPixel => look_up.with_network(&self.pads_per_pixel),
            NormalMethod::Network => look_up.with_network(&self.pads),
        }
    }
}
