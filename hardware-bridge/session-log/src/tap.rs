//! Copies of the bytes on a link, from any thread, for the recorder.
//!
//! A tapped link sends a copy of every packet into a channel and never waits; the recorder empties the channel at every
//! tick. Tap a link after its login, so that no password is recorded.

use std::sync::mpsc;
use std::time::Instant;

/// Which way bytes went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Direction {
    /// From the host.
    Sent,
    /// To the host.
    Received,
}

/// A packet on a link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// Name of the link, as in the topic.
    pub link: &'static str,
    pub direction: Direction,
    /// When the host sent it or had it.
    pub at: Instant,
    pub bytes: Vec<u8>,
}

/// What a link copies its packets into.
#[derive(Debug, Clone)]
pub struct Tap {
    link: &'static str,
    sender: mpsc::Sender<Packet>,
}

impl Tap {
    /// A tap for the link of this name, into the channel that `sender` belongs to.
    pub fn new(link: &'static str, sender: mpsc::Sender<Packet>) -> Self {
        Self { link, sender }
    }

    /// A packet, just now.
    pub fn packet(&self, direction: Direction, bytes: &[u8]) {
        let packet = Packet { link: self.link, direction, at: Instant::now(), bytes: bytes.to_vec() };
        // Nobody records any more: the robot goes on.
        drop(self.sender.send(packet));
    }
}
