//! The seven joints of a Gen3 and their measured quantities.

/// Number of joints.
pub const JOINTS: usize = 7;

/// Measured motion of all joints, from the base on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointMotion {
    /// Joint angles, rad, not wrapped.
    pub position: [f64; JOINTS],
    /// Joint speeds, rad/s.
    pub velocity: [f64; JOINTS],
    /// Joint torques, N m.
    pub torque: [f64; JOINTS],
}

/// Pose of the tool in the arm's base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolPose {
    /// Position, m.
    pub position: [f64; 3],
    /// Rotations about the base's x, y and z axes, in this order, rad.
    pub angles: [f64; 3],
}
