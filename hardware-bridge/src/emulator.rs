//! Emulated devices: six XC330 servos and the camera board, each on a pseudo-terminal, driven by a plant.
//!
//! The plant is any [`Plant`], such as [`spring_hand::SpringHand`] or the simulated robot. In real time
//! ([`EmulatedHand::start`]) a thread ticks the plant: it takes the goals from the servos' registers and returns shaft
//! states and images. One more thread per device speaks the device's protocol. Any program that opens serial ports can
//! be the host.
//!
//! With [`EmulatedHand::start_stepped`] the clock is emulated, and the plant advances only by [`EmulatedHand::step`].
//! Answers are then sent at once, and a delayed answer follows the host's next request. [`lockstep`] is a robot on such
//! devices; [`direct`] uses the same devices without any wire.
//!
//! [`servo`] emulates one servo, [`servo_chain`] six on a bus, [`camera_board`] the board. [`faults`] lists the faults,
//! [`pty`] opens a port.

pub mod camera_board;
pub mod direct;
mod direct_arm;
pub mod faults;
pub mod lockstep;
pub mod lockstep_arm;
pub mod plant_arm;
pub mod pty;
pub mod servo;
pub mod servo_chain;
pub mod spring_hand;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use camera_board::{BoardSettings, CameraBoard};
use dynamixel_bus::protocol2::Decoder;
use faults::{FaultEvent, Faults};
use hand_model::robot::{Plant, RobotCommand, ServoGoal, ServoState, TactileFrame};
use hand_model::{ActuatorVector, RobotModel};
use plant_arm::SharedArm;
use pty::{Pty, PtyError};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serial2::SerialPort;
use servo::EmulatedServo;
use servo_chain::{LineAnswer, ServoChain};

use crate::calibration::HandCalibration;
use crate::clock::Clock;
use crate::lock::lock;
use crate::supported_robot::SERVOS;

/// Longest wait of a device thread for bytes before it checks whether to end.
const READ_TIMEOUT: Duration = Duration::from_millis(5);

#[derive(Debug, Clone)]
pub struct EmulatorSettings {
    /// The servos, in actuator order.
    pub servos: Vec<EmulatedServo>,
    /// Settings of the camera board.
    pub board: BoardSettings,
    /// Injected faults.
    pub faults: Faults,
    /// Latency that the USB adapter adds to every answer, s.
    pub usb_latency: f64,
    /// Seed of random faults and of the cameras' noise.
    pub seed: u64,
}

impl Default for EmulatorSettings {
    /// Six provisioned servos with ids 1 to 6 and arbitrary horn positions, no faults, 1 ms of USB latency.
    fn default() -> Self {
        Self {
            servos: (1..=6).map(|id| EmulatedServo::provisioned(id, 700 * i64::from(id))).collect(),
            board: BoardSettings::default(),
            faults: Faults::default(),
            usb_latency: 1e-3,
            seed: 1,
        }
    }
}

/// A USB plug at the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plug {
    /// The adapter of the servo bus.
    Servos,
    /// The camera board.
    Cameras,
}

struct SharedDevices {
    /// Device end of the servo line, used to check whether bytes wait in it; `None` once it is unplugged.
    servo_line: Mutex<Option<SerialPort>>,
    servos_unplugged: AtomicBool,
    cameras_unplugged: AtomicBool,
    chain: Mutex<ServoChain>,
    board: Mutex<CameraBoard>,
    shafts: Mutex<ActuatorVector<ServoState>>,
    arm: SharedArm,
    capture: AtomicBool,
    stop: AtomicBool,
    ticks: AtomicU64,
    late_ticks: AtomicU64,
    /// Images that the plant has handed to the camera board.
    image_count: AtomicU64,
    clock: Clock,
}

impl SharedDevices {
    fn now(&self) -> f64 {
        self.clock.now()
    }

    fn is_stepped(&self) -> bool {
        matches!(self.clock, Clock::Emulated(_))
    }

    fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// True if the host has sent bytes that the servos have not read yet.
    fn has_pending_bytes(&self) -> bool {
        lock(&self.servo_line).as_ref().is_some_and(|line| has_bytes(line, Duration::ZERO))
    }
}

/// Waits up to `timeout`; true if there is something to read on `port`.
fn has_bytes(port: &SerialPort, timeout: Duration) -> bool {
    let timeout = Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
    let mut polled = [PollFd::new(port, PollFlags::IN)];
    let ready = poll(&mut polled, Some(&timeout)).unwrap_or(0);
    ready > 0 && polled[0].revents().contains(PollFlags::IN)
}

