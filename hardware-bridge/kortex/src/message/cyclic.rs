//! Service 3, the cyclic exchange: one command to all joints, one answer from all of them.

/// Command to all joints.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Command {
    /// Frame number, which counts up with every command, in 16 bits.
    #[prost(fixed32, tag = "1")]
    pub frame_id: u32,
    /// Commands, one per joint, in order.
    #[prost(message, repeated, tag = "2")]
    pub actuators: Vec<ActuatorCommand>,
}

/// Command to one joint. (Speed, torque and current, which position mode does not read, are not declared.)
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct ActuatorCommand {
    /// Frame number, repeated.
    #[prost(fixed32, tag = "1")]
    pub command_id: u32,
    /// Flags: [`SERVO_ENABLE`] to follow the command.
    #[prost(fixed32, tag = "2")]
    pub flags: u32,
    /// Position, degrees.
    #[prost(float, tag = "3")]
    pub position: f32,
}

/// Flag of [`ActuatorCommand::flags`]: the joint follows the command.
pub const SERVO_ENABLE: u32 = 1;

/// Answer of the arm to a command.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Feedback {
    /// Number of the command that it answers.
    #[prost(fixed32, tag = "1")]
    pub frame_id: u32,
    #[prost(message, optional, tag = "2")]
    pub base: Option<BaseFeedback>,
    /// Reports, one per joint, in order.
    #[prost(message, repeated, tag = "3")]
    pub actuators: Vec<ActuatorFeedback>,
}

/// Report of the base.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct BaseFeedback {
    /// Operating state of the arm.
    #[prost(enumeration = "super::ArmState", tag = "2")]
    pub active_state: i32,
    /// Supply voltage of the arm, V.
    #[prost(float, tag = "3")]
    pub arm_voltage: f32,
    /// Supply current of the arm, A.
    #[prost(float, tag = "4")]
    pub arm_current: f32,
    /// Faults; see [`crate::safety_bank::BASE`].
    #[prost(fixed32, tag = "31")]
    pub fault_bank_a: u32,
    /// Faults, second word; its bits have no published names.
    #[prost(fixed32, tag = "32")]
    pub fault_bank_b: u32,
    /// Warnings, the same bits.
    #[prost(fixed32, tag = "33")]
    pub warning_bank_a: u32,
    /// Warnings, second word.
    #[prost(fixed32, tag = "34")]
    pub warning_bank_b: u32,
}

/// Report of a joint.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct ActuatorFeedback {
    /// Number of the command that it answers.
    #[prost(fixed32, tag = "1")]
    pub command_id: u32,
    /// Status flags of brake, servoing and calibration; not interpreted.
    #[prost(fixed32, tag = "2")]
    pub status_flags: u32,
    /// Communication jitter, us.
    #[prost(fixed32, tag = "3")]
    pub jitter: u32,
    /// Position, degrees, 0 to 360.
    #[prost(float, tag = "4")]
    pub position: f32,
    /// Speed, degrees per second.
    #[prost(float, tag = "5")]
    pub velocity: f32,
    /// Torque, N m.
    #[prost(float, tag = "6")]
    pub torque: f32,
    /// Motor current, A.
    #[prost(float, tag = "7")]
    pub current: f32,
    /// Supply voltage, V.
    #[prost(float, tag = "8")]
    pub voltage: f32,
    /// Temperature of the hottest motor phase, degrees Celsius.
    #[prost(float, tag = "9")]
    pub motor_temperature: f32,
    /// Temperature of the processor, degrees Celsius.
    #[prost(float, tag = "10")]
    pub core_temperature: f32,
    /// Faults; see [`crate::safety_bank::ACTUATOR`].
    #[prost(fixed32, tag = "11")]
    pub fault_bank_a: u32,
    /// Faults, second word; its bits have no published names.
    #[prost(fixed32, tag = "12")]
    pub fault_bank_b: u32,
    /// Warnings, the same bits.
    #[prost(fixed32, tag = "13")]
    pub warning_bank_a: u32,
    /// Warnings, second word.
    #[prost(fixed32, tag = "14")]
    pub warning_bank_b: u32,
}
