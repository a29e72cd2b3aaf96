//! An emulated arm and a host connected to it.

use std::time::{Duration, Instant};

use kinova_kortex::JOINTS;
use kinova_kortex::emulator::{Emulator, EventKind, FirstOrderJoints, Pace, Settings};
use kinova_kortex::servoing::ServoingLimits;
use kinova_kortex::{Arm, Credentials, Timeouts, gen3};

/// Time constant of the emulated joints, s.
pub const LAG: f64 = 0.02;

/// Limit of the joint speeds in the tests, rad/s.
pub const TOP_SPEED: [f64; JOINTS] = [1.2; JOINTS];

/// Time limit that only a hung test reaches: no condition below depends on the speed of the machine.
pub const TEST_TIMEOUT: Duration = Duration::from_secs(120);

pub fn credentials() -> Credentials {
    Credentials { user: "admin".to_owned(), password: "admin".to_owned() }
}

/// Timeouts of sessions that never end by themselves: seconds of a stepped arm may pass between two keep-alives of the
/// host.
pub fn timeouts() -> Timeouts {
    let hour = Duration::from_secs(3600);
    Timeouts { call: TEST_TIMEOUT, session: hour, connection: hour, ..Timeouts::default() }
}

/// The published home posture, rad.
pub fn home_posture() -> [f64; JOINTS] {
    gen3::HOME
}

pub fn emulator_at(posture: [f64; JOINTS], pace: Pace) -> Emulator {
    emulator_with(posture, pace, Settings::default().cyclic_deadline)
}

/// An arm in real time whose watchdog tolerates the delays of a busy machine.
pub fn patient_emulator() -> Emulator {
    emulator_with(home_posture(), Pace::RealTime, TEST_TIMEOUT.as_millis() as u64)
}

/// An arm whose watchdog trips after `cyclic_deadline` ms of its own time.
pub fn emulator_with(posture: [f64; JOINTS], pace: Pace, cyclic_deadline: u64) -> Emulator {
    let plant = FirstOrderJoints::new(posture, LAG, gen3::TOP_SPEED);
    let settings = Settings { cyclic_deadline, ..Settings::default() };
    Emulator::start(settings, Box::new(plant), pace).expect("loopback has free ports")
}

/// An arm at its published home posture, whose time passes by [`Emulator::step`] alone.
pub fn emulator() -> Emulator {
    emulator_at(home_posture(), Pace::Stepped)
}

pub fn host(emulator: &Emulator) -> Arm {
    let near = emulator.status().motion.position;
    Arm::connect(emulator.address(), &credentials(), timeouts(), near).expect("connects")
}

pub fn limits() -> ServoingLimits {
    ServoingLimits::gen3()
}

/// Limits that tolerate any silence, for an arm in real time on a busy machine.
pub fn patient_limits() -> ServoingLimits {
    ServoingLimits { silent_cycles: u32::MAX, ..limits() }
}

/// A deadline before which any answer on loopback comes.
pub fn soon() -> Instant {
    Instant::now() + TEST_TIMEOUT
}

/// Returns the time of the last such event, ms of the arm's time.
pub fn time_of(emulator: &Emulator, what: EventKind) -> Option<u64> {
    emulator.status().events.iter().rev().find(|event| event.what == what).map(|event| event.time)
}

/// Waits until `condition` holds.
pub fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let give_up = Instant::now() + TEST_TIMEOUT;
    while !condition() {
        assert!(Instant::now() < give_up, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
