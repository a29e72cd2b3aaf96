//! Services 9, 10 and 23: which devices the arm consists of, their serial numbers, safeties and control modes.

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum DeviceType {
    /// Not said.
    Unspecified = 0,
    Base = 1,
    /// The camera in the wrist.
    Vision = 2,
    /// A big joint.
    BigActuator = 3,
    /// A small joint.
    SmallActuator = 4,
    /// What the hand is plugged into.
    Interconnect = 5,
    /// The maker's gripper.
    Gripper = 6,
    /// A medium joint.
    MediumActuator = 7,
    /// A very big joint.
    ExtraBigActuator = 8,
}

impl DeviceType {
    /// Whether it moves a joint of the arm.
    pub fn is_actuator(self) -> bool {
        matches!(self, Self::BigActuator | Self::SmallActuator | Self::MediumActuator | Self::ExtraBigActuator)
    }
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct DeviceHandles {
    /// In no order of note.
    #[prost(message, repeated, tag = "1")]
    pub devices: Vec<DeviceHandle>,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct DeviceHandle {
    #[prost(enumeration = "DeviceType", tag = "1")]
    pub device_type: i32,
    /// Its address in a frame's header.
    #[prost(uint32, tag = "2")]
    pub identifier: u32,
    /// Where in the arm it is, from the base on.
    #[prost(uint32, tag = "3")]
    pub order: u32,
}

/// A device's serial number.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct SerialNumber {
    /// As printed.
    #[prost(string, tag = "1")]
    pub serial_number: String,
}

/// What a joint follows: torque, speed, position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ControlMode {
    /// Nothing.
    None = 0,
    /// Position commands.
    Position = 1,
    /// Speed commands.
    Velocity = 2,
    /// Torque commands.
    Torque = 3,
    /// Current commands.
    Current = 4,
    /// Something of the maker's own.
    Custom = 5,
    /// Torque commands at high speed.
    TorqueHighVelocity = 6,
}

/// A joint's control mode.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ControlModeInformation {
    #[prost(enumeration = "ControlMode", tag = "1")]
    pub mode: i32,
}

/// A safety changed.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct SafetyNotification {
    #[prost(message, optional, tag = "1")]
    pub safety: Option<SafetyHandle>,
    /// To what.
    #[prost(enumeration = "SafetyStatus", tag = "2")]
    pub status: i32,
}

/// A safety of a device.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct SafetyHandle {
    /// Its bit in the device's bank.
    #[prost(uint32, tag = "1")]
    pub identifier: u32,
}

/// How a safety stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum SafetyStatus {
    /// Not said.
    Unspecified = 0,
    /// Near the limit.
    Warning = 1,
    /// Over it.
    Error = 2,
    /// Fine.
    Normal = 3,
}

/// What kind of device answers.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct DeviceTypeInformation {
    #[prost(enumeration = "DeviceType", tag = "1")]
    pub device_type: i32,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct FirmwareVersion {
    /// As the maker counts it.
    #[prost(uint32, tag = "1")]
    pub firmware_version: u32,
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ModelNumber {
    /// At most 24 bytes.
    #[prost(string, tag = "1")]
    pub model_number: String,
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct PartNumber {
    /// At most 24 bytes.
    #[prost(string, tag = "1")]
    pub part_number: String,
}
