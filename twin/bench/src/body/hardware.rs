//! The real robot: what it needs of its operator, before, during and after a trial.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use control::percept::Sighted;
use hand_model::robot::{Command, Robot, ServoGoal};
use hand_model::{ACTUATORS, ARM_JOINTS, Arm};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::config::secrets::without_secrets;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::pictures::Pictures;
use hardware_bridge::real_time::PERMIT;
use hardware_bridge::safety::state::{Cause, State};
use nalgebra::Isometry3;
use scenarios::referee::{FailureCause, Verdict};
use session_log::{Packet, Session, Tap};
use sim::SimulatedRobot;
use sim::robot::Truth;

use crate::vision::{Vision, VisionError, VisionLink, VisionSource, shown};

use super::arm_link::arm_link;
use super::disk::room_for_session;
use super::emulated::session_file;
use super::operator::{Interrupt, ask, ask_unless};
use super::{BodySource, Glance, Task, TrialBody, TrialSetup};

/// Waited for the first measurements to pass the checks.
const PATIENCE: Duration = Duration::from_secs(5);
/// How fast the arm's joints go to the posture in which trials begin, rad/s.
const SPEED: f64 = 0.3;
/// Longest wait for an operator who was asked something, s; after that the robot holds.
const OPERATOR: f64 = 600.0;
/// For so long the servo cycle is watched before the torque goes on.
const TRIED: Duration = Duration::from_secs(1);
/// A program that stood still so recently may be to blame for what came then.
const RECENTLY: Duration = Duration::from_secs(5);
/// How close to it is there, rad.
const THERE: f64 = 0.01;

/// The real robot, with what it needs of its operator.
pub struct Hardware {
    robot: HardwareRobot,
    places: [Isometry3<f64>; 2],
    names: [String; 2],
    /// Longest time to think, s.
    pause: f64,
    /// From torque on to the end.
    interrupt: Interrupt,
    eyes: Option<VisionLink>,
}

impl Hardware {
    /// What the operator answers in mid-trial, while the robot stands still.
    fn ask(&mut self, question: &str) -> Result<String> {
        self.robot.pause(OPERATOR);
        match ask_unless(question, Some(&self.interrupt))? {
            Some(answer) => Ok(answer),
            None => bail!(super::Stopped(self.stopped().unwrap_or_default())),
        }
    }

    /// Asks until the answer is yes or no.
    fn yes(&mut self, question: &str) -> Result<bool> {
        loop {
            match self.ask(question)?.as_str() {
                "yes" | "y" => return Ok(true),
                "no" | "n" => return Ok(false),
                _ => {}
            }
        }
    }

    /// What went wrong, by number.
    fn why_not(&mut self) -> Result<FailureCause> {
        use FailureCause::{
            BothDropped, FirstDropped, FirstNotPicked, SecondDropped, SecondNotPicked, Slipped, Unreachable,
        };
        let causes = [FirstNotPicked, FirstDropped, SecondNotPicked, SecondDropped, BothDropped, Slipped, Unreachable];
        let list: Vec<String> = (1..).zip(&causes).map(|(n, cause)| format!("{n} {cause}")).collect();
        loop {
            let answer = self.ask(&format!("Why not? [{}]", list.join(", ")))?;
            if let Some(cause) = answer.parse::<usize>().ok().and_then(|n| causes.get(n.wrapping_sub(1))) {
                return Ok(*cause);
            }
        }
    }
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

