//! The protobuf messages of the calls in [`crate::call`], written by hand from the maker's public definitions
//! (Kinovarobotics/ros_kortex, `kortex_driver/protos`). Units here are the wire's: degrees, degrees per second.
//!
//! Only the fields that this bridge reads or writes are declared. A protobuf reader skips the others.

pub mod action;
pub mod base;
pub mod cyclic;
pub mod device;
pub mod session;

/// An empty argument or result.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct Empty {}

/// Request for notifications.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct NotificationOptions {
    /// Type of notification: 3 is on every event, the only type of the arm.
    #[prost(uint32, tag = "1")]
    pub kind: u32,
}

impl NotificationOptions {
    /// Notifications on every event.
    pub const EVENTS: Self = Self { kind: 3 };
}

/// A subscription.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct NotificationHandle {
    /// Handle of the subscription, which returns as the message number of every notification.
    #[prost(uint32, tag = "1")]
    pub identifier: u32,
}

/// Answer to a refused call.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ErrorMessage {
    /// Error class.
    #[prost(uint32, tag = "1")]
    pub code: u32,
    /// Reason.
    #[prost(uint32, tag = "2")]
    pub sub_code: u32,
    /// Text for people.
    #[prost(string, tag = "3")]
    pub text: String,
}

/// Operating state of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ArmState {
    /// Not specified.
    Unspecified = 0,
    /// The base is starting.
    BaseInitialization = 1,
    /// The base has started, but there is no arm yet.
    Idle = 2,
    /// The arm is starting.
    Initialization = 3,
    /// A fault holds the arm. It accepts no motion until the fault is cleared.
    InFault = 4,
    /// The arm is being serviced.
    Maintenance = 5,
    /// The host drives the arm joint by joint over UDP.
    ServoingLowLevel = 6,
    /// The arm is ready for high-level commands.
    ServoingReady = 7,
    ServoingPlayingSequence = 8,
    /// The arm follows high-level speed commands or a joystick.
    ServoingManuallyControlled = 9,
    /// The brakes are opening.
    BrakeReleasing = 10,
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    /// Field numbers and wire types are those expected, byte by byte.
    #[test]
    fn session_bytes() {
        let message = session::CreateSessionInfo {
            user: "a".to_owned(),
            session_timeout: 60_000,
            password: "b".to_owned(),
            connection_timeout: 2_000,
        };
        let expected = [0x0A, 1, b'a', 0x10, 0xE0, 0xD4, 0x03, 0x1A, 1, b'b', 0x20, 0xD0, 0x0F];
        assert_eq!(message.encode_to_vec(), expected);
    }

    #[test]
    fn error_bytes() {
        let message = ErrorMessage { code: 3, sub_code: 75, text: "x".to_owned() };
        assert_eq!(message.encode_to_vec(), [8, 3, 16, 75, 0x1A, 1, b'x']);
    }

    /// One joint of a cyclic command: fixed words for the number and flags, floats for the rest. 90.0 is 0x42B40000.
    #[test]
    fn cyclic_command_bytes() {
        let actuator = cyclic::ActuatorCommand { command_id: 0x0102, flags: 1, position: 90.0 };
        let message = cyclic::Command { frame_id: 0x0102, actuators: vec![actuator] };
        let expected = [
            0x0D, 0x02, 0x01, 0, 0, // frame
            0x12, 15, // the actuator
            0x0D, 0x02, 0x01, 0, 0, 0x15, 1, 0, 0, 0, 0x1D, 0x00, 0x00, 0xB4, 0x42,
        ];
        assert_eq!(message.encode_to_vec(), expected);
    }

    /// The base's fault bank is field 31, which needs a two-byte key: (31 << 3 | 5) = 253 = FD 01.
    #[test]
    fn feedback_bytes() {
        let base =
            cyclic::BaseFeedback { active_state: ArmState::InFault as i32, fault_bank_a: 0x10, ..Default::default() };
        let message = cyclic::Feedback { frame_id: 0, base: Some(base), actuators: vec![] };
        assert_eq!(message.encode_to_vec(), [0x12, 8, 0x10, 4, 0xFD, 0x01, 0x10, 0, 0, 0]);
    }

    #[test]
    fn joint_speed_bytes() {
        let joint = base::JointSpeed { joint: 6, value: -1.0 };
        let message = base::JointSpeeds { joints: vec![joint] };
        assert_eq!(message.encode_to_vec(), [0x0A, 7, 8, 6, 0x15, 0, 0, 0x80, 0xBF]);
    }

    /// Undeclared fields are skipped: an actuator's answer with an unknown field 99.
    #[test]
    fn unknown_fields_are_ignored() {
        let mut bytes = cyclic::ActuatorFeedback { position: 12.5, ..Default::default() }.encode_to_vec();
        bytes.extend([0x98, 0x06, 0x2A]);
        let message = cyclic::ActuatorFeedback::decode(bytes.as_slice()).expect("decodes");
        assert_eq!(message.position, 12.5);
    }
}
