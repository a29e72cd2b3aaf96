//! Services 9, 10 and 23: the devices of the arm, their serial numbers, safeties and control modes.

include!("generated/device.rs");

impl DeviceType {
    /// True if the device moves a joint of the arm.
    pub fn is_actuator(self) -> bool {
        matches!(self, Self::BigActuator | Self::SmallActuator | Self::MediumActuator | Self::ExtraBigActuator)
    }
}
