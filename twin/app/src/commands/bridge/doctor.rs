//! `ftac bridge doctor`: checks all devices.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use clap::Args;
use dynamixel_bus::servo_bus::latency_timer::{self, LatencyTimer};
use dynamixel_bus::servo_bus::{BusError, ServoBus};
use hand_model::{Hand, RobotModel};
use hardware_bridge::arm_link::ArmLinkError;
use hardware_bridge::calibration::HandCalibration;
use hardware_bridge::cameras::Cameras;
use hardware_bridge::clock::Clock;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::hand_bus::HandBus;
use hardware_bridge::reference_pictures::ReferencePictures;
use hardware_bridge::remote::socket_paths::{self, SocketFolder};
use hardware_bridge::setup::{self, SetupFinding};
use robot_backends::arm_link::connect_arm_link;

use super::shared::{ConfigArg, actuator_names, display_path, print_findings};
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Number of servo read cycles measured.
const CYCLE_COUNT: u32 = 200;
/// Time limit for one image from every camera.
const IMAGE_TIMEOUT: Duration = Duration::from_secs(3);

/// Arguments of `bridge doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    robot: RobotArgs,
    #[command(flatten)]
    config: ConfigArg,
    /// Store the present images as references, so that exchanged camera plugs are detected from now on. All cameras
    /// must be in their sockets, and nothing may touch the pads.
    #[arg(long)]
    store_references: bool,
}

pub fn run(terminal: &Terminal, args: &DoctorArgs) -> Result<Option<String>> {
    let robot = args.robot.model()?;
    let RobotModel { hand, arm, .. } = &robot;
    let config = &args.config.read()?;
    let mut findings = vec![check_stop_socket()];
    match check_servos(config, hand, &mut findings) {
        Ok(()) => {}
        Err(error) => findings.push(SetupFinding::new("servo bus", error, "an open port", false)),
    }
    check_cameras(config, hand.cameras.len(), args.store_references, &mut findings);
    match connect_arm_link(config, &robot, arm.home) {
        Ok(mut arm) => findings.push(match arm.read(0.0) {
            Ok(_) => SetupFinding::new("arm", "an answer", "no fault", true),
            Err(ArmLinkError { trouble, text }) => {
                SetupFinding::new("arm", text, format!("no fault ({trouble})"), false)
            }
        }),
        Err(error) => findings.push(SetupFinding::new("arm", format!("{error:#}"), "an answer", false)),
    }
    print_findings(terminal, &findings)
}

/// Reports the folder in which `ftac bridge stop` finds a robot, and who may stop it.
fn check_stop_socket() -> SetupFinding {
    let what = "stop socket";
    match socket_paths::folder() {
        Ok(SocketFolder { path, fallback_reason: None, .. }) => {
            SetupFinding::new(what, display_path(&path), "open to the operators' group", true)
        }
        Ok(SocketFolder { path, fallback_reason: Some(why), .. }) => SetupFinding::new(
            what,
            format!("{}, for this user alone", display_path(&path)),
            format!("any folder ({why})"),
            true,
        ),
        Err(error) => SetupFinding::new(what, error, "a folder for it", false),
    }
}

fn check_servos(config: &BridgeConfig, hand: &Hand, findings: &mut Vec<SetupFinding>) -> Result<(), BusError> {
    findings.push(match latency_timer::read(&config.servos.port, Path::new(latency_timer::SYSTEM_FOLDER)) {
        Ok(LatencyTimer::Milliseconds(ms)) => SetupFinding::new("USB latency timer, ms", ms, "1", ms == 1),
        Ok(LatencyTimer::Absent) => {
            SetupFinding::new("USB latency timer", "none (no FTDI adapter)", "1 ms or none", true)
        }
        Err(error) => SetupFinding::new("USB latency timer", error, "1 ms", false),
    });
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let mut all_there = true;
    for (id, name) in config.servos.ids.iter().zip(actuator_names(hand)) {
        match setup::check(&mut bus, config, *id, &name) {
            Ok(found) => findings.extend(found),
            Err(error) => {
                all_there = false;
                findings.push(SetupFinding::new(format!("{name} ({id})"), error, "an answer", false));
            }
        }
    }
    if !all_there {
        return Ok(());
    }
    let mut hand = HandBus::new(bus, config.servos.ids, config.servos.fast_sync_read);
    check_calibration(config, &mut hand, findings)?;
    let started = Instant::now();
    let mut whole = 0;
    for _ in 0..CYCLE_COUNT {
        whole += u32::from(hand.read(0.0)?.iter().all(Option::is_some));
    }
    let rate = f64::from(CYCLE_COUNT) / started.elapsed().as_secs_f64();
    let queue = hand.bus.statistics();
    let ms = |share| queue.round_trip(share).map_or("none".into(), |seconds| format!("{:.2}", 1e3 * seconds));
    let wanted = config.servos.rate;
    findings.push(SetupFinding::new("reads of all servos a second", format!("{rate:.0}"), wanted, rate >= wanted));
    let complete = format!("{whole} of {CYCLE_COUNT}");
    findings.push(SetupFinding::new("complete reads", complete, "99 % or more", whole * 100 >= CYCLE_COUNT * 99));
    let period = format!("p99 below {:.1}", 1e3 / wanted);
    let in_time = queue.round_trip(0.99).is_some_and(|seconds| seconds * wanted < 1.0);
    findings.push(SetupFinding::new(
        "round trip p50 / p99, ms",
        format!("{} / {}", ms(0.5), ms(0.99)),
        period,
        in_time,
    ));
    Ok(())
}

