//! The emulated arm on its sockets: one thread that serves them and advances time.
//!
//! Before each millisecond, everything that waits in the sockets is handled. So a command that a busy machine lets the
//! emulator read late does not trip its watchdog, and a late sign of life ends no session.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::controller::{Controller, Settings, Status};
use super::fault_injection::Injection;
use super::plant::Plant;
use super::sockets::{Sockets, wait_for_any};
use crate::arm::Address;
use crate::lock::lock;

/// Interval at which a waiting thread checks whether to end.
const REQUEST_TIMEOUT: Duration = Duration::from_millis(20);
const MILLISECOND: Duration = Duration::from_millis(1);

/// Clock of the emulated arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// One millisecond of the arm per millisecond of the machine.
    RealTime,
    /// Time advances by [`Emulator::step`] only.
    Stepped,
}

/// The arm's base and its sockets.
struct Server {
    controller: Controller,
    sockets: Sockets,
}

impl Server {
    /// Handles everything that has arrived.
    fn serve(&mut self) {
        for (peer, frame) in self.sockets.take() {
            let outgoing = self.controller.receive(peer, &frame);
            self.sockets.send(outgoing);
        }
    }

    /// Advances by a millisecond, after everything that arrived before has been handled.
    fn tick(&mut self) {
        self.serve();
        let outgoing = self.controller.tick();
        self.sockets.send(outgoing);
    }
}

/// An emulated Gen3. Dropping it switches it off.
///
/// # Example
/// ```
/// use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Injection, Pace, Settings};
/// use kinova_kortex::safety_bank::FOLLOWING_ERROR;
/// use kinova_kortex::{Arm, Timeouts, gen3};
///
/// let settings = Settings::default();
/// let credentials = settings.credentials.clone();
/// let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::Stepped)?;
/// let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// emulator.inject(Injection::JointFault { joint: 2, bits: FOLLOWING_ERROR });
/// assert_eq!(arm.cyclic.feedback()?.faults.to_string(), "base: joint fault; joint 3: following error");
/// emulator.step(10);
/// assert_eq!(emulator.status().time, 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Emulator {
    server: Arc<Mutex<Server>>,
    stop: Arc<AtomicBool>,
    address: Address,
    pace: Pace,
    thread: Option<JoinHandle<()>>,
}

impl Emulator {
    /// Switches on an arm, on two free ports of the loopback address.
    ///
    /// # Errors
    /// Fails if no port is available.
    pub fn start(settings: Settings, plant: Box<dyn Plant>, pace: Pace) -> io::Result<Self> {
        let loopback: SocketAddr = (Ipv4Addr::LOCALHOST, 0).into();
        Self::start_at(Address { tcp: loopback, udp: loopback }, settings, plant, pace)
    }

    /// Switches on an arm, on given ports.
    ///
    /// # Errors
    /// Fails if the ports are not available.
    pub fn start_at(address: Address, settings: Settings, plant: Box<dyn Plant>, pace: Pace) -> io::Result<Self> {
        let sockets = Sockets::bind(address)?;
        let address = sockets.address()?;
        let server = Arc::new(Mutex::new(Server { controller: Controller::new(settings, plant), sockets }));
        let stop = Arc::new(AtomicBool::new(false));
        let (for_thread, stopped) = (server.clone(), stop.clone());
        let thread =
            std::thread::Builder::new().name("emulated arm".into()).spawn(move || run(&for_thread, &stopped, pace))?;
        Ok(Self { server, stop, address, pace, thread: Some(thread) })
    }

    /// Returns the address to connect to, with the ports that were chosen.
    pub fn address(&self) -> Address {
        self.address
    }

    /// Returns the present state of the arm and its events so far.
    pub fn status(&self) -> Status {
        lock(&self.server).controller.status()
    }

    /// Injects a fault.
    pub fn inject(&self, injection: Injection) {
        let mut server = lock(&self.server);
        let outgoing = server.controller.inject(injection);
        server.sockets.send(outgoing);
    }

    /// Advances the arm's time.
    ///
    /// # Panics
    /// Panics if the arm runs in real time.
    pub fn step(&self, milliseconds: u64) {
        assert_eq!(self.pace, Pace::Stepped, "time passes by itself");
        for _ in 0..milliseconds {
            lock(&self.server).tick();
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

/// Serves the sockets. In real time a millisecond of the arm passes per real one. Time lost to a stall of the machine
/// is not caught up, because the commands that belong to it are still waiting in the socket.
fn run(server: &Mutex<Server>, stop: &AtomicBool, pace: Pace) {
    let mut next = Instant::now() + MILLISECOND;
    let mut sockets = lock(server).sockets.all();
    while !stop.load(Ordering::Relaxed) {
        let deadline = match pace {
            Pace::RealTime => next,
            Pace::Stepped => Instant::now() + REQUEST_TIMEOUT,
        };
        wait_for_any(&sockets, deadline);
        let mut server = lock(server);
        if pace == Pace::RealTime && Instant::now() >= next {
            server.tick();
            next = (next + MILLISECOND).max(Instant::now());
        } else {
            server.serve();
        }
        sockets = server.sockets.all();
    }
}
