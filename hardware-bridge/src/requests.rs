//! Execution of an operator's request, from another terminal or from this program. The result is reported as measured.

use std::time::{Duration, Instant};

use crate::clock::Clock;
use crate::lock::lock;
use crate::remote::RemoteCommand;
use crate::safety::state::SupervisorState;
use crate::servo_cycle::send_order;
use crate::servo_cycle::{CycleOrder, CycleShared, SharedState};

/// Speed below which a joint of the arm counts as at rest, rad/s.
const REST_SPEED: f64 = 0.02;
/// Maximum age of a measurement that describes the present, s.
const MAX_AGE: f64 = 0.3;
/// Longest wait until the arm is measured at rest; `POLL_INTERVAL` is the polling interval.
const BRAKING_TIMEOUT: Duration = Duration::from_secs(1);
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Longest wait for the end of a release, beyond the time in which its current fades.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(6);

/// Passes a request to the servo cycle and waits for its result.
///
/// # Errors
/// The request was refused or could not be confirmed.
pub(crate) fn execute_request(
    shared: &CycleShared,
    clock: &Clock,
    command: RemoteCommand,
    release_time: f64,
) -> Result<String, String> {
    let state = send_order(shared, CycleOrder::Remote(command))?;
    match command {
        RemoteCommand::Hold if lock(&shared.state).state == SupervisorState::Connected => {
            Ok(format!("{state}, without torque by this program; it has to be checked again before it moves"))
        }
        RemoteCommand::State => Ok(format!("{state}; {}", describe_state(&lock(&shared.state), clock.now()))),
        RemoteCommand::Hold => {
            let begun = Instant::now();
            while max_joint_speed(&lock(&shared.state), clock.now()).is_none_or(|speed| speed > REST_SPEED)
                && begun.elapsed() < BRAKING_TIMEOUT
            {
                std::thread::sleep(POLL_INTERVAL);
            }
            let board = lock(&shared.state);
            Ok(format!("{}; {}", board.state, describe_state(&board, clock.now())))
        }
        RemoteCommand::Release => wait_for_release(shared, Duration::from_secs_f64(release_time) + RELEASE_TIMEOUT),
    }
}

/// Waits for the end of a release; returns for how many servos the torque was read back as off.
fn wait_for_release(shared: &CycleShared, timeout: Duration) -> Result<String, String> {
    let begun = Instant::now();
    loop {
        let board = lock(&shared.state);
        match board.state {
            SupervisorState::Connected => {
                let (servos, unsure) = (board.measured.servos.len(), &board.report.torque_still_on);
                let off = format!("torque read back as off from {} of {servos} servos", servos - unsure.len());
                return if unsure.is_empty() { Ok(off) } else { Err(format!("{off}; {}", unsure.join("; "))) };
            }
            SupervisorState::Release { .. } if begun.elapsed() < timeout => {}
            state => return Err(format!("not released: found {state}, expected connected, without torque")),
        }
        drop(board);
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns the speed of the arm's fastest joint, rad/s, if it was measured recently.
fn max_joint_speed(board: &SharedState, now: f64) -> Option<f64> {
    let arm = board.measured.arm.filter(|arm| now - arm.received_at <= MAX_AGE)?;
    Some(arm.state.velocity.iter().fold(0.0, |most, speed| speed.abs().max(most)))
}

/// Describes in words the measured state of arm and servos at `now` (s).
pub(crate) fn describe_state(board: &SharedState, now: f64) -> String {
    let arm = match max_joint_speed(board, now) {
        None => "no recent measurement of the arm".to_owned(),
        Some(speed) if speed <= REST_SPEED => "the arm stands".to_owned(),
        Some(speed) => format!("the arm moves at {speed:.2} rad/s"),
    };
    let servos = &board.measured.servos;
    let answering = servos.iter().flatten().filter(|servo| now - servo.received_at <= MAX_AGE).count();
    format!("{arm}, {answering} of {} servos answer", servos.len())
}
