//! Refusals by the arm, including those of requests that cannot be read.

use prost::Message;

use crate::frame::Frame;

/// A refusal: class, reason, text.
pub(super) type No = (u8, u16, &'static str);

pub(super) const UNSUPPORTED_METHOD: No = (1, 5, "method not supported");
pub(super) const INVALID_SESSION: No = (1, 12, "session not recognized");
pub(super) const PAYLOAD: No = (1, 13, "payload cannot be decoded");
pub(super) const WRONG_PASSWORD: No = (1, 15, "wrong password");
pub(super) const UNKNOWN_USER: No = (1, 16, "unknown user");
pub(super) const INVALID_PARAMETER: No = (3, 3, "invalid parameter");
pub(super) const ENTITY_NOT_FOUND: No = (3, 17, "entity not found");
pub(super) const NOT_MOVING: No = (3, 19, "robot not moving");
pub(super) const IN_FAULT: No = (3, 22, "robot in fault");
pub(super) const IN_EMERGENCY_STOP: No = (3, 25, "robot in emergency stop");
pub(super) const IN_LOW_LEVEL: No = (3, 27, "robot in low-level servoing");
pub(super) const UNSUPPORTED_ACTION: No = (3, 46, "action not supported");
pub(super) const INVALID_DEVICE: No = (3, 52, "no such device");
pub(super) const MANUAL_STOP: No = (3, 55, "stopped by a command");
pub(super) const COUNT_MISMATCH: No = (3, 57, "not one entry per actuator");
pub(super) const CANNOT_REACH_SO_SOON: No = (3, 58, "duration too short");
pub(super) const NEGATIVE_SPEED: No = (3, 59, "speed negative");
pub(super) const SPEED_TOO_HIGH: No = (3, 60, "speed too high");
pub(super) const TOO_LONG: No = (3, 63, "trajectory longer than 100 s");
pub(super) const JOINT_LIMIT: No = (3, 65, "joint outside its range");
pub(super) const NO_ACTION: No = (3, 73, "no action to resume");
pub(super) const WRONG_MODE: No = (3, 75, "wrong servoing mode, must be low level servoing mode");

pub(super) fn argument<A: Message + Default>(frame: &Frame) -> Result<A, No> {
    A::decode(frame.payload.as_slice()).map_err(|_| PAYLOAD)
}
