//! Service 2, the base: modes, faults, measured angles, joint speeds.

/// Servoing mode: who moves the joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ServoingMode {
    /// Not specified.
    Unspecified = 0,
    /// The base follows high-level commands of one session.
    SingleLevel = 2,
    /// The host commands the joints one by one over UDP.
    LowLevel = 3,
    /// The actuators are commanded directly, bypassing the base.
    Bypass = 4,
}

/// The servoing mode, as argument or as result.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ServoingModeInformation {
    #[prost(enumeration = "ServoingMode", tag = "1")]
    pub mode: i32,
}

/// Number of joints.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ActuatorInformation {
    /// Seven on the arm this bridge drives.
    #[prost(uint32, tag = "1")]
    pub count: u32,
}

/// Operating state of the arm; also the payload of [`crate::call::ARM_STATE_TOPIC`].
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ArmStateInformation {
    #[prost(enumeration = "super::ArmState", tag = "1")]
    pub active_state: i32,
}

/// Measured angles.
#[derive(Clone, PartialEq, prost::Message)]
pub struct JointAngles {
    /// One per joint.
    #[prost(message, repeated, tag = "1")]
    pub joints: Vec<JointAngle>,
}

/// One measured angle.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct JointAngle {
    /// Index of the joint, from 0.
    #[prost(uint32, tag = "1")]
    pub joint: u32,
    /// Angle, degrees.
    #[prost(float, tag = "2")]
    pub value: f32,
}

/// Joint speeds, in force until the next command.
#[derive(Clone, PartialEq, prost::Message)]
pub struct JointSpeeds {
    /// One per joint.
    #[prost(message, repeated, tag = "1")]
    pub joints: Vec<JointSpeed>,
}

/// Speed of one joint. (The maker's message has a duration too, "not implemented yet": it does not end the motion.)
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct JointSpeed {
    /// Index of the joint, from 0.
    #[prost(uint32, tag = "1")]
    pub joint: u32,
    /// Speed, degrees per second.
    #[prost(float, tag = "2")]
    pub value: f32,
}

/// Pose of the tool in the arm's base frame.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct Pose {
    /// Position, m.
    #[prost(float, tag = "1")]
    pub x: f32,
    #[prost(float, tag = "2")]
    pub y: f32,
    #[prost(float, tag = "3")]
    pub z: f32,
    /// Rotation about the base's x axis, degrees; applied first.
    #[prost(float, tag = "4")]
    pub theta_x: f32,
    /// Rotation about the base's y axis, degrees; applied second.
    #[prost(float, tag = "5")]
    pub theta_y: f32,
    /// Rotation about the base's z axis, degrees; applied last.
    #[prost(float, tag = "6")]
    pub theta_z: f32,
}
