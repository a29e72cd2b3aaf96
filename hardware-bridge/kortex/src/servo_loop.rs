//! Servoing at 1 kHz in a thread of its own, with targets from a slower controller.
//!
//! The controller sets a target at each of its ticks (say 10 ms). The loop interpolates to it in equal steps over one
//! tick, never faster than the limits allow. If the controller is silent for longer than [`Pacing::host_deadline`], the
//! loop stops the arm in place and reports it.
//!
//! The thread also keeps the sessions alive. It ends at the first error, leaves low-level servoing, and returns the arm.

use std::sync::mpsc;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::arm::Arm;
use crate::cyclic::{Counters, Feedback};
use crate::error::{CommandError, KortexError};
use crate::joints::JOINTS;
use crate::lock::lock;
use crate::servoing::{Servoing, ServoingLimits};

/// Timing of the controller that sets the targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pacing {
    /// Interval between two targets of the controller.
    pub tick: Duration,
    /// Longest silence of the controller; after it the arm is stopped.
    pub host_deadline: Duration,
}

/// State of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// Newest measurements.
    pub feedback: Feedback,
    /// Command last sent, rad.
    pub command: [f64; JOINTS],
    /// Outcomes of the cycles.
    pub counters: Counters,
    /// Cycles that were skipped because one began late by more than a cycle.
    pub overruns: u64,
    /// Largest lateness of a cycle so far.
    pub lateness: Duration,
    /// True while the arm is stopped because the controller is silent.
    pub host_silent: bool,
    /// Cycles in which the command waited for an arm that lagged too far behind.
    pub waited: u64,
    /// True once the loop has ended; [`ServoLoop::finish`] gives the reason.
    pub ended: bool,
}

struct Target {
    angles: [f64; JOINTS],
    set: Instant,
    /// True until the loop has seen it.
    new: bool,
}

struct Shared {
    target: Option<Target>,
    snapshot: Snapshot,
    stop: bool,
}

/// The running loop. Dropping it stops it and leaves low-level servoing.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// use std::time::Duration;
///
/// use kinova_kortex::servo_loop::{Pacing, ServoLoop};
/// use kinova_kortex::servoing::ServoingLimits;
///
/// let limits = ServoingLimits::gen3();
/// # let limits = ServoingLimits { silent_cycles: 60_000, ..limits };
/// let pacing = Pacing { tick: Duration::from_millis(10), host_deadline: Duration::from_millis(200) };
/// let servo_loop = ServoLoop::start(arm, limits, pacing)?;
/// let mut target = servo_loop.snapshot().command;
/// target[6] += 0.01;
/// servo_loop.set_target(target)?;
/// std::thread::sleep(Duration::from_millis(50));
/// println!("{:?} rad", servo_loop.snapshot().feedback.motion.position);
/// let (arm, result) = servo_loop.finish();
/// result?;
/// arm.close()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ServoLoop {
    shared: Arc<Mutex<Shared>>,
    limits: ServoingLimits,
    thread: Option<JoinHandle<(Arm, Result<(), KortexError>)>>,
}

impl std::fmt::Debug for Shared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.snapshot.fmt(f)
    }
}

impl ServoLoop {
    /// Enters low-level servoing and starts cycling. The arm stands still until the first target.
    ///
    /// # Errors
    /// As [`Servoing::enter`].
    pub fn start(arm: Arm, limits: ServoingLimits, pacing: Pacing) -> Result<Self, KortexError> {
        let (entered, entry) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            let mut arm = arm;
            let result = match Servoing::enter(&mut arm, limits) {
                Ok(servoing) => run(servoing, pacing, &entered),
                Err(error) => Err(error),
            };
            (arm, result)
        });
        match entry.recv() {
            Ok(shared) => Ok(Self { shared, limits, thread: Some(thread) }),
            // The thread ended before it entered, and has the reason.
            Err(_) => match thread.join() {
                Ok((_, Err(error))) => Err(error),
                Ok((_, Ok(()))) => unreachable!("a loop that never entered cannot have been asked to stop"),
                Err(panic) => std::panic::resume_unwind(panic),
            },
        }
    }

    /// Sets the joint angles to be reached one tick from now, rad.
    ///
    /// # Errors
    /// [`CommandError::NotFinite`], [`CommandError::Range`]; the previous target stays.
    pub fn set_target(&self, angles: [f64; JOINTS]) -> Result<(), CommandError> {
        self.limits.check_range(&angles)?;
        lock(&self.shared).target = Some(Target { angles, set: Instant::now(), new: true });
        Ok(())
    }

    /// Returns the state of the loop.
    pub fn snapshot(&self) -> Snapshot {
        lock(&self.shared).snapshot
    }

    /// True if [`ServoLoop::finish`] returns at once. A loop that has ended may still be waiting for the answer to its
    /// log-out.
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Stops the loop and returns the arm, with the error that ended the loop if there was one.
    pub fn finish(mut self) -> (Arm, Result<(), KortexError>) {
        lock(&self.shared).stop = true;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => unreachable!("the thread is taken here and in drop only"),
        }
    }
}

