//! Finds the servos on a bus and reads their state.
//!
//! `cargo run -p dynamixel-bus --example scan -- /dev/ttyUSB0` tries all baud rates, and with `-- /dev/ttyUSB0 57600` one.
//! Without a port it finds servos that this program emulates on a pseudo-terminal.

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use dynamixel_bus::models::xm430_w350;
use dynamixel_bus::servo_bus::latency_timer::{self, LatencyTimer};
use dynamixel_bus::x_series::{BAUD_RATES, hardware_error};
use dynamixel_bus::{BusSettings, Model, ServoBus};

#[path = "../tests/support/responder.rs"]
mod responder;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.as_slice() {
        [] => {
            let servos = responder::Responder::start(&xm430_w350::MODEL, &[1, 2, 11])?;
            scan(&servos.path, &[57_600])
        }
        [port] => scan(&PathBuf::from(port), &BAUD_RATES),
        [port, baud] => scan(&PathBuf::from(port), &[baud.parse()?]),
        _ => Err("expected: [PORT [BAUD]]".into()),
    }
}

fn scan(port: &PathBuf, rates: &[u32]) -> Result<(), Box<dyn Error>> {
    if let LatencyTimer::Milliseconds(timer) = latency_timer::read(port, latency_timer::SYSTEM_FOLDER.as_ref())? {
        println!("latency timer of the adapter: {timer} ms (1 ms is best)");
    }
    for &baud in rates {
        // Factory settings: a return delay of 0.5 ms.
        let mut bus = ServoBus::open(port, BusSettings { baud, return_delay: 500e-6, ..BusSettings::default() })?;
        let servos = bus.scan(Duration::from_millis(300))?;
        println!("{baud} baud: {} servos", servos.len());
        for servo in servos {
            let Some(model) = Model::by_number(servo.model) else {
                println!("  id {:3}: unknown model {}, firmware {}", servo.id, servo.model, servo.firmware);
                continue;
            };
            let mut read = |name: &str| -> Result<f64, Box<dyn Error>> {
                Ok(bus.read(servo.id, model.register(name).ok_or("no such register")?)?)
            };
            println!(
                "  id {:3}: {}, firmware {}, {:.1} V, {} C, {:.3} rad, errors: {}",
                servo.id,
                model.name,
                servo.firmware,
                read("Present Input Voltage")?,
                read("Present Temperature")?,
                read("Present Position")?,
                hardware_error::describe(read("Hardware Error Status")? as u8),
            );
        }
    }
    Ok(())
}
