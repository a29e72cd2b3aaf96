//! What perception takes: the tactile images of one look and the servos' readings at the same moment.

use hand_model::robot::TactileFrame;
use touch::Readings;

/// Measurements of one look. No executor, no plan: whoever moves the hand can be felt with.
#[derive(Debug, Clone, Copy)]
pub struct Look<'a> {
    /// Images of the look, at most one a camera.
    pub images: &'a [TactileFrame],
    /// Sequence number that each camera had sent before the images were asked for: what is not newer is stale.
    pub sequences_before: &'a [Option<u64>],
    /// Newest servo readings, and how the palm is turned.
    pub readings: Readings<'a>,
}
