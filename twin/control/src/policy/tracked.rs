//! An object as a policy has seen and tried it so far.

use std::collections::BTreeMap;

use super::{Knowledge, PolicyError};
use crate::executor::Executor;
use crate::odds::Belief;
use crate::percept::{Eyes, Looked, Percept};
use crate::uncertainty::Uncertainty;
use crate::worth;

/// Looks at an object and failed tries.
pub struct Tracked {
    /// Number of the object in the trial.
    object: usize,
    /// Number of looks over which its position is averaged.
    pub looks: u32,
    /// Standard deviation stated by the latest look, m.
    sighted: Option<f64>,
    /// Belief about the error of its position since it was touched; `None` if it was only seen.
    pub located: Option<Belief>,
    /// True if it was hidden when it was last looked for.
    pub hidden: bool,
    /// Number of failures of each grasp, by the grasp's number.
    failures: BTreeMap<u32, i32>,
}

impl Tracked {
    /// Records for all objects of a trial, each of which was looked at once.
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

    /// Expected errors of its seen position and of the arm.
    pub fn uncertainty(&self, knowledge: &Knowledge) -> Uncertainty {
        knowledge.uncertainty.stated(self.sighted)
    }

    /// Looks at the object again; `None` if it is hidden.
    pub fn look(&mut self, knowledge: &Knowledge, eyes: &mut dyn Eyes) -> Result<Option<Percept>, PolicyError> {
        let Some(sighted) = eyes.look(self.object)? else { return Ok(None) };
        self.sighted = sighted.sigma;
        Ok(Some(Percept::of(&knowledge.objects[self.object], &sighted.pose)))
    }

    /// Replaces the percept by `seen`, because something may have moved the object since the previous looks; `None` if
    /// it is hidden.
    pub fn replace(&mut self, seen: Option<Percept>, executor: &mut Executor) {
        self.hidden = seen.is_none();
        if let Some(seen) = seen {
            executor.see(self.object, seen);
            (self.looks, self.located) = (1, None);
        }
    }

    /// Adds the look `seen` of an object that nothing has moved: its position is the mean of all looks that agree.
    pub fn refine(&mut self, seen: Percept, knowledge: &Knowledge, executor: &mut Executor) {
        let known = Looked { mean: executor.target(self.object).percept, looks: self.looks };
        let Looked { mean, looks } = known.again(seen, self.uncertainty(knowledge).fresh_look());
        executor.see(self.object, mean);
        self.looks = looks;
    }

    /// Counts a failure of a grasp of this object.
    pub fn failed(&mut self, grasp: u32) {
        *self.failures.entry(grasp).or_default() += 1;
    }

    /// Factor on a grasp's worth after its failures.
    pub fn trust(&self, grasp: u32) -> f64 {
        worth::FAILED.powi(self.failures.get(&grasp).copied().unwrap_or(0))
    }
}
