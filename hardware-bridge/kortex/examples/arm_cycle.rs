//! Measures how well this machine holds the arm's cycle: commands the emulated arm a thousand times a second and prints
//! round-trip times, lateness and the outcome of the datagrams. Run with `cargo run --release -p kinova-kortex --features
//! emulator --example arm_cycle -- SECONDS`.

use std::time::{Duration, Instant};

use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
use kinova_kortex::servoing::{Servoing, ServoingLimits};
use kinova_kortex::{Arm, Timeouts, gen3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seconds: u64 = std::env::args().nth(1).map_or(Ok(10), |text| text.parse())?;
    let settings = Settings { cyclic_deadline: 1000, ..Settings::default() };
    let credentials = settings.credentials.clone();
    let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
    let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
    let limits = ServoingLimits::gen3();
    let cycle = limits.cycle;
    let mut servoing = Servoing::enter(&mut arm, limits)?;
    let home = *servoing.command();

    let (mut round_trips, mut lateness, mut overruns) = (Vec::new(), Vec::new(), 0_u64);
    let begin = Instant::now();
    let mut next = begin + cycle;
    let mut phase = 0.0_f64;
    while begin.elapsed() < Duration::from_secs(seconds) {
        // 0.2 rad at 0.5 Hz, counted in cycles, so that a late cycle makes no larger step.
        phase += std::f64::consts::PI * cycle.as_secs_f64();
        let wanted = home.map(|angle| angle + 0.2 * phase.sin());
        let start = Instant::now();
        if servoing.command_angles(&wanted, next)? {
            round_trips.push(start.elapsed());
        }
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        let late = next.elapsed();
        lateness.push(late);
        next += cycle;
        if late > cycle {
            overruns += 1;
            next = Instant::now() + cycle;
        }
    }
    let counters = servoing.arm().cyclic.counters();
    servoing.leave()?;
    arm.close()?;
    println!("{seconds} s, {} cycles, {overruns} begun more than a cycle late", lateness.len());
    println!("round trip: {}", quantiles(&mut round_trips));
    println!("lateness:   {}", quantiles(&mut lateness));
    println!("{counters:?}");
    Ok(())
}

fn quantiles(times: &mut [Duration]) -> String {
    times.sort();
    let at = |share: f64| times.get(((times.len() as f64 - 1.0) * share) as usize).copied().unwrap_or_default();
    format!("p50 {:?}, p99 {:?}, p99.9 {:?}, max {:?}", at(0.5), at(0.99), at(0.999), at(1.0))
}
