//! `ftac bridge doctor`: checks all devices.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use clap::Args;
use hand_model::{Hand, RobotModel};
use hardware_bridge::arm_link::ArmLinkError;
use hardware_bridge::calibration::HandCalibration;
use hardware_bridge::cameras::Cameras;
use hardware_bridge::clock::Clock;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::hand_bus::HandBus;
use hardware_bridge::pictures::Pictures;
use hardware_bridge::remote::places::{self, Folder};
use hardware_bridge::servo_bus::latency_timer::{self, LatencyTimer};
use hardware_bridge::servo_bus::{BusError, ServoBus};
use hardware_bridge::setup::{self, Finding};
use robot_backends::arm_link::arm_link;

use super::shared::{ConfigArg, actuator_names, shown, tell};
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Number of servo read cycles measured.
const CYCLES: u32 = 200;
/// Time limit for one image from every camera.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `bridge doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    robot: RobotArgs,
    #[command(flatten)]
    config: ConfigArg,
    /// Keep the present images as reference, so that exchanged camera plugs are noticed from now on. All cameras must
    /// be in their sockets and nothing may touch the pads.
    #[arg(long)]
    know_cameras: bool,
}

pub fn run(terminal: &Terminal, args: &DoctorArgs) -> Result<Option<String>> {
    let robot = args.robot.model()?;
    let RobotModel { hand, arm, .. } = &robot;
    let config = &args.config.read()?;
    let mut findings = vec![stop_socket()];
    match servos(config, hand, &mut findings) {
        Ok(()) => {}
        Err(error) => findings.push(Finding::new("servo bus", error, "an open port", false)),
    }
    cameras(config, hand.cameras.len(), args.know_cameras, &mut findings);
    match arm_link(config, &robot, arm.home) {
        Ok(mut arm) => findings.push(match arm.read(0.0) {
            Ok(_) => Finding::new("arm", "an answer", "no fault", true),
            Err(ArmLinkError { trouble, text }) => Finding::new("arm", text, format!("no fault ({trouble})"), false),
        }),
        Err(error) => findings.push(Finding::new("arm", format!("{error:#}"), "an answer", false)),
    }
    tell(terminal, &findings)
}

/// Reports the folder in which `ftac bridge stop` finds a robot, and who may stop it.
fn stop_socket() -> Finding {
    let what = "stop socket";
    match places::folder() {
        Ok(Folder { path, why_own: None, .. }) => {
            Finding::new(what, shown(&path), "open to the operators' group", true)
        }
        Ok(Folder { path, why_own: Some(why), .. }) => {
            Finding::new(what, format!("{}, for this user alone", shown(&path)), format!("any folder ({why})"), true)
        }
        Err(error) => Finding::new(what, error, "a folder for it", false),
    }
}

fn servos(config: &BridgeConfig, hand: &Hand, findings: &mut Vec<Finding>) -> Result<(), BusError> {
    findings.push(match latency_timer::read(&config.servos.port, Path::new(latency_timer::SYSTEM)) {
        Ok(LatencyTimer::Milliseconds(ms)) => Finding::new("USB latency timer, ms", ms, "1", ms == 1),
        Ok(LatencyTimer::Absent) => Finding::new("USB latency timer", "none (no FTDI adapter)", "1 ms or none", true),
        Err(error) => Finding::new("USB latency timer", error, "1 ms", false),
    });
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let mut all_there = true;
    for (id, name) in config.servos.ids.iter().zip(actuator_names(hand)) {
        match setup::check(&mut bus, config, *id, &name) {
            Ok(found) => findings.extend(found),
            Err(error) => {
                all_there = false;
                findings.push(Finding::new(format!("{name} ({id})"), error, "an answer", false));
            }
        }
    }
    if !all_there {
        return Ok(());
    }
    let mut hand = HandBus::new(bus, config.servos.ids, config.servos.fast_sync_read);
    calibration(config, &mut hand, findings)?;
    let started = Instant::now();
    let mut whole = 0;
    for _ in 0..CYCLES {
        whole += u32::from(hand.read(0.0)?.iter().all(Option::is_some));
    }
    let rate = f64::from(CYCLES) / started.elapsed().as_secs_f64();
    let books = hand.bus.statistics();
    let ms = |share| books.round_trip(share).map_or("none".into(), |seconds| format!("{:.2}", 1e3 * seconds));
    let wanted = config.servos.rate;
    findings.push(Finding::new("reads of all servos a second", format!("{rate:.0}"), wanted, rate >= wanted));
    let complete = format!("{whole} of {CYCLES}");
    findings.push(Finding::new("complete reads", complete, "99 % or more", whole * 100 >= CYCLES * 99));
    let period = format!("p99 below {:.1}", 1e3 / wanted);
    let in_time = books.round_trip(0.99).is_some_and(|seconds| seconds * wanted < 1.0);
    findings.push(Finding::new("round trip p50 / p99, ms", format!("{} / {}", ms(0.5), ms(0.99)), period, in_time));
    Ok(())
}

