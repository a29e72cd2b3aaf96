//! Notifications that the emulated arm sends unasked.

use prost::Message;

use super::controller::Controller;
use super::peer::Outgoing;
use crate::call;
use crate::message::ArmState;
use crate::message::base::{ArmStateInformation, ServoingModeInformation};
use crate::message::device::{SafetyHandle, SafetyNotification, SafetyStatus};

impl Controller {
    /// Returns the notifications of all changes since the last call.
    pub(super) fn announce(&mut self) -> Vec<Outgoing> {
        let (before, now) = (self.announced, (self.state(), self.mode));
        self.announced = now;
        let mut outgoing = Vec::new();
        for event in std::mem::take(&mut self.action_events) {
            let told = self.subscriptions.iter().filter(|subscription| subscription.topic == call::ACTION_TOPIC);
            outgoing.extend(told.map(|subscription| subscription.notification(event.encode_to_vec())));
        }
        for subscription in &self.subscriptions {
            let payload = match subscription.topic {
                call::ARM_STATE_TOPIC if now.0 != before.0 => {
                    ArmStateInformation { active_state: now.0 as i32 }.encode_to_vec()
                }
                call::SERVOING_MODE_TOPIC if now.1 != before.1 => {
                    ServoingModeInformation { mode: now.1 as i32 }.encode_to_vec()
                }
                call::SAFETY_TOPIC if now.0 != before.0 && ArmState::InFault == now.0 => {
                    let banks = match subscription.device {
                        0 => self.faults.base,
                        joint => self.faults.joints[usize::from(joint) - 1],
                    };
                    // The lowest bit is enough for a notification; the cyclic feedback has all bits.
                    let identifier = banks.a & banks.a.wrapping_neg();
                    if identifier == 0 {
                        continue;
                    }
                    let safety = Some(SafetyHandle { identifier });
                    SafetyNotification { safety, status: SafetyStatus::Error as i32 }.encode_to_vec()
                }
                _ => continue,
            };
            outgoing.push(subscription.notification(payload));
        }
        outgoing
    }
}
