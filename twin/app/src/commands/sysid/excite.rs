//! `ftac sysid excite`: a scripted, resumable excitation of any robot backend, recorded as a session.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, Tick};
use hand_model::{Hand, RobotModel, RobotSources};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::config::secrets::without_secrets;
use hardware_bridge::emulator::direct::DirectRobot;
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::safety::state::SupervisorState;
use hardware_bridge::supported_robot::check_supported;
use identification::ExcitationScript;
use identification::excitation::{ExcitationProgress, describe, run_script};
use identification::script::ExcitationStep;
use identification::task::IdentificationTask;
use identification::touches::ImageFilter;
use plant::RobotInstance;
use progress::interrupt::{Interrupt, Interrupted};
use robot_backends::arm_link::connect_arm_link;
use robot_backends::operator::operator_agrees;
use robot_backends::wire_emulation::{SharedPlant, lockstep_settings};
use robot_session_log::{SessionHeader, SessionRecorder, SessionWriter};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::NominalModel;
use crate::options::backend::{BackendKind, check_backend};
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Time limit for the first measurements to pass the checks.
const CHECK_TIMEOUT: Duration = Duration::from_secs(5);
/// Size of a session, bytes, measured with the built-in script: of a second without images, and of the images of a press on
/// the ball.
const SECOND_BYTES: f64 = 150e3;
const PRESS_BYTES: f64 = 4.4e6;
/// Name of the file with the progress of an excitation.
const STATE_FILE: &str = "excitation.json";

/// Arguments of `sysid excite`.
#[derive(Debug, Args)]
pub struct ExciteArgs {
    #[command(flatten)]
    pub model: RobotArgs,
    /// Folder of the sessions; an unfinished excitation in it resumes after its last finished step.
    pub folder: PathBuf,
    /// Robot backend.
    #[arg(long, value_enum, default_value_t = BackendKind::Direct)]
    pub robot: BackendKind,
    /// Configuration file of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Excitation script (TOML); default: the built-in one.
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// Number of the instance that a simulated or emulated robot is; 0 is the nominal model.
    #[arg(long, default_value_t = 0)]
    pub instance: u64,
    /// File for the instance's true parameters, for evaluation only.
    #[arg(long)]
    pub truth_out: Option<PathBuf>,
    /// Only print the steps.
    #[arg(long)]
    pub dry_run: bool,
    /// Do not ask before moving a real robot.
    #[arg(long)]
    pub yes: bool,
}

/// Progress of an excitation, as kept in its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ExcitationState {
    version: u32,
    robot: String,
    /// Files of the robot, if it is not the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    robot_model: Option<RobotSources>,
    /// Number of the instance, for a simulated or emulated robot.
    #[serde(alias = "individual")]
    instance: u64,
    script: ExcitationScript,
    /// Number of finished steps, from the first on.
    done: usize,
    /// Number of sessions begun.
    parts: usize,
}

impl ExcitationState {
    fn read(folder: &Path, hand: &Hand) -> Result<Option<Self>> {
        let path = folder.join(STATE_FILE);
        if !path.exists() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let record: Self = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        let steps = record.script.steps(hand).len();
        if record.version != 1 || record.done > steps {
            bail!(
                "{}: version, done: found {}, {}, expected 1 and at most {steps}",
                path.display(),
                record.version,
                record.done
            );
        }
        Ok(Some(record))
    }

    /// Estimates duration (s, without the arm's motions) and size (MB) of the steps that are not done.
    fn remaining(&self, hand: &Hand) -> (f64, f64) {
        let steps = self.script.steps(hand);
        let left = || steps.iter().skip(self.done);
        let seconds: f64 = left().map(|step| self.script.step_duration(step, hand)).sum();
        let presses = left().filter(|step| matches!(step, ExcitationStep::Press(..))).count();
        (seconds, 1e-6 * (SECOND_BYTES * seconds + PRESS_BYTES * presses as f64))
    }

    fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(STATE_FILE);
        ftac_platform::data::write_atomically(&path, serde_json::to_string_pretty(self)?.as_bytes())?;
        Ok(())
    }
}

