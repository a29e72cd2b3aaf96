//! A session that ends in a failed look replays to the same failure, also in the middle of a trial.

use hand_model::RobotModel;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use control::percept::Sighted;
use hand_model::robot::RobotBackend;
use robot_backends::replayed::ReplaySource;
use robot_backends::{BodySource, Glance, LookFailed, Task, TrialBody, TrialSetup};
use robot_session_log::{Reader, Replay, Session, Sizes};
use scenarios::Scenario;
use scenarios::record::Condition;
use sim::SimulatedRobot;
use sim::robot::Truth;

const WHY: &str = "--eyes unix:/eyes: lemon: found nothing, expected a measurement of it within 3 s";

/// The simulated robot with failed eyes.
struct Blinded(SimulatedRobot);

impl TrialBody for Blinded {
    fn robot(&self) -> &dyn RobotBackend {
        &self.0
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.0
    }

    fn truth(&self) -> Option<Truth> {
        Some(self.0.truth())
    }

    fn look(&mut self, _: &Glance) -> Result<Option<Sighted>> {
        bail!(WHY)
    }
}

struct Source<'a>(&'a Path);

impl BodySource for Source<'_> {
    fn open(&mut self, _: &TrialSetup, robot: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        Ok(Box::new(Blinded(robot)))
    }

    fn session(&self, _: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(Some((self.0.to_owned(), Session::default())))
    }
}

#[test]
fn a_session_that_ends_in_a_failed_look_replays() {
    let folder = tempfile::tempdir().expect("a folder");
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 4, 1, true).expect("the built-in benchmark");
    let mut ended = 0;
    for combination in 0..4 {
        let file = folder.path().join(format!("{combination}.mcap"));
        let task = Task::new("sim", 1, [combination, 0, 4], Condition::Reflex);
        // Trials without a second look do not count.
        let Err(error) = bench.play(&task, &mut Source(&file), &mut NoWatcher) else { continue };
        assert!(error.chain().any(|cause| cause.to_string().contains(WHY)), "{error:#}");
        ended += 1;
        let replay =
            Replay::new(Reader::open(&file, Sizes::of(&RobotModel::ftac_gen3())).expect("whole")).expect("readable");
        let (mut source, report) = ReplaySource::new(replay, false);
        let again = bench.play(&task, &mut source, &mut NoWatcher).expect_err("the same failure");
        let failed = again.chain().find_map(|cause| cause.downcast_ref::<LookFailed>());
        assert_eq!(failed.map(|failed| failed.0.as_str()), Some(WHY), "{again:#}");
        assert_eq!(format!("{again:#}"), format!("{error:#}"));
        let (progress, divergence) = report.take().expect("played");
        assert_eq!(divergence, None);
        assert!(progress.commands > 100, "{progress:?}");
    }
    assert!(ended > 0, "no trial looked again");
}
