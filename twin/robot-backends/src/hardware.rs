//! The real robot, with its questions to the operator before, during and after a trial.

use std::time::Duration;

use anyhow::{Result, bail};
use control::detection::PoseDetection;
use hand_model::robot::RobotBackend;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use nalgebra::Isometry3;
use scenarios::referee::{FailureCause, Verdict};
use sim::robot::GroundTruth;

use super::driver::scene::{DriverScene, SceneError};
use super::operator::Operator;
use super::{Detection, TrialBackend};
use object_detector::{VisionError, VisionLink, format_position};
use progress::interrupt::Interrupt;

mod source;

pub use self::source::{CheckedRobot, HardwareFactory};

/// Time limit for the first measurements to pass the checks.
const CHECK_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest wait for an operator's answer, s; after it the robot holds.
const OPERATOR_TIMEOUT: f64 = 600.0;
/// Time within which a standstill of this program may have caused a stop of the robot.
const STANDSTILL_WINDOW: Duration = Duration::from_secs(5);

/// The real robot with its operator.
pub struct HardwareBackend {
    robot: HardwareRobot,
    nominal_poses: Vec<Isometry3<f64>>,
    names: Vec<String>,
    /// Longest pause while the controller computes, s.
    max_pause: f64,
    /// Interrupt by the operator, caught from torque-on to the end; none on a robot without an operator.
    interrupt: Option<Interrupt>,
    vision: Option<VisionLink>,
    /// Scene of a driver that needs no operator.
    scene: Option<DriverScene>,
    operator: Operator,
}

impl HardwareBackend {
    /// Asks the operator in mid-trial while the robot stands still. Returns the answer. A robot that stops meanwhile
    /// ends the question and the trial.
    fn ask_during_trial(&mut self, question: &str) -> Result<String> {
        self.robot.pause(OPERATOR_TIMEOUT);
        match self.operator.ask_until(question, || Ok(self.stop_reason().is_some()))? {
            Some(answer) => Ok(answer),
            None => bail!(super::TrialStopped(self.stop_reason().unwrap_or_default())),
        }
    }

    /// Asks the operator after the trial. A robot that is lost meanwhile has not kept the objects to the end. A robot
    /// that holds because the operator takes long has.
    fn ask_for_verdict(&mut self, question: &str) -> Result<String> {
        self.robot.pause(OPERATOR_TIMEOUT);
        let waited = |state: SupervisorState| matches!(state, SupervisorState::Hold(StopCause::HostSilent(_)));
        let lost = || self.stop_reason().filter(|_| !waited(self.robot.state()));
        match self.operator.ask_until(question, || Ok(lost().is_some()))? {
            Some(answer) => Ok(answer),
            None => {
                let why = self.stop_reason().unwrap_or_default();
                bail!(super::TrialStopped(format!(
                    "{why}; this was while the verdict was asked for, and the trial has none"
                )))
            }
        }
    }

    /// Asks for the verdict until the answer is yes or no.
    fn ask_yes_no(&mut self, question: &str) -> Result<bool> {
        loop {
            match self.ask_for_verdict(question)?.as_str() {
                "yes" | "y" => return Ok(true),
                "no" | "n" => return Ok(false),
                _ => {}
            }
        }
    }

    /// Asks for the cause of failure, by number.
    fn ask_failure_cause(&mut self) -> Result<FailureCause> {
        use FailureCause::{
            BothDropped, FirstDropped, FirstNotPicked, SecondDropped, SecondNotPicked, Slipped, Unreachable,
        };
        let causes = [FirstNotPicked, FirstDropped, SecondNotPicked, SecondDropped, BothDropped, Slipped, Unreachable];
        let list: Vec<String> = (1..).zip(&causes).map(|(n, cause)| format!("{n} {cause}")).collect();
        loop {
            let answer = self.ask_for_verdict(&format!("Why not? [{}]", list.join(", ")))?;
            if let Some(cause) = answer.parse::<usize>().ok().and_then(|n| causes.get(n.wrapping_sub(1))) {
                return Ok(*cause);
            }
        }
    }
}

impl TrialBackend for HardwareBackend {
    fn robot(&self) -> &dyn RobotBackend {
        &self.robot
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.robot
    }

    fn truth(&self) -> Option<GroundTruth> {
        None
    }

