//! Copies of the bytes on the bus, for a recorder.

use std::fmt;

/// Direction of the bytes, seen from the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// From the host to the servos.
    Sent,
    /// From the servos to the host.
    Received,
}

type OnPacket = dyn FnMut(Direction, &[u8]) + Send;

/// A callback that gets a copy of all bytes on the bus. It runs in the thread of the bus and must not block.
///
/// # Example
/// ```
/// # include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/responder.rs"));
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let servos = Responder::start(&dynamixel_bus::xc330::MODEL, &[1])?;
/// # let port = &servos.path;
/// use std::sync::mpsc;
///
/// use dynamixel_bus::{BusSettings, Direction, ServoBus, Tap};
///
/// let mut bus = ServoBus::open(port, BusSettings { slack: 1.0, ..BusSettings::default() })?;
/// let (packets, record) = mpsc::channel();
/// bus.tap(Tap::new(move |direction, bytes| drop(packets.send((direction, bytes.to_vec())))));
/// bus.ping(1)?;
/// let (direction, bytes) = record.recv()?;
/// assert_eq!((direction, bytes.len()), (Direction::Sent, 10));
/// # Ok(())
/// # }
/// ```
pub struct Tap(Box<OnPacket>);

impl Tap {
    /// Wraps `on_packet`, which gets the direction and the bytes: one instruction packet, or the bytes of one read,
    /// which may be a part of a packet or several packets.
    pub fn new(on_packet: impl FnMut(Direction, &[u8]) + Send + 'static) -> Self {
        Self(Box::new(on_packet))
    }

    pub(crate) fn packet(&mut self, direction: Direction, bytes: &[u8]) {
        (self.0)(direction, bytes);
    }
}

impl fmt::Debug for Tap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Tap")
    }
}
