//! Services 9, 10 and 23: the devices of the arm, their serial numbers, safeties and control modes.

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum DeviceType {
    /// Not specified.
    Unspecified = 0,
    Base = 1,
    /// The camera in the wrist.
    Vision = 2,
    /// A big joint.
    BigActuator = 3,
    /// A small joint.
    SmallActuator = 4,
    /// The interface that the hand is plugged into.
    Interconnect = 5,
    /// The maker's gripper.
    Gripper = 6,
    /// A medium joint.
    MediumActuator = 7,
    /// A very big joint.
    ExtraBigActuator = 8,
}

impl DeviceType {
    /// True if the device moves a joint of the arm.
    pub fn is_actuator(self) -> bool {
        matches!(self, Self::BigActuator | Self::SmallActuator | Self::MediumActuator | Self::ExtraBigActuator)
    }
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct DeviceHandles {
    /// The devices, in no particular order.
    #[prost(message, repeated, tag = "1")]
    pub devices: Vec<DeviceHandle>,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct DeviceHandle {
    #[prost(enumeration = "DeviceType", tag = "1")]
    pub device_type: i32,
    /// Address of the device in a frame's header.
    #[prost(uint32, tag = "2")]
    pub identifier: u32,
    /// Position in the arm, counted from the base.
    #[prost(uint32, tag = "3")]
    pub order: u32,
}

/// A device's serial number.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct SerialNumber {
    /// Serial number as printed on the device.
    #[prost(string, tag = "1")]
    pub serial_number: String,
}

/// Control mode of a joint: the quantity that it follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ControlMode {
    /// Follows no commands.
    None = 0,
    /// Follows position commands.
    Position = 1,
    /// Follows speed commands.
    Velocity = 2,
    /// Follows torque commands.
    Torque = 3,
    /// Follows current commands.
    Current = 4,
    /// A mode of the maker's own.
    Custom = 5,
    /// Follows torque commands at high speed.
    TorqueHighVelocity = 6,
}

/// A joint's control mode.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ControlModeInformation {
    #[prost(enumeration = "ControlMode", tag = "1")]
    pub mode: i32,
}

/// Change of a safety.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct SafetyNotification {
    #[prost(message, optional, tag = "1")]
    pub safety: Option<SafetyHandle>,
    /// New status.
    #[prost(enumeration = "SafetyStatus", tag = "2")]
    pub status: i32,
}

/// A safety of a device.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct SafetyHandle {
    /// Bit of the safety in the device's bank.
    #[prost(uint32, tag = "1")]
    pub identifier: u32,
}

/// Status of a safety.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum SafetyStatus {
    /// Not specified.
    Unspecified = 0,
    /// The quantity is near its limit.
    Warning = 1,
    /// The quantity is over its limit.
    Error = 2,
    /// The quantity is within its limits.
    Normal = 3,
}

/// Type of a device.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct DeviceTypeInformation {
    #[prost(enumeration = "DeviceType", tag = "1")]
    pub device_type: i32,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct FirmwareVersion {
    /// Firmware version, in the maker's encoding.
    #[prost(uint32, tag = "1")]
    pub firmware_version: u32,
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ModelNumber {
    /// Model number, at most 24 bytes.
    #[prost(string, tag = "1")]
    pub model_number: String,
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct PartNumber {
    /// Part number, at most 24 bytes.
    #[prost(string, tag = "1")]
    pub part_number: String,
}
