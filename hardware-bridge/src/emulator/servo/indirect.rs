//! Indirect addressing: a data area whose bytes are aliases of bytes elsewhere in the control table.

use dynamixel_bus::protocol2::ServoError;
use dynamixel_bus::register::Register;
use dynamixel_bus::xc330::{self, Indirect};

use super::EmulatedServo;

/// First address that may be pointed at: the first in RAM.
const MIN_TARGET_ADDRESS: u16 = xc330::TORQUE_ENABLE.address;

/// One change that a write makes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum MemoryWrite {
    /// A register and its value, in counts.
    Register(&'static Register, i64),
    /// A byte of the data area, by its slot number, and the address that it is to point at.
    Pointer(u16, u16),
    /// An address inside the data area, and the byte to store there.
    Byte(u16, u8),
}

impl EmulatedServo {
    fn indirect(&self) -> Indirect {
        Indirect::for_firmware(self.get(&xc330::FIRMWARE_VERSION) as u8)
    }

    /// Returns the address that slot number `slot` of the data area points at.
    fn target(&self, slot: u16) -> u16 {
        let place = usize::from(Indirect::ADDRESS_AREA_START + 2 * slot);
        u16::from_le_bytes([self.memory[place], self.memory[place + 1]])
    }

    pub(super) fn set_pointer(&mut self, slot: u16, target: u16) {
        let place = usize::from(Indirect::ADDRESS_AREA_START + 2 * slot);
        self.memory[place..place + 2].copy_from_slice(&target.to_le_bytes());
    }

    /// Resolves an address: the target of a byte in the data area, or `address` itself elsewhere.
    pub(super) fn resolve_address(&self, address: u16) -> u16 {
        let Indirect { data, slots } = self.indirect();
        if (data..data + slots).contains(&address) { self.target(address - data) } else { address }
    }

    /// Resets the pointers as at power-up: every byte of the data area points at itself.
    pub(super) fn reset_pointers(&mut self) {
        let Indirect { data, slots } = self.indirect();
        for slot in 0..slots {
            self.set_pointer(slot, data + slot);
            self.memory[usize::from(data + slot)] = 0;
        }
    }

    /// Returns the changes that a write would make, or the error with which it is refused. Only whole registers can be
    /// written, also by way of the data area (interpretation).
    pub(super) fn decode_write(&self, address: u16, data: &[u8]) -> Result<Vec<MemoryWrite>, ServoError> {
        let area = self.indirect();
        let (mut place, mut rest, mut changes) = (address, data, Vec::new());
        while let Some(&byte) = rest.first() {
            let taken =
                if (Indirect::ADDRESS_AREA_START..Indirect::ADDRESS_AREA_START + 2 * area.slots).contains(&place) {
                    changes.push(decode_pointer(area, place, rest)?);
                    2
                } else if (area.data..area.data + area.slots).contains(&place) {
                    let target = self.resolve_address(place);
                    if (area.data..area.data + area.slots).contains(&target) {
                        changes.push(MemoryWrite::Byte(target, byte));
                        1
                    } else {
                        let run = self.contiguous_run(area, place, rest.len() as u16);
                        changes.extend(self.decode_register_writes(target, &rest[..usize::from(run)])?);
                        run
                    }
                } else {
                    let before_area = Indirect::ADDRESS_AREA_START.saturating_sub(place);
                    let run = if before_area == 0 { rest.len() } else { rest.len().min(before_area.into()) };
                    changes.extend(self.decode_register_writes(place, &rest[..run])?);
                    run as u16
                };
            rest = &rest[usize::from(taken)..];
            place += taken;
        }
        Ok(changes)
    }

    /// Returns the number of bytes of the data area from `place` on, at most `most`, that point at consecutive
    /// addresses.
    fn contiguous_run(&self, area: Indirect, place: u16, most: u16) -> u16 {
        let target = self.resolve_address(place);
        let most = most.min(area.data + area.slots - place);
        (1..most).find(|n| self.resolve_address(place + n) != target + n).unwrap_or(most)
    }
}

