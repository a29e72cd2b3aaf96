//! Execution of an operator's request, from another terminal or from this program. The result is reported as measured.

use std::time::{Duration, Instant};

use crate::clock::Clock;
use crate::driven::SERVOS;
use crate::lock::lock;
use crate::remote::Wish;
use crate::safety::state::State;
use crate::servo_cycle::give;
use crate::servo_cycle::{Board, Order, Shared};

/// Speed below which a joint of the arm counts as at rest, rad/s.
const STANDS: f64 = 0.02;
/// Maximum age of a measurement that describes the present, s.
const FRESH: f64 = 0.3;
/// Longest wait until the arm is measured at rest; `LOOK` is the polling interval.
const BRAKING: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(5);
/// Longest wait for the end of a release, beyond the time in which its current fades.
const LETTING_GO: Duration = Duration::from_secs(6);

/// Passes a request to the servo cycle and waits for its result.
///
/// # Errors
/// The request was refused or could not be confirmed.
pub(crate) fn fulfil(shared: &Shared, clock: &Clock, wish: Wish, release_time: f64) -> Result<String, String> {
    let state = give(shared, Order::Remote(wish))?;
    match wish {
        Wish::Hold if lock(&shared.board).state == State::Connected => {
            Ok(format!("{state}, without torque by this program; it has to be checked again before it moves"))
        }
        Wish::State => Ok(format!("{state}; {}", standing(&lock(&shared.board), clock.now()))),
        Wish::Hold => {
            let begun = Instant::now();
            while speed(&lock(&shared.board), clock.now()).is_none_or(|speed| speed > STANDS)
                && begun.elapsed() < BRAKING
            {
                std::thread::sleep(LOOK);
            }
            let board = lock(&shared.board);
            Ok(format!("{}; {}", board.state, standing(&board, clock.now())))
        }
        Wish::Release => released(shared, Duration::from_secs_f64(release_time) + LETTING_GO),
    }
}

/// Waits for the end of a release; returns for how many servos the torque was read back as off.
fn released(shared: &Shared, patience: Duration) -> Result<String, String> {
    let begun = Instant::now();
    loop {
        let board = lock(&shared.board);
        match board.state {
            State::Connected => {
                let unsure = &board.report.still_on;
                let off = format!("torque read back as off from {} of {SERVOS} servos", SERVOS - unsure.len());
                return if unsure.is_empty() { Ok(off) } else { Err(format!("{off}; {}", unsure.join("; "))) };
            }
            State::Release { .. } if begun.elapsed() < patience => {}
            state => return Err(format!("not released: found {state}, expected connected, without torque")),
        }
        drop(board);
        std::thread::sleep(LOOK);
    }
}

/// Returns the speed of the arm's fastest joint, rad/s, if it was measured recently.
fn speed(board: &Board, now: f64) -> Option<f64> {
    let arm = board.measured.arm.filter(|arm| now - arm.at <= FRESH)?;
    Some(arm.state.velocity.iter().fold(0.0, |most, speed| speed.abs().max(most)))
}

/// Describes in words the measured state of arm and servos at `now` (s).
pub(crate) fn standing(board: &Board, now: f64) -> String {
    let arm = match speed(board, now) {
        None => "nothing is heard from the arm".to_owned(),
        Some(speed) if speed <= STANDS => "the arm stands".to_owned(),
        Some(speed) => format!("the arm moves at {speed:.2} rad/s"),
    };
    let servos = board.measured.servos.iter().flatten().filter(|servo| now - servo.at <= FRESH).count();
    format!("{arm}, {servos} of {SERVOS} servos answer")
}
