//! `ftac bridge emulate`: the devices without the hardware, in real time, moved by the simulated robot.

use std::f64::consts::PI;
use std::fs::OpenOptions;
use std::io::{IsTerminal as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use bench::body::emulated::{SharedPlant, settings};
use bench::builtin::trial_scene;
use bench::faults::STANDS;
use clap::Args;
use hand_model::ACTUATORS;
use hand_model::robot::Robot;
use hardware_bridge::calibration::{HandCalibration, ServoCalibration};
use hardware_bridge::config::{ArmConfig, BridgeConfig, CameraConfig, LimitConfig, ServoConfig};
use hardware_bridge::emulator::faults::{Event, Faults};
use hardware_bridge::emulator::servo::EmulatedServo;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings, Plug};
use hardware_bridge::xc330;
use kortex::Credentials;
use kortex::emulator::{Emulator, EventKind, Injection, Pace, Settings, Status};
use kortex::safety_bank::FOLLOWING_ERROR;

use super::shared::shown;
use crate::terminal::Terminal;

/// Travel of the shafts of [`SpringHand`], rad.
const TRAVEL: f64 = 4.0;
/// Who may log in to the emulated arm.
const USER: &str = "ftac";
const PASSWORD: &str = "of-the-emulated-arm";
/// Between two looks at what is due.
const LOOK: Duration = Duration::from_millis(20);

/// Arguments of `bridge emulate`.
#[derive(Debug, Args)]
pub struct EmulateArgs {
    /// Folder for bridge.toml and for the links `servos` and `cameras` to the pseudo-terminals.
    #[arg(long, default_value = "recordings/emulated")]
    dir: PathBuf,
    /// Combination whose objects stand on the table of the simulated robot.
    #[arg(long, default_value_t = 0)]
    combo: usize,
    /// Which of the robots built from the drawing it is: its servos, cables, springs, pads, mount and arm differ from the drawing by
    /// what was drawn for this number; 0 is the robot as drawn.
    #[arg(long, default_value_t = 0, conflicts_with = "springs")]
    individual: u64,
    /// Where the individual's true parameters go (JSON), for evaluation alone.
    #[arg(long, conflicts_with = "springs")]
    truth_out: Option<PathBuf>,
    /// Six springs instead of the simulated robot, and no arm.
    #[arg(long, conflicts_with = "combo")]
    springs: bool,
    /// Write the calibration too, as if it had been done.
    #[arg(long)]
    calibrated: bool,
    /// What goes wrong: CHANCE or WHAT@SECONDS, such as noise=0.1, drop=0.02, overload=3@5, voltage=5.2@3, freeze=7@2, usb=servos@4,
    /// usb=cameras@4, arm=stop@6 (emergency stop), arm=free@8 (its release), arm=fault@6, arm=deaf@6, arm=lossy@6. What has a time may also be
    /// piped in, one a line without @SECONDS, and happens at once.
    #[arg(long = "fault")]
    faults: Vec<String>,
    /// One servo as it leaves the factory instead of six provisioned ones, for `bridge provision`.
    #[arg(long)]
    factory: bool,
    /// Long watchdogs and time-outs, in the devices and in bridge.toml, for a busy machine.
    #[arg(long)]
    patient: bool,
    /// End as soon as all servos and the arm have been stopped by their own watchdogs.
    #[arg(long)]
    until_stopped: bool,
    /// End after so many seconds; default: when interrupted.
    #[arg(long)]
    seconds: Option<f64>,
}

/// The emulated arm's watchdog under `--patient`, ms: shorter than the 2 s after which the arm ends a silent session.
const PATIENT_ARM: u64 = 1500;

/// What goes wrong outside the servos and the camera board.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mishap {
    Unplugged(Plug),
    Arm(Injection),
    /// Something that happens to a servo or a camera.
    Device(Event),
}

