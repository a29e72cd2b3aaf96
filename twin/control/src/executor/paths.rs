//! Candidate paths of the executor's next motion, to touch an object or to grasp it.

use dexterous_grasping::Grasp;
use nalgebra::Isometry3;
use world::geometry::ObjectShape;

use super::{Executor, GraspTarget};
use crate::detection::DetectedObject;
use crate::motion::MotionError;
use crate::motion::approach::approach_in_parts;
use crate::palpation::{self, PalpationPaths};
use crate::trajectory::PosePath;

/// Rises of the palm before it goes to an object beside others, m, so that what it holds passes above them.
const RISE_CANDIDATES: [f64; 3] = [0.0, 0.05, 0.1];

impl Executor {
    /// Via poses of the candidate paths from the present palm pose to the next approach pose: the direct path first,
    /// then higher ones.
    pub fn approach_paths(&self) -> impl Iterator<Item = Vec<Isometry3<f64>>> {
        RISE_CANDIDATES.iter().map(|rise| self.motion.start_stops(self.rise() + rise))
    }

    /// Path by way of `stops` that takes an object detected at `detected` with `grasp`, in two parts: to the approach
    /// pose, and from there to the pose at which the digits close.
    pub fn path_to(
        &self,
        stops: &[Isometry3<f64>],
        grasp: &Grasp,
        detected: &DetectedObject,
    ) -> Result<[PosePath; 2], MotionError> {
        Ok(approach_in_parts((self.motion.hand(), &self.protocol.limits), stops, grasp, detected)?)
    }

    /// Path by way of `stops` that the arm can follow to the pose at which `grasp` closes on the object at `detected`;
    /// see [`crate::motion::MotionExecutor::feasible_approach`].
    pub fn feasible_approach(
        &self,
        stops: &[Isometry3<f64>],
        grasp: &Grasp,
        detected: &DetectedObject,
    ) -> Option<PosePath> {
        self.motion.feasible_approach(&self.protocol.limits, grasp, detected, stops)
    }

    /// Rise of the palm before any other motion, m: fingers that touch an object must leave it upwards.
    fn rise(&self) -> f64 {
        if self.has_touched() { palpation::RETREAT_HEIGHT } else { 0.0 }
    }

    /// Paths by which the arm can touch `object` of this `shape` at its detected pose, the preferred one first.
    pub fn feasible_palpations(&self, object: usize, shape: &ObjectShape) -> impl Iterator<Item = PalpationPaths> {
        let (motion, limits, GraspTarget { grasp, detected: percept }) =
            (&self.motion, &self.protocol.limits, self.target(object));
        let onto = palpation::guarded_motions(motion.hand(), grasp.yaw + percept.yaw, (shape, percept)).into_iter();
        onto.filter_map(move |onto| {
            let there = onto.start();
            let way =
                motion.first_feasible(limits, |limits| [palpation::approach_path(limits, &motion.end(), &there)])?;
            Some(PalpationPaths { approach: way, guarded_motion: onto })
        })
    }
}