fn check_calibration(
    config: &BridgeConfig,
    hand: &mut HandBus,
    findings: &mut Vec<SetupFinding>,
) -> Result<(), BusError> {
    let what = "calibration";
    let calibration = match HandCalibration::read(&config.calibration) {
        Ok(calibration) => calibration,
        Err(error) => {
            findings.push(SetupFinding::new(what, error, "a file from `ftac bridge calibrate`", false));
            return Ok(());
        }
    };
    findings.push(match hand.compare_homing_offsets(&calibration)? {
        None => SetupFinding::new(what, calibration.hash(), "of these servos", true),
        Some((n, found, expected)) => {
            SetupFinding::new(format!("{what}: homing offset of actuator {n}"), found, expected, false)
        }
    });
    Ok(())
}

fn check_cameras(config: &BridgeConfig, expected: usize, know: bool, findings: &mut Vec<SetupFinding>) {
    let link = match Cameras::open(config, expected, &Clock::wall()) {
        Ok(Some(link)) => link,
        Ok(None) => {
            findings.push(SetupFinding::new("cameras", "not configured", "anything", true));
            return;
        }
        Err(error) => {
            findings.push(SetupFinding::new("cameras", error, "an answer", false));
            return;
        }
    };
    findings.push(match link.board() {
        Some(board) => {
            SetupFinding::new("camera board", format!("serial number {}", board.board().serial), "an answer", true)
        }
        None => SetupFinding::new("UVC devices", config.uvc.len(), "any number", true),
    });
    if let Err(error) = link.request_capture() {
        findings.push(SetupFinding::new("images", error, "one of every camera", false));
        return;
    }
    let started = Instant::now();
    let good = || link.camera_counters().iter().filter(|camera| camera.decoded > 0).count();
    while good() < expected && started.elapsed() < IMAGE_TIMEOUT {
        std::thread::sleep(Duration::from_millis(5));
    }
    let took = format!("{} in {:.0} ms", good(), 1e3 * started.elapsed().as_secs_f64());
    findings.push(SetupFinding::new("cameras with an image", took, expected, good() == expected));
    if good() == expected {
        findings.push(check_pictures(config, &link, know));
    }
    if let Some(error) = link.failure() {
        findings.push(SetupFinding::new("cameras, after that", error, "still there", false));
    }
    let Some(board) = link.board() else { return };
    let uncertainty = board.clock_uncertainty();
    let ms = uncertainty.map_or("unknown".into(), |seconds| format!("{:.2}", 1e3 * seconds));
    let good = uncertainty.is_some_and(|seconds| seconds < 5e-3);
    findings.push(SetupFinding::new("board clock known to, ms", ms, "below 5", good));
}

/// Checks that every camera shows its own pad.
fn check_pictures(config: &BridgeConfig, link: &Cameras, know: bool) -> SetupFinding {
    let what = "every camera shows its own pad";
    match describe_exchanged_cameras(config, link, know) {
        Ok(None) => SetupFinding::new(what, "unknown: no references", "references of --store-references", true),
        Ok(Some(wrong)) => SetupFinding::new(what, &wrong, "yes", wrong == "yes"),
        Err(error) => SetupFinding::new(what, format!("{error:#}"), "yes", false),
    }
}

/// Describes cameras that show another pad than their own. Returns `yes` if all are right, none if no references are
/// stored.
fn describe_exchanged_cameras(config: &BridgeConfig, link: &Cameras, know: bool) -> Result<Option<String>> {
    let path = ReferencePictures::beside(&config.calibration);
    let look = || ReferencePictures::capture(link, IMAGE_TIMEOUT).map_err(|error| anyhow!(error));
    let now = look()?;
    if know {
        let alike = now.indistinguishable_cameras(now.noise(&look()?));
        now.write(&path)?;
        if let Some([one, other]) = alike.first() {
            return Ok(Some(format!("{one} and {other} look alike: they cannot be distinguished")));
        }
    }
    let Some(kept) = ReferencePictures::read(&path, link.camera_counters().len())? else { return Ok(None) };
    let wrong = kept.exchanged_cameras(&now).into_iter();
    let wrong: Vec<String> = wrong.map(|one| one.to_string()).collect();
    Ok(Some(if wrong.is_empty() { "yes".to_owned() } else { wrong.join(", ") }))
}
