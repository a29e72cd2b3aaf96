//! Input of perception: the tactile images of one look, and the servo readings at the same moment.

use hand_model::robot::TactileFrame;
use tactile_perception::Readings;

/// Measurements of one look. It needs no executor and no plan, so that perception works whoever moves the hand.
#[derive(Debug, Clone, Copy)]
pub struct TactileSnapshot<'a> {
    /// Images of the look, at most one per camera.
    pub images: &'a [TactileFrame],
    /// Sequence number of the last image of each camera before the request; an image that is not newer is stale.
    pub sequences_before: &'a [Option<u64>],
    /// Newest servo readings, and the orientation of the palm.
    pub readings: Readings<'a>,
}
