//! The sockets of the emulated arm.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::controller::{Controller, Settings, Status};
use super::fault_injection::Injection;
use super::peer::{Outgoing, Peer};
use super::plant::Plant;
use crate::arm::Address;
use crate::frame::{Frame, LONGEST};
use crate::link::wait;
use crate::lock::lock;
use crate::tcp_framing::{self, Deframer};

/// Interval at which a waiting thread checks whether to end.
const PATIENCE: Duration = Duration::from_millis(20);

/// How the emulated arm's time advances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    RealTime,
    /// By [`Emulator::step`].
    Stepped,
}

struct Shared {
    controller: Mutex<Controller>,
    udp: UdpSocket,
    /// Where answers on a TCP connection go.
    writers: Mutex<BTreeMap<u64, TcpStream>>,
    stop: AtomicBool,
}

impl Shared {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn deliver(&self, outgoing: Vec<Outgoing>) {
        for (peer, frame) in outgoing {
            // A host that is gone is noticed by the session's timeout, as on the real arm.
            match peer {
                Peer::Udp(address) => drop(self.udp.send_to(&frame.encode(), address)),
                Peer::Tcp(number) => {
                    if let Some(writer) = lock(&self.writers).get_mut(&number) {
                        drop(writer.write_all(&tcp_framing::encode(&frame)));
                    }
                }
            }
        }
    }

    fn handle(&self, peer: Peer, frame: &Frame) {
        let outgoing = lock(&self.controller).receive(peer, frame);
        self.deliver(outgoing);
    }
}

/// An emulated Gen3. Dropping it switches it off.
pub struct Emulator {
    shared: Arc<Shared>,
    address: Address,
    pace: Pace,
    threads: Vec<JoinHandle<()>>,
}

impl Emulator {
    /// Switches an arm on, on two free ports of the loopback address.
    ///
    /// # Errors
    /// When no port can be had.
    pub fn start(settings: Settings, plant: Box<dyn Plant>, pace: Pace) -> io::Result<Self> {
        let loopback: SocketAddr = (Ipv4Addr::LOCALHOST, 0).into();
        Self::start_at(Address { tcp: loopback, udp: loopback }, settings, plant, pace)
    }

    /// Switches an arm on, on given ports.
    ///
    /// # Errors
    /// When the ports cannot be had.
    pub fn start_at(address: Address, settings: Settings, plant: Box<dyn Plant>, pace: Pace) -> io::Result<Self> {
        let listener = TcpListener::bind(address.tcp)?;
        let udp = UdpSocket::bind(address.udp)?;
        let address = Address { tcp: listener.local_addr()?, udp: udp.local_addr()? };
        let shared = Arc::new(Shared {
            controller: Mutex::new(Controller::new(settings, plant)),
            udp,
            writers: Mutex::default(),
            stop: AtomicBool::new(false),
        });
        let spawn = |work: fn(&Shared)| {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || work(&shared))
        };
        let mut threads = vec![spawn(serve_udp)];
        if pace == Pace::RealTime {
            threads.push(spawn(keep_time));
        }
        let connections = Arc::clone(&shared);
        threads.push(std::thread::spawn(move || serve_tcp(&connections, &listener)));
        Ok(Self { shared, address, pace, threads })
    }

    pub fn address(&self) -> Address {
        self.address
    }

    pub fn status(&self) -> Status {
        lock(&self.shared.controller).status()
    }

    /// Injects a fault.
    pub fn inject(&self, injection: Injection) {
        let outgoing = lock(&self.shared.controller).inject(injection);
        self.shared.deliver(outgoing);
    }

    /// Advances the arm's time.
    ///
    /// # Panics
    /// In real time.
    pub fn step(&self, milliseconds: u64) {
        assert_eq!(self.pace, Pace::Stepped, "time passes by itself");
        for _ in 0..milliseconds {
            let outgoing = lock(&self.shared.controller).tick();
            self.shared.deliver(outgoing);
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            drop(thread.join());
        }
    }
}

fn serve_udp(shared: &Shared) {
    let mut buffer = vec![0; LONGEST];
    while !shared.stopped() {
        let Ok(true) = wait(&shared.udp, Instant::now() + PATIENCE) else { continue };
        // An error here is about a datagram sent earlier to a host that is gone.
        let Ok((length, from)) = shared.udp.recv_from(&mut buffer) else { continue };
        if let Ok(frame) = Frame::decode(&buffer[..length]) {
            shared.handle(Peer::Udp(from), &frame);
        }
    }
}

fn serve_tcp(shared: &Arc<Shared>, listener: &TcpListener) {
    let mut connections = Vec::new();
    let mut number = 0;
    while !shared.stopped() {
        let Ok(true) = wait(listener, Instant::now() + PATIENCE) else { continue };
        let Ok((stream, _)) = listener.accept() else { continue };
        let Ok(writer) = stream.try_clone() else { continue };
        number += 1;
        lock(&shared.writers).insert(number, writer);
        let shared = Arc::clone(shared);
        connections.push(std::thread::spawn(move || {
            serve_connection(&shared, stream, number);
            lock(&shared.writers).remove(&number);
        }));
    }
    for connection in connections {
        drop(connection.join());
    }
}

/// Serves until the host closes the connection or sends an invalid frame.
fn serve_connection(shared: &Shared, mut stream: TcpStream, number: u64) {
    drop(stream.set_nodelay(true));
    let mut deframer = Deframer::default();
    let mut bytes = [0; 4096];
    while !shared.stopped() {
        match wait(&stream, Instant::now() + PATIENCE) {
            Ok(true) => {}
            Ok(false) => continue,
            Err(_) => return,
        }
        match stream.read(&mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(length) => deframer.push(&bytes[..length]),
        }
        loop {
            match deframer.next_frame() {
                Ok(Some(frame)) => shared.handle(Peer::Tcp(number), &frame),
                Ok(None) => break,
                Err(_) => return,
            }
        }
    }
}

/// Advances the arm by one millisecond per real one. Time lost to a stall of the machine is not caught up, because the
/// commands that belong to it are still waiting in the socket.
fn keep_time(shared: &Shared) {
    let millisecond = Duration::from_millis(1);
    let mut next = Instant::now() + millisecond;
    while !shared.stopped() {
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        let outgoing = lock(&shared.controller).tick();
        shared.deliver(outgoing);
        next = (next + millisecond).max(Instant::now());
    }
}
