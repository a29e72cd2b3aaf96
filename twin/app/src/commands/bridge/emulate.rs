//! `ftac bridge emulate`: emulated devices in real time, driven by the simulated robot.

mod emulated_table;
mod emulator_fault;
mod table_endpoint;
mod truth_recorder;

use dynamixel_bus::xc330;
use hardware_bridge::supported_robot::SERVOS;
use std::f64::consts::PI;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use self::emulated_table::{EmulatedTable, TableCommand};
use anyhow::{Context, Result, bail};
use clap::Args;
use fault_injection::STANDSTILL_SPEED;
use fault_injection::plant::FaultyPlant;
use hand_model::RobotModel;
use hand_model::robot::Plant;
use hardware_bridge::calibration::{HandCalibration, ServoCalibration};
use hardware_bridge::config::{ArmConfig, BridgeConfig, CameraConfig, LimitConfig, ServoConfig};
use hardware_bridge::emulator::servo::EmulatedServo;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::supported_robot::check_supported;
use kinova_kortex::Credentials;
use kinova_kortex::emulator::{Emulator, EventKind, Pace, Settings, Status};
use kinova_kortex::joints::JOINTS;
use object_detector::Address;
use object_detector::camera::{EmulatedDetector, EmulatedDetectorSettings};
use progress::interrupt::Interrupt;
use robot_backends::wire_emulation::{DETECTOR_SIGMA, lockstep_settings};
use schemars::JsonSchema;
use serde::Serialize;

use self::emulator_fault::EmulatorFault;
use self::table_endpoint::TableEndpoint;
use self::truth_recorder::TruthRecorder;
use super::shared::display_path;
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Name of the socket on which a running emulator takes requests.
const REQUEST_SOCKET: &str = "emulator";
/// Period of the emulated vision system's measurements.
const VISION_PERIOD: Duration = Duration::from_millis(100);
/// Travel of the shafts of [`SpringHand`], rad.
const SPRING_HAND_TRAVEL: f64 = 4.0;
/// User name for the login to the emulated arm.
const ARM_USER: &str = "ftac";
const ARM_PASSWORD: &str = "of-the-emulated-arm";
/// Polling period for requests and timed faults.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Arguments of `bridge emulate`.
#[derive(Debug, Args)]
pub struct EmulateArgs {
    #[command(flatten)]
    robot: RobotArgs,
    /// Folder for bridge.toml and for the links `servos` and `cameras` to the pseudo-terminals.
    #[arg(long, default_value = "recordings/emulated")]
    dir: PathBuf,
    /// Combination whose objects stand on the table of the simulated robot.
    #[arg(long, default_value_t = 0)]
    combo: usize,
    /// Number of the robot instance to emulate: its servos, cables, springs, pads, mount and arm differ from the
    /// nominal model by random amounts drawn for this number; 0 is the nominal model.
    #[arg(long, default_value_t = 0, conflicts_with = "springs")]
    instance: u64,
    /// File for the instance's true parameters (JSON), for evaluation only.
    #[arg(long, conflicts_with = "springs")]
    truth_out: Option<PathBuf>,
    /// Put the balls of `bridge register` on their marks instead.
    #[arg(long, conflicts_with = "combo")]
    balls: bool,
    /// Emulate six springs instead of the simulated robot, and no arm.
    #[arg(long, conflicts_with_all = ["combo", "balls", "mount", "detector", "truth", "live"])]
    springs: bool,
    /// Seed for a hidden pose of the arm's base, away from the nominal one.
    #[arg(long, value_name = "N")]
    mount: Option<u64>,
    /// Emulate a vision system for `trial --detector` on this socket (HOST:PORT or unix:PATH): it sends the objects'
    /// poses ten times a second, with errors of 3 mm and 0.02 rad drawn from the seed.
    #[arg(long, value_name = "ADDRESS")]
    detector: Option<Address>,
    /// Record the true scene into this file for the viewer.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Show the true scene in the viewer.
    #[arg(long)]
    live: bool,
    /// Also read requests from the terminal; Enter alone puts the objects back.
    #[arg(long)]
    keys: bool,
    /// Only send this request to the emulator that runs in --dir: objects=back, objects=N (a combination),
    /// objects=balls, or a fault as for --fault without its time: freeze=7, slip=ring:3, snatch=1, arm=stop.
    #[arg(long, value_name = "LINE")]
    send: Option<String>,
    /// Also write the calibration file, as if the hand had been calibrated.
    #[arg(long)]
    calibrated: bool,
    /// Fault to inject (repeatable), with its probability or as FAULT@SECONDS, such as noise=0.1, drop=0.02,
    /// overload=3@5, voltage=5.2@3, freeze=7@2, usb=servos@4, usb=cameras@4, arm=stop@6 (emergency stop), arm=free@8
    /// (its release), arm=fault@6, arm=deaf@6, arm=lossy@6; and faults of the robot itself: break=ring@5 (a cable),
    /// slip=ring:3@5 (by 3 mm on its spool), weak=ring:0.6@5 (a servo gives 0.6 of its torque), stick=JOINT@5,
    /// heavy=1:0.3@5 (object 1 weighs 0.3 kg more), snatch=1@5 (object 1 is taken away), push=12@5 (12 N on the palm
    /// for half a second), dim=7:red:0.5@5 (half of the red light of camera 7), blind=PAD:missing@5 or
    /// blind=PAD:black@5. Faults with a time may also be piped in, one per line without @SECONDS, or sent with --send,
    /// and happen at once; objects=back, objects=N and objects=balls too.
    #[arg(long = "fault")]
    faults: Vec<String>,
    /// Emulate one servo with factory settings instead of six provisioned ones, for `bridge provision`.
    #[arg(long)]
    factory: bool,
    /// Firmware version of the servos: from 52 on their indirect data are at address 208, before at 224.
    #[arg(long, value_name = "N", default_value_t = 46)]
    firmware: u8,
    /// Use long watchdogs and timeouts, in the devices and in bridge.toml, for a busy machine.
    #[arg(long)]
    patient: bool,
    /// End as soon as all servos and the arm have been stopped by their own watchdogs.
    #[arg(long)]
    until_stopped: bool,
    /// End after this many seconds; default: when interrupted.
    #[arg(long)]
    seconds: Option<f64>,
}

