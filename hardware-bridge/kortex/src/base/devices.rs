//! The devices inside the arm.

use super::Base;
use crate::call;
use crate::error::KortexError;
use crate::joints::JOINTS;
use crate::message::Empty;
use crate::message::device::{
    ControlMode, ControlModeInformation, DeviceHandles, DeviceType, DeviceTypeInformation, FirmwareVersion,
    ModelNumber, PartNumber, SerialNumber,
};

/// A device inside the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Device {
    /// Type of the device.
    pub kind: DeviceType,
    /// Address, for calls such as [`Base::serial_number`].
    pub address: u8,
    /// Position in the chain, counted from the base.
    pub order: u32,
}

impl Base {
    /// Returns the devices that the arm consists of, from the base on.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`]; [`KortexError::Answer`] for an address that fits no header.
    pub fn devices(&mut self) -> Result<Vec<Device>, KortexError> {
        let call = call::READ_ALL_DEVICES;
        let answer: DeviceHandles = self.ask(call)?;
        let mut devices = Vec::new();
        for handle in answer.devices {
            let address = u8::try_from(handle.identifier).map_err(|_| KortexError::Answer {
                call,
                field: "device identifier",
                found: handle.identifier.to_string(),
                expected: "0 to 255".to_owned(),
            })?;
            devices.push(Device { kind: handle.device_type(), address, order: handle.order });
        }
        devices.sort_by_key(|device| device.order);
        Ok(devices)
    }

    /// Returns the addresses of the seven joints, from the base on.
    ///
    /// # Errors
    /// As [`Base::devices`]; [`KortexError::Answer`] if there are not seven.
    pub fn actuators(&mut self) -> Result<[u8; JOINTS], KortexError> {
        let actuators = self.devices()?.into_iter().filter(|device| device.kind.is_actuator());
        let addresses: Vec<u8> = actuators.map(|device| device.address).collect();
        addresses.try_into().map_err(|addresses: Vec<u8>| KortexError::Answer {
            call: call::READ_ALL_DEVICES,
            field: "number of actuators",
            found: addresses.len().to_string(),
            expected: JOINTS.to_string(),
        })
    }

    /// Reads the serial number of a device.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn serial_number(&mut self, device: u8) -> Result<String, KortexError> {
        Ok(self.session.call::<SerialNumber>(call::GET_SERIAL_NUMBER, device, &Empty {})?.serial_number)
    }

    /// Reads the control mode of a joint: the quantity that it follows.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn control_mode(&mut self, actuator: u8) -> Result<ControlMode, KortexError> {
        Ok(self.session.call::<ControlModeInformation>(call::GET_CONTROL_MODE, actuator, &Empty {})?.mode())
    }

    /// Reads the type of a device.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn device_type(&mut self, device: u8) -> Result<DeviceType, KortexError> {
        Ok(self.session.call::<DeviceTypeInformation>(call::GET_DEVICE_TYPE, device, &Empty {})?.device_type())
    }

    /// Reads the firmware version of a device, in the maker's encoding.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn firmware_version(&mut self, device: u8) -> Result<u32, KortexError> {
        Ok(self.session.call::<FirmwareVersion>(call::GET_FIRMWARE_VERSION, device, &Empty {})?.firmware_version)
    }

    /// Reads the model number of a device.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn model_number(&mut self, device: u8) -> Result<String, KortexError> {
        Ok(self.session.call::<ModelNumber>(call::GET_MODEL_NUMBER, device, &Empty {})?.model_number)
    }

    /// Reads the part number of a device.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn part_number(&mut self, device: u8) -> Result<String, KortexError> {
        Ok(self.session.call::<PartNumber>(call::GET_PART_NUMBER, device, &Empty {})?.part_number)
    }
}