pub fn run(terminal: &Terminal, args: &EmulateArgs) -> Result<Option<String>> {
    let (mishaps, texts) = mishaps(&args.faults)?;
    let faults = Faults::parse(texts)?;
    let (plant, travel, usual): (Box<dyn Robot + Send>, _, _) = if args.springs {
        (Box::new(SpringHand::new([TRAVEL; ACTUATORS])), [TRAVEL; ACTUATORS], EmulatorSettings::default())
    } else {
        let (hand, robot) = trial_scene(args.combo, terminal.seed, terminal.quiet || terminal.json, args.individual)?;
        if let Some(path) = &args.truth_out {
            crate::commands::twin::write_truth(path, args.individual)?;
        }
        let usual = settings(&hand, terminal.seed);
        (Box::new(SharedPlant::new(robot)), usual.travel, usual.devices)
    };
    let mut settings = EmulatorSettings { faults, seed: terminal.seed, ..usual };
    if args.factory {
        settings.servos = vec![EmulatedServo::factory(2000)];
    }
    let zeros: Vec<i64> = settings.servos.iter().map(EmulatedServo::zero).collect();
    std::fs::create_dir_all(&args.dir).with_context(|| shown(&args.dir))?;
    let mut hand = EmulatedHand::start(plant, settings)?;
    let arm = match args.springs {
        true => None,
        false => {
            let credentials = Credentials { user: USER.to_owned(), password: PASSWORD.to_owned() };
            let usual = Settings { credentials, seed: terminal.seed, standstill: STANDS, ..Settings::default() };
            let cyclic_deadline = if args.patient { PATIENT_ARM } else { usual.cyclic_deadline };
            // A plant held up by a busy machine follows late.
            let following_error = if args.patient { PI } else { usual.following_error };
            let settings = Settings { cyclic_deadline, following_error, ..usual };
            Some(Emulator::start(settings, Box::new(hand.arm_joints()), Pace::RealTime).context("the emulated arm")?)
        }
    };
    let config = write_config(args, &hand, arm.as_ref())?;
    if args.calibrated && !args.factory {
        let calibration = calibration(&zeros, &travel);
        hand.home(&calibration);
        calibration.write(&args.dir.join("calibration.json"))?;
    }
    let address = arm.as_ref().map(|arm| arm.address().tcp.to_string());
    if terminal.json {
        println!(
            "{}",
            serde_json::json!({"config": shown(&config), "servos": shown(hand.servo_port()), "cameras": shown(hand.camera_port()), "arm": address})
        );
    } else {
        println!("servos on {}, cameras on {}", shown(hand.servo_port()), shown(hand.camera_port()));
        println!("arm on {}", address.as_deref().unwrap_or("none"));
        println!("try: ftac bridge scan --config {}", shown(&config));
    }
    attend(args, &mut hand, arm.as_ref(), mishaps);
    tell(terminal, &hand, arm.as_ref().map(Emulator::status).as_ref());
    Ok(None)
}

/// Lets the devices run until the end, with mishaps at their times, and at once where one comes over a pipe (as `usb=cameras`).
fn attend(args: &EmulateArgs, hand: &mut EmulatedHand, arm: Option<&Emulator>, mut pending: Vec<(f64, Mishap)>) {
    let (sender, piped) = mpsc::channel();
    // Ends with the input; nobody waits for it. A terminal is left alone: to read from it would stop a background job.
    std::thread::spawn(move || {
        let lines = (!std::io::stdin().is_terminal()).then(|| std::io::stdin().lines());
        for line in lines.into_iter().flatten().map_while(Result::ok) {
            match at_once(line.trim()) {
                Ok(now) => drop(sender.send(now)),
                Err(error) => eprintln!("{error}"),
            }
        }
    });
    let started = Instant::now();
    while args.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds) {
        std::thread::sleep(LOOK);
        pending.extend(piped.try_iter().flatten());
        let now = started.elapsed().as_secs_f64();
        for (_, mishap) in pending.extract_if(.., |(at, _)| *at <= now) {
            match (mishap, arm) {
                (Mishap::Unplugged(plug), _) => hand.unplug(plug),
                (Mishap::Arm(injection), Some(arm)) => arm.inject(injection),
                (Mishap::Arm(_), None) => {}
                (Mishap::Device(event), _) => hand.inject(event),
            }
        }
        if args.until_stopped && stopped(hand, arm) {
            return;
        }
    }
}

/// Whether all watchdogs have tripped and nothing moves any more.
fn stopped(hand: &EmulatedHand, arm: Option<&Emulator>) -> bool {
    let arm_stopped = arm.map(Emulator::status).is_none_or(|arm| {
        let tripped = arm.events.iter().any(|event| event.what == EventKind::Watchdog);
        tripped && arm.motion.velocity.iter().all(|speed| speed.abs() <= STANDS)
    });
    hand.watchdog_trips().len() == ACTUATORS && arm_stopped
}

/// How the devices were stopped by their own watchdogs, if they were.
fn tell(terminal: &Terminal, hand: &EmulatedHand, arm: Option<&Status>) {
    let (ticks, late) = hand.ticks();
    let trips = hand.watchdog_trips();
    let stopped = arm.and_then(|arm| {
        let time = |what| arm.events.iter().rev().find(|event| event.what == what).map(|event| event.time);
        let watchdog = time(EventKind::Watchdog)?;
        // Joints that stood already need not come to a standstill.
        let still = time(EventKind::StandsStill).filter(|still| *still >= watchdog).unwrap_or(watchdog);
        Some((watchdog.saturating_sub(arm.commands.last), still.saturating_sub(arm.commands.last)))
    });
    if terminal.json {
        let servos: Vec<_> =
            trips.iter().map(|(id, _, after)| serde_json::json!({"id": id, "after_ms": 1e3 * after})).collect();
        let arm = stopped
            .map(|(watchdog, still)| serde_json::json!({"watchdog_after_ms": watchdog, "stands_after_ms": still}));
        println!(
            "{}",
            serde_json::json!({"ticks": ticks, "late_ticks": late, "servos_stopped": servos, "arm_stopped": arm})
        );
        return;
    }
    eprintln!("{ticks} plant ticks, {late} late");
    for (id, at, after) in trips {
        eprintln!("servo {id}: stopped by its bus watchdog at {at:.2} s, {:.0} ms after the last packet", 1e3 * after);
    }
    if let Some((watchdog, still)) = stopped {
        eprintln!("arm: watchdog {watchdog} ms after the last command, standing after {still} ms");
    }
}

