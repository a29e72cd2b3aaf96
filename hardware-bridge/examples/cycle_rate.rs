//! Measures the rate of the servo bus on this machine: reads all six emulated servos and writes their goals 200 times, and prints the measured rate
//! beside the one calculated from the line's timing. `cargo run --release -p hardware-bridge --example cycle_rate`

use dynamixel_bus::servo_bus::timing::CycleTraffic;
use dynamixel_bus::servo_bus::{BusSettings, ServoBus};
use dynamixel_bus::xc330::{self, PRESENT_BLOCK_LONG};
use hardware_bridge::supported_robot::SERVOS;
use std::time::Instant;

use hand_model::RobotModel;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};

const IDS: [u8; SERVOS] = [1, 2, 3, 4, 5, 6];
const CYCLES: u32 = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plant = Box::new(SpringHand::new([4.0; SERVOS], 18));
    let hand = EmulatedHand::start(plant, EmulatorSettings::default(), &RobotModel::ftac_gen3())?;
    let mut bus = ServoBus::open(hand.servo_port(), BusSettings { slack: 0.25, ..BusSettings::default() })?;
    let read = PRESENT_BLOCK_LONG;
    let length = read.end - read.start;
    for fast in [false, true] {
        let started = Instant::now();
        for _ in 0..CYCLES {
            match fast {
                true => bus.fast_sync_read(&IDS, read.start, length)?,
                false => bus.sync_read(&IDS, read.start, length)?,
            };
            for register in [xc330::GOAL_CURRENT, xc330::GOAL_POSITION] {
                bus.sync_write_register(&IDS, &register, 0.0)?;
            }
        }
        let rate = f64::from(CYCLES) / started.elapsed().as_secs_f64();
        let cycle = CycleTraffic { servos: IDS.len(), read: length.into(), writes: &[2, 4], fast };
        let round_trip = |quantile| 1e3 * bus.statistics().round_trip(quantile).unwrap_or(f64::NAN);
        println!(
            "fast {fast}: {rate:.0} cycles/s measured, {:.0} calculated; round trip p50 {:.2} ms, p99 {:.2} ms",
            1.0 / bus.timing().cycle(cycle),
            round_trip(0.5),
            round_trip(0.99),
        );
    }
    println!("{} answers missing", bus.statistics().missing);
    Ok(())
}
