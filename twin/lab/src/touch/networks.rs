//! The networks that come with the program, and which way from colours to normals trials use.

use std::path::Path;

use anyhow::{Context, Result};
use schemars::JsonSchema;
use serde::Serialize;
use touch::{Network, TouchPipeline};

/// A way from colours to normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The photometric model of each pixel's colour.
    LookUp,
    /// The per-pixel perceptron.
    PerPixel,
    /// The encoder-decoder.
    Network,
}

impl Method {
    /// All, in the order of tables.
    pub const ALL: [Self; 3] = [Self::LookUp, Self::PerPixel, Self::Network];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::LookUp => "look-up",
            Self::PerPixel => "per-pixel perceptron",
            Self::Network => "network",
        }
    }
}

/// How trials find normals: what is best on shapes and pads not trained on, in the time there is.
pub const IN_USE: Method = Method::LookUp;

/// The networks that are measured.
pub struct Networks {
    /// For the hand's pads.
    pub pads: Network,
    /// Perceptron for the hand's pads.
    pub pads_per_pixel: Network,
    /// For the real sensor, from renders of it.
    pub gelsight_simulated: Network,
    /// For the real sensor, from its even-numbered presses.
    pub gelsight_fitted: Network,
    /// Perceptron from the same presses.
    pub gelsight_per_pixel: Network,
}

impl Networks {
    /// Those that come with the program.
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

    /// Files of the same names in a folder.
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

    /// The pipeline by `method`; `look_up` is that of the calibration alone.
    pub fn pipeline(&self, look_up: &TouchPipeline, method: Method) -> TouchPipeline {
        match method {
            Method::LookUp => look_up.clone(),
            Method::PerPixel => look_up.with_network(&self.pads_per_pixel),
            Method::Network => look_up.with_network(&self.pads),
        }
    }
}
