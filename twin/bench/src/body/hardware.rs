//! The real robot: what it needs of its operator, before, during and after a trial.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use hand_model::robot::{Command, Robot, ServoGoal};
use hand_model::{ACTUATORS, ARM_JOINTS, Arm};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::safety::state::State;
use nalgebra::Isometry3;
use scenarios::referee::{FailureCause, Verdict};
use session_log::{Packet, Session, Tap};
use sim::SimulatedRobot;
use sim::robot::Truth;

use super::arm_link::arm_link;
use super::emulated::session_file;
use super::{BodySource, Glance, Task, TrialBody, TrialSetup};

/// Waited for the first measurements to pass the checks.
const PATIENCE: Duration = Duration::from_secs(5);
/// How fast the arm's joints go to the posture in which trials begin, rad/s.
const SPEED: f64 = 0.3;
/// Longest wait for an operator who was asked something, s; after that the robot holds.
const OPERATOR: f64 = 600.0;
/// How close to it is there, rad.
const THERE: f64 = 0.01;

/// The real robot, with what it needs of its operator.
pub struct Hardware {
    robot: HardwareRobot,
    places: [Isometry3<f64>; 2],
    names: [String; 2],
    /// Longest time to think, s.
    pause: f64,
}

impl TrialBody for Hardware {
    fn robot(&self) -> &dyn Robot {
        &self.robot
    }

    fn robot_mut(&mut self) -> &mut dyn Robot {
        &mut self.robot
    }

    fn truth(&self) -> Option<Truth> {
        None
    }

    /// Nobody looks but the operator, who puts the object where it belongs.
    fn look(&mut self, glance: &Glance) -> Result<Option<Isometry3<f64>>> {
        let object = glance.object;
        let place = self.places[object];
        self.robot.pause(OPERATOR);
        let question = format!(
            "Is {} at {}? Put it there if it can be reached safely, and press Enter.",
            self.names[object],
            shown(&place)
        );
        ask(&question)?;
        // With the answer the controller goes on thinking.
        self.pause();
        Ok(Some(place))
    }

    fn pause(&mut self) {
        self.robot.pause(self.pause);
    }

    fn stopped(&self) -> Option<String> {
        match self.robot.state() {
            State::Running | State::Armed => None,
            state => Some(state.to_string()),
        }
    }

    fn judge(&mut self) -> Result<Option<Verdict>> {
        self.robot.pause(OPERATOR);
        let contact = yes(
            "Did the held object, the fingers that hold it, or the palm touch the second one before it was grasped? [yes/no]",
        )?;
        let success = yes("Were both objects in the hand to the end? [yes/no]")?;
        let cause = match success {
            true => None,
            false => Some(why_not()?),
        };
        Ok(Some(Verdict { contact, first_contact: None, success, cause }))
    }

    /// The hand opens only when somebody says so.
    fn leave(&mut self, why: Option<&str>) -> Result<()> {
        if let Some(why) = why {
            eprintln!("STOPPED: {why}");
            eprintln!("The hand keeps hold of what it holds, the arm stands.");
        }
        let report = self.robot.report();
        let silence = 1e3 * report.longest_silence;
        eprintln!(
            "{} servo cycles, {} late; no command for {silence:.0} ms at the longest",
            report.cycles, report.late
        );
        let answer =
            ask("Hold your hands under the objects; `release` opens the hand, anything else leaves it holding.")?;
        if answer != "release" {
            eprintln!("left holding; switch the servos' supply off to open the hand");
            return Ok(());
        }
        self.robot.release()?;
        let begun = Instant::now();
        while self.robot.state() != State::Connected && begun.elapsed() < 3 * PATIENCE {
            std::thread::sleep(Duration::from_millis(10));
        }
        let report = self.robot.report();
        if !report.still_on.is_empty() {
            bail!("torque is still on: {}", report.still_on.join("; "));
        }
        Ok(())
    }
}

/// Where the real robot stands.
pub struct HardwareSource {
    config: BridgeConfig,
    about: Session,
    arm: Arc<Arm>,
    /// Posture in which trials begin, rad.
    ready: [f64; ARM_JOINTS],
    sessions: PathBuf,
    packets: Option<std::sync::mpsc::Receiver<Packet>>,
}

impl HardwareSource {
    /// Under the configuration at `path`; sessions are always recorded, into `sessions`.
    pub fn new(path: &std::path::Path, arm: Arc<Arm>, ready: [f64; ARM_JOINTS], sessions: PathBuf) -> Result<Self> {
        let config = BridgeConfig::read(path)?;
        let bytes = |path: &std::path::Path| std::fs::read(path).with_context(|| path.display().to_string());
        let about =
            Session { configuration: bytes(path)?, calibration: bytes(&config.calibration)?, ..Session::default() };
        Ok(Self { config, about, arm, ready, sessions, packets: None })
    }
}

