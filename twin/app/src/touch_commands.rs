//! `ftac touch`: photometric stereo is trained, and touch is measured from images to poses.

mod eval;
mod grasps;
mod images;
mod poses;

pub use eval::{EvalArgs, eval};

/// What a command gives back: nothing, or in what it falls short.
pub type Outcome = anyhow::Result<Option<String>>;
