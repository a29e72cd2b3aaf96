//! A trial whose body stops: none where somebody has to see to the robot, a failed one where others follow.

use std::path::PathBuf;

use anyhow::Result;
use bench::body::{BodySource, Glance, Places, Stopped, Task, TrialBody, TrialSetup};
use bench::builtin::make_bench;
use bench::trial::{Bench, NoWatcher};
use control::percept::Sighted;
use hand_model::robot::RobotBackend;
use scenarios::record::{Condition, TrialRecord};
use scenarios::{FailureCause, Scenario};
use session_log::Session;
use sim::SimulatedRobot;
use sim::robot::Truth;

/// The simulated robot, which stops after some time (s).
struct Stopping {
    robot: SimulatedRobot,
    after: f64,
}

impl TrialBody for Stopping {
    fn robot(&self) -> &dyn RobotBackend {
        &self.robot
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.robot
    }

    fn truth(&self) -> Option<Truth> {
        Some(self.robot.truth())
    }

    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        TrialBody::look(&mut self.robot, glance)
    }

    fn stopped(&self) -> Option<String> {
        (self.robot.truth().time >= self.after).then(|| "fault: the arm leans on the table".to_owned())
    }
}

struct Source {
    after: f64,
}

impl BodySource for Source {
    fn open(&mut self, _setup: &TrialSetup, robot: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        Ok(Box::new(Stopping { robot, after: self.after }))
    }

    fn session(&self, _task: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(None)
    }
}

fn play(bench: &Bench, condition: Condition, after: f64) -> Result<TrialRecord> {
    let task = Task {
        robot: "sim".to_owned(),
        seed: 1,
        combination: 0,
        trial: 0,
        condition,
        watched: false,
        combos: 1,
        scenario: String::new(),
        individual: None,
        pads: None,
        foresees: false,
        mirrored: false,
        places: Places::default(),
    };
    Ok(bench.play(&task, &mut Source { after }, &mut NoWatcher)?.record)
}

#[test]
fn a_trial_whose_body_stops_is_none_or_has_failed() {
    let mut bench = make_bench(Scenario::benchmark(), 1, 1, true).expect("the built-in benchmark");
    for condition in [Condition::Blind, Condition::Touch] {
        bench.outlasts_faults = false;
        let error = play(&bench, condition, 2.0).expect_err("stopped");
        assert!(error.downcast_ref::<Stopped>().is_some_and(|why| why.0.contains("leans")), "{error:#}");
        bench.outlasts_faults = true;
        // What was dropped before counts first.
        let causes =
            [(2.0, vec![FailureCause::RobotFault]), (9.0, vec![FailureCause::RobotFault, FailureCause::FirstDropped])];
        for (after, causes) in causes {
            let record = play(&bench, condition, after).expect("a record");
            assert!(!record.success && record.cause.is_some_and(|cause| causes.contains(&cause)), "{:?}", record.cause);
            assert!(record.reason.contains("the arm leans on the table"), "{}", record.reason);
            assert!((after..after + 0.1).contains(&record.sim_seconds), "{}", record.sim_seconds);
        }
        let whole = play(&bench, condition, f64::INFINITY).expect("a record");
        assert_ne!(whole.cause, Some(FailureCause::RobotFault));
    }
}
