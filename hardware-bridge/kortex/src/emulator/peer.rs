//! The hosts an emulated arm talks to.

use std::net::SocketAddr;

use crate::frame::Frame;

/// The sender or the recipient of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Peer {
    /// A TCP connection, numbered in the order of acceptance.
    Tcp(u64),
    /// A UDP port.
    Udp(SocketAddr),
}

/// A frame and its recipient.
pub type Outgoing = (Peer, Frame);
