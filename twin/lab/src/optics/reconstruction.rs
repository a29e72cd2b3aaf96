//! Normals, heights and contact of whatever presses into a calibrated real sensor, from its images.
//!
//! [`known_ball`] is what is known of a calibration press without looking at its colours. [`photometry`] learns from such
//! presses the way from colours to slopes, by look-up and by a network, and keeps it in a file beside the calibration.
//! [`surface`] applies it to an image; [`accuracy`] compares surfaces with balls that were held out. [`folder`] reads
//! images as they come, and [`output`] writes what was found.

pub mod accuracy;
pub mod folder;
pub mod known_ball;
pub mod output;
pub mod photometry;
pub mod ply;
pub mod surface;

pub use accuracy::Accuracy;
pub use photometry::{Method, Photometry};
pub use surface::{Reconstructor, Surface};