    /// A vision system looks, or nobody but the operator, who puts the object where it belongs.
    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        let object = glance.object;
        if let Some(eyes) = &mut self.eyes {
            self.robot.pause(OPERATOR);
            let interrupt = &self.interrupt;
            let seen = eyes.look(&self.names[object], || interrupt.happened());
            self.pause();
            return match seen {
                Err(VisionError::Stopped(_)) => bail!(super::Stopped(self.stopped().unwrap_or_default())),
                seen => Ok(seen?),
            };
        }
        let place = self.places[object];
        let question = format!(
            "Is {} at {}? Put it there if it can be reached safely, and press Enter.",
            self.names[object],
            shown(&place)
        );
        self.ask(&question)?;
        // With the answer the controller goes on thinking.
        self.pause();
        Ok(Some(place.into()))
    }

    fn hold(&mut self) {
        // A robot that cannot hold says why by its state.
        let _ = self.robot.hold();
    }

    fn pause(&mut self) {
        self.robot.pause(self.pause);
    }

    fn stopped(&self) -> Option<String> {
        if self.interrupt.happened() && matches!(self.robot.state(), State::Running | State::Armed) {
            // A robot that cannot hold says why by its state.
            let _ = self.robot.hold();
        }
        let state = self.robot.state();
        if matches!(state, State::Running | State::Armed) {
            return None;
        }
        let report = self.robot.report();
        let own_words = match (state, report.arm_error) {
            (State::Fault(Cause::ArmFault(_)), Some(words)) => format!(" ({words})"),
            _ => String::new(),
        };
        let frozen = match (state, report.frozen) {
            (State::Hold(Cause::Frozen(_)) | State::Fault(Cause::Frozen(_)), _) => String::new(),
            (_, Some((at, gap))) if at.elapsed() < RECENTLY => format!(
                "; before that this program stood still for {:.0} ms: was it stopped, or the computer suspended or overloaded?",
                1e3 * gap
            ),
            _ => String::new(),
        };
        Some(format!("{state}{own_words}{frozen}"))
    }

    fn judge(&mut self) -> Result<Option<Verdict>> {
        let contact = self.yes(
            "Did the held object, the fingers that hold it, or the palm touch the second one before it was grasped? [yes/no]",
        )?;
        let success = self.yes("Were both objects in the hand to the end? [yes/no]")?;
        let cause = match success {
            true => None,
            false => Some(self.why_not()?),
        };
        Ok(Some(Verdict { contact, first_contact: None, success, cause }))
    }

    fn statistics(&self) -> Option<serde_json::Value> {
        let report = self.robot.report();
        let ms = |seconds: f64| 1e3 * seconds;
        let mm = |metres: f64| 1e3 * metres;
        // How near to the supervisor's limits the robot came: what owners set their own by.
        let pressed = report.margins.pressed.map(|most| {
            serde_json::json!({"torque_nm": most.torque, "residual_nm": most.residual, "longest_above_ms": ms(most.longest)})
        });
        let room = report.margins.room.map(|least| {
            serde_json::json!({"table_mm": mm(least.table), "sides_mm": mm(least.sides), "clearance_mm": mm(least.clearance)})
        });
        Some(serde_json::json!({
            "pressed": pressed,
            "room": room,
            "cycles": report.cycles,
            "late_cycles": report.late,
            "longest_gap_ms": ms(report.longest_gap),
            "longest_silence_ms": ms(report.longest_silence),
            "last_standstill_ms": report.frozen.map(|(_, gap)| ms(gap)),
            "not_run_ahead": report.behind,
            "missing_answers": report.bus.missing,
            "round_trip_ms": {"p50": report.bus.round_trip(0.5).map(ms), "p99": report.bus.round_trip(0.99).map(ms)},
        }))
    }

    /// The hand opens only when somebody says so.
    fn leave(&mut self, why: Option<&str>) -> Result<()> {
        if let Some(why) = why {
            eprintln!("STOPPED: {why}");
            eprintln!("The hand keeps hold of what it holds, as far as its servos answer; {}.", self.robot.standing());
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
        // Until the torque was read back.
        let off = self.robot.release()?;
        eprintln!("released: {off}");
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
    eyes: Option<Vision>,
    packets: Option<std::sync::mpsc::Receiver<Packet>>,
}

impl HardwareSource {
    /// Under the configuration at `path`; sessions are always recorded, into `sessions`.
    pub fn new(path: &std::path::Path, arm: Arc<Arm>, ready: [f64; ARM_JOINTS], sessions: PathBuf) -> Result<Self> {
        let config = BridgeConfig::read(path)?;
        let bytes = |path: &std::path::Path| std::fs::read(path).with_context(|| path.display().to_string());
        let configuration = without_secrets(&String::from_utf8_lossy(&bytes(path)?)).into_bytes();
        let about = Session { configuration, calibration: bytes(&config.calibration)?, ..Session::default() };
        Ok(Self { config, about, arm, ready, sessions, eyes: None, packets: None })
    }

    /// The same with a vision system that says where objects are.
    #[must_use]
    pub fn with_eyes(self, eyes: Option<Vision>) -> Self {
        Self { eyes, ..self }
    }

    /// The vision system, connected.
    fn open_eyes(&self) -> Result<Option<VisionLink>> {
        let connect = |eyes: &Vision| match &eyes.source {
            VisionSource::At(address) => Ok(VisionLink::connect(address, eyes.checks.clone())?),
            VisionSource::Emulated => {
                bail!("--eyes emulated: found --robot hardware, expected the address of a vision system")
            }
        };
        self.eyes.as_ref().map(connect).transpose()
    }

    /// Makes sure that no camera is plugged in where another was, as far as somebody knows.
    fn compare_pictures(&self, robot: &HardwareRobot) -> Result<()> {
        let kept = Pictures::read(&Pictures::beside(&self.config.calibration))?;
        let (Some(kept), Some(cameras)) = (kept, robot.cameras()) else { return Ok(()) };
        let now = Pictures::look(cameras, PATIENCE).map_err(anyhow::Error::msg)?;
        let mistaken: Vec<String> = kept.mistaken(&now).iter().map(ToString::to_string).collect();
        if !mistaken.is_empty() {
            bail!(
                "found {}, expected every camera where it was (`ftac bridge doctor --know-cameras` keeps what is right now)",
                mistaken.join(", ")
            );
        }
        Ok(())
    }

    /// Whether it has tactile cameras.
    pub fn has_cameras(&self) -> bool {
        self.config.cameras.is_some() || !self.config.uvc.is_empty()
    }

    /// The robot, connected, checked, with torque on and in its ready posture; `objects` belong in these places.
    pub fn connect(&mut self, objects: [(&str, Isometry3<f64>); 2]) -> Result<Hardware> {
        let link = arm_link(&self.config, self.ready)?;
        let robot = HardwareRobot::connect(&self.config, link, &self.arm, None)?;
        let begun = Instant::now();
        while let Err(error) = robot.check() {
            if begun.elapsed() > PATIENCE {
                bail!("the checks do not pass: {error}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        self.compare_pictures(&robot)?;
        let (sender, receiver) = std::sync::mpsc::channel();
        robot.tap(&sender);
        if let Some(tactile) = robot.tactile() {
            tactile.tap(Tap::new("cameras", sender));
        }
        self.packets = Some(receiver);
        if let Some(why) = robot.report().behind {
            eprintln!(
                "warning: the servo cycle does not run ahead of other programs ({why}). On a busy computer devices may stop in mid-trial. To permit it:"
            );
            PERMIT.iter().for_each(|command| eprintln!("  {command}"));
            eprintln!("then log in again.");
        }
        std::thread::sleep(TRIED);
        let (gap, limits) = (robot.report().longest_gap, &self.config.limits);
        let most = 0.5 * limits.servo_watchdog.min(limits.arm_watchdog);
        if gap > most {
            bail!(
                "this computer is too busy to begin: found {:.0} ms between two servo cycles, expected at most {:.0} (half of the shortest watchdog)",
                1e3 * gap,
                1e3 * most
            );
        }
        let interrupt = Interrupt::catch()?;
        robot.arm()?;
        let names = objects.map(|(name, _)| name.to_owned());
        let pause = self.config.limits.pause;
        let places = objects.map(|(_, place)| place);
        let mut hardware = Hardware { robot, places, names, pause, interrupt, eyes: None };
        if let Err(error) = go_to(&mut hardware, &self.ready) {
            hardware.leave(Some(&format!("{error:#}")))?;
            return Err(error);
        }
        Ok(hardware)
    }
}

impl BodySource for HardwareSource {
    fn open(&mut self, setup: &TrialSetup, _: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        let Task { combination, trial, condition, .. } = setup.task;
        room_for_session(&self.sessions)?;
        eprintln!("combination {combination}, trial {trial}, {condition}:");
        let mut eyes = self.open_eyes()?;
        for (name, place) in &setup.objects {
            eprintln!("  put {name} at {}", shown(place));
        }
        let look = |eyes: &mut VisionLink, name: &str| -> Result<()> {
            // What cannot be seen is found before anything moves.
            let seen = eyes.look(name, || false)?;
            let seen =
                seen.with_context(|| format!("{name} is hidden, expected it in sight before the trial begins"))?;
            eprintln!("  {name} is seen at {}", shown(&seen.pose));
            Ok(())
        };
        ask("The arm will move to its ready posture, then the trial begins. Empty hand, clear way? Enter begins, `q` ends here.")
            .and_then(|answer| if answer == "q" { bail!(super::Stopped("the operator ended the list here".into())) } else { Ok(()) })?;
        for (name, _) in &setup.objects {
            eyes.as_mut().map_or(Ok(()), |eyes| look(eyes, name))?;
        }
        Ok(Box::new(Hardware { eyes, ..self.connect(setup.objects)? }))
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
