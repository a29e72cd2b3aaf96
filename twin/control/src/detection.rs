//! Object detection: detected poses of objects, and the interface of a detector.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use world::objects::ObjectModel;

/// Gate of two detections at the same place: largest distance, in standard deviations of one detection's error.
const POSITION_GATE: f64 = 4.0;
/// Gate of two detections at the same place: largest rotation between them, rad. An object that fell over, or is
/// mistaken for a fallen one, is turned by more.
const ROTATION_GATE: f64 = 0.5;

/// Detected pose of an object as a detector reports it (a camera over the table, for instance), error included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedObject {
    /// Centre, m, world.
    pub position: Point3<f64>,
    /// Orientation `world_from_object`.
    pub rotation: UnitQuaternion<f64>,
    /// Yaw from the object's rest pose, rad; 0 if it lies in another way.
    pub yaw: f64,
}

impl DetectedObject {
    /// Detected pose of `object` reported at `world_from_object`.
    pub fn from_pose(object: &ObjectModel, world_from_object: &Isometry3<f64>) -> Self {
        Self {
            position: world_from_object.translation.vector.into(),
            rotation: world_from_object.rotation,
            yaw: object.resting_yaw(&world_from_object.rotation).unwrap_or(0.0),
        }
    }

    /// Detected pose of a ball reported at `world_from_object`; its rotation is ignored.
    pub fn from_ball_pose(world_from_object: &Isometry3<f64>) -> Self {
        Self { position: world_from_object.translation.vector.into(), rotation: UnitQuaternion::identity(), yaw: 0.0 }
    }

    /// Returns `world_from_object`.
    pub fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position.coords), self.rotation)
    }
}

/// Position of an object, averaged over several detections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AveragedDetection {
    pub mean: DetectedObject,
    /// Number of detections over which the mean is taken.
    pub detections: u32,
}

impl AveragedDetection {
    /// Adds one detection whose own error has the standard deviation `sigma` (m, each of x and y). A detection that
    /// disagrees with the mean replaces it: the object was moved, or its lying pose was mistaken before.
    #[must_use]
    pub fn with_detection(self, seen: DetectedObject, sigma: f64) -> Self {
        let apart = seen.position - self.mean.position;
        if apart.norm() > POSITION_GATE * sigma || seen.rotation.angle_to(&self.mean.rotation) > ROTATION_GATE {
            return Self { mean: seen, detections: 1 };
        }
        let looks = self.detections + 1;
        let share = 1.0 / f64::from(looks);
        let mean = DetectedObject {
            position: self.mean.position + share * apart,
            rotation: self.mean.rotation.slerp(&seen.rotation, share),
            yaw: self.mean.yaw + share * (seen.yaw - self.mean.yaw),
        };
        Self { mean, detections: looks }
    }
}

/// Failure to detect an object.
#[derive(Debug, thiserror::Error)]
#[error("detecting object {object}: {source}")]
pub struct DetectionError {
    /// Number of the object.
    pub object: usize,
    /// Underlying error.
    #[source]
    pub source: Box<dyn std::error::Error + Send + Sync>,
}

/// Report of an object from one detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseDetection {
    /// `world_from_object`, with the detection's error.
    pub pose: Isometry3<f64>,
    /// Standard deviation that the detector reports for this detection, each of x and y, m; `None` for the usual one.
    pub sigma: Option<f64>,
}

impl From<Isometry3<f64>> for PoseDetection {
    fn from(pose: Isometry3<f64>) -> Self {
        Self { pose, sigma: None }
    }
}

/// Object detector: simulated with errors, a camera, or an operator who puts the object in its place.
pub trait ObjectDetector {
    /// Detects object number `object` again; `None` if it is not visible.
    fn detect(&mut self, object: usize) -> Result<Option<PoseDetection>, DetectionError>;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(x: f64, yaw: f64) -> DetectedObject {
        let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
        DetectedObject { position: Point3::new(x, 0.0, 0.03), rotation, yaw }
    }

    #[test]
    fn looks_that_agree_are_averaged() {
        let one = AveragedDetection { mean: seen(0.0, 0.0), detections: 1 };
        let three = one.with_detection(seen(0.006, 0.12), 0.004).with_detection(seen(0.003, 0.0), 0.004);
        assert_eq!(three.detections, 3);
        assert!((three.mean.position.x - 0.003).abs() < 1e-12 && (three.mean.yaw - 0.04).abs() < 1e-12);
        assert!(three.mean.rotation.angle_to(&seen(0.0, 0.04).rotation) < 1e-9);
    }

    /// An object that was moved or fell over is at its last detected pose.
    #[test]
    fn a_look_that_disagrees_is_believed() {
        let one = AveragedDetection { mean: seen(0.0, 0.0), detections: 4 };
        for other in [seen(0.03, 0.0), seen(0.001, 1.5)] {
            assert_eq!(one.with_detection(other, 0.004), AveragedDetection { mean: other, detections: 1 });
        }
    }
}
