//! Copies of the bytes on a link, for a recorder.
//!
//! Install a tap after the login, as [`crate::Arm::tap`] does, so that the password stays out of the record.

use std::fmt;

/// Direction of the bytes, seen from the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// From the host to the arm.
    Sent,
    /// From the arm to the host.
    Received,
}

type OnPacket = dyn FnMut(Direction, &[u8]) + Send;

/// A callback that gets a copy of every packet on one link. It runs in the thread of the link and must not block.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// use std::sync::mpsc;
///
/// use kinova_kortex::{Direction, Tap};
///
/// let (packets, record) = mpsc::channel();
/// let other = packets.clone();
/// arm.tap(
///     Tap::new(move |direction, bytes| drop(packets.send(("tcp", direction, bytes.to_vec())))),
///     Tap::new(move |direction, bytes| drop(other.send(("udp", direction, bytes.to_vec())))),
/// );
/// arm.base.arm_state()?;
/// let (link, direction, bytes) = record.recv()?;
/// assert_eq!((link, direction), ("tcp", Direction::Sent));
/// println!("{} bytes", bytes.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Tap(Box<OnPacket>);

impl Tap {
    /// Wraps `on_packet`, which gets the direction and the bytes of each packet: one datagram on UDP, the bytes of one
    /// write or read on TCP, which may be a part of a frame or several frames.
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
