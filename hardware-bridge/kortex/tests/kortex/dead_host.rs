//! A host process that is killed or frozen in motion: the arm's own watchdog stops it.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use kinova_kortex::emulator::{Emulator, EventKind, Pace};
use kinova_kortex::message::ArmState;
use kinova_kortex::servoing::Servoing;
use kinova_kortex::{Address, Arm, CommandError, KortexError};

use crate::support::*;

const TCP: &str = "FTAC_TEST_ARM_TCP";
const UDP: &str = "FTAC_TEST_ARM_UDP";
/// Timeout of the arm's watchdog, ms: longer than a busy machine delays a living host.
const DEADLINE: u64 = 3000;

/// The host: swings joint 1 until something stops it. The tests below run it in a process of its own.
#[test]
#[ignore = "run by the other tests of this file"]
fn host_process() {
    let variable = |name: &str| std::env::var(name).expect("set by the parent").parse().expect("an address");
    let address = Address { tcp: variable(TCP), udp: variable(UDP) };
    let mut arm = Arm::connect(address, &credentials(), timeouts(), home_posture()).expect("connects");
    let mut servoing = Servoing::enter(&mut arm, patient_limits()).expect("enters");
    let start = *servoing.command();
    let begin = Instant::now();
    let mut next = begin;
    loop {
        next += Duration::from_millis(1);
        // Near 0.5 rad/s nearly all the time, so that it is moving whenever it is stopped.
        let phase = begin.elapsed().as_secs_f64() % 2.0;
        let mut wanted = start;
        wanted[0] += 0.5 * phase.min(2.0 - phase);
        let command = *servoing.command();
        wanted[0] = wanted[0].clamp(command[0] - 1e-3, command[0] + 1e-3);
        match servoing.command_angles(&wanted, next) {
            // On a busy machine the emulated arm may fall behind: wait for it.
            Err(KortexError::Command(CommandError::Lead { .. })) => drop(servoing.hold(next).expect("holds")),
            result => drop(result.expect("follows")),
        }
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        next = next.max(Instant::now() - Duration::from_millis(5));
    }
}

/// Ends the host process, whatever the outcome of the test.
struct Host(Child);

impl Drop for Host {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

fn signal(host: &Host, name: &str) {
    let done = Command::new("kill").args([name, &host.0.id().to_string()]).status().expect("kill runs");
    assert!(done.success());
}

fn stopped_by(end: impl FnOnce(&Host)) {
    let emulator = emulator_with(home_posture(), Pace::RealTime, DEADLINE);
    let address = emulator.address();
    let host = Command::new(std::env::current_exe().expect("this program"))
        .args(["--ignored", "--exact", "dead_host::host_process"])
        .env(TCP, address.tcp.to_string())
        .env(UDP, address.udp.to_string())
        .stdout(Stdio::null())
        .spawn()
        .expect("starts itself");
    let host = Host(host);
    let moving = |emulator: &Emulator| emulator.status().motion.velocity[0].abs() > 0.3;
    until("the arm moves", || moving(&emulator) && emulator.status().commands.followed > 300);
    assert_eq!(time_of(&emulator, EventKind::Watchdog), None, "before the host was stopped");
    end(&host);
    until("the watchdog trips", || time_of(&emulator, EventKind::Watchdog).is_some());
    let (watchdog, last) = (time_of(&emulator, EventKind::Watchdog), emulator.status().commands.last);
    assert_eq!(watchdog, Some(last + DEADLINE + 1), "by the arm's own clock");
    until("the arm stands", || emulator.status().motion.velocity.iter().all(|speed| speed.abs() < 1e-3));
    assert_eq!(emulator.status().state, ArmState::InFault);
}

#[test]
fn a_killed_host_leaves_a_standing_arm() {
    stopped_by(|host| signal(host, "-KILL"));
}

#[test]
fn a_frozen_host_leaves_a_standing_arm() {
    stopped_by(|host| signal(host, "-STOP"));
}
