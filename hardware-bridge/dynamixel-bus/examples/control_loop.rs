//! Moves a hand of 16 XL330 or XC330 servos (such as a LEAP Hand) by sines at 100 Hz, and prints statistics of the bus.
//!
//! `cargo run -p dynamixel-bus --example control_loop -- /dev/ttyUSB0` moves the servos 0 to 15 at 3 Mbaud by 0.2 rad about
//! the places where they are. Without a port, this program emulates them on a pseudo-terminal.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

use dynamixel_bus::models::xl330_m288::{self, GOAL_POSITION, PRESENT_CURRENT, PRESENT_POSITION};
use dynamixel_bus::xc330::PRESENT_BLOCK;
use dynamixel_bus::{BusSettings, ServoBus};

#[path = "../tests/support/responder.rs"]
mod responder;

const IDS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
const TICK: Duration = Duration::from_millis(10);
const CYCLES: u32 = 200;

fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args().nth(1) {
        Some(port) => run(port.as_ref()),
        None => {
            let servos = responder::Responder::start(&xl330_m288::MODEL, &IDS)?;
            run(&servos.path)
        }
    }
}

fn run(port: &Path) -> Result<(), Box<dyn Error>> {
    let mut bus = ServoBus::open(port, BusSettings::default())?;
    let start: Vec<f64> = bus.sync_read_register(&IDS, &PRESENT_POSITION)?.into_iter().collect::<Result<_, _>>()?;
    for torque in bus.set_torque(&IDS, true) {
        torque?;
    }
    let result = cycles(&mut bus, &start);
    // Whatever happened, the servos are left without torque.
    for torque in bus.set_torque(&IDS, false) {
        torque?;
    }
    result?;
    let statistics = bus.statistics();
    let milliseconds = |share| statistics.round_trip(share).unwrap_or(f64::NAN) * 1e3;
    println!(
        "{} answers, {} missing, {} bad checksums; round trip {:.2} ms median, {:.2} ms at 99 %",
        statistics.answers,
        statistics.missing,
        statistics.bad_crc,
        milliseconds(0.5),
        milliseconds(0.99)
    );
    Ok(())
}

fn cycles(bus: &mut ServoBus, start: &[f64]) -> Result<(), Box<dyn Error>> {
    let mut next = Instant::now();
    for cycle in 0..CYCLES {
        // Current, velocity and position of all servos in one request.
        let replies = bus.sync_read(&IDS, PRESENT_BLOCK.start, PRESENT_BLOCK.len() as u16)?;
        if cycle % 50 == 0 {
            for status in replies.iter().flatten().take(1) {
                let current = PRESENT_CURRENT.read_from(&status.data, PRESENT_BLOCK.start).ok_or("no current")?;
                let angle = PRESENT_POSITION.read_from(&status.data, PRESENT_BLOCK.start).ok_or("no angle")?;
                println!("servo {}: {angle:.3} rad, {current:.3} A", status.id);
            }
        }
        // A servo that does not answer once is no reason to stop; one with an error is.
        if let Some(alert) = replies.iter().flatten().find(|status| status.alert) {
            return Err(format!("servo {} reports a hardware error", alert.id).into());
        }
        let phase = std::f64::consts::TAU * f64::from(cycle) / f64::from(CYCLES);
        let goals: Vec<(u8, f64)> = IDS.iter().zip(start).map(|(id, angle)| (*id, angle + 0.2 * phase.sin())).collect();
        bus.sync_write_values(&GOAL_POSITION, &goals)?;
        next += TICK;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}
