//! Registered writes, which wait for an action instruction.

use super::EmulatedServo;
use crate::protocol2::ServoError;
use crate::xc330;

impl EmulatedServo {
    /// Registers a write for [`EmulatedServo::act`], in place of an earlier one. A write that would be refused is
    /// refused at once (our reading).
    pub fn register(&mut self, address: u16, data: &[u8]) -> Result<(), ServoError> {
        self.plan(address, data)?;
        self.registered = Some((address, data.to_vec()));
        self.set(&xc330::REGISTERED_INSTRUCTION, 1);
        Ok(())
    }

    /// Executes the registered write. Without one, returns an instruction error, as the e-Manual has it.
    pub fn act(&mut self) -> Result<(), ServoError> {
        let (address, data) = self.registered.clone().ok_or(ServoError::Instruction)?;
        self.forget_registered();
        self.write(address, &data)
    }

    /// Forgets the registered write, as at power-up.
    pub(super) fn forget_registered(&mut self) {
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
        assert_eq!(servo.act(), Err(ServoError::Instruction));
        assert_eq!(servo.register(xc330::PRESENT_CURRENT.address, &[0, 0]), Err(ServoError::Access));
        servo.register(xc330::GOAL_CURRENT.address, &[50, 0]).expect("waits");
        servo.register(xc330::GOAL_CURRENT.address, &[40, 0]).expect("replaces it");
        servo.act().expect("done");
        assert_eq!(servo.read(xc330::GOAL_CURRENT.address, 2), Ok(vec![40, 0]));
        servo.register(xc330::GOAL_CURRENT.address, &[30, 0]).expect("waits");
        servo.reboot(0.0);
        assert_eq!(servo.act(), Err(ServoError::Instruction));
        assert_eq!(servo.read(xc330::REGISTERED_INSTRUCTION.address, 1), Ok(vec![0]));
    }
}
