//! `ftac optics`: tactile images, their calibration, and how good they are.

mod calibrate;

pub use calibrate::{CalibrateArgs, calibrate};

/// What a command gives back: nothing, or in what it falls short.
pub type Outcome = anyhow::Result<Option<String>>;