/// A fault's text that belongs to servos or cameras.
type Texts<'a> = Vec<&'a str>;

/// What a line without a time says.
fn at_once(line: &str) -> Result<Vec<(f64, Mishap)>> {
    let text = [format!("{line}@0")];
    let (mut now, rest) = mishaps(&text)?;
    now.extend(Faults::parse(rest)?.events.into_iter().map(|(at, event)| (at, Mishap::Device(event))));
    Ok(now)
}

/// Takes out what is not the servos' or the cameras'.
fn mishaps(texts: &[String]) -> Result<(Vec<(f64, Mishap)>, Texts<'_>)> {
    let (mut mishaps, mut rest) = (Vec::new(), Vec::new());
    for text in texts {
        let Some((name @ ("usb" | "arm"), value)) = text.split_once('=') else {
            rest.push(text.as_str());
            continue;
        };
        let parsed = value.split_once('@').and_then(|(what, at)| {
            let at = f64::from_str(at).ok().filter(|at| at.is_finite() && *at >= 0.0)?;
            let mishap = match (name, what) {
                ("usb", "servos") => Mishap::Unplugged(Plug::Servos),
                ("usb", "cameras") => Mishap::Unplugged(Plug::Cameras),
                ("arm", "stop") => Mishap::Arm(Injection::EmergencyStop(true)),
                ("arm", "free") => Mishap::Arm(Injection::EmergencyStop(false)),
                ("arm", "fault") => Mishap::Arm(Injection::JointFault { joint: 2, bits: FOLLOWING_ERROR }),
                ("arm", "deaf") => Mishap::Arm(Injection::Deaf(true)),
                ("arm", "lossy") => Mishap::Arm(Injection::LoseReplies(0.3)),
                _ => return None,
            };
            Some((at, mishap))
        });
        match parsed {
            Some(mishap) => mishaps.push(mishap),
            None => {
                bail!(
                    "fault: found `{text}`, expected usb=servos|cameras@SECONDS or arm=stop|free|fault|deaf|lossy@SECONDS"
                )
            }
        }
    }
    Ok((mishaps, rest))
}

/// What homing would have found.
fn calibration(zeros: &[i64], travel: &[f64; ACTUATORS]) -> HandCalibration {
    let servos = std::array::from_fn(|n| ServoCalibration {
        id: n as u8 + 1,
        model: xc330::MODEL,
        firmware: 46,
        homing_offset: zeros.get(n).map_or(0, |zero| -(zero.rem_euclid(4096) as i32)),
        travel: travel[n],
    });
    HandCalibration::new("ftac", servos)
}

/// A pseudo-terminal has no real time behind it: a busy machine may be late by more than a real line ever is.
fn limits(patient: bool) -> LimitConfig {
    let (staleness, servo_watchdog, arm_watchdog, host_watchdog) =
        if patient { (1.0, 2.54, 1.0, 10.0) } else { (0.3, 0.16, 0.5, 1.0) };
    LimitConfig {
        staleness,
        servo_watchdog,
        arm_watchdog,
        host_watchdog,
        pause: 60.0_f64.min(5.0 * host_watchdog),
        ..LimitConfig::default()
    }
}

/// A file for its owner alone.
fn write_password(path: &Path, password: &str) -> Result<()> {
    // An older one may be open to others: its permissions would stay.
    let _ = std::fs::remove_file(path);
    let mut file =
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(path).with_context(|| shown(path))?;
    writeln!(file, "{password}").with_context(|| shown(path))
}

/// Links to the pseudo-terminals and a configuration that names them.
fn write_config(args: &EmulateArgs, hand: &EmulatedHand, arm: Option<&Emulator>) -> Result<PathBuf> {
    let folder = std::path::absolute(&args.dir).with_context(|| shown(&args.dir))?;
    let (servos, cameras) = (folder.join("servos"), folder.join("cameras"));
    hand.link_servos(&servos)?;
    hand.link_cameras(&cameras)?;
    let arm = match arm.map(Emulator::address) {
        None => ArmConfig::Loopback,
        Some(address) => ArmConfig::Kortex {
            host: address.tcp.ip().to_string(),
            tcp_port: address.tcp.port(),
            udp_port: address.udp.port(),
            user: USER.to_owned(),
            password: None,
            password_file: Some("arm-password".into()),
        },
    };
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
            slack: if args.patient { 0.5 } else { 0.020 },
        },
        cameras: Some(CameraConfig { port: cameras }),
        uvc: Vec::new(),
        arm,
        limits: limits(args.patient),
    };
    write_password(&args.dir.join("arm-password"), PASSWORD)?;
    let path = args.dir.join("bridge.toml");
    std::fs::write(&path, config.to_toml()).with_context(|| shown(&path))?;
    Ok(path)
}
