//! Ways to a grasp: rehearsed by the arm's servo before they are gone.
//!
//! A straight path to where the hand closes can end in a wedge, joints at their limits and the palm decimetres off, although the arm
//! could be there in another posture: after a failed try it starts from wherever that ended. Such a grasp is reached by way of
//! the pose the trial began in, where the arm is free again.

use nalgebra::Isometry3;

use super::{APPROACH_DISTANCE, Executive, ExecutiveError, Grasp, Percept, duration};
use crate::trajectory::{PathLimits, PosePath};

/// How far the palm may be from a path, m. Where every way is worse, the arm lags behind the first that ends well.
const OFF_PATH: f64 = 0.02;
/// How far it may be from its end, m and rad.
const OFF_END: (f64, f64) = (0.002, 0.02);
/// Shares of the trial's speed that are tried: joints far from where they suit a motion cannot keep up with the whole.
const SPEEDS: [f64; 2] = [1.0, 0.5];
/// Ticks of a rehearsal and what it waits at the end, s: coarser than the real ones.
const REHEARSAL: (f64, f64) = (1.0 / 40.0, 0.1);

impl Executive {
    /// How the palm gets from where it is to where `grasp` closes on what is seen at `percept`: straight, or by way of where the
    /// trial began. `None` if the arm can do neither.
    pub fn way(&self, grasp: &Grasp, percept: &Percept) -> Option<PosePath> {
        let here = self.path.end();
        let mut lagging = None;
        for speed in SPEEDS {
            for stops in [&[here][..], &[here, self.home]] {
                let Ok(path) = self.approach(stops, grasp, percept, speed) else { continue };
                match self.off_path(&path) {
                    Some(off) if off < OFF_PATH => return Some(path),
                    Some(_) => lagging = lagging.or(Some(path)),
                    None => {}
                }
            }
        }
        lagging
    }

    /// Goes `way` instead of straight; call it as an approach begins.
    pub fn go(&mut self, way: PosePath) {
        self.path = way;
    }

    /// As [`approach`], at a share `speed` of the trial's.
    pub(super) fn approach(
        &self,
        stops: &[Isometry3<f64>],
        grasp: &Grasp,
        percept: &Percept,
        speed: f64,
    ) -> Result<PosePath, ExecutiveError> {
        approach(&self.protocol.limits.scaled(speed), stops, grasp, percept)
    }

    /// How far the arm would get from `path` under way, m; `None` if it would not get to its end.
    fn off_path(&self, path: &PosePath) -> Option<f64> {
        let (tick, settle) = REHEARSAL;
        let done = self.servo.rehearse(path, settle, tick).ok()?;
        let there = done.position_error < OFF_END.0 && done.rotation_error < OFF_END.1;
        there.then_some(done.worst_position_error)
    }
}

/// The path from the first of `stops` past the others to where the digits of `grasp` close on what is seen at `percept`, by way of
/// a place before it.
pub(crate) fn approach(
    limits: &PathLimits,
    stops: &[Isometry3<f64>],
    grasp: &Grasp,
    percept: &Percept,
) -> Result<PosePath, ExecutiveError> {
    let target = grasp.palm_pose(&percept.position, percept.yaw);
    let before = grasp.pregrasp_pose(&target, APPROACH_DISTANCE);
    let mut waypoints: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(stops.len() + 2);
    for pose in stops.iter().chain([&before]) {
        let time = waypoints.last().map_or(0.0, |(_, last)| duration(limits, last, pose));
        waypoints.push((time, *pose));
    }
    waypoints.push((duration(&limits.scaled(0.6), &before, &target), target));
    Ok(PosePath::new(waypoints)?)
}
