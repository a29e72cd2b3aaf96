//! Viewer recordings of injections.

use anyhow::Result;
use bench::recording::{Recording, TimeOrigin};
use control::executor::Phase;
use robot_backends::TrialTask;
use scenarios::record::Condition;
use telemetry::recorder::RecordingTarget;

use super::FaultMatrix;
use super::kind::InjectedFault;

impl FaultMatrix<'_> {
    /// Opens the recording of an injection, if one was requested.
    pub(super) fn open_recording(&self, kind: InjectedFault, phase: Phase, round: usize) -> Result<Option<Recording>> {
        let file = self.record.as_ref().map(|folder| {
            let name = format!("{}_{}_{round}.rrd", phase.name(), kind.name());
            RecordingTarget::File(
                folder.join(name.replace(|letter: char| !letter.is_ascii_alphanumeric() && letter != '.', "_")),
            )
        });
        let targets: Vec<RecordingTarget> =
            file.into_iter().chain(self.live.then_some(RecordingTarget::Spawn)).collect();
        if targets.is_empty() {
            return Ok(None);
        }
        let combos = self.bench.grasp_pairs.pairs.len();
        let task = TrialTask {
            images_throughout: true,
            scenario: scenarios::scenario::BENCHMARK_TOML.to_owned(),
            ..TrialTask::new("emulated", self.seed, [round % combos, round, combos], Condition::Ideal)
        };
        Recording::open(&targets, self.bench, &task, (TimeOrigin::Now, false)).map(Some)
    }
}