/// JSON output of `--send`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RequestOutput {
    /// Answer of the running emulator to --send.
    answer: String,
}

/// JSON output once the devices run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct EmulatorStartOutput {
    /// The configuration file.
    config: String,
    /// Port of the servos.
    servos: String,
    /// Port of the camera board.
    cameras: String,
    /// Address of the arm, or null.
    arm: Option<String>,
    /// Address of the emulated vision system, or null.
    detector: Option<String>,
}

/// A servo stopped by its bus watchdog.
#[derive(Debug, Serialize, JsonSchema)]
struct StoppedServo {
    /// Bus id.
    id: u8,
    /// Time after the last packet that it received, ms.
    after_ms: f64,
}

#[derive(Debug, Serialize, JsonSchema)]
struct StoppedArm {
    /// Time at which the arm's watchdog stopped it, ms after the last set-point.
    watchdog_after_ms: u64,
    /// Time at which the arm stood, ms after the last set-point.
    stopped_after_ms: u64,
}

/// JSON output at the end.
#[derive(Debug, Serialize, JsonSchema)]
pub struct EmulatorEndOutput {
    /// Control ticks.
    ticks: u64,
    /// Control ticks more than one period late.
    late_ticks: u64,
    /// Servos stopped by their bus watchdogs.
    servos_stopped: Vec<StoppedServo>,
    /// Stop of the arm by its watchdog; null if the watchdog did not trip.
    arm_stopped: Option<StoppedArm>,
}

/// Error for faults of cables, joints and objects under --springs.
const NO_PLANT_ERROR: &str =
    "fault: found --springs, expected the simulated robot: springs have no cables, joints or objects";

/// Timeout of the emulated arm's watchdog under `--patient`, ms: shorter than the 2 s after which the arm ends a silent
/// session.
const PATIENT_ARM_TIMEOUT_MS: u64 = 1500;

