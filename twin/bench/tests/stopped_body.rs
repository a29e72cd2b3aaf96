//! A trial whose backend stops or cannot be reached does not count if an operator must attend to the robot, and counts
//! as failed if other trials follow.

use hand_model::RobotModel;
use std::ops::Range;
use std::path::PathBuf;

use anyhow::Result;
use bench::builtin::make_bench;
use bench::trial::{Bench, NoWatcher};
use control::detection::PoseDetection;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, Tick};
use robot_backends::{BackendFactory, Detection, TrialBackend, TrialSetup, TrialStopped, TrialTask};
use robot_session_log::SessionHeader;
use scenarios::record::{Condition, TrialRecord};
use scenarios::{FailureCause, Scenario};
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

/// Simulated robot that stops after some time (s), or is unreachable for some time.
struct StoppingRobot {
    robot: SimulatedRobot,
    after: f64,
    silent: Range<f64>,
}

impl StoppingRobot {
    fn reached(&self) -> Result<(), RobotError> {
        match self.silent.contains(&self.robot.truth().time) {
            true => Err(RobotError::ConnectionLost("no answer".to_owned())),
            false => Ok(()),
        }
    }
}

impl RobotBackend for StoppingRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        self.reached()?;
        Ok(self.robot.observe().into())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.reached()?;
        Ok(self.robot.send(command))
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}

impl TrialBackend for StoppingRobot {
    fn robot(&self) -> &dyn RobotBackend {
        self
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        self
    }

    fn truth(&self) -> Option<GroundTruth> {
        Some(self.robot.truth())
    }

    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        TrialBackend::detect(&mut self.robot, glance)
    }

    fn stop_reason(&self) -> Option<String> {
        (self.robot.truth().time >= self.after).then(|| "fault: the arm leans on the table".to_owned())
    }
}

struct StoppingRobotFactory {
    after: f64,
    silent: Range<f64>,
}

impl BackendFactory for StoppingRobotFactory {
    fn open(&mut self, _setup: &TrialSetup, robot: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        Ok(Box::new(StoppingRobot { robot, after: self.after, silent: self.silent.clone() }))
    }

    fn session(&self, _task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(None)
    }
}

const NEVER_SILENT: Range<f64> = 0.0..0.0;

fn run_stopping_trial(bench: &Bench, condition: Condition, after: f64, silent: Range<f64>) -> Result<TrialRecord> {
    let task = TrialTask::new("sim", 1, [0, 0, 1], condition);
    Ok(bench.run(&task, &mut StoppingRobotFactory { after, silent }, &mut NoWatcher)?.record)
}

#[test]
fn a_trial_whose_body_stops_is_none_or_has_failed() {
    let mut bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 1, 1, true).expect("the built-in benchmark");
    for condition in [Condition::Blind, Condition::Touch] {
        bench.continues_after_faults = false;
        let error = run_stopping_trial(&bench, condition, 2.0, NEVER_SILENT).expect_err("stopped");
        assert!(error.downcast_ref::<TrialStopped>().is_some_and(|why| why.0.contains("leans")), "{error:#}");
        bench.continues_after_faults = true;
        // An object that was dropped before counts first.
        let causes =
            [(2.0, vec![FailureCause::RobotFault]), (9.0, vec![FailureCause::RobotFault, FailureCause::FirstDropped])];
        for (after, causes) in causes {
            let record = run_stopping_trial(&bench, condition, after, NEVER_SILENT).expect("a record");
            assert!(!record.success && record.cause.is_some_and(|cause| causes.contains(&cause)), "{:?}", record.cause);
            assert!(record.reason.contains("the arm leans on the table"), "{}", record.reason);
            assert!((after..after + 0.1).contains(&record.sim_seconds), "{}", record.sim_seconds);
        }
        let whole = run_stopping_trial(&bench, condition, f64::INFINITY, NEVER_SILENT).expect("a record");
        assert_ne!(whole.cause, Some(FailureCause::RobotFault));
    }
}

/// A robot that is unreachable for a third of a second keeps its last command, and the trial goes on. One that stays
/// unreachable ends the trial with its own message.
#[test]
fn a_robot_that_cannot_be_reached_is_borne_for_a_while() {
    let mut bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 1, 1, true).expect("the built-in benchmark");
    bench.continues_after_faults = true;
    let of =
        |silent: Range<f64>| run_stopping_trial(&bench, Condition::Blind, f64::INFINITY, silent).expect("a record");
    let (sound, held, lost) = (of(NEVER_SILENT), of(2.0..2.3), of(2.0..f64::INFINITY));
    let late = held.sim_seconds - sound.sim_seconds;
    assert!((0.2..0.4).contains(&late) && held.cause != Some(FailureCause::RobotFault), "{late} s, {:?}", held.cause);
    assert_eq!(lost.cause, Some(FailureCause::RobotFault));
    assert!(lost.reason.contains("no answer"), "{}", lost.reason);
    assert!((2.4..2.7).contains(&lost.sim_seconds), "{}", lost.sim_seconds);
}
