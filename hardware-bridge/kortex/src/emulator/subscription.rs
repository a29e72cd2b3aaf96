//! A topic that a client has asked to be notified of.

use super::peer::{Outgoing, Peer};
use crate::call::Call;
use crate::frame::{Frame, FrameKind, Header};

pub(super) struct Subscription {
    pub topic: Call,
    pub device: u8,
    pub handle: u16,
    pub peer: Peer,
    pub session: u16,
}

impl Subscription {
    pub(super) fn notification(&self, payload: Vec<u8>) -> Outgoing {
        let Self { topic: call, device, handle: message, session, peer } = *self;
        let header = Header { kind: FrameKind::Notification, device, error: 0, sub_error: 0, session, message, call };
        (peer, Frame { header, payload })
    }
}
