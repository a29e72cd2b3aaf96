//! Surface reconstruction: normals, heights and contact of whatever presses into a calibrated real sensor, from its
//! images.
//!
//! [`known_ball`] gives the ground truth of a calibration press, without its colours. [`photometry`] is the mapping
//! from colours to slopes, by look-up and by a network; its file beside the calibration also holds the [`range`] of
//! colours and slopes in the presses. `fitting` learns it from such presses, with synthetic presses of the sensor's
//! fitted model ([`synthetic`]) as the prior. [`surface`] applies it at the pixels of [`touched`].
//! [`errors`] compares surfaces with held-out balls, [`accuracy`] summarizes these errors, and [`verdict`] decides
//! whether surfaces are usable. [`folder`] reads images as they arrive, and [`output`] writes the results.

pub mod accuracy;
pub mod errors;
mod fitting;
pub mod folder;
pub mod known_ball;
mod learning;
pub mod output;
pub mod photometry;
pub mod ply;
pub mod range;
pub mod surface;
pub mod synthetic;
pub mod touched;
pub mod verdict;

pub use accuracy::Accuracy;
pub use photometry::{Photometry, SlopeMethod};
pub use surface::{ReconstructedSurface, Reconstructor};
