//! The sockets of the emulated arm, read without waiting.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::peer::{Outgoing, Peer};
use crate::arm::Address;
use crate::frame::{Frame, LONGEST};
use crate::link::wait;
use crate::tcp_framing::{self, Deframer};

/// Time limit of a write, so that a host that does not read cannot block the arm.
const WRITE_TIMEOUT: Duration = Duration::from_millis(100);

/// A socket that can be waited for.
#[derive(Clone)]
pub(super) enum Socket {
    Listener(Arc<TcpListener>),
    Udp(Arc<UdpSocket>),
    Stream(Arc<TcpStream>),
}

/// Connection of a host.
struct Connection {
    stream: Arc<TcpStream>,
    deframer: Deframer,
}

/// The listener, the datagram socket, and the open connections by number.
pub(super) struct Sockets {
    listener: Arc<TcpListener>,
    udp: Arc<UdpSocket>,
    connections: BTreeMap<u64, Connection>,
    accepted: u64,
    buffer: Vec<u8>,
}

impl Sockets {
    pub(super) fn bind(address: Address) -> io::Result<Self> {
        let (listener, udp) = (TcpListener::bind(address.tcp)?, UdpSocket::bind(address.udp)?);
        Ok(Self {
            listener: Arc::new(listener),
            udp: Arc::new(udp),
            connections: BTreeMap::new(),
            accepted: 0,
            buffer: vec![0; LONGEST],
        })
    }

    pub(super) fn address(&self) -> io::Result<Address> {
        Ok(Address { tcp: self.listener.local_addr()?, udp: self.udp.local_addr()? })
    }

    /// Returns all sockets, to be waited for.
    pub(super) fn all(&self) -> Vec<Socket> {
        let streams = self.connections.values().map(|connection| Socket::Stream(connection.stream.clone()));
        [Socket::Listener(self.listener.clone()), Socket::Udp(self.udp.clone())].into_iter().chain(streams).collect()
    }

    /// Returns every frame that has arrived, with its sender. Ends connections that hosts have closed, and those that
    /// send invalid frames.
    pub(super) fn take(&mut self) -> Vec<(Peer, Frame)> {
        let now = Instant::now();
        let mut frames = Vec::new();
        while let Ok(true) = wait(&*self.listener, now) {
            let Ok((stream, _)) = self.listener.accept() else { break };
            drop(stream.set_nodelay(true).and_then(|()| stream.set_write_timeout(Some(WRITE_TIMEOUT))));
            self.accepted += 1;
            let connection = Connection { stream: Arc::new(stream), deframer: Deframer::default() };
            self.connections.insert(self.accepted, connection);
        }
        self.connections.retain(|number, connection| connection.take(Peer::Tcp(*number), &mut frames));
        while let Ok(true) = wait(&*self.udp, now) {
            // An error here concerns a datagram sent earlier to a host that is gone.
            let Ok((length, from)) = self.udp.recv_from(&mut self.buffer) else { continue };
            frames.extend(Frame::decode(&self.buffer[..length]).ok().map(|frame| (Peer::Udp(from), frame)));
        }
        frames
    }

    /// Sends frames. A host that is gone is noticed by its session's timeout, as on the real arm.
    pub(super) fn send(&self, outgoing: Vec<Outgoing>) {
        for (peer, frame) in outgoing {
            match peer {
                Peer::Udp(address) => self.send_datagram(&frame, address),
                Peer::Tcp(number) => {
                    if let Some(connection) = self.connections.get(&number) {
                        drop((&*connection.stream).write_all(&tcp_framing::encode(&frame)));
                    }
                }
            }
        }
    }

    fn send_datagram(&self, frame: &Frame, address: SocketAddr) {
        drop(self.udp.send_to(&frame.encode(), address));
    }
}

impl Connection {
    /// Adds the frames that have arrived to `frames`. Returns false if the connection has ended.
    fn take(&mut self, peer: Peer, frames: &mut Vec<(Peer, Frame)>) -> bool {
        let mut bytes = [0; 4096];
        let now = Instant::now();
        loop {
            match wait(&*self.stream, now) {
                Ok(true) => {}
                Ok(false) => return true,
                Err(_) => return false,
            }
            match (&*self.stream).read(&mut bytes) {
                Ok(0) | Err(_) => return false,
                Ok(length) => self.deframer.push(&bytes[..length]),
            }
            loop {
                match self.deframer.next_frame() {
                    Ok(Some(frame)) => frames.push((peer, frame)),
                    Ok(None) => break,
                    Err(_) => return false,
                }
            }
        }
    }
}

/// Waits until one of `sockets` is readable, or until `deadline`.
pub(super) fn wait_for_any(sockets: &[Socket], deadline: Instant) {
    let left = deadline.saturating_duration_since(Instant::now());
    let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
    let mut watched: Vec<PollFd<'_>> = sockets
        .iter()
        .map(|socket| {
            let socket = match socket {
                Socket::Listener(listener) => listener.as_fd(),
                Socket::Udp(udp) => udp.as_fd(),
                Socket::Stream(stream) => stream.as_fd(),
            };
            PollFd::from_borrowed_fd(socket, PollFlags::IN)
        })
        .collect();
    // An interruption or failure counts as a timeout: the caller checks the sockets in any case.
    let _ = poll(&mut watched, Some(&left));
}
