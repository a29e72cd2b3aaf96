//! A session that ends in a failed detection replays to the same failure, also in the middle of a trial.

use hand_model::RobotModel;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use control::detection::PoseDetection;
use hand_model::robot::RobotBackend;
use robot_backends::replay::ReplayFactory;
use robot_backends::{BackendFactory, Detection, DetectionFailed, TrialBackend, TrialSetup, TrialTask};
use robot_session_log::{Replay, RobotSizes, SessionHeader, SessionReader};
use scenarios::Scenario;
use scenarios::record::Condition;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

const FAILURE_MESSAGE: &str = "--detector unix:/eyes: lemon: found nothing, expected a measurement of it within 3 s";

/// The simulated robot with a failed object detector.
struct FailedDetector(SimulatedRobot);

impl TrialBackend for FailedDetector {
    fn robot(&self) -> &dyn RobotBackend {
        &self.0
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.0
    }

    fn truth(&self) -> Option<GroundTruth> {
        Some(self.0.truth())
    }

    fn detect(&mut self, _: &Detection) -> Result<Option<PoseDetection>> {
        bail!(FAILURE_MESSAGE)
    }
}

struct FailedDetectorFactory<'a>(&'a Path);

impl BackendFactory for FailedDetectorFactory<'_> {
    fn open(&mut self, _: &TrialSetup, robot: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        Ok(Box::new(FailedDetector(robot)))
    }

    fn session(&self, _: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(Some((self.0.to_owned(), SessionHeader::default())))
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
        let task = TrialTask::new("sim", 1, [combination, 0, 4], Condition::Reflex);
        // Trials without a second detection do not count.
        let Err(error) = bench.run(&task, &mut FailedDetectorFactory(&file), &mut NoWatcher) else { continue };
        assert!(error.chain().any(|cause| cause.to_string().contains(FAILURE_MESSAGE)), "{error:#}");
        ended += 1;
        let replay =
            Replay::new(SessionReader::open(&file, RobotSizes::from_robot(&RobotModel::ftac_gen3())).expect("whole"))
                .expect("readable");
        let (mut source, report) = ReplayFactory::new(replay, false);
        let again = bench.run(&task, &mut source, &mut NoWatcher).expect_err("the same failure");
        let failed = again.chain().find_map(|cause| cause.downcast_ref::<DetectionFailed>());
        assert_eq!(failed.map(|failed| failed.0.as_str()), Some(FAILURE_MESSAGE), "{again:#}");
        assert_eq!(format!("{again:#}"), format!("{error:#}"));
        let (progress, fault) = report.take().expect("run");
        assert_eq!(fault, None);
        assert!(progress.commands > 100, "{progress:?}");
    }
    assert!(ended > 0, "no trial detected objects again");
}