impl Drop for ServoLoop {
    fn drop(&mut self) {
        lock(&self.shared).stop = true;
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

/// Path to a target: equal steps over a tick of the controller.
struct Path {
    target: [f64; JOINTS],
    step: [f64; JOINTS],
}

impl Path {
    fn new(from: &[f64; JOINTS], target: [f64; JOINTS], cycles: f64, limits: &ServoingLimits) -> Self {
        let step = std::array::from_fn(|i| ((target[i] - from[i]).abs() / cycles).min(limits.step[i]));
        Self { target, step }
    }

    fn next(&self, from: &[f64; JOINTS]) -> [f64; JOINTS] {
        std::array::from_fn(|i| from[i] + (self.target[i] - from[i]).clamp(-self.step[i], self.step[i]))
    }
}

fn run(
    mut servoing: Servoing<'_>,
    pacing: Pacing,
    entered: &mpsc::Sender<Arc<Mutex<Shared>>>,
) -> Result<(), KortexError> {
    let snapshot = Snapshot {
        feedback: *servoing.latest(),
        command: *servoing.command(),
        counters: Counters::default(),
        overruns: 0,
        lateness: Duration::ZERO,
        host_silent: false,
        waited: 0,
        ended: false,
    };
    let shared = Arc::new(Mutex::new(Shared { target: None, snapshot, stop: false }));
    // If nobody waits for the entry any more, nobody wants the arm to servo either.
    let result = match entered.send(Arc::clone(&shared)) {
        Ok(()) => cycle_on(&mut servoing, pacing, &shared),
        Err(_) => Ok(()),
    };
    lock(&shared).snapshot.ended = true;
    result?;
    servoing.leave()
}

fn cycle_on(servoing: &mut Servoing<'_>, pacing: Pacing, shared: &Mutex<Shared>) -> Result<(), KortexError> {
    let limits = *servoing.limits();
    let cycles = (pacing.tick.as_secs_f64() / limits.cycle.as_secs_f64()).max(1.0);
    let mut path: Option<Path> = None;
    let mut next = Instant::now() + limits.cycle;
    loop {
        let command = *servoing.command();
        {
            let mut shared = lock(shared);
            if shared.stop {
                return Ok(());
            }
            if let Some(target) = &mut shared.target {
                if std::mem::take(&mut target.new) {
                    path = Some(Path::new(&command, target.angles, cycles, &limits));
                }
                let silent = target.set.elapsed() > pacing.host_deadline;
                if silent {
                    path = None;
                }
                shared.snapshot.host_silent = silent;
            }
        }
        let wanted = path.as_ref().map_or(command, |path| path.next(&command));
        let mut waited = false;
        match servoing.command_angles(&wanted, next) {
            // The arm lags, perhaps because it is blocked: wait for it.
            Err(KortexError::Command(CommandError::Lead { .. })) => {
                waited = true;
                servoing.hold(next)?;
            }
            result => drop(result?),
        }
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        let late = next.elapsed();
        let mut shared = lock(shared);
        let snapshot = &mut shared.snapshot;
        snapshot.feedback = *servoing.latest();
        snapshot.command = *servoing.command();
        snapshot.counters = servoing.arm().cyclic.counters();
        snapshot.waited += u64::from(waited);
        snapshot.lateness = snapshot.lateness.max(late);
        next += limits.cycle;
        if late > limits.cycle {
            // Missed cycles are not caught up: the arm takes one command a millisecond.
            snapshot.overruns += (late.as_nanos() / limits.cycle.as_nanos()) as u64;
            next = Instant::now() + limits.cycle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The path takes ten cycles to the target, in equal steps, and goes no further.
    #[test]
    fn path_is_straight_and_ends_at_the_target() {
        let limits = ServoingLimits::gen3();
        let target = [0.01, -0.005, 0.0, 0.0, 0.0, 0.0, 0.0];
        let mut at = [0.0; JOINTS];
        let path = Path::new(&at, target, 10.0, &limits);
        for cycle in 1..=12 {
            at = path.next(&at);
            let share = f64::from(cycle.min(10)) / 10.0;
            assert!((at[0] - 0.01 * share).abs() < 1e-12 && (at[1] + 0.005 * share).abs() < 1e-12, "cycle {cycle}");
        }
        assert_eq!(at, target);
    }

    /// A target too far for one tick is approached at top speed.
    #[test]
    fn path_keeps_the_speed_limit() {
        let limits = ServoingLimits::gen3();
        let from = [0.0; JOINTS];
        let next = Path::new(&from, [1.0; JOINTS], 10.0, &limits).next(&from);
        assert_eq!(next, limits.step);
    }
}
