//! Actions: motions that the arm plans and carries out by itself. Their end or abort is reported as a
//! [`super::Notification::Action`], not by the answer to the call that began them.

use super::Base;
use crate::call::{self, Call};
use crate::degrees;
use crate::error::{CommandError, KortexError};
use crate::joints::JOINTS;
use crate::message::action::{
    Action as ActionMessage, ActionHandle, ActionList, ActionType, ConstrainedJointAngles, JointConstraint,
    JointConstraintType, RequestedActionType,
};
use crate::message::base::{JointAngle, JointAngles};
use crate::message::{Empty, NotificationHandle, NotificationOptions};

/// An action that the arm stores.
#[derive(Debug, Clone, PartialEq)]
pub struct Action {
    /// Number of the action.
    pub id: u32,
    /// Name on the arm's web page.
    pub name: String,
    /// Type of the action.
    pub kind: ActionType,
    /// Target of a [`ActionType::ReachJointAngles`]: rad, each within half a turn of 0.
    pub posture: Option<[f64; JOINTS]>,
}

impl Base {
    /// Returns the stored actions of this kind, or all for [`ActionType::Unspecified`].
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn actions(&mut self, kind: ActionType) -> Result<Vec<Action>, KortexError> {
        let argument = RequestedActionType { action_type: kind as i32 };
        let list: ActionList = self.session.call(call::READ_ALL_ACTIONS, 0, &argument)?;
        Ok(list.actions.iter().map(read).collect())
    }

    /// Returns the stored action `id`.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`]; refused if there is none.
    pub fn action(&mut self, id: u32) -> Result<Action, KortexError> {
        let action: ActionMessage = self.session.call(call::READ_ACTION, 0, &handle(id))?;
        Ok(read(&action))
    }

    /// Begins the action `id`. It continues without this host, for as long as the session lasts.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`]; refused in fault and in low-level servoing.
    pub fn execute_action(&mut self, id: u32) -> Result<(), KortexError> {
        self.session.call::<Empty>(call::EXECUTE_ACTION_FROM_REFERENCE, 0, &handle(id)).map(|_| ())
    }

    /// Begins a motion to `posture` (rad), within `duration` (s) or at the arm's own speed.
    ///
    /// # Errors
    /// [`CommandError`] before anything is sent; otherwise as [`Base::execute_action`].
    pub fn reach_joint_angles(&mut self, posture: &[f64; JOINTS], duration: Option<f64>) -> Result<(), KortexError> {
        for (i, &found) in posture.iter().enumerate() {
            if !found.is_finite() {
                return Err(CommandError::NotFinite { joint: i + 1, found }.into());
            }
        }
        let joints = (0..).zip(posture.map(degrees::to_wire_angle)).map(|(joint, value)| JointAngle { joint, value });
        let constraint =
            duration.map(|s| JointConstraint { kind: JointConstraintType::Duration as i32, value: s as f32 });
        let angles = Some(JointAngles { joints: joints.collect() });
        let action = ActionMessage {
            handle: Some(handle(0)),
            name: String::new(),
            reach_joint_angles: Some(ConstrainedJointAngles { angles, constraint }),
        };
        self.session.call::<Empty>(call::EXECUTE_ACTION, 0, &action).map(|_| ())
    }

    /// Stops the action; it cannot be resumed.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn stop_action(&mut self) -> Result<(), KortexError> {
        self.plain(call::STOP_ACTION)
    }

    /// Pauses the action until [`Base::resume_action`].
    ///
    /// # Errors
    /// As [`crate::session::Session::call`]; refused if there is none.
    pub fn pause_action(&mut self) -> Result<(), KortexError> {
        self.plain(call::PAUSE_ACTION)
    }

    /// Resumes a paused action.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`]; refused if there is none.
    pub fn resume_action(&mut self) -> Result<(), KortexError> {
        self.plain(call::RESUME_ACTION)
    }

    /// Subscribes to the progress of actions.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn subscribe_to_actions(&mut self) -> Result<(), KortexError> {
        let topic = call::ACTION_TOPIC;
        let handle: NotificationHandle = self.session.call(topic, 0, &NotificationOptions::EVENTS)?;
        self.subscriptions.push((topic, 0, handle.identifier as u16));
        Ok(())
    }

    fn plain(&mut self, call: Call) -> Result<(), KortexError> {
        self.ask::<Empty>(call).map(|_| ())
    }
}

fn handle(identifier: u32) -> ActionHandle {
    ActionHandle { identifier, action_type: ActionType::ReachJointAngles as i32, permission: 0 }
}

fn read(message: &ActionMessage) -> Action {
    let handle = message.handle.unwrap_or_default();
    let joints = message.reach_joint_angles.as_ref().and_then(|wanted| wanted.angles.as_ref());
    let posture = joints.and_then(|angles| {
        let mut posture = [f64::NAN; JOINTS];
        for angle in &angles.joints {
            *posture.get_mut(angle.joint as usize)? = degrees::nearest_turn(degrees::to_radians(angle.value), 0.0);
        }
        posture.iter().all(|angle| angle.is_finite()).then_some(posture)
    });
    Action { id: handle.identifier, name: message.name.clone(), kind: handle.action_type(), posture }
}
