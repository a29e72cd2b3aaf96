//! Viewer recordings of injections.

use anyhow::Result;
use bench::recording::{Began, Recording};
use control::executor::Phase;
use robot_backends::Task;
use scenarios::record::Condition;
use telemetry::recorder::Target;

use super::Matrix;
use super::kind::Kind;

impl Matrix<'_> {
    /// Opens the recording of an injection, if one was asked for.
    pub(super) fn watcher(&self, kind: Kind, phase: Phase, round: usize) -> Result<Option<Recording>> {
        let file = self.record.as_ref().map(|folder| {
            let name = format!("{}_{}_{round}.rrd", phase.name(), kind.name());
            Target::File(
                folder.join(name.replace(|letter: char| !letter.is_ascii_alphanumeric() && letter != '.', "_")),
            )
        });
        let targets: Vec<Target> = file.into_iter().chain(self.live.then_some(Target::Spawn)).collect();
        if targets.is_empty() {
            return Ok(None);
        }
        let combos = self.bench.plans.plans.len();
        let task = Task {
            watched: true,
            scenario: scenarios::scenario::BENCHMARK.to_owned(),
            ..Task::new("emulated", self.seed, [round % combos, round, combos], Condition::Ideal)
        };
        Recording::open(&targets, self.bench, &task, (Began::Now, false)).map(Some)
    }
}