/// The running emulator; it ends when dropped.
pub struct EmulatedHand {
    shared: Arc<SharedDevices>,
    servo_pty: Option<Pty>,
    board_pty: Option<Pty>,
    paths: [PathBuf; 2],
    /// Device ends of unplugged ports, kept open.
    unplugged_ports: Vec<SerialPort>,
    threads: Vec<JoinHandle<()>>,
    /// The plant, if it advances by [`EmulatedHand::step`], with the queue of its images.
    stepped_plant: Option<PlantWithImages>,
}

impl EmulatedHand {
    /// Starts the plant, and the devices of `robot` on their pseudo-terminals.
    pub fn start(
        plant: Box<dyn Plant + Send>,
        settings: EmulatorSettings,
        robot: &RobotModel,
    ) -> Result<Self, PtyError> {
        Self::open(plant, settings, robot, Clock::wall())
    }

    /// Like [`Self::start`], with `clock`, which must be an emulated one: nothing moves except by
    /// [`EmulatedHand::step`].
    pub fn start_stepped(
        plant: Box<dyn Plant + Send>,
        settings: EmulatorSettings,
        robot: &RobotModel,
        clock: Clock,
    ) -> Result<Self, PtyError> {
        Self::open(plant, settings, robot, clock)
    }

    fn open(
        mut plant: Box<dyn Plant + Send>,
        settings: EmulatorSettings,
        robot: &RobotModel,
        clock: Clock,
    ) -> Result<Self, PtyError> {
        let (servo_pty, board_pty) = (Pty::open()?, Pty::open()?);
        let port_of = |pty: &Pty| pty.device.try_clone().map_err(PtyError::Open);
        let (servo_port, board_port) = (port_of(&servo_pty)?, port_of(&board_pty)?);
        let jpeg_chance = settings.faults.probabilities.jpeg;
        let observation = plant.observe();
        let shafts = observation.servos;
        let mut chain = ServoChain::new(settings.servos, settings.faults, settings.usb_latency, settings.seed);
        chain.advance(clock.now(), 0.0, &shafts);
        let board = CameraBoard::new(settings.board, robot.hand.cameras.len(), jpeg_chance, settings.seed);
        let shared = Arc::new(SharedDevices {
            servo_line: Mutex::new(Some(port_of(&servo_pty)?)),
            servos_unplugged: AtomicBool::new(false),
            cameras_unplugged: AtomicBool::new(false),
            chain: Mutex::new(chain),
            board: Mutex::new(board),
            shafts: Mutex::new(shafts),
            arm: SharedArm::at(observation.arm, robot.arm.clone()),
            capture: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            ticks: AtomicU64::new(0),
            late_ticks: AtomicU64::new(0),
            image_count: AtomicU64::new(0),
            clock,
        });
        let (images, arrived) = mpsc::channel();
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(work).map_err(PtyError::Open)
        };
        let (for_plant, for_servos, for_board) = (shared.clone(), shared.clone(), shared.clone());
        let mut threads = vec![
            spawn("servos", Box::new(move || run_servos(servo_port, &for_servos)))?,
            spawn("cameras", Box::new(move || run_board(board_port, &for_board, &arrived)))?,
        ];
        let plant = PlantWithImages { physics: plant, images };
        let stepped = if shared.is_stepped() {
            Some(plant)
        } else {
            threads.push(spawn("plant", Box::new(move || run_plant(plant, &for_plant)))?);
            None
        };
        let paths = [servo_pty.path().to_owned(), board_pty.path().to_owned()];
        let (servo_pty, board_pty) = (Some(servo_pty), Some(board_pty));
        Ok(Self { shared, servo_pty, board_pty, paths, unplugged_ports: Vec::new(), threads, stepped_plant: stepped })
    }

    /// Advances the plant by one of its ticks, and the clock with it. Returns the tick's length, s; 0 if the plant runs
    /// in real time.
    pub fn step(&mut self) -> f64 {
        let Some(plant) = &mut self.stepped_plant else { return 0.0 };
        let tick = plant.physics.tick_length();
        self.shared.clock.advance(tick);
        // Images without a receiver are dropped.
        let _ = tick_plant(plant, &self.shared, tick);
        tick
    }

    /// True if the host has requested images that the plant has not taken yet.
    pub fn capture_pending(&self) -> bool {
        self.shared.capture.load(Ordering::Acquire)
    }

    /// Returns the number of images that the plant has handed to the camera board so far.
    pub fn image_count(&self) -> u64 {
        self.shared.image_count.load(Ordering::Relaxed)
    }

    /// Returns the servos' last watchdog trips: id, time, and delay after the last packet heard, s.
    pub fn watchdog_trips(&self) -> Vec<(u8, f64, f64)> {
        lock(&self.shared.chain).watchdog_trips()
    }

    /// Returns the path of the servos' port.
    pub fn servo_port(&self) -> &Path {
        &self.paths[0]
    }

    /// Returns the path of the camera board's port.
    pub fn camera_port(&self) -> &Path {
        &self.paths[1]
    }

    /// Makes `link` point to the servos' port.
    pub fn link_servos(&self, link: &Path) -> Result<(), PtyError> {
        self.servo_pty.as_ref().map_or(Ok(()), |pty| pty.link(link))
    }

    /// Makes `link` point to the camera board's port.
    pub fn link_cameras(&self, link: &Path) -> Result<(), PtyError> {
        self.board_pty.as_ref().map_or(Ok(()), |pty| pty.link(link))
    }

    /// Pulls a USB plug; the port does not come back.
    pub fn unplug(&mut self, plug: Plug) {
        let (gone, pty) = match plug {
            Plug::Servos => (&self.shared.servos_unplugged, &mut self.servo_pty),
            Plug::Cameras => (&self.shared.cameras_unplugged, &mut self.board_pty),
        };
        gone.store(true, Ordering::Relaxed);
        if plug == Plug::Servos {
            *lock(&self.shared.servo_line) = None;
        }
        self.unplugged_ports.extend(pty.take().map(Pty::hang_up));
    }

    /// Injects a fault now.
    pub fn inject(&self, event: FaultEvent) {
        match event {
            event if event.concerns_cameras() => lock(&self.shared.board).apply_fault(event),
            event => lock(&self.shared.chain).apply_fault(event, self.shared.now()),
        }
    }

    /// Sets the probabilities of random line faults of the servos.
    pub fn set_fault_probabilities(&self, chances: faults::FaultProbabilities) {
        lock(&self.shared.chain).set_fault_probabilities(chances);
    }

    /// Sets the probability that an image's JPEG is cut in half.
    pub fn set_jpeg_cut_probability(&self, chance: f64) {
        lock(&self.shared.board).set_jpeg_cut_probability(chance);
    }

    /// Returns the true state of the shafts, for tests and displays; a host must not use it.
    pub fn shafts(&self) -> ActuatorVector<ServoState> {
        *lock(&self.shared.shafts)
    }

    /// Returns the goal that each servo applies to its shaft now.
    pub fn applied_goals(&self) -> Vec<ServoGoal> {
        lock(&self.shared.chain).applied_goals()
    }

    /// Returns the number of servos that their bus watchdog has stopped.
    pub fn watchdogs_tripped(&self) -> usize {
        lock(&self.shared.chain).watchdogs_tripped()
    }

    /// Returns the plant's arm, for an emulated arm controller.
    pub fn arm_joints(&self) -> SharedArm {
        self.shared.arm.clone()
    }

    /// Writes the servos' homing offsets into their memory, as a calibration does over the bus.
    pub fn write_homing_offsets(&self, calibration: &HandCalibration) {
        lock(&self.shared.chain).write_homing_offsets(calibration);
    }

    /// Returns the number of plant ticks so far, and of those that began late because the plant is slower than real
    /// time.
    pub fn tick_counts(&self) -> (u64, u64) {
        (self.shared.ticks.load(Ordering::Relaxed), self.shared.late_ticks.load(Ordering::Relaxed))
    }
}

