//! Service 2, the base: actions, which are named motions that the arm carries out by itself.

use super::base::JointAngles;

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ActionHandle {
    /// 0 for an action that the arm does not store.
    #[prost(uint32, tag = "1")]
    pub identifier: u32,
    #[prost(enumeration = "ActionType", tag = "2")]
    pub action_type: i32,
    /// Permission bits: 1 read, 2 update, 4 delete.
    #[prost(fixed32, tag = "3")]
    pub permission: u32,
}

/// The types of action that this client distinguishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ActionType {
    /// All types, in a request.
    Unspecified = 0,
    ReachPose = 6,
    ReachJointAngles = 7,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct RequestedActionType {
    #[prost(enumeration = "ActionType", tag = "1")]
    pub action_type: i32,
}

/// An action. Parameters of other types are skipped.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Action {
    #[prost(message, optional, tag = "1")]
    pub handle: Option<ActionHandle>,
    #[prost(string, tag = "2")]
    pub name: String,
    #[prost(message, optional, tag = "10")]
    pub reach_joint_angles: Option<ConstrainedJointAngles>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub struct ActionList {
    #[prost(message, repeated, tag = "1")]
    pub actions: Vec<Action>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub struct ConstrainedJointAngles {
    #[prost(message, optional, tag = "1")]
    pub angles: Option<JointAngles>,
    #[prost(message, optional, tag = "2")]
    pub constraint: Option<JointConstraint>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct JointConstraint {
    #[prost(enumeration = "JointConstraintType", tag = "1")]
    pub kind: i32,
    /// Value: seconds, or degrees per second.
    #[prost(float, tag = "2")]
    pub value: f32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum JointConstraintType {
    /// The arm's own speed.
    Unspecified = 0,
    Duration = 1,
    /// Speed of the fastest joint.
    Speed = 2,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ActionEvent {
    /// Not specified.
    Unspecified = 0,
    End = 1,
    Abort = 2,
    Pause = 3,
    Start = 4,
}

#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct ActionNotification {
    #[prost(enumeration = "ActionEvent", tag = "1")]
    pub event: i32,
    #[prost(message, optional, tag = "2")]
    pub handle: Option<ActionHandle>,
    /// Reason of an abort: a sub-code as in [`crate::refusal::RefusalReason`].
    #[prost(uint32, tag = "5")]
    pub abort_details: u32,
}