/// Decodes a write to the stored addresses.
fn decode_pointer(area: Indirect, place: u16, rest: &[u8]) -> Result<MemoryWrite, ServoError> {
    let offset = place - Indirect::ADDRESS_AREA_START;
    let [low, high] = *rest.first_chunk::<2>().filter(|_| offset.is_multiple_of(2)).ok_or(ServoError::DataLength)?;
    let target = u16::from_le_bytes([low, high]);
    let pointable = MIN_TARGET_ADDRESS..Indirect::ADDRESS_AREA_START;
    let itself = area.data..area.data + area.slots;
    if !pointable.contains(&target) && !itself.contains(&target) {
        return Err(ServoError::DataRange);
    }
    Ok(MemoryWrite::Pointer(offset / 2, target))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn addresses(servo: &mut EmulatedServo, slot: u16, targets: &[u16]) -> Result<(), ServoError> {
        let bytes: Vec<u8> = targets.iter().flat_map(|target| target.to_le_bytes()).collect();
        servo.write(Indirect::ADDRESS_AREA_START + 2 * slot, &bytes)
    }

    fn registers(all: &[Register]) -> Vec<u16> {
        all.iter().flat_map(|register| register.address..register.address + u16::from(register.size)).collect()
    }

    /// Set up as by ROBOTIS' ROS 2 interface: goals in the first slots, measurements in those from the seventh on.
    #[test]
    fn goals_and_measurements_are_where_the_firmware_has_them() {
        for (firmware, data) in [(46, 224), (51, 224), (52, 208)] {
            let mut servo = EmulatedServo::provisioned(1, 0).with_firmware(firmware);
            let goals = registers(&[xc330::GOAL_POSITION, xc330::GOAL_CURRENT]);
            addresses(&mut servo, 0, &goals).expect("set up");
            let shown = registers(&[xc330::PRESENT_INPUT_VOLTAGE, xc330::HARDWARE_ERROR_STATUS]);
            addresses(&mut servo, 6, &shown).expect("set up");
            let mut command = 1000_i32.to_le_bytes().to_vec();
            command.extend(120_i16.to_le_bytes());
            servo.write(data, &command).expect("written");
            assert_eq!(servo.read(xc330::GOAL_POSITION.address, 4), Ok(command[..4].to_vec()), "firmware {firmware}");
            assert_eq!(servo.read(xc330::GOAL_CURRENT.address, 2), Ok(command[4..].to_vec()));
            assert_eq!(servo.read(data, 6), Ok(command));
            assert_eq!(servo.read(data + 6, 3), Ok(vec![111, 0, 0]), "11.1 V and no error");
        }
    }

    /// A write that is refused directly is refused by way of the data area too, and then nothing is written.
    #[test]
    fn refusals_reach_through() {
        let mut servo = EmulatedServo::provisioned(1, 0);
        let targets = registers(&[xc330::GOAL_CURRENT, xc330::PRESENT_CURRENT]);
        addresses(&mut servo, 0, &targets).expect("set up");
        let before = servo.read(xc330::GOAL_CURRENT.address, 2);
        assert_eq!(servo.write(224, &[50, 0, 0, 0]), Err(ServoError::Access), "a measurement");
        assert_eq!(servo.write(224, &[50]), Err(ServoError::DataLength), "half a register");
        assert_eq!(servo.read(xc330::GOAL_CURRENT.address, 2), before);
        assert_eq!(addresses(&mut servo, 0, &[11]), Err(ServoError::DataRange), "EEPROM");
        assert_eq!(servo.write(Indirect::ADDRESS_AREA_START, &[64]), Err(ServoError::DataLength));
    }

    /// Bytes that point at themselves keep what is written, and a restart forgets all of it.
    #[test]
    fn bytes_of_their_own_and_a_restart() {
        let mut servo = EmulatedServo::provisioned(1, 0);
        servo.write(224, &[1, 2, 3]).expect("kept");
        assert_eq!(servo.read(224, 3), Ok(vec![1, 2, 3]));
        addresses(&mut servo, 1, &[xc330::LED.address]).expect("set up");
        servo.write(224, &[7, 1, 9]).expect("one of them is the LED");
        assert_eq!(servo.read(xc330::LED.address, 1), Ok(vec![1]));
        servo.reboot(0.0);
        assert_eq!(servo.read(224, 3), Ok(vec![0, 0, 0]));
        assert_eq!(servo.read(Indirect::ADDRESS_AREA_START, 4), Ok(vec![224, 0, 225, 0]));
    }
}
