//! Devices of the emulated arm: four big joints, three small ones, base and wrist interface.

use prost::Message;

use super::refusals::{INVALID_DEVICE, No};
use crate::call::{self, Call};
use crate::joints::JOINTS;
use crate::message::device::{
    DeviceHandle, DeviceHandles, DeviceType, DeviceTypeInformation, FirmwareVersion, ModelNumber, PartNumber,
    SerialNumber,
};

/// Firmware version that the maker has never used.
const FIRMWARE: u32 = 0x0E00_0000;

/// Returns the devices, deliberately not in the order of the chain.
fn devices() -> DeviceHandles {
    let joint = |n: u32| (if n <= 4 { DeviceType::BigActuator } else { DeviceType::SmallActuator }, n, n);
    let others = [(DeviceType::Interconnect, 8, 8), (DeviceType::Base, 0, 0)];
    let devices = others.into_iter().chain((1..=JOINTS as u32).rev().map(joint));
    let handle = |(device_type, identifier, order)| DeviceHandle { device_type: device_type as i32, identifier, order };
    DeviceHandles { devices: devices.map(handle).collect() }
}

/// Answers calls about devices; `None` for another call.
pub(super) fn device_call(call: Call, device: u8) -> Option<Result<Vec<u8>, No>> {
    let devices = devices();
    if call == call::READ_ALL_DEVICES {
        return Some(Ok(devices.encode_to_vec()));
    }
    let found = devices.devices.iter().find(|handle| handle.identifier == u32::from(device));
    let answer: fn(u8, i32) -> Vec<u8> = match call {
        call::GET_SERIAL_NUMBER => |n, _| SerialNumber { serial_number: format!("EMULATED-{n}") }.encode_to_vec(),
        call::GET_DEVICE_TYPE => |_, device_type| DeviceTypeInformation { device_type }.encode_to_vec(),
        call::GET_FIRMWARE_VERSION => |_, _| FirmwareVersion { firmware_version: FIRMWARE }.encode_to_vec(),
        call::GET_MODEL_NUMBER => |_, _| ModelNumber { model_number: "EMULATED-GEN3".to_owned() }.encode_to_vec(),
        call::GET_PART_NUMBER => |n, _| PartNumber { part_number: format!("EMULATED-PART-{n}") }.encode_to_vec(),
        _ => return None,
    };
    Some(found.map(|handle| answer(device, handle.device_type)).ok_or(INVALID_DEVICE))
}
