//! Normals, heights and contact of whatever presses into a calibrated real sensor, from its images.
//!
//! [`known_ball`] is what is known of a calibration press without looking at its colours. [`photometry`] is the way from
//! colours to slopes, by look-up and by a network, in a file beside the calibration, with the [`range`] of colours and slopes that the presses showed;
//! `fitting` learns it from such presses, with what the fitted model of the sensor [imagines](imagined) as the prior.
//! [`surface`] applies it where an image is [`touched`]; [`errors`] compares surfaces with balls that were held out; the [`accuracy`] is what they come to, and the [`verdict`] on it says whether surfaces are of use. [`folder`] reads
//! images as they come, and [`output`] writes what was found.

pub mod accuracy;
pub mod errors;
mod fitting;
pub mod folder;
pub mod imagined;
pub mod known_ball;
mod learning;
pub mod output;
pub mod photometry;
pub mod ply;
pub mod range;
pub mod surface;
pub mod touched;
pub mod verdict;

pub use accuracy::Accuracy;
pub use photometry::{Method, Photometry};
pub use surface::{Reconstructor, Surface};