pub fn run(terminal: &Terminal, args: &EmulateArgs) -> Result<Option<String>> {
    if let Some(line) = &args.send {
        return send_request(terminal, &args.dir, line);
    }
    if let Some(seconds) = args.seconds.filter(|seconds| !(seconds.is_finite() && *seconds >= 0.0)) {
        bail!("--seconds: found {seconds}, expected 0 or more");
    }
    let robot = args.robot.model()?;
    check_supported(&robot)?;
    let (mishaps, faults) = emulator_fault::parse_faults(&args.faults, &robot.hand)?;
    if args.springs && mishaps.iter().any(|(_, mishap)| matches!(mishap, EmulatorFault::Plant(_))) {
        bail!(NO_PLANT_ERROR);
    }
    let mut breakable = None;
    let (mut table, mut plant): (Option<EmulatedTable>, Box<dyn Plant + Send>) =
        (None, Box::new(SpringHand::new([SPRING_HAND_TRAVEL; SERVOS], robot.hand.cameras.len())));
    let (mut travel, mut usual) = ([SPRING_HAND_TRAVEL; SERVOS], EmulatorSettings::default());
    if !args.springs {
        let objects = if args.balls { TableCommand::Balls } else { TableCommand::Combination(args.combo) };
        let standing = EmulatedTable::new(&robot, objects, (args.mount, args.instance), terminal.seed)?;
        if let Some(path) = &args.truth_out {
            crate::commands::sysid::write_truth(path, &robot, args.instance)?;
        }
        let settings = lockstep_settings(&standing.bench().world.cell.robot.hand, terminal.seed);
        (travel, usual) = (settings.travel, settings.devices);
        let broken = FaultyPlant::new(standing.plant().clone());
        plant = Box::new(broken.clone());
        breakable = Some(broken);
        table = Some(standing);
    }
    let mut settings = EmulatorSettings { faults, seed: terminal.seed, ..usual };
    if args.factory {
        settings.servos = vec![EmulatedServo::factory(2000)];
    }
    settings.servos = settings.servos.into_iter().map(|servo| servo.with_firmware(args.firmware)).collect();
    let zeros: Vec<i64> = settings.servos.iter().map(EmulatedServo::zero).collect();
    std::fs::create_dir_all(&args.dir).with_context(|| display_path(&args.dir))?;
    let endpoint = TableEndpoint::open(&args.dir.join(REQUEST_SOCKET), args.keys)?;
    let hand = EmulatedHand::start(plant, settings, &robot)?;
    let camera = start_vision(args, table.as_ref(), terminal.seed)?;
    let arm = match args.springs {
        true => None,
        false => {
            let credentials = Credentials { user: ARM_USER.to_owned(), password: ARM_PASSWORD.to_owned() };
            let usual =
                Settings { credentials, seed: terminal.seed, standstill: STANDSTILL_SPEED, ..Settings::default() };
            let cyclic_deadline = if args.patient { PATIENT_ARM_TIMEOUT_MS } else { usual.cyclic_deadline };
            // On a busy machine the plant lags behind its set-points.
            let following_error = if args.patient { PI } else { usual.following_error };
            let settings = Settings { cyclic_deadline, following_error, ..usual };
            Some(Emulator::start(settings, Box::new(hand.arm_joints()), Pace::RealTime).context("the emulated arm")?)
        }
    };
    let config = write_config(args, &hand, arm.as_ref())?;
    if args.calibrated && !args.factory {
        let calibration = calibration(&robot, &zeros, &travel, args.firmware);
        hand.write_homing_offsets(&calibration);
        calibration.write(&args.dir.join("calibration.json"))?;
    }
    let started = EmulatorStartOutput {
        config: display_path(&config),
        servos: display_path(hand.servo_port()),
        cameras: display_path(hand.camera_port()),
        arm: arm.as_ref().map(|arm| arm.address().tcp.to_string()),
        detector: camera.as_ref().map(|camera| camera.address().to_string()),
    };
    let EmulatorStartOutput { config, servos, cameras, arm: address, detector } = &started;
    let address = address.as_deref().unwrap_or("none");
    let detector = detector.as_ref().map_or(String::new(), |detector| format!("detector on {detector}\n"));
    let text = format!(
        "servos on {servos}, cameras on {cameras}\narm on {address}\n{detector}try: ftac bridge scan --config {config}\n"
    );
    terminal.print(&started, &text)?;
    let truth = (args.truth.is_some() || args.live).then(|| TruthRecorder::new(args.truth.clone(), args.live));
    let mut running = RunningDevices { robot, hand, arm, table, breakable, truth };
    run_devices(args, &mut running, mishaps, &endpoint)?;
    print_stops(terminal, &running.hand, running.arm.as_ref().map(Emulator::status).as_ref())
}

/// Main loop of the emulator: applies faults at their times and requests as they arrive, until the end.
fn run_devices(
    args: &EmulateArgs,
    running: &mut RunningDevices,
    mut pending: Vec<(f64, EmulatorFault)>,
    endpoint: &TableEndpoint,
) -> Result<()> {
    // Ctrl-C ends the loop, so that a recording is finished.
    let interrupt = Interrupt::catch()?;
    let started = Instant::now();
    while !interrupt.happened() && args.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds) {
        std::thread::sleep(POLL_INTERVAL);
        for request in endpoint.requests() {
            let outcome = running.execute_request(&request.line);
            request.answer(outcome);
        }
        let now = started.elapsed().as_secs_f64();
        for (_, mishap) in pending.extract_if(.., |(at, _)| *at <= now) {
            running.apply_fault(mishap);
        }
        if let (Some(truth), Some(table)) = (&mut running.truth, &running.table) {
            truth.record(table)?;
        }
        if args.until_stopped && all_stopped(&running.hand, running.arm.as_ref()) {
            break;
        }
    }
    running.truth.take().map_or(Ok(()), TruthRecorder::finish)
}

