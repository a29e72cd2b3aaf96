//! The devices without the hardware: six XC330 and the camera board, each on a pseudo-terminal, moved by a plant.
//!
//! The plant is any [`Robot`]: [`spring_hand::SpringHand`] here, the simulated robot where the program wires it. A plant thread ticks
//! it in real time: goals from the servos' registers go in, shafts and images come out. A thread a device talks the device's protocol and
//! knows nothing of the plant. Any program that opens serial ports can be the host.
//!
//! [`servo`] is one servo, [`servo_chain`] six on a line, [`camera_board`] the board, [`faults`] what can be made to go wrong, [`pty`]
//! the pseudo-terminal.

pub mod camera_board;
pub mod faults;
pub mod pty;
pub mod servo;
pub mod servo_chain;
pub mod spring_hand;

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hand_model::robot::{ArmState, Command, Robot, ServoGoal, ServoState, TactileFrame};
use hand_model::{ACTUATORS, ARM_JOINTS};
use serial2::SerialPort;

use crate::lock;
use crate::protocol2::Decoder;
use camera_board::{BoardSettings, CameraBoard};
use faults::{Event, Faults};
use pty::{Pty, PtyError};
use servo::EmulatedServo;
use servo_chain::ServoChain;

/// How long a device thread waits for bytes before it looks whether it should end.
const WAIT: Duration = Duration::from_millis(5);

/// How the hand is emulated.
#[derive(Debug, Clone)]
pub struct EmulatorSettings {
    /// The servos, in actuator order.
    pub servos: Vec<EmulatedServo>,
    /// The camera board.
    pub board: BoardSettings,
    /// What goes wrong.
    pub faults: Faults,
    /// What the USB adapter adds to every answer, s.
    pub usb_latency: f64,
    /// Arm posture until somebody sets another, rad.
    pub arm: [f64; ARM_JOINTS],
    /// Seed of random faults and of the cameras' noise.
    pub seed: u64,
}

impl Default for EmulatorSettings {
    /// Six provisioned servos with ids 1 to 6 and horns mounted anyhow, no faults, 1 ms of USB latency.
    fn default() -> Self {
        Self {
            servos: (1..=6).map(|id| EmulatedServo::provisioned(id, 700 * i64::from(id))).collect(),
            board: BoardSettings::default(),
            faults: Faults::default(),
            usb_latency: 1e-3,
            arm: [0.0; ARM_JOINTS],
            seed: 1,
        }
    }
}

struct Shared {
    chain: Mutex<ServoChain>,
    board: Mutex<CameraBoard>,
    shafts: Mutex<[ServoState; ACTUATORS]>,
    arm_goal: Mutex<[f64; ARM_JOINTS]>,
    arm: Mutex<ArmState>,
    capture: AtomicBool,
    stop: AtomicBool,
    ticks: AtomicU64,
    late_ticks: AtomicU64,
    started: Instant,
}

impl Shared {
    fn now(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }
}

/// The running emulator; it ends when dropped.
pub struct EmulatedHand {
    shared: Arc<Shared>,
    servo_pty: Pty,
    board_pty: Pty,
    threads: Vec<JoinHandle<()>>,
}

