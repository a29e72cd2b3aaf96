//! Streams set-points to an emulated arm for a second: the wrist turns by 0.2 rad and back.
//!
//! `cargo run -p kinova-kortex --features emulator --example stream_set_points`

use std::error::Error;
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
use kinova_kortex::servo_loop::{Pacing, ServoLoop};
use kinova_kortex::servoing::ServoingLimits;
use kinova_kortex::{Arm, Timeouts, gen3};

/// Interval between set-points.
const TICK: Duration = Duration::from_millis(10);

fn main() -> Result<(), Box<dyn Error>> {
    // Generous deadlines, for a machine that does other work besides.
    let settings = Settings { cyclic_deadline: 1000, ..Settings::default() };
    let limits = ServoingLimits { silent_cycles: 1000, ..ServoingLimits::gen3() };
    let pacing = Pacing { tick: TICK, host_deadline: Duration::from_secs(1) };

    let credentials = settings.credentials.clone();
    let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
    let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
    println!("before: {:.3?} rad", arm.cyclic.feedback()?.motion.position);

    let servo_loop = ServoLoop::start(arm, limits, pacing)?;
    let start = servo_loop.snapshot().command;
    let mut next = Instant::now();
    for tick in 1..=100 {
        let mut angles = start;
        angles[6] += 0.1 * (1.0 - (TAU * f64::from(tick) / 100.0).cos());
        servo_loop.set_target(angles)?;
        next += TICK;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        if tick % 25 == 0 {
            println!("wrist:  {:.3} rad", servo_loop.snapshot().feedback.motion.position[6]);
        }
    }
    let snapshot = servo_loop.snapshot();
    let (mut arm, result) = servo_loop.finish();
    result?;

    println!("after:  {:.3?} rad", arm.cyclic.feedback()?.motion.position);
    println!("{:?}, {} cycles late by more than a cycle", snapshot.counters, snapshot.overruns);
    arm.close()?;
    Ok(())
}
