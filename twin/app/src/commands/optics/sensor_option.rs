//! The option that names a sensor's file, which is the same in all commands.

use std::path::PathBuf;

use clap::Args;

use crate::terminal::Terminal;

/// A sensor's file.
#[derive(Debug, Clone, Args)]
#[group(id = "sensor_file", multiple = false)]
pub struct SensorOption {
    /// The sensor: a real one (what `optics calibrate --out` wrote) or, to render, a pad's (see `optics pads`).
    #[arg(long)]
    pub sensor: Option<PathBuf>,
    /// The former name of `--sensor`.
    #[arg(long, hide = true)]
    pub calibration: Option<PathBuf>,
}

impl SensorOption {
    /// The file. Its former name is taken with a notice.
    pub fn file(&self, terminal: &Terminal) -> Option<&PathBuf> {
        if self.calibration.is_some() && !terminal.quiet {
            eprintln!("--calibration is now called --sensor");
        }
        self.sensor.as_ref().or(self.calibration.as_ref())
    }
}
