//! Registered writes, which wait for an action instruction.

use dynamixel_bus::protocol2::ServoError;
use dynamixel_bus::xc330;

use super::EmulatedServo;

impl EmulatedServo {
    /// Registers a write for [`EmulatedServo::execute_registered`], in place of an earlier one. Invalid writes are
    /// rejected on registration; the e-Manual does not state when.
    pub fn register_write(&mut self, address: u16, data: &[u8]) -> Result<(), ServoError> {
        self.decode_write(address, data)?;
        self.registered = Some((address, data.to_vec()));
        self.set(&xc330::REGISTERED_INSTRUCTION, 1);
        Ok(())
    }

    /// Executes the registered write. Without one, returns an instruction error, as the e-Manual states.
    pub fn execute_registered(&mut self) -> Result<(), ServoError> {
        let (address, data) = self.registered.clone().ok_or(ServoError::Instruction)?;
        self.clear_registered();
        self.write(address, &data)
    }

    /// Forgets the registered write, as at power-up.
    pub(super) fn clear_registered(&mut self) {
        self.registered = None;
        self.set(&xc330::REGISTERED_INSTRUCTION, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_write_waits_and_a_restart_forgets_it() {
        let mut servo = EmulatedServo::provisioned(1, 0);
        assert_eq!(servo.execute_registered(), Err(ServoError::Instruction));
        assert_eq!(servo.register_write(xc330::PRESENT_CURRENT.address, &[0, 0]), Err(ServoError::Access));
        servo.register_write(xc330::GOAL_CURRENT.address, &[50, 0]).expect("waits");
        servo.register_write(xc330::GOAL_CURRENT.address, &[40, 0]).expect("replaces it");
        servo.execute_registered().expect("done");
        assert_eq!(servo.read(xc330::GOAL_CURRENT.address, 2), Ok(vec![40, 0]));
        servo.register_write(xc330::GOAL_CURRENT.address, &[30, 0]).expect("waits");
        servo.reboot(0.0);
        assert_eq!(servo.execute_registered(), Err(ServoError::Instruction));
        assert_eq!(servo.read(xc330::REGISTERED_INSTRUCTION.address, 1), Ok(vec![0]));
    }
}
