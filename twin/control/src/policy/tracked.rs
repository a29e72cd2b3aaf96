//! An object with its detections and failed tries so far.

use std::collections::BTreeMap;

use super::{Knowledge, PolicyError};
use crate::detection::{AveragedDetection, DetectedObject, ObjectDetector};
use crate::executor::Executor;
use crate::outcome_model::AimPosterior;
use crate::score;
use crate::uncertainty::Uncertainty;

/// Detections of an object and failed tries.
pub struct TrackedObject {
    /// Number of the object in the trial.
    object: usize,
    /// Number of detections over which its position is averaged.
    pub detections: u32,
    /// Standard deviation reported for the latest detection, m.
    detection_sigma: Option<f64>,
    /// Posterior of the error of its position since it was touched; `None` if it was only detected.
    pub touch_posterior: Option<AimPosterior>,
    /// True if it was hidden at the last attempt to detect it.
    pub hidden: bool,
    /// Number of failures of each grasp, by the grasp's number.
    failures: BTreeMap<u32, i32>,
}

impl TrackedObject {
    /// Records for all objects of a trial, each of which was detected once.
    pub fn for_trial(knowledge: &Knowledge) -> Vec<Self> {
        let one = |object| Self {
            object,
            detections: 1,
            detection_sigma: knowledge.first_detection_sigmas[object],
            touch_posterior: None,
            hidden: false,
            failures: BTreeMap::new(),
        };
        (0..knowledge.objects.len()).map(one).collect()
    }

    /// Expected errors of its detected position and of the arm.
    pub fn uncertainty(&self, knowledge: &Knowledge) -> Uncertainty {
        knowledge.uncertainty.with_detector_sigma(self.detection_sigma)
    }

    /// Detects the object again; `None` if it is hidden.
    pub fn detect(
        &mut self,
        knowledge: &Knowledge,
        detector: &mut dyn ObjectDetector,
    ) -> Result<Option<DetectedObject>, PolicyError> {
        let Some(sighted) = detector.detect(self.object)? else { return Ok(None) };
        self.detection_sigma = sighted.sigma;
        Ok(Some(DetectedObject::from_pose(&knowledge.objects[self.object], &sighted.pose)))
    }

    /// Replaces the detected pose by `seen`, because something may have moved the object since the previous detections;
    /// `None` if it is hidden.
    pub fn replace_detection(&mut self, seen: Option<DetectedObject>, executor: &mut Executor) {
        self.hidden = seen.is_none();
        if let Some(seen) = seen {
            executor.update_detection(self.object, seen);
            (self.detections, self.touch_posterior) = (1, None);
        }
    }

    /// Adds the detection `seen` of an object that nothing has moved: its position is the mean of all detections that
    /// agree.
    pub fn add_detection(&mut self, seen: DetectedObject, knowledge: &Knowledge, executor: &mut Executor) {
        let known = AveragedDetection { mean: executor.target(self.object).detected, detections: self.detections };
        let AveragedDetection { mean, detections: looks } =
            known.with_detection(seen, self.uncertainty(knowledge).independent_detection_sigma());
        executor.update_detection(self.object, mean);
        self.detections = looks;
    }

    /// Counts a failure of a grasp of this object.
    pub fn count_failure(&mut self, grasp: u32) {
        *self.failures.entry(grasp).or_default() += 1;
    }

    /// Factor on a grasp's score after its failures.
    pub fn failure_factor(&self, grasp: u32) -> f64 {
        score::FAILURE_FACTOR.powi(self.failures.get(&grasp).copied().unwrap_or(0))
    }
}