/// JSON output of `sysid excite`, also of a dry run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ExciteOutput {
    /// Folder of the sessions.
    folder: String,
    /// Robot backend: sim, direct, emulated or hardware.
    robot: String,
    /// True if nothing was moved.
    dry_run: bool,
    /// Number of steps of the script.
    steps: usize,
    /// Number of finished steps.
    done: usize,
    /// Duration of the remaining steps without the arm's motions, s.
    seconds_left: f64,
    /// Estimated size of the sessions of the remaining steps, MB.
    megabytes_left: f64,
    /// Session files.
    sessions: Vec<String>,
}

/// A robot backend with every layer between it and a controller.
enum ExcitationBackend {
    Simulated(Box<dyn RobotBackend>),
    Direct(Box<DirectRobot>),
    Lockstep(Box<LockstepRobot>),
    Hardware(Box<HardwareRobot>),
}

impl ExcitationBackend {
    fn robot(&mut self) -> &mut dyn RobotBackend {
        match self {
            Self::Simulated(robot) => robot.as_mut(),
            Self::Direct(robot) => robot.as_mut(),
            Self::Lockstep(robot) => robot.as_mut(),
            Self::Hardware(robot) => robot.as_mut(),
        }
    }

    /// Returns the state of the supervisor if the robot no longer runs.
    fn stopped(&self) -> Option<String> {
        let state = match self {
            Self::Simulated(_) => return None,
            Self::Direct(robot) => robot.state(),
            Self::Lockstep(robot) => robot.state(),
            Self::Hardware(robot) => robot.state(),
        };
        (!matches!(state, SupervisorState::Running | SupervisorState::Armed)).then(|| state.to_string())
    }
}

impl RobotBackend for ExcitationBackend {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        self.robot().observe()
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.robot().send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot().wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        match self {
            Self::Simulated(robot) => robot.tick_length(),
            Self::Direct(robot) => robot.tick_length(),
            Self::Lockstep(robot) => robot.tick_length(),
            Self::Hardware(robot) => robot.tick_length(),
        }
    }
}

pub fn run(terminal: &Terminal, args: &ExciteArgs) -> Outcome {
    if args.robot == BackendKind::Ros2 {
        bail!("--robot: found ros2, expected sim, direct, emulated or hardware");
    }
    check_backend(&args.robot.into(), args.config.as_deref(), &[])?;
    if args.robot == BackendKind::Hardware && (args.instance != 0 || args.truth_out.is_some()) {
        bail!("--instance, --truth-out: found --robot hardware, expected a simulated or emulated robot");
    }
    let nominal = NominalModel::new(args.model.model()?)?;
    let script = nominal.script(args.script.as_deref())?;
    let asked = ExcitationState {
        version: 1,
        robot: args.robot.name().to_owned(),
        robot_model: nominal.robot.sources.clone(),
        instance: args.instance,
        script,
        done: 0,
        parts: 0,
    };
    let mut record = match ExcitationState::read(&args.folder, &nominal.robot.hand)? {
        None => asked,
        Some(begun) => {
            let same = ExcitationState { done: begun.done, parts: begun.parts, ..asked.clone() };
            if begun != same {
                bail!(
                    "{}: found an excitation of another robot, instance or script, expected the same; use a separate folder",
                    args.folder.join(STATE_FILE).display()
                );
            }
            begun
        }
    };
    let steps = record.script.steps(&nominal.robot.hand).len();
    if args.dry_run {
        return print_steps(terminal, args, &nominal.robot.hand, &record, true);
    }
    if let Some(path) = &args.truth_out {
        super::write_truth(path, &nominal.robot, args.instance)?;
    }
    if record.done == steps {
        eprintln!("all {steps} steps are done");
        return print_steps(terminal, args, &nominal.robot.hand, &record, false);
    }
    std::fs::create_dir_all(&args.folder).with_context(|| args.folder.display().to_string())?;
    let (body, about) = open_backend(terminal, args, &nominal, &record.script)?;
    record.parts += 1;
    record.write(&args.folder)?;
    let session = SessionHeader {
        robot: record.robot.clone(),
        program: format!("ftac {}", env!("CARGO_PKG_VERSION")),
        seed: terminal.seed,
        tick_length: body.tick_length(),
        task: serde_json::to_vec(&IdentificationTask::new(&nominal.robot.hand, &record.script, record.done))?,
        ..about
    };
    let interrupt = Interrupt::catch()?;
    let path = args.folder.join(format!("part_{}.mcap", record.parts));
    if !terminal.quiet {
        eprintln!("{}: a session of about {:.0} MB", path.display(), record.remaining(&nominal.robot.hand).1);
    }
    let mut recorder = SessionRecorder::new(ImageFilter::new(body), SessionWriter::create(&path, &session)?);
    let interruption = excite(terminal, args, &nominal, &mut record, (&mut recorder, &interrupt));
    let (body, finished) = recorder.finish();
    if let ExcitationBackend::Hardware(robot) = body.into_robot() {
        // Only an operator opens a hand that was stopped: it may hold an object.
        if matches!(interruption, Ok(None)) && finished.is_ok() {
            robot.release()?;
        } else {
            eprintln!("the hand keeps hold of what it holds; `ftac bridge stop --release` opens it");
        }
    }
    if let Some(why) = interruption? {
        finished?;
        if interrupt.happened() {
            let resume_hint = "the same command resumes from there".to_owned();
            bail!(Interrupted { done: record.done, total: steps, pieces: "steps are done", resume_hint });
        }
        return Ok(Some(format!("{why} after {} of {steps} steps; the same command resumes from there", record.done)));
    }
    finished?;
    print_steps(terminal, args, &nominal.robot.hand, &record, false)
}

