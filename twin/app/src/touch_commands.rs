//! `ftac touch`: photometric stereo is trained, and touch is measured from images to poses.

mod eval;
mod grasps;
mod images;
pub mod normals;
mod pictures;
mod poses;
mod real;
pub mod shapes;
mod train_network;

pub use eval::{EvalArgs, eval};
pub use train_network::{TrainNetworkArgs, train_network};

/// What a command gives back: nothing, or in what it falls short.
pub type Outcome = anyhow::Result<Option<String>>;
