//! Transport of frames: TCP for calls, UDP for the cyclic exchange.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};

use crate::frame::{Frame, FrameError, LONGEST};
use crate::tap::{Direction, Tap};
use crate::tcp_framing::{self, Deframer};

/// A failure that ends the link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The operating system reported an error.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The arm closed the connection.
    #[error("the arm closed the connection")]
    Closed,
    /// The stream is not valid any more.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// A connection that carries frames: [`TcpLink`], [`UdpLink`], or a test's own.
pub trait Link {
    /// Sends a frame.
    ///
    /// # Errors
    /// [`LinkError`].
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError>;

    /// Returns the next frame, waiting for it until `deadline`; `None` if there was none. A deadline in the past asks
    /// for a frame that has already arrived.
    ///
    /// # Errors
    /// [`LinkError`].
    fn receive(&mut self, deadline: Instant) -> Result<Option<Frame>, LinkError>;

    /// Returns the number of frames dropped because they were damaged.
    fn damaged(&self) -> u64;

    /// Copies all further bytes to `tap`.
    fn tap(&mut self, tap: Tap);
}

/// Waits until `socket` is readable, or until `deadline`. (`set_read_timeout` rounds up to the kernel's tick, up to 4
/// ms.)
pub(super) fn wait(socket: &impl AsFd, deadline: Instant) -> io::Result<bool> {
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let left = rustix::event::Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
        match poll(&mut [PollFd::new(socket, PollFlags::IN)], Some(&left)) {
            Ok(ready) => return Ok(ready > 0),
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

fn copy(tap: &mut Option<Tap>, direction: Direction, bytes: &[u8]) {
    if let Some(tap) = tap {
        tap.packet(direction, bytes);
    }
}

/// A TCP connection.
#[derive(Debug)]
pub struct TcpLink {
    stream: TcpStream,
    deframer: Deframer,
    tap: Option<Tap>,
}

impl TcpLink {
    /// Connects to `address`.
    ///
    /// # Errors
    /// [`LinkError::Io`].
    pub fn connect(address: SocketAddr, timeout: Duration) -> Result<Self, LinkError> {
        Ok(Self::new(TcpStream::connect_timeout(&address, timeout)?)?)
    }

    /// Wraps an open connection.
    ///
    /// # Errors
    /// Fails if its options cannot be set.
    pub fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        // Time limit for a peer that stops reading, which would otherwise block the sender.
        stream.set_write_timeout(Some(Duration::from_millis(100)))?;
        Ok(Self { stream, deframer: Deframer::default(), tap: None })
    }
}

impl Link for TcpLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        let bytes = tcp_framing::encode(frame);
        copy(&mut self.tap, Direction::Sent, &bytes);
        Ok(self.stream.write_all(&bytes)?)
    }

    fn receive(&mut self, deadline: Instant) -> Result<Option<Frame>, LinkError> {
        loop {
            if let Some(frame) = self.deframer.next_frame()? {
                return Ok(Some(frame));
            }
            if !wait(&self.stream, deadline)? {
                return Ok(None);
            }
            let mut bytes = [0; 4096];
            match self.stream.read(&mut bytes)? {
                0 => return Err(LinkError::Closed),
                length => {
                    copy(&mut self.tap, Direction::Received, &bytes[..length]);
                    self.deframer.push(&bytes[..length]);
                }
            }
        }
    }

    fn damaged(&self) -> u64 {
        0
    }

    fn tap(&mut self, tap: Tap) {
        self.tap = Some(tap);
    }
}

/// Damaged datagrams in a row after which `receive` returns anyway: a flood must not outlast the deadline.
const DAMAGED_AT_ONCE: usize = 64;

/// A UDP socket bound to one peer.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    buffer: Vec<u8>,
    damaged: u64,
    tap: Option<Tap>,
}

impl UdpLink {
    /// Binds a port of our own and takes datagrams from `address` only.
    ///
    /// # Errors
    /// [`LinkError::Io`].
    pub fn connect(address: SocketAddr) -> Result<Self, LinkError> {
        let any: SocketAddr = if address.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0; 16], 0).into() };
        let socket = UdpSocket::bind(any)?;
        socket.connect(address)?;
        Ok(Self { socket, buffer: vec![0; LONGEST], damaged: 0, tap: None })
    }
}

impl Link for UdpLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        let bytes = frame.encode();
        copy(&mut self.tap, Direction::Sent, &bytes);
        self.socket.send(&bytes)?;
        Ok(())
    }

    fn receive(&mut self, deadline: Instant) -> Result<Option<Frame>, LinkError> {
        for _ in 0..DAMAGED_AT_ONCE {
            if !wait(&self.socket, deadline)? {
                break;
            }
            let length = self.socket.recv(&mut self.buffer)?;
            copy(&mut self.tap, Direction::Received, &self.buffer[..length]);
            match Frame::decode(&self.buffer[..length]) {
                Ok(frame) => return Ok(Some(frame)),
                Err(_) => self.damaged += 1,
            }
        }
        Ok(None)
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }

    fn tap(&mut self, tap: Tap) {
        self.tap = Some(tap);
    }
}
