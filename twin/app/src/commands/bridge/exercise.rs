//! `ftac bridge exercise`: the first motion of a new hand, and of every working day.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::Args;
use control::outage::Outage;
use hand_model::Hand;
use hand_model::robot::{Observation, RobotBackend, RobotCommand, RobotError, ServoGoal};
use hardware_bridge::calibration::HandCalibration;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::safety::state::SupervisorState;
use hardware_bridge::servo_cycle::DryLines;
use hardware_bridge::supported_robot::SERVOS;
use robot_backends::arm_link::connect_arm_link;
use robot_backends::operator::operator_agrees;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::actuator_names;
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Time limit for the first measurements to pass the checks.
const CHECK_TIMEOUT: Duration = Duration::from_secs(2);
/// Duration of one motion, s: the spools wind for the first half, then open.
const MOTION_DURATION: f64 = 4.0;

/// Arguments of `bridge exercise`.
#[derive(Debug, Args)]
pub struct ExerciseArgs {
    #[command(flatten)]
    robot: RobotArgs,
    /// Configuration of the bridge.
    #[arg(long, default_value = "bridge.toml")]
    config: PathBuf,
    /// Servo current of the motion, A.
    #[arg(long, default_value_t = 0.08)]
    current: f64,
    /// Number of times to close and open.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    times: u32,
    /// Take tactile images while closed.
    #[arg(long)]
    images: bool,
    /// Only print the commands that would be sent.
    #[arg(long)]
    dry_run: bool,
    /// Do not ask before moving.
    #[arg(long)]
    yes: bool,
}

/// Round-trip time on the servo bus, ms.
#[derive(Debug, Serialize, JsonSchema)]
struct RoundTrip {
    /// Median.
    p50: Option<f64>,
    /// 99th percentile.
    p99: Option<f64>,
}

/// JSON output of `bridge exercise`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ExerciseOutput {
    /// State of the safety supervisor.
    state: String,
    /// Largest angle of each servo from its open mark, rad.
    furthest_rad: [f64; SERVOS],
    /// Travel of each servo according to its calibration, rad.
    travel_rad: [f64; SERVOS],
    /// Control ticks.
    ticks: u64,
    /// Largest delay of a control tick, ms.
    latest_tick_ms: f64,
    images: u64,
    /// Servo cycles.
    cycles: u64,
    /// Servo cycles that began more than a period late.
    late_cycles: u64,
    /// Missing answers of servos.
    missing_answers: u64,
    /// Round-trip time on the servo bus, ms.
    round_trip_ms: RoundTrip,
}

/// Measurements of the exercise.
#[derive(Default)]
struct ExerciseMeasurements {
    furthest: [f64; SERVOS],
    max_delay: f64,
    ticks: u64,
    images: u64,
}