fn calibration(config: &BridgeConfig, hand: &mut HandBus, findings: &mut Vec<Finding>) -> Result<(), BusError> {
    let what = "calibration";
    let calibration = match HandCalibration::read(&config.calibration) {
        Ok(calibration) => calibration,
        Err(error) => {
            findings.push(Finding::new(what, error, "a file from `ftac bridge calibrate`", false));
            return Ok(());
        }
    };
    findings.push(match hand.compare(&calibration)? {
        None => Finding::new(what, calibration.hash(), "of these servos", true),
        Some((n, found, expected)) => {
            Finding::new(format!("{what}: homing offset of actuator {n}"), found, expected, false)
        }
    });
    Ok(())
}

fn cameras(config: &BridgeConfig, expected: usize, know: bool, findings: &mut Vec<Finding>) {
    let link = match Cameras::open(config, expected, &Clock::wall()) {
        Ok(Some(link)) => link,
        Ok(None) => {
            findings.push(Finding::new("cameras", "not configured", "anything", true));
            return;
        }
        Err(error) => {
            findings.push(Finding::new("cameras", error, "an answer", false));
            return;
        }
    };
    findings.push(match link.board() {
        Some(board) => {
            Finding::new("camera board", format!("serial number {}", board.board().serial), "an answer", true)
        }
        None => Finding::new("UVC devices", config.uvc.len(), "any number", true),
    });
    if let Err(error) = link.request_capture() {
        findings.push(Finding::new("images", error, "one of every camera", false));
        return;
    }
    let started = Instant::now();
    let good = || link.cameras().iter().filter(|camera| camera.good > 0).count();
    while good() < expected && started.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(5));
    }
    let took = format!("{} in {:.0} ms", good(), 1e3 * started.elapsed().as_secs_f64());
    findings.push(Finding::new("cameras with an image", took, expected, good() == expected));
    if good() == expected {
        findings.push(pictures(config, &link, know));
    }
    if let Some(error) = link.lost() {
        findings.push(Finding::new("cameras, after that", error, "still there", false));
    }
    let Some(board) = link.board() else { return };
    let uncertainty = board.clock_uncertainty();
    let ms = uncertainty.map_or("unknown".into(), |seconds| format!("{:.2}", 1e3 * seconds));
    let good = uncertainty.is_some_and(|seconds| seconds < 5e-3);
    findings.push(Finding::new("board clock known to, ms", ms, "below 5", good));
}

/// Checks that every camera shows its own pad.
fn pictures(config: &BridgeConfig, link: &Cameras, know: bool) -> Finding {
    let what = "every camera shows its own pad";
    match known_pictures(config, link, know) {
        Ok(None) => Finding::new(what, "unknown: none are kept", "pictures kept by --know-cameras", true),
        Ok(Some(wrong)) => Finding::new(what, &wrong, "yes", wrong == "yes"),
        Err(error) => Finding::new(what, format!("{error:#}"), "yes", false),
    }
}

/// Describes cameras that show another pad than their own. Returns `yes` if all are right, none if no reference images
/// are kept.
fn known_pictures(config: &BridgeConfig, link: &Cameras, know: bool) -> Result<Option<String>> {
    let path = Pictures::beside(&config.calibration);
    let look = || Pictures::look(link, PATIENCE).map_err(|error| anyhow!(error));
    let now = look()?;
    if know {
        let alike = now.alike(now.noise(&look()?));
        now.write(&path)?;
        if let Some([one, other]) = alike.first() {
            return Ok(Some(format!("{one} and {other} look alike: they cannot be told apart")));
        }
    }
    let Some(kept) = Pictures::read(&path, link.cameras().len())? else { return Ok(None) };
    let wrong = kept.mistaken(&now).into_iter();
    let wrong: Vec<String> = wrong.map(|one| one.to_string()).collect();
    Ok(Some(if wrong.is_empty() { "yes".to_owned() } else { wrong.join(", ") }))
}