/// The running devices, and the plant that moves them.
struct RunningDevices {
    robot: RobotModel,
    hand: EmulatedHand,
    arm: Option<Emulator>,
    table: Option<EmulatedTable>,
    /// The simulated robot, if there is one.
    breakable: Option<FaultyPlant>,
    truth: Option<TruthRecorder>,
}

impl RunningDevices {
    /// Carries out the request in `line` at once, and returns the outcome in words.
    fn execute_request(&mut self, line: &str) -> Result<String> {
        let Some(command) = line.strip_prefix("objects=") else {
            let mishaps = emulator_fault::parse_immediate(line, &self.robot.hand)?;
            if self.breakable.is_none() && mishaps.iter().any(|mishap| matches!(mishap, EmulatorFault::Plant(_))) {
                bail!(NO_PLANT_ERROR);
            }
            mishaps.into_iter().for_each(|mishap| self.apply_fault(mishap));
            return Ok("done".to_owned());
        };
        let command = command.parse().map_err(|error| anyhow::anyhow!("objects: {error}"))?;
        match &self.table {
            Some(table) => table.place_objects(command),
            None => bail!("objects: found --springs, expected the simulated robot"),
        }
    }

    fn apply_fault(&mut self, mishap: EmulatorFault) {
        match (mishap, &self.arm) {
            (EmulatorFault::Unplugged(plug), _) => self.hand.unplug(plug),
            (EmulatorFault::Arm(injection), Some(arm)) => arm.inject(injection),
            (EmulatorFault::Arm(_), None) => {}
            (EmulatorFault::Device(event), _) => self.hand.inject(event),
            (EmulatorFault::Plant(fault), _) => {
                if let (Some(breakable), Some(table)) = (&self.breakable, &self.table) {
                    breakable.inject_now(&fault, &table.bench().world.cell.robot.hand);
                }
            }
        }
    }
}

/// True if all watchdogs have tripped and the arm stands still.
fn all_stopped(hand: &EmulatedHand, arm: Option<&Emulator>) -> bool {
    let arm_stopped = arm.map(Emulator::status).is_none_or(|arm| {
        let tripped = arm.events.iter().any(|event| event.what == EventKind::Watchdog);
        tripped && arm.motion.velocity.iter().all(|speed| speed.abs() <= STANDSTILL_SPEED)
    });
    hand.watchdog_trips().len() == SERVOS && arm_stopped
}

/// Prints how the devices were stopped by their own watchdogs, if they were.
fn print_stops(terminal: &Terminal, hand: &EmulatedHand, arm: Option<&Status>) -> Result<Option<String>> {
    let (ticks, late) = hand.tick_counts();
    let trips = hand.watchdog_trips();
    let stopped = arm.and_then(|arm| {
        let time = |what| arm.events.iter().rev().find(|event| event.what == what).map(|event| event.time);
        let watchdog = time(EventKind::Watchdog)?;
        // Joints that stood still already report no standstill event.
        let still = time(EventKind::StandsStill).filter(|still| *still >= watchdog).unwrap_or(watchdog);
        Some((watchdog.saturating_sub(arm.commands.last), still.saturating_sub(arm.commands.last)))
    });
    if terminal.json {
        let servo = |(id, _, after)| StoppedServo { id, after_ms: 1e3 * after };
        let arm =
            |(watchdog_after_ms, stands_after_ms)| StoppedArm { watchdog_after_ms, stopped_after_ms: stands_after_ms };
        let ended = EmulatorEndOutput {
            ticks,
            late_ticks: late,
            servos_stopped: trips.into_iter().map(servo).collect(),
            arm_stopped: stopped.map(arm),
        };
        terminal.print(&ended, "")?;
        return Ok(None);
    }
    eprintln!("{ticks} plant ticks, {late} late");
    for (id, at, after) in trips {
        eprintln!("servo {id}: stopped by its bus watchdog at {at:.2} s, {:.0} ms after the last packet", 1e3 * after);
    }
    if let Some((watchdog, still)) = stopped {
        eprintln!("arm: watchdog {watchdog} ms after the last command, standing after {still} ms");
    }
    Ok(None)
}

