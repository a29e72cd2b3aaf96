//! Service 3, the cyclic exchange: one command to all joints, one answer from all of them.

/// What the joints are asked to do.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Command {
    /// Counts up with every command, in 16 bits.
    #[prost(fixed32, tag = "1")]
    pub frame_id: u32,
    /// One per joint, in order.
    #[prost(message, repeated, tag = "2")]
    pub actuators: Vec<ActuatorCommand>,
}

/// What one joint is asked to do. (Speed, torque and current, which position mode does not read, are not declared.)
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct ActuatorCommand {
    /// The frame's number again.
    #[prost(fixed32, tag = "1")]
    pub command_id: u32,
    /// [`SERVO_ENABLE`] to be followed.
    #[prost(fixed32, tag = "2")]
    pub flags: u32,
    /// Degrees.
    #[prost(float, tag = "3")]
    pub position: f32,
}

/// [`ActuatorCommand::flags`]: the joint follows the command.
pub const SERVO_ENABLE: u32 = 1;

/// What the arm answers.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Feedback {
    /// Number of the command it answers.
    #[prost(fixed32, tag = "1")]
    pub frame_id: u32,
    #[prost(message, optional, tag = "2")]
    pub base: Option<BaseFeedback>,
    /// One per joint, in order.
    #[prost(message, repeated, tag = "3")]
    pub actuators: Vec<ActuatorFeedback>,
}

/// What the base reports.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct BaseFeedback {
    /// What the arm is doing.
    #[prost(enumeration = "super::ArmState", tag = "2")]
    pub active_state: i32,
    /// V.
    #[prost(float, tag = "3")]
    pub arm_voltage: f32,
    /// A.
    #[prost(float, tag = "4")]
    pub arm_current: f32,
    /// Faults; see [`crate::safety_bank::BASE`].
    #[prost(fixed32, tag = "31")]
    pub fault_bank_a: u32,
    /// Faults, second word; no bit of it is named.
    #[prost(fixed32, tag = "32")]
    pub fault_bank_b: u32,
    /// Warnings, the same bits.
    #[prost(fixed32, tag = "33")]
    pub warning_bank_a: u32,
    /// Warnings, second word.
    #[prost(fixed32, tag = "34")]
    pub warning_bank_b: u32,
}

/// What a joint reports.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct ActuatorFeedback {
    /// Number of the command it answers.
    #[prost(fixed32, tag = "1")]
    pub command_id: u32,
    /// Brake, servoing, calibration; not interpreted.
    #[prost(fixed32, tag = "2")]
    pub status_flags: u32,
    /// Communication jitter, us.
    #[prost(fixed32, tag = "3")]
    pub jitter: u32,
    /// Degrees, 0 to 360.
    #[prost(float, tag = "4")]
    pub position: f32,
    /// Degrees per second.
    #[prost(float, tag = "5")]
    pub velocity: f32,
    /// N m.
    #[prost(float, tag = "6")]
    pub torque: f32,
    /// A.
    #[prost(float, tag = "7")]
    pub current: f32,
    /// V.
    #[prost(float, tag = "8")]
    pub voltage: f32,
    /// Hottest motor phase, degrees Celsius.
    #[prost(float, tag = "9")]
    pub motor_temperature: f32,
    /// Processor, degrees Celsius.
    #[prost(float, tag = "10")]
    pub core_temperature: f32,
    /// Faults; see [`crate::safety_bank::ACTUATOR`].
    #[prost(fixed32, tag = "11")]
    pub fault_bank_a: u32,
    /// Faults, second word; no bit of it is named.
    #[prost(fixed32, tag = "12")]
    pub fault_bank_b: u32,
    /// Warnings, the same bits.
    #[prost(fixed32, tag = "13")]
    pub warning_bank_a: u32,
    /// Warnings, second word.
    #[prost(fixed32, tag = "14")]
    pub warning_bank_b: u32,
}
