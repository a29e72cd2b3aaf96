//! Input of perception: the tactile images of one snapshot, and the servo readings at the same moment.

use hand_model::robot::TactileFrame;
use tactile_perception::Readings;

/// Measurements of one tactile snapshot. It needs no executor and no plan, so perception works for any motion of the
/// hand.
#[derive(Debug, Clone, Copy)]
pub struct TactileSnapshot<'a> {
    /// Images of the snapshot, at most one per camera.
    pub images: &'a [TactileFrame],
    /// Sequence number of the last image of each camera before the request; an image that is not newer is stale.
    pub sequences_before: &'a [Option<u64>],
    /// Newest servo readings, and the orientation of the palm.
    pub readings: Readings<'a>,
}
