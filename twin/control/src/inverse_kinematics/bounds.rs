//! Joint speed bounds of a tick, combined from speed, acceleration and position limits.

use hand_model::Arm;

use super::{IkSettings, JointVector, Joints};

/// Lowest and highest speed of every joint, rad/s; never empty, 0 beyond the last joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpeedBounds {
    pub lower: JointVector,
    pub upper: JointVector,
}

/// Speed bounds for a tick of `dt` (s) from joint angles `q` (rad) and speeds `qd` (rad/s).
///
/// A joint that starts within its limits and obeys the bounds stays within them: braking with a preserves v dt + v^2 /
/// 2a <= distance to the limit. A joint that starts outside (after a change of `dt` or of the limits) brakes as hard as
/// it may.
pub(crate) fn speed_bounds(arm: &Arm, settings: &IkSettings, q: &Joints, qd: &Joints, dt: f64) -> SpeedBounds {
    let mut bounds = SpeedBounds { lower: JointVector::zeros(), upper: JointVector::zeros() };
    for i in 0..arm.joints() {
        let speed = arm.velocity_limits[i] * settings.joint_speed_share;
        let change = arm.acceleration_limits[i] * settings.joint_acceleration_share * dt;
        let joint = &arm.tree.joints[i];
        let margin = settings.joint_margin;
        // Greatest v with v dt + v^2 / 2a <= room.
        let brakeable = |room: f64| {
            if room <= 0.0 { 0.0 } else { -change + (change * change + 2.0 * change / dt * room).sqrt() }
        };
        let (least, most) = (qd[i] - change, qd[i] + change);
        let upper = speed.min(brakeable(joint.upper - margin - q[i]));
        let lower = -speed.min(brakeable(q[i] - joint.lower - margin));
        bounds.upper[i] = upper.clamp(least, most);
        bounds.lower[i] = lower.clamp(least, most).min(bounds.upper[i]);
    }
    bounds
}
