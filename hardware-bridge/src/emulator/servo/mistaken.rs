//! A servo in the wrong place: of another model, or with another one's id.

use super::EmulatedServo;
use crate::xc330;

/// XL330-M288-T: the same plug and control table, a plastic gear and half the torque.
const OTHER_MODEL: i64 = 1200;

impl EmulatedServo {
    /// It is of another model from now on.
    pub fn become_other_model(&mut self) {
        self.set(&xc330::MODEL_NUMBER, OTHER_MODEL);
    }

    /// It has another id from now on.
    pub fn set_id(&mut self, id: u8) {
        self.set(&xc330::ID, id.into());
    }
}
