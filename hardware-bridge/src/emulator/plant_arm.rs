//! The emulated Gen3's joints, where they are those of the hand's plant: what the arm's controller wants goes into a shared place, and what the
//! plant's arm does comes back from there.

use std::sync::{Arc, Mutex};

use hand_model::ARM_JOINTS;
use hand_model::robot::ArmState;

use crate::kortex::emulator::{Drive, Plant};
use crate::lock;

/// Between the arm's controller and the plant.
#[derive(Debug, Clone)]
pub struct SharedArm(Arc<Mutex<(ArmState, [f64; ARM_JOINTS])>>);

impl SharedArm {
    /// An arm in this state, which is to stay where it is.
    pub fn at(state: ArmState) -> Self {
        Self(Arc::new(Mutex::new((state, state.position))))
    }

    /// Where the controller wants the joints, rad.
    pub fn goal(&self) -> [f64; ARM_JOINTS] {
        lock(&self.0).1
    }

    /// The plant's arm.
    pub fn state(&self) -> ArmState {
        lock(&self.0).0
    }

    /// What the plant's arm does now.
    pub fn set_state(&self, state: ArmState) {
        lock(&self.0).0 = state;
    }
}

impl Plant for SharedArm {
    fn advance(&mut self, drive: &Drive, seconds: f64) {
        let mut shared = lock(&self.0);
        match drive {
            Drive::Position(target) => shared.1 = *target,
            Drive::Velocity(speed) => {
                for (goal, speed) in shared.1.iter_mut().zip(speed) {
                    *goal += speed * seconds;
                }
            }
            // Where it was last sent: a joint that is held goes no further.
            Drive::Hold => {}
        }
    }

    fn state(&self) -> ArmState {
        lock(&self.0).0
    }
}
