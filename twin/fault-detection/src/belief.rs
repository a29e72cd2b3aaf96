//! What a mirror believes of the object in the hand: where it was felt, moved with the twin's palm, less certain with time.

use control::executor::Phase;
use control::perception::Felt;
use nalgebra::{Isometry3, Matrix6};

/// How the place of a held object becomes uncertain, standard deviations after a second: m and rad. A grip creeps by tenths of a millimetre a
/// second where it holds (slip that is more than that is felt as such).
const WALK: (f64, f64) = (0.0005, 0.01);

/// An object in the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Belief {
    /// `palm_from_object`.
    pub palm_from_object: Isometry3<f64>,
    /// Covariance of position (m) and rotation (rad), along the palm's axes.
    pub covariance: Matrix6<f64>,
    /// When it was felt, s.
    pub felt: f64,
}

/// Keeps the belief.
#[derive(Debug, Clone, Default)]
pub struct Believes {
    /// Tells an estimate from others: its cost, and its patches.
    known: Option<(f64, usize)>,
    object: Option<Belief>,
    time: f64,
}

impl Believes {
    /// One tick at `time` (s): a new estimate replaces the belief, for it is itself the fusion of all that was known at its time.
    pub fn see(&mut self, time: f64, phase: Phase, felt: Option<&Felt>) {
        let past = (time - self.time).max(0.0);
        self.time = time;
        let felt = felt.filter(|felt| felt.grip.holds(felt.object) && phase.lifts(felt.object));
        let known = felt.map(|felt| (felt.estimate.cost, felt.estimate.patches));
        if known != self.known {
            self.known = known;
            self.object = felt.map(|felt| Belief {
                palm_from_object: felt.estimate.palm_from_object,
                covariance: felt.estimate.covariance,
                felt: time,
            });
        } else if let Some(object) = &mut self.object {
            for axis in 0..3 {
                object.covariance[(axis, axis)] += WALK.0.powi(2) * past;
                object.covariance[(axis + 3, axis + 3)] += WALK.1.powi(2) * past;
            }
        }
    }

    /// It is no longer in the hand.
    pub fn lose(&mut self) {
        self.object = None;
    }

    /// What is believed to be in the hand.
    pub fn object(&self) -> Option<&Belief> {
        self.object.as_ref()
    }
}
