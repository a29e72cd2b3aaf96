//! The option `--sensor`, which names a sensor's file in all commands.

use std::path::PathBuf;

use clap::Args;

use crate::terminal::Terminal;

/// Option for a sensor's file.
#[derive(Debug, Clone, Args)]
#[group(id = "sensor_file", multiple = false)]
pub struct SensorOption {
    /// Sensor file: of a real sensor (from `optics calibrate --out`) or, to render, of a pad (see `optics pads`).
    #[arg(long)]
    pub sensor: Option<PathBuf>,
    /// The former name of `--sensor`.
    #[arg(long, hide = true)]
    pub calibration: Option<PathBuf>,
}

impl SensorOption {
    /// Returns the file. The former option name is accepted with a notice.
    pub fn file(&self, terminal: &Terminal) -> Option<&PathBuf> {
        if self.calibration.is_some() && !terminal.quiet {
            eprintln!("--calibration is now called --sensor");
        }
        self.sensor.as_ref().or(self.calibration.as_ref())
    }
}