/// Starts the emulated vision system, if `--detector` asks for one.
fn start_vision(args: &EmulateArgs, table: Option<&EmulatedTable>, seed: u64) -> Result<Option<EmulatedDetector>> {
    let (Some(address), Some(table)) = (&args.detector, table) else { return Ok(None) };
    let settings = EmulatedDetectorSettings { sigma: DETECTOR_SIGMA, seed, period: Some(VISION_PERIOD) };
    let table = table.clone();
    let sight = move || table.placed_objects().0.into_iter().zip(table.plant().lock().truth().objects).collect();
    EmulatedDetector::start(address, settings, Box::new(sight))
        .map(Some)
        .with_context(|| format!("--detector {address}"))
}

/// Runs `--send`: sends `line` to the emulator that runs in `dir` and prints its answer.
fn send_request(terminal: &Terminal, dir: &Path, line: &str) -> Result<Option<String>> {
    let answer = table_endpoint::send_line(&dir.join(REQUEST_SOCKET), line)?;
    let text = format!("{answer}\n");
    terminal.print(&RequestOutput { answer }, &text)?;
    Ok(None)
}

/// Returns the calibration that homing would find on `robot`.
fn calibration(robot: &RobotModel, zeros: &[i64], travel: &[f64; SERVOS], firmware: u8) -> HandCalibration {
    let servos = std::array::from_fn(|n| ServoCalibration {
        id: n as u8 + 1,
        model: xc330::MODEL.number,
        firmware,
        homing_offset: zeros.get(n).map_or(0, |zero| -(zero.rem_euclid(4096) as i32)),
        travel: travel[n],
    });
    HandCalibration::new(&robot.hand.parameters.name, servos)
}

/// Safety limits for emulated devices. A pseudo-terminal gives no real-time guarantee: delays on a busy machine exceed
/// those of a real line.
fn limits(patient: bool) -> LimitConfig {
    let (staleness, servo_watchdog, arm_watchdog, host_watchdog) =
        if patient { (1.0, 2.54, 1.0, 10.0) } else { (0.3, 0.16, 0.5, 1.0) };
    LimitConfig {
        staleness,
        servo_watchdog,
        arm_watchdog,
        host_watchdog,
        pause: 60.0_f64.min(5.0 * host_watchdog),
        arm: press_limits(patient),
        ..LimitConfig::default()
    }
}

/// Torque limits of the arm. On a busy machine the plant lags behind its set-points, and its joints pull as if
/// something pushed them.
fn press_limits(patient: bool) -> hardware_bridge::config::ArmLimitConfig {
    use hardware_bridge::config::ArmLimitConfig;
    let usual = ArmLimitConfig::default();
    match patient {
        true => ArmLimitConfig { torque: [60.0; JOINTS].into(), residual: [60.0; JOINTS].into(), ..usual },
        false => ArmLimitConfig { jolt: 0.3, ..usual },
    }
}

/// Writes the password to a file that only its owner can read.
fn write_password(path: &Path, password: &str) -> Result<()> {
    // An older file may be readable by others, and would keep its permissions.
    let _ = std::fs::remove_file(path);
    let mut file =
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(path).with_context(|| display_path(path))?;
    writeln!(file, "{password}").with_context(|| display_path(path))
}

/// Writes links to the pseudo-terminals and a configuration that names them. Returns the configuration's path.
fn write_config(args: &EmulateArgs, hand: &EmulatedHand, arm: Option<&Emulator>) -> Result<PathBuf> {
    let folder = std::path::absolute(&args.dir).with_context(|| display_path(&args.dir))?;
    let (servos, cameras) = (folder.join("servos"), folder.join("cameras"));
    hand.link_servos(&servos)?;
    hand.link_cameras(&cameras)?;
    let arm = match arm.map(Emulator::address) {
        None => ArmConfig::Loopback {},
        Some(address) => ArmConfig::Kortex {
            host: address.tcp.ip().to_string(),
            tcp_port: address.tcp.port(),
            udp_port: address.udp.port(),
            user: ARM_USER.to_owned(),
            password: None,
            password_file: Some("arm-password".into()),
        },
    };
    let config = BridgeConfig {
        version: 1,
        calibration: "calibration.json".into(),
        stop_socket: Some("stop".into()),
        file: folder.join("bridge.toml"),
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
    write_password(&args.dir.join("arm-password"), ARM_PASSWORD)?;
    let path = args.dir.join("bridge.toml");
    std::fs::write(&path, config.to_toml()).with_context(|| display_path(&path))?;
    Ok(path)
}
