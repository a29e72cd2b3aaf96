//! Source of real robots: first connected and checked, then the objects are laid out by the operator, then the torque
//! is switched on.

use hardware_bridge::driven::SERVOS;
use std::path::PathBuf;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use control::outage::Outage;
use hand_model::robot::{Command, RobotBackend, ServoGoal};
use hand_model::{ArmVector, RobotModel};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::config::secrets::without_secrets;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::pictures::Pictures;
use hardware_bridge::real_time::PERMIT;
use nalgebra::Isometry3;
use robot_session_log::{Packet, Session, Tap};
use sim::SimulatedRobot;

use super::{Hardware, PATIENCE};
use crate::arm_link::arm_link;
use crate::disk::room_for_session;
use crate::emulated::session_file;
use crate::operator::{Operator, ask_until};
use crate::{BodySource, Stopped, Task, TrialBody, TrialSetup};
use object_detector::{Vision, VisionLink, VisionSource, shown};
use progress::interrupt::Interrupt;

/// Speed of the arm's joints on the way to the posture in which trials begin, rad/s.
const SPEED: f64 = 0.3;
/// Time for which the servo cycle is observed before the torque goes on.
const TRIED: Duration = Duration::from_secs(1);
/// Tolerance of the ready posture, rad.
const THERE: f64 = 0.01;

/// Source of the real robot.
pub struct HardwareSource {
    config: BridgeConfig,
    about: Session,
    model: RobotModel,
    /// Posture in which trials begin, rad.
    ready: ArmVector,
    sessions: PathBuf,
    eyes: Option<Vision>,
    packets: Option<std::sync::mpsc::Receiver<Packet>>,
}

impl HardwareSource {
    /// Reads the configuration at `path`. Sessions are always recorded, into `sessions`.
    pub fn new(path: &std::path::Path, model: RobotModel, ready: ArmVector, sessions: PathBuf) -> Result<Self> {
        let config = BridgeConfig::read(path)?;
        let bytes = |path: &std::path::Path| std::fs::read(path).with_context(|| path.display().to_string());
        let configuration = without_secrets(&String::from_utf8_lossy(&bytes(path)?)).into_bytes();
        let about = Session { configuration, calibration: bytes(&config.calibration)?, ..Session::default() };
        Ok(Self { config, about, model, ready, sessions, eyes: None, packets: None })
    }

    /// Adds a vision system that reports object poses.
    #[must_use]
    pub fn with_eyes(self, eyes: Option<Vision>) -> Self {
        Self { eyes, ..self }
    }

    /// Connects the vision system.
    fn open_eyes(&self) -> Result<Option<VisionLink>> {
        let connect = |eyes: &Vision| match &eyes.source {
            VisionSource::At(address) => Ok(VisionLink::connect(address, eyes.checks.clone())?),
            VisionSource::Emulated => {
                bail!("--eyes emulated: found --robot hardware, expected the address of a vision system")
            }
        };
        self.eyes.as_ref().map(connect).transpose()
    }

    /// Checks that no camera is plugged in at another's place, as far as reference pictures exist.
    fn compare_pictures(&self, robot: &HardwareRobot) -> Result<()> {
        let kept = Pictures::read(&Pictures::beside(&self.config.calibration), self.model.hand.cameras.len())?;
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

    /// True if the robot has tactile cameras.
    pub fn has_cameras(&self) -> bool {
        self.config.cameras.is_some() || !self.config.uvc.is_empty()
    }

    /// Connects and checks the robot with its torque as it was. This finds every fault that can be found before objects
    /// are laid out or anything moves.
    pub fn check(&mut self) -> Result<Checked> {
        let link = arm_link(&self.config, &self.model, self.ready)?;
        let robot = HardwareRobot::connect(&self.config, link, &self.model, None)?;
        wait_for_checks(&robot)?;
        self.compare_pictures(&robot)?;
        let (packets, receiver) = std::sync::mpsc::channel();
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
        Ok(Checked { robot, packets, ready: self.ready, pause: self.config.limits.pause, wrong_since: None })
    }
}

/// A robot that passed the checks. Its links are kept while its operator lays out objects; nothing moves.
pub struct Checked {
    robot: HardwareRobot,
    /// Destination of the links' bytes from the beginning of the trial on.
    packets: Sender<Packet>,
    /// Posture in which trials begin, rad.
    ready: ArmVector,
    /// Longest time to think, s.
    pause: f64,
    /// Time since which the checks have failed, if they do.
    wrong_since: Option<Instant>,
}

impl Checked {
    /// Repeats the checks while the operator is asked something. A robot that fails them for [`PATIENCE`] ends the
    /// question.
    pub fn attend(&mut self) -> Result<()> {
        let Err(error) = self.robot.check() else {
            self.wrong_since = None;
            return Ok(());
        };
        if self.wrong_since.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
            bail!("the checks do not pass any more: {error}");
        }
        Ok(())
    }

