//! An object as a policy has seen and tried it so far.

use std::collections::BTreeMap;

use super::{Knowledge, PolicyError};
use crate::executor::Executor;
use crate::odds::Belief;
use crate::percept::{Eyes, Looked, Percept};
use crate::uncertainty::Uncertainty;
use crate::worth;

/// Looks at an object, and tries that failed.
pub struct Tracked {
    /// Number in the trial.
    object: usize,
    /// Looks that its place is the mean of.
    pub looks: u32,
    /// Standard deviation that the latest look states, m.
    sighted: Option<f64>,
    /// Error of its place since it was touched where it stands.
    pub located: Option<Belief>,
    /// It was hidden when it was last looked for.
    pub hidden: bool,
    /// Count of failures of each grasp, by its number.
    failures: BTreeMap<u32, i32>,
}

impl Tracked {
    /// All objects of a trial, each of which was looked at once.
    pub fn all(knowledge: &Knowledge) -> Vec<Self> {
        let one = |object| Self {
            object,
            looks: 1,
            sighted: knowledge.sighted[object],
            located: None,
            hidden: false,
            failures: BTreeMap::new(),
        };
        (0..knowledge.objects.len()).map(one).collect()
    }

    /// The errors that are expected of where it is seen and of the arm that goes there.
    pub fn uncertainty(&self, knowledge: &Knowledge) -> Uncertainty {
        knowledge.uncertainty.stated(self.sighted)
    }

    /// The eyes look at it anew; none if it is hidden.
    pub fn look(&mut self, knowledge: &Knowledge, eyes: &mut dyn Eyes) -> Result<Option<Percept>, PolicyError> {
        let Some(sighted) = eyes.look(self.object)? else { return Ok(None) };
        self.sighted = sighted.sigma;
        Ok(Some(Percept::of(&knowledge.objects[self.object], &sighted.pose)))
    }

    /// It was `seen`, and something may have moved it since the looks before, or it is hidden.
    pub fn replace(&mut self, seen: Option<Percept>, executor: &mut Executor) {
        self.hidden = seen.is_none();
        if let Some(seen) = seen {
            executor.see(self.object, seen);
            (self.looks, self.located) = (1, None);
        }
    }

    /// It was `seen` once more, and nothing has moved it: its place is the mean of all looks that agree.
    pub fn refine(&mut self, seen: Percept, knowledge: &Knowledge, executor: &mut Executor) {
        let known = Looked { mean: executor.target(self.object).percept, looks: self.looks };
        let Looked { mean, looks } = known.again(seen, self.uncertainty(knowledge).fresh_look());
        executor.see(self.object, mean);
        self.looks = looks;
    }

    /// A grasp of it failed.
    pub fn failed(&mut self, grasp: u32) {
        *self.failures.entry(grasp).or_default() += 1;
    }

    /// Factor on a grasp's worth after its failures.
    pub fn trust(&self, grasp: u32) -> f64 {
        worth::FAILED.powi(self.failures.get(&grasp).copied().unwrap_or(0))
    }
}