impl Drop for EmulatedHand {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic is reported by the thread's own panic message.
            let _ = thread.join();
        }
    }
}

/// Capture time on the devices' clock, s, and the images that left the plant together.
type CapturedImages = (f64, Vec<TactileFrame>);

/// The plant and the queue of its images.
struct PlantWithImages {
    physics: Box<dyn Plant + Send>,
    images: Sender<CapturedImages>,
}

/// Ticks the plant; returns false once its images have no receiver.
fn tick_plant(plant: &mut PlantWithImages, shared: &SharedDevices, tick: f64) -> bool {
    let mut servos = [ServoGoal::Current(0.0); SERVOS];
    for (goal, drive) in servos.iter_mut().zip(lock(&shared.chain).applied_goals()) {
        *goal = drive;
    }
    let capture = shared.capture.swap(false, Ordering::AcqRel);
    // With a stepped clock the tick has passed already. With a running one it begins now, regardless of how soon the
    // plant is done with it.
    let end = if shared.is_stepped() { shared.now() } else { shared.now() + tick };
    plant.physics.send(&RobotCommand { arm: shared.arm.goal(), servos: servos.into(), capture });
    plant.physics.wait_for_tick();
    let observation = plant.physics.observe();
    *lock(&shared.shafts) = observation.servos;
    shared.arm.set_state(observation.arm);
    let others = {
        let mut chain = lock(&shared.chain);
        // A packet that waits to be read is not a missing one.
        if shared.has_pending_bytes() {
            chain.feed_watchdogs(shared.now());
        }
        chain.advance(shared.now(), tick, &observation.servos)
    };
    for event in others {
        lock(&shared.board).apply_fault(event);
    }
    shared.ticks.fetch_add(1, Ordering::Relaxed);
    let Some(first) = observation.tactile.first() else { return true };
    let taken = end - (observation.time - first.time);
    shared.image_count.fetch_add(observation.tactile.len() as u64, Ordering::Relaxed);
    plant.images.send((taken, observation.tactile)).is_ok()
}

