//! Calibration of tactile sensors: the image-formation model from presses of a ball, and surface reconstruction from
//! the images of a calibrated sensor.
//!
//! [`calibration`] fits a real sensor's model to presses and renders held-out ones. [`evaluation`] compares a
//! calibration with images, the gel with the paper's probe, and fits with a known sensor. [`reconstruction`] computes
//! the surface from a real sensor's images, on the [`grid`] of the pads' images. [`pad_calibration`] fits the
//! photometric model of a hand's pads, and [`pad_forces`] compares force estimates from images with the forces of the
//! physics engine.
//!
//! Presses come from [`real_presses`] and [`pressed_shapes`]. [`render`] presses a mesh into a pad, [`shape_sheet`]
//! twenty known shapes. [`exr`] and [`npy`] write numeric files, and [`video`] reads frames.

pub mod calibration;
pub mod evaluation;
pub mod exr;
pub mod npy;
pub mod pad_calibration;
pub mod pad_forces;
pub mod pressed_shapes;
pub mod real_presses;
pub mod reconstruction;
pub mod render;
pub mod shape_sheet;
pub mod video;

use hand_model::Hand;
use hand_model::pads::PadCamera;

pub use tactile_perception::grid;

/// Returns the serial number of a camera's sensor in hand `unit`, as numbered by the tactile board.
fn sensor_serial(hand: &Hand, unit: u64, camera: &PadCamera) -> u64 {
    let index = hand.cameras.iter().position(|other| other.name == camera.name).unwrap_or(0);
    unit.wrapping_mul(1000).wrapping_add(index as u64)
}
