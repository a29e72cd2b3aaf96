//! Pose estimate of the object in the hand: the pose from touch, carried along with the reference model's palm, with a
//! covariance that grows with time.

use control::executor::Phase;
use control::perception::ObjectEstimate;
use nalgebra::{Isometry3, Matrix6};

/// Random walk of a held object's pose: standard deviations after one second, m and rad. In a firm grip, an object
/// creeps by tenths of a millimetre a second. Larger slip is detected as such.
const RANDOM_WALK_SIGMA: (f64, f64) = (0.0005, 0.01);

/// Pose estimate of an object in the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldPose {
    /// Estimated pose of the object in the palm's frame.
    pub palm_from_object: Isometry3<f64>,
    /// Covariance of position (m) and rotation (rad), along the palm's axes.
    pub covariance: Matrix6<f64>,
    /// Time of the pose estimate from touch, s.
    pub felt_time: f64,
}

/// Keeps the pose estimate of the held object up to date.
#[derive(Debug, Clone, Default)]
pub struct HeldPoseTracker {
    /// Cost and number of patches of the last estimate from touch, which identify it.
    last_estimate: Option<(f64, usize)>,
    object: Option<HeldPose>,
    time: f64,
}

impl HeldPoseTracker {
    /// Updates the estimate at `time` (s). A new estimate from touch replaces it, because it fuses all knowledge of its
    /// time.
    pub fn update(&mut self, time: f64, phase: Phase, felt: Option<&ObjectEstimate>) {
        let past = (time - self.time).max(0.0);
        self.time = time;
        let felt = felt.filter(|felt| felt.hold_state.holds(felt.object) && phase.has_begun_lift(felt.object));
        let known = felt.map(|felt| (felt.estimate.cost, felt.estimate.patches));
        if known != self.last_estimate {
            self.last_estimate = known;
            self.object = felt.map(|felt| HeldPose {
                palm_from_object: felt.estimate.palm_from_object,
                covariance: felt.estimate.covariance,
                felt_time: time,
            });
        } else if let Some(object) = &mut self.object {
            for axis in 0..3 {
                object.covariance[(axis, axis)] += RANDOM_WALK_SIGMA.0.powi(2) * past;
                object.covariance[(axis + 3, axis + 3)] += RANDOM_WALK_SIGMA.1.powi(2) * past;
            }
        }
    }

    /// Drops the estimate: the object is no longer in the hand.
    pub fn clear(&mut self) {
        self.object = None;
    }

    /// Returns the estimate of the object in the hand.
    pub fn object(&self) -> Option<&HeldPose> {
        self.object.as_ref()
    }
}
