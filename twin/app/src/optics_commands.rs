//! `ftac optics`: tactile images, calibration to real sensors, and how good both are.

mod calibrate;
mod eval;
mod exr;
mod npy;
mod pad_forces;
mod pads;
mod render;

pub use calibrate::{CalibrateArgs, calibrate};
pub use eval::{EvalArgs, eval};
pub use pads::{PadsArgs, pads};
pub use render::{RenderArgs, ShapesArgs, render, shapes};

/// What a command gives back: nothing, or in what it falls short.
pub type Outcome = anyhow::Result<Option<String>>;
