//! Service 3, the cyclic exchange: one command to all joints, one answer from all of them.

include!("generated/cyclic.rs");

/// Flag of [`ActuatorCommand::flags`]: the joint follows the command.
pub const SERVO_ENABLE: u32 = 1;