    /// Detects the object with the vision system, or with the scene of the robot's driver. Without them, asks the
    /// operator, who puts the object at its nominal place.
    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        let object = glance.object;
        if let Some(detector) = &mut self.vision {
            self.robot.pause(OPERATOR_TIMEOUT);
            let interrupt = self.interrupt.as_ref();
            let seen = detector.detect(&self.names[object], || interrupt.is_some_and(Interrupt::happened));
            self.pause();
            return match seen {
                Err(VisionError::Stopped(_)) => bail!(super::TrialStopped(self.stop_reason().unwrap_or_default())),
                seen => Ok(seen?),
            };
        }
        if let Some(scene) = &self.scene {
            return Ok(scene.detect(&self.names[object])?);
        }
        let place = self.nominal_poses[object];
        let question = format!(
            "Is {} at {}? Put it there if it can be reached safely, and press Enter.",
            self.names[object],
            format_position(&place)
        );
        self.ask_during_trial(&question)?;
        // After the answer the controller continues to compute.
        self.pause();
        Ok(Some(place.into()))
    }

    fn hold(&mut self) {
        // The state of a robot that cannot hold gives the reason.
        let _ = self.robot.hold();
    }

    fn pause(&mut self) {
        self.robot.pause(self.max_pause);
    }

    fn stop_reason(&self) -> Option<String> {
        let interrupted = self.interrupt.as_ref().is_some_and(Interrupt::happened);
        if interrupted && matches!(self.robot.state(), SupervisorState::Running | SupervisorState::Armed) {
            // The state of a robot that cannot hold gives the reason.
            let _ = self.robot.hold();
        }
        let state = self.robot.state();
        if matches!(state, SupervisorState::Running | SupervisorState::Armed) {
            return None;
        }
        let report = self.robot.report();
        let own_words = match (state, report.arm_error, report.driver_error) {
            (SupervisorState::Fault(StopCause::ArmFault(_)), Some(words), _) => format!(" ({words})"),
            (SupervisorState::Fault(StopCause::DriverFailed), _, Some(words)) => format!(" ({words})"),
            _ => String::new(),
        };
        let frozen = match (state, report.last_standstill) {
            (SupervisorState::Hold(StopCause::HostFrozen(_)) | SupervisorState::Fault(StopCause::HostFrozen(_)), _) => {
                String::new()
            }
            (_, Some((at, gap))) if at.elapsed() < STANDSTILL_WINDOW => format!(
                "; before that this program stood still for {:.0} ms: was it stopped, or the computer suspended or overloaded?",
                1e3 * gap
            ),
            _ => String::new(),
        };
        Some(format!("{state}{own_words}{frozen}"))
    }

    fn judge(&mut self) -> Result<Option<Verdict>> {
        if let Some(scene) = &self.scene {
            let stopped = |error: SceneError| super::TrialStopped(format!("{error}; the trial has no verdict"));
            return Ok(Some(scene.judge().map_err(stopped)?));
        }
        let contact = self.ask_yes_no(
            "Did a held object, the fingers that hold it, or the palm touch the next one before it was grasped? [yes/no]",
        )?;
        let success = self.ask_yes_no("Were all objects in the hand to the end? [yes/no]")?;
        let cause = match success {
            true => None,
            false => Some(self.ask_failure_cause()?),
        };
        Ok(Some(Verdict { contact, first_contact: None, success, cause }))
    }

    fn statistics(&self) -> Option<serde_json::Value> {
        let report = self.robot.report();
        let ms = |seconds: f64| 1e3 * seconds;
        let mm = |metres: f64| 1e3 * metres;
        // Smallest margins to the supervisor's limits, by which users set their own.
        let pressed = report.margins.torque.map(|most| {
            serde_json::json!({"torque_nm": most.torque, "residual_nm": most.residual, "longest_above_ms": ms(most.longest_excess)})
        });
        let room = report.margins.workspace.map(|least| {
            serde_json::json!({"table_mm": mm(least.table), "sides_mm": mm(least.sides), "clearance_mm": mm(least.clearance)})
        });
        Some(serde_json::json!({
            "pressed": pressed,
            "room": room,
            "cycles": report.cycles,
            "late_cycles": report.late,
            "longest_gap_ms": ms(report.longest_gap),
            "longest_silence_ms": ms(report.longest_silence),
            "last_standstill_ms": report.last_standstill.map(|(_, gap)| ms(gap)),
            "not_run_ahead": report.priority_error,
            "missing_answers": report.bus.missing,
            "round_trip_ms": {"p50": report.bus.round_trip(0.5).map(ms), "p99": report.bus.round_trip(0.99).map(ms)},
        }))
    }

    /// Opens the hand only at the operator's request.
    fn end_trial(&mut self, why: Option<&str>) -> Result<()> {
        if self.scene.is_some() {
            return Ok(());
        }
        if let Some(why) = why {
            eprintln!("STOPPED: {why}");
            eprintln!(
                "The hand keeps hold of what it holds, as far as its servos answer; {}.",
                self.robot.describe_state()
            );
        }
        let report = self.robot.report();
        let silence = 1e3 * report.longest_silence;
        eprintln!(
            "{} servo cycles, {} late; no command for {silence:.0} ms at the longest",
            report.cycles, report.late
        );
        let mut told = why.is_some();
        let question = "Hold your hands under the objects; `release` opens the hand, anything else leaves it holding.";
        if why.is_none() {
            self.robot.pause(OPERATOR_TIMEOUT);
        }
        let answer = self
            .operator
            .ask_until(question, || {
                // Reported once, when it happens: it may change where the operator holds their hands.
                if !told && let SupervisorState::Fault(cause) = self.robot.state() {
                    told = true;
                    eprint!("\nSTOPPED meanwhile: fault: {cause}; the trial was over. {question} ");
                }
                Ok(false)
            })?
            .unwrap_or_default();
        if answer != "release" {
            eprintln!("left holding; switch the servos' supply off to open the hand");
            return Ok(());
        }
        // Returns when the torque has been read back as off.
        let off = self.robot.release()?;
        eprintln!("released: {off}");
        Ok(())
    }
}

#[cfg(test)]
mod tests;