impl EmulatedHand {
    /// Starts the devices on their pseudo-terminals, and the plant.
    pub fn start(plant: Box<dyn Robot + Send>, settings: EmulatorSettings) -> Result<Self, PtyError> {
        let (servo_pty, board_pty) = (Pty::open()?, Pty::open()?);
        let port_of = |pty: &Pty| pty.device.try_clone().map_err(PtyError::Open);
        let (servo_port, board_port) = (port_of(&servo_pty)?, port_of(&board_pty)?);
        let jpeg_chance = settings.faults.chances.jpeg;
        let shared = Arc::new(Shared {
            chain: Mutex::new(ServoChain::new(settings.servos, settings.faults, settings.usb_latency, settings.seed)),
            board: Mutex::new(CameraBoard::new(settings.board, jpeg_chance, settings.seed)),
            shafts: Mutex::new([ServoState::default(); ACTUATORS]),
            arm_goal: Mutex::new(settings.arm),
            arm: Mutex::new(ArmState { position: settings.arm, ..ArmState::default() }),
            capture: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            ticks: AtomicU64::new(0),
            late_ticks: AtomicU64::new(0),
            started: Instant::now(),
        });
        let (images, arrived) = mpsc::channel();
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(work).map_err(PtyError::Open)
        };
        let (for_plant, for_servos, for_board) = (shared.clone(), shared.clone(), shared.clone());
        let threads = vec![
            spawn("plant", Box::new(move || run_plant(plant, &for_plant, &images)))?,
            spawn("servos", Box::new(move || run_servos(servo_port, &for_servos)))?,
            spawn("cameras", Box::new(move || run_board(board_port, &for_board, &arrived)))?,
        ];
        Ok(Self { shared, servo_pty, board_pty, threads })
    }

    /// What a host opens to talk to the servos.
    pub fn servos(&self) -> &Pty {
        &self.servo_pty
    }

    /// What a host opens to talk to the camera board.
    pub fn cameras(&self) -> &Pty {
        &self.board_pty
    }

    /// The path of the servos' port.
    pub fn servo_port(&self) -> &Path {
        self.servo_pty.path()
    }

    /// The path of the camera board's port.
    pub fn camera_port(&self) -> &Path {
        self.board_pty.path()
    }

    /// Makes something go wrong now.
    pub fn inject(&self, event: Event) {
        match event {
            Event::Freeze(camera) => lock(&self.shared.board).freeze(camera),
            event => lock(&self.shared.chain).happen(event, self.shared.now()),
        }
    }

    /// Changes the chances of random line faults of the servos.
    pub fn set_chances(&self, chances: faults::Chances) {
        lock(&self.shared.chain).set_chances(chances);
    }

    /// Where the shafts really are: for tests and displays, not for hosts.
    pub fn shafts(&self) -> [ServoState; ACTUATORS] {
        *lock(&self.shared.shafts)
    }

    /// What each servo makes its shaft do right now.
    pub fn drives(&self) -> Vec<ServoGoal> {
        lock(&self.shared.chain).drives()
    }

    /// How many servos have been stopped by their bus watchdog.
    pub fn watchdogs_tripped(&self) -> usize {
        lock(&self.shared.chain).watchdogs_tripped()
    }

    /// Arm set-points for the plant, rad: for an emulated arm controller.
    pub fn set_arm_goal(&self, goal: [f64; ARM_JOINTS]) {
        *lock(&self.shared.arm_goal) = goal;
    }

    /// The plant's arm.
    pub fn arm(&self) -> ArmState {
        *lock(&self.shared.arm)
    }

    /// Plant ticks so far, and how many of them began late because the plant is slower than real time.
    pub fn ticks(&self) -> (u64, u64) {
        (self.shared.ticks.load(Ordering::Relaxed), self.shared.late_ticks.load(Ordering::Relaxed))
    }
}

impl Drop for EmulatedHand {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so itself.
            let _ = thread.join();
        }
    }
}

fn run_plant(mut plant: Box<dyn Robot + Send>, shared: &Shared, images: &Sender<Vec<TactileFrame>>) {
    let tick = plant.tick_length();
    let mut next = Instant::now();
    while shared.running() {
        let mut servos = [ServoGoal::Current(0.0); ACTUATORS];
        for (goal, drive) in servos.iter_mut().zip(lock(&shared.chain).drives()) {
            *goal = drive;
        }
        let capture = shared.capture.swap(false, Ordering::Relaxed);
        plant.send(&Command { arm: *lock(&shared.arm_goal), servos, capture });
        plant.wait_for_tick();
        let observation = plant.observe();
        *lock(&shared.shafts) = observation.servos;
        *lock(&shared.arm) = observation.arm;
        let others = lock(&shared.chain).advance(shared.now(), tick, &observation.servos);
        for event in others {
            if let Event::Freeze(camera) = event {
                lock(&shared.board).freeze(camera);
            }
        }
        if !observation.tactile.is_empty() && images.send(observation.tactile).is_err() {
            return;
        }
        shared.ticks.fetch_add(1, Ordering::Relaxed);
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

fn run_servos(mut port: SerialPort, shared: &Shared) {
    let mut decoder = Decoder::default();
    let mut buffer = [0; 4096];
    if port.set_read_timeout(WAIT).is_err() {
        return;
    }
    while shared.running() {
        let Ok(count) = port.read(&mut buffer) else { continue };
        let arrived = Instant::now();
        let baud = port.get_configuration().and_then(|settings| settings.get_baud_rate()).unwrap_or(0);
        decoder.push(&buffer[..count]);
        for packet in decoder.drain().into_iter().flatten() {
            let length = packet.encode().map_or(0, |wire| wire.len());
            let answers = lock(&shared.chain).handle(&packet, length, baud, shared.now());
            for answer in answers {
                let due = arrived + Duration::from_secs_f64(answer.after);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                // A host that does not read loses answers, as on a real line.
                let _ = port.write_all(&answer.bytes);
            }
        }
    }
}

fn run_board(mut port: SerialPort, shared: &Shared, images: &mpsc::Receiver<Vec<TactileFrame>>) {
    let mut buffer = [0; 4096];
    if port.set_read_timeout(Duration::from_millis(2)).is_err() {
        return;
    }
    while shared.running() {
        let mut out = Vec::new();
        if let Ok(count) = port.read(&mut buffer) {
            let reaction = lock(&shared.board).receive(&buffer[..count], shared.now());
            if reaction.capture {
                shared.capture.store(true, Ordering::Relaxed);
            }
            out.extend(reaction.bytes);
        }
        for frames in images.try_iter() {
            out.extend(lock(&shared.board).send_images(&frames, shared.now()));
        }
        if !out.is_empty() {
            // A host that does not read loses images, as on a real line.
            let _ = port.write_all(&out);
        }
    }
}