impl BodySource for HardwareSource {
    fn open(&mut self, setup: &TrialSetup, _: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        let Task { combination, trial, condition, .. } = setup.task;
        eprintln!("combination {combination}, trial {trial}, {condition}:");
        for (name, place) in &setup.objects {
            eprintln!("  put {name} at {}", shown(place));
        }
        ask("The arm will move to its ready posture, then the trial begins. Empty hand, clear way? Enter begins, `q` ends here.")
            .and_then(|answer| if answer == "q" { bail!(super::Stopped("the operator ended the list here".into())) } else { Ok(()) })?;
        let link = arm_link(&self.config, self.ready)?;
        let robot = HardwareRobot::connect(&self.config, link, &self.arm, None)?;
        let begun = Instant::now();
        while let Err(error) = robot.check() {
            if begun.elapsed() > PATIENCE {
                bail!("the checks do not pass: {error}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let (sender, receiver) = std::sync::mpsc::channel();
        robot.tap(&sender);
        if let Some(tactile) = robot.tactile() {
            tactile.tap(Tap::new("cameras", sender));
        }
        self.packets = Some(receiver);
        robot.arm()?;
        let names = setup.objects.map(|(name, _)| name.to_owned());
        let pause = self.config.limits.pause;
        let mut hardware = Hardware { robot, places: setup.objects.map(|(_, place)| place), names, pause };
        go_to(&mut hardware, &self.ready)?;
        Ok(Box::new(hardware))
    }

    fn session(&self, task: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(session_file(Some(&self.sessions), task)?.map(|path| (path, self.about.clone())))
    }

    fn packets(&mut self) -> Option<std::sync::mpsc::Receiver<Packet>> {
        self.packets.take()
    }

    fn is_real(&self) -> bool {
        true
    }
}

/// Moves the arm to `posture` (rad), all joints at [`SPEED`] at most, with the hand open.
fn go_to(hardware: &mut Hardware, posture: &[f64; ARM_JOINTS]) -> Result<()> {
    let step = SPEED * hardware.robot.tick_length();
    let mut goal = hardware.robot.observe().arm.position;
    let longest = goal.iter().zip(posture).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
    let mut left = (longest / step) as u64 + 600;
    loop {
        let observation = hardware.robot.observe();
        let far = observation.arm.position.iter().zip(posture).any(|(is, to)| (is - to).abs() > THERE);
        let arrived = goal == *posture && !far;
        for (goal, to) in goal.iter_mut().zip(posture) {
            *goal += (to - *goal).clamp(-step, step);
        }
        hardware.robot.send(&Command { arm: goal, servos: [ServoGoal::Current(0.0); ACTUATORS], capture: false });
        hardware.robot.wait_for_tick();
        if let Some(why) = hardware.stopped() {
            bail!(super::Stopped(format!("{why} on the way to the ready posture")));
        }
        left = left.saturating_sub(1);
        if arrived {
            return Ok(());
        }
        if left == 0 {
            bail!(
                "the arm does not reach its ready posture: found {:.3?} rad, expected {posture:.3?}",
                observation.arm.position
            );
        }
    }
}

/// A place on the table in words.
fn shown(place: &Isometry3<f64>) -> String {
    let t = place.translation.vector;
    format!("x {:.3}, y {:.3}, z {:.3} m", t.x, t.y, t.z)
}

/// What the operator answers, in the terminal.
fn ask(question: &str) -> Result<String> {
    eprint!("{question} ");
    std::io::stderr().flush()?;
    let mut line = String::new();
    if std::io::stdin().read_line(&mut line)? == 0 {
        bail!("the operator is gone: found the end of the input, expected an answer");
    }
    Ok(line.trim().to_owned())
}

/// What went wrong, by number.
fn why_not() -> Result<FailureCause> {
    use FailureCause::{
        BothDropped, FirstDropped, FirstNotPicked, SecondDropped, SecondNotPicked, Slipped, Unreachable,
    };
    let causes = [FirstNotPicked, FirstDropped, SecondNotPicked, SecondDropped, BothDropped, Slipped, Unreachable];
    let list: Vec<String> = (1..).zip(&causes).map(|(n, cause)| format!("{n} {cause}")).collect();
    loop {
        let answer = ask(&format!("Why not? [{}]", list.join(", ")))?;
        if let Some(cause) = answer.parse::<usize>().ok().and_then(|n| causes.get(n.wrapping_sub(1))) {
            return Ok(*cause);
        }
    }
}

/// Asks until the answer is one.
fn yes(question: &str) -> Result<bool> {
    loop {
        match ask(question)?.as_str() {
            "yes" | "y" => return Ok(true),
            "no" | "n" => return Ok(false),
            _ => {}
        }
    }
}