/// Runs the remaining steps. Returns the reason if it stopped before the end.
fn excite(
    terminal: &Terminal,
    args: &ExciteArgs,
    nominal: &NominalModel,
    record: &mut ExcitationState,
    (recorder, interrupt): (&mut SessionRecorder<ImageFilter<ExcitationBackend>>, &Interrupt),
) -> Result<Option<String>> {
    let bar = terminal.progress();
    bar.set_length(record.script.steps(&nominal.robot.hand).len() as u64);
    bar.set_position(record.done as u64);
    let (script, first) = (record.script.clone(), record.done);
    let heard = |progress: ExcitationProgress| {
        let left_out = match progress {
            ExcitationProgress::OutOfReach(step) => {
                Some((step, "the arm has no collision-free motion to it; it is left out".to_owned()))
            }
            ExcitationProgress::NotLifted(step) => {
                Some((step, "no payload is measured in the hand, the object was not lifted; it is left out".to_owned()))
            }
            ExcitationProgress::Blocked(step, held) => Some((step, format!("{held}; the rest of it is left out"))),
            ExcitationProgress::Begins(_) | ExcitationProgress::Done(_) => None,
        };
        if let Some((step, why)) = left_out {
            eprintln!("step {}: {why}", step + 1);
        }
        if let Some(step) = progress.finished_step() {
            bar.set_position(step as u64 + 1);
            record.done = step + 1;
            record.write(&args.folder)?;
        }
        Ok::<(), anyhow::Error>(())
    };
    let mut stopped = None;
    let goes_on = |recorder: &mut SessionRecorder<ImageFilter<ExcitationBackend>>| {
        stopped =
            if interrupt.happened() { Some("interrupted".to_owned()) } else { recorder.robot().robot().stopped() };
        stopped.is_none()
    };
    let finished = run_script(recorder, &nominal.excitation_inputs(&script), first, heard, goes_on);
    bar.finish_and_clear();
    Ok(if finished? { None } else { Some(stopped.unwrap_or_default()) })
}

/// Opens and arms the requested backend. Also returns the session header.
fn open_backend(
    terminal: &Terminal,
    args: &ExciteArgs,
    nominal: &NominalModel,
    script: &ExcitationScript,
) -> Result<(ExcitationBackend, SessionHeader)> {
    if args.robot == BackendKind::Hardware {
        let path = args.config.as_deref().context("--config")?;
        return connect_hardware(path, args.yes, script, &nominal.robot);
    }
    check_supported(&nominal.robot)?;
    let individual = RobotInstance::sample(&nominal.robot, args.instance);
    let model = &nominal.robot;
    let robot = nominal.simulated_robot(args.instance, terminal.seed, script)?;
    let settings = lockstep_settings(&individual.apply_to_hand(&model.hand), terminal.seed);
    let about = SessionHeader::default();
    Ok(match args.robot {
        BackendKind::Direct => {
            let robot = DirectRobot::start(Box::new(SharedPlant::new(robot)), settings, model)?;
            (ExcitationBackend::Direct(Box::new(robot)), about)
        }
        BackendKind::Emulated => {
            let robot = LockstepRobot::start(Box::new(SharedPlant::new(robot)), settings, model, None)?;
            let configuration = robot.config().to_toml().into_bytes();
            let calibration = serde_json::to_vec(robot.calibration())?;
            (ExcitationBackend::Lockstep(Box::new(robot)), SessionHeader { configuration, calibration, ..about })
        }
        BackendKind::Sim | BackendKind::Hardware | BackendKind::Ros2 => {
            (ExcitationBackend::Simulated(Box::new(robot)), about)
        }
    })
}

