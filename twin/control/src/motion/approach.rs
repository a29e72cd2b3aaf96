//! Palm paths to a grasp.

use dexterous_grasping::Grasp;
use dexterous_grasping::grasp::pregrasp_pose;
use hand_model::Hand;
use nalgebra::Isometry3;

use crate::detection::DetectedObject;
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Distance of the approach pose from the grasp, m.
pub const APPROACH_DISTANCE: f64 = 0.09;
/// Share of the speed limits on the last part of an approach.
const FINAL_SPEED_SHARE: f64 = 0.6;
/// Shortest duration of a motion, s.
const MIN_DURATION: f64 = 0.05;

/// Duration (s) of a motion between two poses within limits.
pub fn duration(limits: &PathLimits, from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let length = (to.translation.vector - from.translation.vector).norm();
    let angle = from.rotation.angle_to(&to.rotation);
    limits.duration(length, angle).max(MIN_DURATION)
}

/// Path from the first of `stops` through the others and the approach pose of `grasp` to the pose at which the digits
/// close on the object at `detected`.
pub fn approach(
    (hand, limits): (&Hand, &PathLimits),
    stops: &[Isometry3<f64>],
    grasp: &Grasp,
    detected: &DetectedObject,
) -> Result<PosePath, PathError> {
    let (mut waypoints, last) = waypoints((hand, limits), stops, grasp, detected);
    waypoints.push(last);
    PosePath::new(waypoints)
}

/// The path of [`approach`] in two parts: up to the approach pose, and from there.
pub fn approach_in_parts(
    (hand, limits): (&Hand, &PathLimits),
    stops: &[Isometry3<f64>],
    grasp: &Grasp,
    detected: &DetectedObject,
) -> Result<[PosePath; 2], PathError> {
    let (way, last) = waypoints((hand, limits), stops, grasp, detected);
    let from = way.last().map(|(_, before)| (0.0, *before));
    Ok([PosePath::new(way)?, PosePath::new(from.into_iter().chain([last]).collect())?])
}

/// Waypoints up to the approach pose, each with its time from the one before, and the last waypoint.
fn waypoints(
    (hand, limits): (&Hand, &PathLimits),
    stops: &[Isometry3<f64>],
    grasp: &Grasp,
    detected: &DetectedObject,
) -> (Vec<Waypoint>, Waypoint) {
    let target = grasp.palm_pose(&detected.position, detected.yaw);
    let before = pregrasp_pose(hand, &target, APPROACH_DISTANCE);
    let mut waypoints: Vec<Waypoint> = Vec::with_capacity(stops.len() + 2);
    for pose in stops.iter().chain([&before]) {
        let time = waypoints.last().map_or(0.0, |(_, last)| duration(limits, last, pose));
        waypoints.push((time, *pose));
    }
    (waypoints, (duration(&limits.scaled(FINAL_SPEED_SHARE), &before, &target), target))
}

/// Time (s) from the waypoint before, and pose.
type Waypoint = (f64, Isometry3<f64>);