fn run_plant(mut plant: PlantWithImages, shared: &SharedDevices) {
    let tick = plant.physics.tick_length();
    let mut next = Instant::now();
    while shared.running() {
        if !tick_plant(&mut plant, shared, tick) {
            return;
        }
        next += Duration::from_secs_f64(tick);
        let now = Instant::now();
        if next > now {
            std::thread::sleep(next - now);
        } else {
            shared.late_ticks.fetch_add(1, Ordering::Relaxed);
            // Late ticks are not caught up: the plant's time falls behind instead.
            next = now;
        }
    }
}

fn run_servos(mut port: SerialPort, shared: &SharedDevices) {
    let mut decoder = Decoder::default();
    let mut held_back: Vec<Vec<u8>> = Vec::new();
    let mut buffer = [0; 4096];
    if port.set_read_timeout(READ_TIMEOUT).is_err() {
        return;
    }
    while shared.running() && !shared.servos_unplugged.load(Ordering::Relaxed) {
        if !has_bytes(&port, READ_TIMEOUT) {
            continue;
        }
        // The lock keeps bytes either on the line or with the servos, never between.
        let mut chain = lock(&shared.chain);
        let Ok(count) = port.read(&mut buffer) else { continue };
        let arrived = Instant::now();
        let baud = port.get_configuration().and_then(|settings| settings.get_baud_rate()).unwrap_or(0);
        decoder.push(&buffer[..count]);
        let packets = decoder.drain().into_iter().flatten();
        let answers: Vec<Vec<LineAnswer>> = packets
            .map(|packet| {
                let length = packet.encode().map_or(0, |wire| wire.len());
                chain.handle(&packet, length, baud, shared.now())
            })
            .collect();
        drop(chain);
        for answers in answers {
            for late in held_back.drain(..) {
                let _ = port.write_all(&late);
            }
            for answer in answers {
                if shared.is_stepped() && answer.delayed {
                    held_back.push(answer.bytes);
                    continue;
                }
                if shared.is_stepped() {
                    let _ = port.write_all(&answer.bytes);
                    continue;
                }
                let due = arrived + Duration::from_secs_f64(answer.arrival);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                // A host that does not read loses answers, as on a real line.
                let _ = port.write_all(&answer.bytes);
            }
        }
    }
}

fn run_board(mut port: SerialPort, shared: &SharedDevices, images: &mpsc::Receiver<CapturedImages>) {
    let mut buffer = [0; 4096];
    if port.set_read_timeout(Duration::from_millis(2)).is_err() {
        return;
    }
    while shared.running() && !shared.cameras_unplugged.load(Ordering::Relaxed) {
        let mut out = Vec::new();
        if let Ok(count) = port.read(&mut buffer) {
            let reaction = lock(&shared.board).receive(&buffer[..count], shared.now());
            if reaction.capture {
                shared.capture.store(true, Ordering::Release);
            }
            out.extend(reaction.bytes);
        }
        for (taken, frames) in images.try_iter() {
            out.extend(lock(&shared.board).send_images(&frames, taken));
        }
        if !out.is_empty() {
            // A host that does not read loses images, as on a real line.
            let _ = port.write_all(&out);
        }
    }
}