/// Connects the real robot of the configuration at `path`, and arms it once its operator agrees.
fn connect_hardware(
    path: &Path,
    yes: bool,
    script: &ExcitationScript,
    model: &RobotModel,
) -> Result<(ExcitationBackend, SessionHeader)> {
    let config = BridgeConfig::read(path)?;
    let bytes = |path: &Path| std::fs::read(path).with_context(|| path.display().to_string());
    let configuration = without_secrets(&String::from_utf8_lossy(&bytes(path)?)).into_bytes();
    let about = SessionHeader { configuration, calibration: bytes(&config.calibration)?, ..SessionHeader::default() };
    let robot = HardwareRobot::connect(&config, connect_arm_link(&config, model, model.arm.home)?, model, None)?;
    let begun = Instant::now();
    while let Err(error) = robot.check() {
        if begun.elapsed() > CHECK_TIMEOUT {
            bail!("the checks do not pass: {error}");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut question = "The arm will move to its home posture in a straight line in joint space and turn its wrist there, and the hand will close and open for minutes.".to_owned();
    for thing in describe_objects(script) {
        question += &format!(" {thing}");
    }
    question += " Is the way clear, the hand empty, and everything in its place?";
    if !yes && !operator_agrees(&question)? {
        bail!("not armed: the operator did not confirm");
    }
    robot.arm()?;
    Ok((ExcitationBackend::Hardware(Box::new(robot)), about))
}

/// Describes the objects that the script uses, a sentence each.
fn describe_objects(script: &ExcitationScript) -> Vec<String> {
    let ball = script.ball.as_ref().map(|ball| {
        let [x, y, z] = ball.place;
        format!(
            "It presses every pad on a ball of {:.0} mm on a post, {x:.3} m before, {y:.3} m beside and {z:.3} m over its base.",
            2e3 * ball.radius
        )
    });
    let weight = script.payload.as_ref().map(|weight| {
        let [x, y] = weight.place;
        format!(
            "Last, it lifts the {} of {:.0} g that stands on the table {x:.3} m before and {y:.3} m beside its base, turns it about, and puts it down again; \
             put it back there before you resume an excitation that was stopped meanwhile.",
            weight.object,
            1e3 * weight.mass
        )
    });
    ball.into_iter().chain(weight).collect()
}

/// Prints the steps done, or in a dry run the steps to do.
fn print_steps(terminal: &Terminal, args: &ExciteArgs, hand: &Hand, record: &ExcitationState, dry: bool) -> Outcome {
    let steps = record.script.steps(hand);
    let (seconds, megabytes) = record.remaining(hand);
    let sessions: Vec<String> =
        (1..=record.parts).map(|part| args.folder.join(format!("part_{part}.mcap")).display().to_string()).collect();
    let mut text = String::new();
    if dry {
        for line in describe(&record.script, hand).iter().skip(record.done) {
            text += &format!("{line}\n");
        }
        for thing in describe_objects(&record.script) {
            text += &format!("{thing}\n");
        }
        text += &format!(
            "{} steps to do, about {seconds:.0} s plus the arm's motions between them, and about {megabytes:.0} MB; nothing was moved\n",
            steps.len() - record.done,
        );
    } else {
        text += &format!("{} of {} steps done, in {}\n", record.done, steps.len(), sessions.join(", "));
        text += &format!("next: ftac sysid identify {}\n", args.folder.display());
    }
    let excited = ExciteOutput {
        folder: args.folder.display().to_string(),
        robot: record.robot.clone(),
        dry_run: dry,
        steps: steps.len(),
        done: record.done,
        seconds_left: seconds,
        megabytes_left: megabytes,
        sessions,
    };
    terminal.print(&excited, &text)?;
    Ok(None)
}