    /// Switches the torque on and moves to the ready posture. `objects` are given with their nominal poses,
    /// `world_from_object`.
    pub fn begin(self, objects: &[(&str, Isometry3<f64>)]) -> Result<Hardware> {
        let Self { robot, packets, ready, pause, .. } = self;
        wait_for_checks(&robot)?;
        robot.tap(&packets);
        if let Some(tactile) = robot.tactile() {
            tactile.tap(Tap::new("cameras", packets));
        }
        let (interrupt, operator) = (Interrupt::catch()?, Operator::at_the_terminal()?);
        robot.arm()?;
        let (names, places) = objects.iter().map(|(name, place)| ((*name).to_owned(), *place)).unzip();
        let mut hardware = Hardware { robot, places, names, pause, interrupt, eyes: None, operator };
        if let Err(error) = go_to(&mut hardware, &ready) {
            hardware.leave(Some(&format!("{error:#}")))?;
            return Err(error);
        }
        Ok(hardware)
    }
}

/// Waits until the newest measurements pass the checks.
fn wait_for_checks(robot: &HardwareRobot) -> Result<()> {
    let begun = Instant::now();
    while let Err(error) = robot.check() {
        if begun.elapsed() > PATIENCE {
            bail!("the checks do not pass: {error}");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}

impl BodySource for HardwareSource {
    fn open(&mut self, setup: &TrialSetup, _: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        let Task { combination, trial, condition, .. } = setup.task;
        room_for_session(&self.sessions)?;
        // Faults of robot or eyes are found before anybody lays out objects.
        let mut eyes = self.open_eyes()?;
        let mut checked = self.check()?;
        eprintln!("combination {combination}, trial {trial}, {condition}:");
        for (name, place) in &setup.objects {
            eprintln!("  put {name} at {}", shown(place));
        }
        let look = |eyes: &mut VisionLink, name: &str| -> Result<()> {
            // A hidden object is found before anything moves.
            let seen = eyes.look(name, || false)?;
            let seen =
                seen.with_context(|| format!("{name} is hidden, expected it in sight before the trial begins"))?;
            eprintln!("  {name} is seen at {}", shown(&seen.pose));
            Ok(())
        };
        let question = "The arm will move to its ready posture, then the trial begins. Empty hand, clear way? Enter begins, `q` ends here.";
        if ask_until(question, || checked.attend().map(|()| false))?.is_none_or(|answer| answer == "q") {
            bail!(Stopped("the operator ended the list here".into()));
        }
        for (name, _) in &setup.objects {
            eyes.as_mut().map_or(Ok(()), |eyes| look(eyes, name))?;
        }
        Ok(Box::new(Hardware { eyes, ..checked.begin(&setup.objects)? }))
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
fn go_to(hardware: &mut Hardware, posture: &[f64]) -> Result<()> {
    let step = SPEED * hardware.robot.tick_length();
    let mut goal = hardware.robot.observe()?.complete()?.arm.position;
    let longest = goal.iter().zip(posture).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
    let mut left = (longest / step) as u64 + 600;
    let mut outage = Outage::default();
    loop {
        let Some(observation) = outage.observed(hardware.robot.observe())? else {
            hardware.robot.wait_for_tick();
            continue;
        };
        let far = observation.arm.position.iter().zip(posture).any(|(is, to)| (is - to).abs() > THERE);
        let arrived = goal[..] == *posture && !far;
        for (goal, to) in goal.iter_mut().zip(posture) {
            *goal += (to - *goal).clamp(-step, step);
        }
        let command = Command { arm: goal, servos: [ServoGoal::Current(0.0); SERVOS].into(), capture: false };
        let sent = outage.sent(hardware.robot.send(&command));
        hardware.robot.wait_for_tick();
        if let Some(why) = hardware.stopped() {
            bail!(Stopped(format!("{why} on the way to the ready posture")));
        }
        sent?;
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