pub fn run(terminal: &Terminal, args: &ExerciseArgs) -> Result<Option<String>> {
    let model = args.robot.model()?;
    let config = BridgeConfig::read(&args.config)?;
    if !(0.0..=config.limits.current).contains(&args.current) {
        bail!("--current: found {}, expected 0 to {} A", args.current, config.limits.current);
    }
    let travel = HandCalibration::read(&config.calibration)?.travel();
    let dry = args.dry_run.then(|| Box::new(|line: String| eprintln!("{line}")) as DryLines);
    let mut robot = HardwareRobot::connect(&config, connect_arm_link(&config, &model, model.arm.home)?, &model, dry)?;
    let started = Instant::now();
    while let Err(error) = robot.check() {
        if started.elapsed() > CHECK_TIMEOUT {
            return Ok(Some(format!("the checks do not pass: {error}")));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let question = "The hand will close and open. Is it empty, and are your fingers clear of it?";
    if !args.yes && !args.dry_run && !operator_agrees(question)? {
        bail!("not armed: the operator did not confirm");
    }
    robot.arm()?;
    let (mut seen, mut failed) = (ExerciseMeasurements::default(), None);
    for _ in 0..args.times {
        failed = move_once(&mut robot, args, &mut seen).err();
        if failed.is_some() || robot.state() != SupervisorState::Running {
            break;
        }
    }
    let state = robot.state();
    let stopped = !matches!(state, SupervisorState::Running);
    let released = if stopped { Ok(String::new()) } else { robot.release() };
    print_output(terminal, &robot, &model.hand, &seen, &travel)?;
    if stopped {
        let measured = robot.describe_state();
        return Ok(Some(format!("{state}; {measured}. `ftac bridge stop --release` opens the hand")));
    }
    if let Some(error) = failed {
        return Ok(Some(error.to_string()));
    }
    // A dry run has written nothing that could be read back.
    if let (Err(error), false) = (released, args.dry_run) {
        return Ok(Some(error.to_string()));
    }
    let names = actuator_names(&model.hand);
    let lazy = seen.furthest.iter().position(|angle| *angle < 0.2);
    Ok(lazy.filter(|_| !args.dry_run).map(|n| format!("{} moved {:.2} rad, expected 0.2", names[n], seen.furthest[n])))
}

/// Winds all cables under the current, then opens. Ends early when the robot no longer runs.
fn move_once(
    robot: &mut HardwareRobot,
    args: &ExerciseArgs,
    seen: &mut ExerciseMeasurements,
) -> Result<(), RobotError> {
    let (mut start, mut outage) = (None, Outage::default());
    let mut asked_for_images = false;
    loop {
        let Some(observation) = outage.record_observation(robot.observe())? else {
            robot.wait_for_tick();
            continue;
        };
        update_measurements(seen, &observation);
        let elapsed = observation.time - *start.get_or_insert(observation.time);
        if elapsed > MOTION_DURATION {
            return Ok(());
        }
        let closing = elapsed < 0.5 * MOTION_DURATION;
        let goal = if closing {
            ServoGoal::Current(args.current)
        } else {
            ServoGoal::Position { angle: 0.0, current_limit: args.current }
        };
        let capture = args.images && !asked_for_images && elapsed > 0.4 * MOTION_DURATION;
        asked_for_images |= capture;
        outage.record_send(robot.send(&RobotCommand {
            arm: observation.arm.position,
            servos: [goal; SERVOS].into(),
            capture,
        }))?;
        seen.max_delay = seen.max_delay.max(robot.wait_for_tick().lateness);
        seen.ticks += 1;
        if matches!(
            robot.state(),
            SupervisorState::Hold(_)
                | SupervisorState::Fault(_)
                | SupervisorState::Release { .. }
                | SupervisorState::Connected
        ) {
            return Ok(());
        }
    }
}

fn update_measurements(seen: &mut ExerciseMeasurements, observation: &Observation) {
    for (furthest, servo) in seen.furthest.iter_mut().zip(&observation.servos) {
        *furthest = furthest.max(servo.position);
    }
    seen.images += observation.tactile.len() as u64;
}

fn print_output(
    terminal: &Terminal,
    robot: &HardwareRobot,
    hand: &Hand,
    seen: &ExerciseMeasurements,
    travel: &[f64; SERVOS],
) -> Result<()> {
    let report = robot.report();
    let ms = |share| report.bus.round_trip(share).map(|seconds| 1e3 * seconds);
    let exercised = ExerciseOutput {
        state: robot.state().to_string(),
        furthest_rad: seen.furthest,
        travel_rad: *travel,
        ticks: seen.ticks,
        latest_tick_ms: 1e3 * seen.max_delay,
        images: seen.images,
        cycles: report.cycles,
        late_cycles: report.late,
        missing_answers: report.bus.missing,
        round_trip_ms: RoundTrip { p50: ms(0.5), p99: ms(0.99) },
    };
    let mut text = String::new();
    for (n, name) in actuator_names(hand).iter().enumerate() {
        text += &format!("{name:12} went to {:.2} rad of {:.2}\n", seen.furthest[n], travel[n]);
    }
    if seen.images > 0 {
        text += &format!("{} images of {} cameras\n", seen.images, hand.cameras.len());
    }
    text += &format!(
        "{} ticks, the latest {:.1} ms late; {} servo cycles, {} late; {} answers missing; round trip p50 {:.2} ms, p99 {:.2} ms\n",
        seen.ticks,
        exercised.latest_tick_ms,
        report.cycles,
        report.late,
        report.bus.missing,
        exercised.round_trip_ms.p50.unwrap_or(f64::NAN),
        exercised.round_trip_ms.p99.unwrap_or(f64::NAN),
    );
    terminal.print(&exercised, &text)
}
