//! Injections for the viewer.

use anyhow::Result;
use bench::body::{Places, Task};
use bench::recording::{Began, Recording};
use control::executive::Phase;
use scenarios::record::Condition;
use stream::recorder::Target;

use super::Matrix;
use super::kind::Kind;

impl Matrix<'_> {
    /// What watches an injection, if anything does.
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
        let task = Task {
            robot: "emulated".to_owned(),
            seed: self.seed,
            combination: round % self.bench.plans.plans.len(),
            trial: round,
            condition: Condition::Ideal,
            watched: true,
            combos: self.bench.plans.plans.len(),
            scenario: scenarios::scenario::BENCHMARK.to_owned(),
            robot_model: None,
            individual: None,
            pads: None,
            foresees: false,
            mirrored: false,
            places: Places::default(),
        };
        Recording::open(&targets, self.bench, &task, (Began::Now, false)).map(Some)
    }
}
