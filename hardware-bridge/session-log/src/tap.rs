//! Copies of the bytes on a link, from any thread, for the recorder.
//!
//! A tapped link sends a copy of every packet into a channel and never waits; the recorder empties the channel at every
//! tick. Tap a link after its login, so that no password is recorded.

use std::sync::mpsc;
use std::time::Instant;

/// Direction of transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Direction {
    /// From the host.
    Sent,
    /// To the host.
    Received,
}

/// A packet on a link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinkPacket {
    /// Name of the link, as in the topic.
    pub link: &'static str,
    /// Direction of transfer.
    pub direction: Direction,
    /// Time at which the host sent or received it.
    pub time: Instant,
    /// The bytes on the wire.
    pub bytes: Vec<u8>,
}

/// Tap: a sink for copies of a link's packets.
///
/// ```
/// use robot_session_log::{Direction, LinkTap};
///
/// let (sender, packets) = std::sync::mpsc::channel();
/// let tap = LinkTap::new("servos", sender);
/// // In the driver of the link, which may run in another thread:
/// tap.copy_packet(Direction::Sent, &[0xFF, 0xFF, 0xFD]);
/// // The recorder takes the other end: `recorder.with_packets(packets)`.
/// assert_eq!(packets.recv().map(|packet| packet.link), Ok("servos"));
/// ```
#[derive(Debug, Clone)]
pub struct LinkTap {
    link: &'static str,
    sender: mpsc::Sender<LinkPacket>,
}

impl LinkTap {
    /// Creates a tap for the link of this name that copies packets into the channel of `sender`.
    pub fn new(link: &'static str, sender: mpsc::Sender<LinkPacket>) -> Self {
        Self { link, sender }
    }

    /// Copies a packet, stamped with the present time.
    pub fn copy_packet(&self, direction: Direction, bytes: &[u8]) {
        let packet = LinkPacket { link: self.link, direction, time: Instant::now(), bytes: bytes.to_vec() };
        // A failure means that nobody records any more: the robot goes on.
        drop(self.sender.send(packet));
    }
}
