//! Simulated object detector of a trial: reported object poses with their errors, latency and occlusion.

use std::collections::VecDeque;
use std::sync::Arc;

use control::detection::{DetectionError, ObjectDetector, PoseDetection};
use nalgebra::{Isometry3, Point3};
use rand_chacha::ChaCha8Rng;
use scenarios::detector_model::DetectorModel;
use scenarios::noise::{NoiseLevels, ObjectNoise, TrialNoise};
use sim::robot::GroundTruth;
use world::objects::{ObjectModel, ObjectSet};

use super::disturbance::Disturber;
use robot_backends::{Backend, Detection};

/// Tolerance of the latency, s, well below a tick: a pose exactly as old as the latency has arrived.
const LATENCY_TOLERANCE: f64 = 1e-9;

/// Random generators of a trial's detections; a clone makes the same errors.
#[derive(Debug, Clone)]
pub struct DetectionNoise {
    rng: ChaCha8Rng,
    detector_model: Option<DetectorModel>,
}

impl DetectionNoise {
    /// Creates detections whose own errors come from `rng`, with the additional errors of vision in `sight`.
    pub fn new(rng: ChaCha8Rng, sight: Option<DetectorModel>) -> Self {
        Self { rng, detector_model: sight }
    }

    /// Returns `noise` with the errors of the first detection of `objects` standing at `places`.
    pub fn first_detection(
        &mut self,
        noise: &TrialNoise,
        objects: &[Arc<ObjectModel>],
        library: &ObjectSet,
        places: &[Isometry3<f64>],
    ) -> TrialNoise {
        let Some(sight) = &mut self.detector_model else { return *noise };
        let mut seen = *noise;
        for ((error, object), place) in seen.objects.iter_mut().zip(objects).zip(places) {
            *error = sight.draw_error(error, object, library, &place.rotation);
        }
        seen
    }

    /// Draws the error of a later detection of one of the `objects`, given by its index, which stands at `pose` as far
    /// as is known.
    fn later_detection_error(
        &mut self,
        levels: &NoiseLevels,
        (index, objects): (usize, &[Arc<ObjectModel>]),
        library: &ObjectSet,
        pose: Option<&Isometry3<f64>>,
    ) -> ObjectNoise {
        let (object, fresh) = (&objects[index], TrialNoise::draw(levels, objects.len(), &mut self.rng).objects[index]);
        match &mut self.detector_model {
            None => fresh,
            Some(sight) => sight.draw_error(&fresh, object, library, &pose.map_or(object.rest, |pose| pose.rotation)),
        }
    }
}

/// Past object poses, as far back as the latency of vision.
#[derive(Debug, Clone, Default)]
pub struct PoseHistory {
    /// Length of the history, s.
    length: f64,
    poses: VecDeque<(f64, Vec<Isometry3<f64>>)>,
}

impl PoseHistory {
    /// Creates a history of the last `length` s, empty if that is 0.
    pub fn new(length: f64) -> Self {
        Self { length, poses: VecDeque::new() }
    }

    /// Stores the present object poses.
    pub fn record(&mut self, truth: &GroundTruth) {
        if self.length <= 0.0 {
            return;
        }
        self.poses.push_back((truth.time, truth.objects.clone()));
        // The first entry is the newest that is old enough.
        while self.poses.get(1).is_some_and(|(time, _)| *time <= truth.time - self.length + LATENCY_TOLERANCE) {
            self.poses.pop_front();
        }
    }

    /// Returns the pose of object `index` at the exposure of the frame whose report arrives now. `None` if nothing is
    /// kept.
    pub fn delayed_pose(&self, index: usize) -> Option<Isometry3<f64>> {
        self.poses.front().map(|(_, poses)| poses[index])
    }
}

/// Object detector of a trial in progress: each detection has its own error, plus those of the disturbances.
pub struct SimulatedDetector<'a> {
    /// Backend whose objects are detected.
    pub robot: &'a mut Backend,
    /// Disturbances, with their perception errors.
    pub disturber: &'a Disturber,
    /// Noise levels.
    pub noise: &'a NoiseLevels,
    /// Generators of the branch's detections.
    pub detection_noise: &'a mut DetectionNoise,
    /// The objects as known to the controller.
    pub objects: &'a [Arc<ObjectModel>],
    /// Models of the objects in every stable pose.
    pub library: &'a ObjectSet,
    /// Past poses of the objects.
    pub history: &'a PoseHistory,
}

impl ObjectDetector for SimulatedDetector<'_> {
    fn detect(&mut self, object: usize) -> Result<Option<PoseDetection>, DetectionError> {
        let camera =
            self.detection_noise.detector_model.as_ref().map(|sight| Point3::from(sight.detector_errors().camera));
        let mut then = None;
        if camera.is_some() {
            // A backend without ground truth has its own errors.
            then = self.history.delayed_pose(object).or_else(|| self.robot.truth().map(|truth| truth.objects[object]));
        }
        let noise =
            self.detection_noise.later_detection_error(self.noise, (object, self.objects), self.library, then.as_ref());
        let noise = self.disturber.perceived_noise(object, &noise);
        let glance = Detection { object, noise, pose_at_capture: then, camera_position: camera };
        // The cause of the error stays in its chain.
        let boxed = |error: anyhow::Error| error.reallocate_into_boxed_dyn_error_without_backtrace();
        self.robot.detect(&glance).map_err(|error| DetectionError { object, source: boxed(error) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: f64) -> GroundTruth {
        let pose = Isometry3::translation(time, 0.0, 0.0);
        GroundTruth { time, objects: vec![pose, pose.inverse()], ..GroundTruth::default() }
    }

    /// A report is as old as the latency, to a tick, and nothing older is kept. At the start it is the first pose.
    #[test]
    fn a_report_is_as_old_as_the_latency() {
        let mut history = PoseHistory::new(0.15);
        let tick = 1.0 / 120.0;
        for n in 0..200 {
            let time = f64::from(n) * tick;
            history.record(&at(time));
            let then = history.delayed_pose(0).expect("kept").translation.x;
            let age = time - then;
            assert!((age - time.min(0.15)).abs() < tick, "{age}");
            assert!(then <= (time - 0.15).max(0.0) + 1e-9);
            assert_eq!(history.delayed_pose(1).expect("kept").translation.x, -then);
        }
        assert!(history.poses.len() < 22);
        let mut none = PoseHistory::new(0.0);
        none.record(&at(1.0));
        assert!(none.delayed_pose(0).is_none());
    }
}
