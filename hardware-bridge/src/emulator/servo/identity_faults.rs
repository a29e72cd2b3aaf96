//! A wrong servo: of another model, or with the id of another servo.

use dynamixel_bus::xc330;

use super::EmulatedServo;

/// XL330-M288-T: the same plug and control table, a plastic gear and half the torque.
const XL330_MODEL: i64 = 1200;

impl EmulatedServo {
    /// Turns the servo into one of another model.
    pub fn become_other_model(&mut self) {
        self.set(&xc330::MODEL_NUMBER, XL330_MODEL);
    }

    /// Gives the servo another id.
    pub fn set_id(&mut self, id: u8) {
        self.set(&xc330::ID, id.into());
    }
}
