//! `ftac bridge emulate`: the devices without the hardware.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use hand_model::ACTUATORS;
use hardware_bridge::config::{ArmConfig, BridgeConfig, CameraConfig, LimitConfig, ServoConfig};
use hardware_bridge::emulator::faults::Faults;
use hardware_bridge::emulator::servo::EmulatedServo;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};

use super::shown;
use crate::cli::Cli;

/// Travel of the shafts of [`SpringHand`], rad.
const TRAVEL: f64 = 4.0;

/// Arguments of `bridge emulate`.
#[derive(Debug, Args)]
pub struct EmulateArgs {
    /// Folder for bridge.toml and for the links `servos` and `cameras` to the pseudo-terminals.
    #[arg(long, default_value = "recordings/emulated")]
    dir: PathBuf,
    /// What goes wrong: CHANCE or ID@SECONDS, such as noise=0.1, drop=0.02, overload=3@5, voltage=5.2@3, freeze=7@2.
    #[arg(long = "fault")]
    faults: Vec<String>,
    /// One servo as it leaves the factory instead of six provisioned ones, for `bridge provision`.
    #[arg(long)]
    factory: bool,
    /// End after so many seconds; default: when interrupted.
    #[arg(long)]
    seconds: Option<f64>,
}

pub fn run(cli: &Cli, args: &EmulateArgs) -> Result<Option<String>> {
    let faults = Faults::parse(args.faults.iter().map(String::as_str))?;
    let mut settings = EmulatorSettings { faults, seed: cli.seed, ..EmulatorSettings::default() };
    if args.factory {
        settings.servos = vec![EmulatedServo::factory(2000)];
    }
    std::fs::create_dir_all(&args.dir).with_context(|| shown(&args.dir))?;
    let hand = EmulatedHand::start(Box::new(SpringHand::new([TRAVEL; ACTUATORS])), settings)?;
    let config = write_config(args, &hand)?;
    if cli.json {
        println!(
            "{}",
            serde_json::json!({"config": shown(&config), "servos": shown(hand.servo_port()), "cameras": shown(hand.camera_port())})
        );
    } else {
        println!("servos on {}, cameras on {}", shown(hand.servo_port()), shown(hand.camera_port()));
        println!("try: ftac bridge scan --config {}", shown(&config));
    }
    let started = Instant::now();
    while args.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let (ticks, late) = hand.ticks();
    eprintln!("{ticks} plant ticks, {late} late");
    Ok(None)
}

/// Links to the pseudo-terminals and a configuration that names them.
fn write_config(args: &EmulateArgs, hand: &EmulatedHand) -> Result<PathBuf> {
    let folder = std::path::absolute(&args.dir).with_context(|| shown(&args.dir))?;
    let (servos, cameras) = (folder.join("servos"), folder.join("cameras"));
    hand.servos().link(&servos)?;
    hand.cameras().link(&cameras)?;
    let config = BridgeConfig {
        version: 1,
        calibration: "calibration.json".into(),
        stop_socket: "stop".into(),
        servos: ServoConfig {
            port: servos,
            ids: [1, 2, 3, 4, 5, 6],
            baud: 3_000_000,
            rate: 200.0,
            fast_sync_read: false,
            slack: 0.020,
        },
        cameras: Some(CameraConfig { port: cameras }),
        arm: ArmConfig::Loopback,
        // A pseudo-terminal has no real time behind it: a busy machine may be late by more than a real line ever is.
        limits: LimitConfig { staleness: 0.2, servo_watchdog: 0.2, arm_watchdog: 0.5, ..LimitConfig::default() },
    };
    let path = args.dir.join("bridge.toml");
    std::fs::write(&path, config.to_toml()).with_context(|| shown(&path))?;
    Ok(path)
}
