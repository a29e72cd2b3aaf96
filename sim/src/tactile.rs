//! The simulated camera board: what presses into each pad, as images.

use hand_model::Hand;
use hand_model::robot::TactileFrame;
use nalgebra::Isometry3;
use scenarios::geometry::Shape;

/// 18 cameras of one hand unit.
#[derive(Clone)]
pub struct TactileBoard {}

impl TactileBoard {
    /// One image of every camera.
    pub fn capture(&mut self, _hand: &Hand, _time: f64, _pads: &[Isometry3<f64>], _forces: &[f64], _objects: &[(&Shape, Isometry3<f64>)]) -> Vec<TactileFrame> {
        Vec::new()
    }
}
