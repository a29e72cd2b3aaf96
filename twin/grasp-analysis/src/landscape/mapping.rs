//! The ADELM loop: every sampled minimum joins the basin that it reaches over the lowest barrier, or starts a new one.
//! The barriers between basins are then measured with a stronger pull.
//!
//! Results are written to a journal as they are found, one line per minimum and one per basin's barriers. A run resumed
//! from a journal ends as if it had not been interrupted, because every pair has its own random generator.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ftac_platform::DataError;
use ftac_platform::journal::Journal;
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::Landscape;
use super::attraction::{AttractionSettings, lowest_barrier};

/// Parameters of a mapping.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MappingParameters {
    /// Chains that sort minima into basins.
    pub attraction: AttractionSettings,
    /// Largest number of doublings of the pull for barriers between basins.
    pub doublings: u32,
    /// Number of nearest basins to which each basin's barriers are measured.
    pub neighbors: usize,
    pub seed: u64,
    /// Description of the landscape. A journal with another one is refused.
    pub subject: String,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Basin<S> {
    /// Lowest minimum of the basin.
    pub minimum: S,
    /// Energy of that minimum.
    pub energy: f64,
    /// Indices of the samples in the basin.
    pub members: Vec<usize>,
}

/// A line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum JournalLine<S> {
    /// First line.
    Plan(MappingParameters),
    /// Minimum of sample `n`, and the basins it reaches with their barriers.
    Minimum { n: usize, state: S, reached: Vec<(usize, f64)> },
    /// Barriers from basin `n`.
    Barriers { n: usize, found: Vec<(usize, f64)> },
}

#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// File that cannot be read or written, or with a line that does not belong to a journal.
    #[error(transparent)]
    Data(#[from] DataError),
    /// Invalid line.
    #[error("{path}:{line}: {message}")]
    InvalidLine {
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Description of the error.
        message: String,
    },
    /// Journal of another run.
    #[error("{path}: found a journal of {found}, expected {expected}; give another folder or remove it")]
    OtherRun {
        path: PathBuf,
        /// Parameters of the journal.
        found: String,
        /// Parameters of this run.
        expected: String,
    },
}

/// A mapping in progress.
#[derive(Debug)]
pub struct Mapping<S> {
    pub parameters: MappingParameters,
    /// Basins in order of discovery.
    pub basins: Vec<Basin<S>>,
    /// Lowest barrier found between two basins, by indices with the smaller one first.
    pub barriers: BTreeMap<(usize, usize), f64>,
    /// Number of samples sorted so far.
    pub sorted: usize,
    /// Number of basins with measured barriers.
    measured: usize,
    journal: Option<Journal>,
}

impl<S: Clone + Send + Sync + Serialize + DeserializeOwned> Mapping<S> {
    /// Creates an empty mapping without a journal.
    pub fn new(plan: MappingParameters) -> Self {
        Self { parameters: plan, basins: Vec::new(), barriers: BTreeMap::new(), sorted: 0, measured: 0, journal: None }
    }

    /// Resumes from the journal at `path`, or starts one. An incomplete last line is dropped. `energy` gives the energy
    /// of a state.
    pub fn resume(plan: MappingParameters, path: &Path, energy: impl Fn(&S) -> f64) -> Result<Self, JournalError> {
        let mut mapping = Self::new(plan);
        let mut journal = Journal::open(path)?;
        let lines = Journal::read(path)?;
        if lines.is_empty() {
            journal.append(&JournalLine::<S>::Plan(mapping.parameters.clone()))?;
        }
        for (number, line) in lines.into_iter().enumerate() {
            let fault = |message: String| JournalError::InvalidLine { path: path.into(), line: number + 1, message };
            match line {
                JournalLine::Plan(plan) if number == 0 && plan == mapping.parameters => {}
                JournalLine::Plan(plan) if number == 0 => {
                    return Err(JournalError::OtherRun {
                        path: path.into(),
                        found: format!("{plan:?}"),
                        expected: format!("{:?}", mapping.parameters),
                    });
                }
                JournalLine::Minimum { n, state, reached } if number > 0 && n == mapping.sorted => {
                    if reached.iter().any(|(basin, _)| *basin >= mapping.basins.len()) {
                        return Err(fault(
                            "reached: found a basin that does not exist yet, expected a known one".into(),
                        ));
                    }
                    let energy = energy(&state);
                    mapping.insert_minimum(state, energy, &reached);
                }
                JournalLine::Barriers { n, found } if n == mapping.measured && n < mapping.basins.len() => {
                    if found.iter().any(|(basin, _)| *basin >= mapping.basins.len()) {
                        return Err(fault("found: found a basin that does not exist, expected a known one".into()));
                    }
                    mapping.insert_barriers(n, &found);
                }
                _ => return Err(fault("found a line out of order, expected the next sample or basin".into())),
            }
        }
        mapping.journal = Some(journal);
        Ok(mapping)
    }

    fn append(&mut self, line: &JournalLine<S>) -> Result<(), JournalError> {
        self.journal.as_mut().map_or(Ok(()), |journal| Ok(journal.append(line)?))
    }

    /// Sorts the next sample's `minimum` into a basin.
    pub fn sort<L: Landscape<State = S>>(&mut self, landscape: &L, minimum: S) -> Result<(), JournalError> {
        let (n, plan) = (self.sorted, &self.parameters);
        let reached: Vec<(usize, f64)> = self
            .basins
            .par_iter()
            .enumerate()
            .filter_map(|(k, basin)| {
                let question = [n as u64, k as u64];
                let found = lowest_barrier(landscape, &minimum, &basin.minimum, &plan.attraction, plan.seed, question);
                found.map(|barrier| (k, barrier))
            })
            .collect();
        self.append(&JournalLine::Minimum { n, state: minimum.clone(), reached: reached.clone() })?;
        let energy = landscape.energy(&minimum);
        self.insert_minimum(minimum, energy, &reached);
        Ok(())
    }

    fn insert_minimum(&mut self, minimum: S, energy: f64, reached: &[(usize, f64)]) {
        let n = self.sorted;
        self.sorted += 1;
        match reached.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
            None => self.basins.push(Basin { minimum, energy, members: vec![n] }),
            Some(&(home, _)) => {
                let basin = &mut self.basins[home];
                basin.members.push(n);
                if energy < basin.energy {
                    (basin.minimum, basin.energy) = (minimum, energy);
                }
            }
        }
        // A sample that reaches two basins connects them.
        for (k, &(a, first)) in reached.iter().enumerate() {
            for &(b, second) in &reached[k + 1..] {
                self.lower_barrier(a, b, first.max(second));
            }
        }
    }

    fn lower_barrier(&mut self, a: usize, b: usize, barrier: f64) {
        let known = self.barriers.entry((a.min(b), a.max(b))).or_insert(barrier);
        *known = known.min(barrier);
    }

    /// Measures the barriers from the next basin to its nearest ones, doubling the pull until a chain arrives. Returns
    /// false when all basins are done.
    pub fn measure<L: Landscape<State = S>>(&mut self, landscape: &L) -> Result<bool, JournalError> {
        let (n, plan) = (self.measured, &self.parameters);
        if n == self.basins.len() {
            return Ok(false);
        }
        let own = &self.basins[n].minimum;
        let mut others: Vec<(f64, usize)> = (0..self.basins.len())
            .filter(|k| *k != n)
            .map(|k| (landscape.distance(own, &self.basins[k].minimum), k))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        others.truncate(plan.neighbors);
        let found: Vec<(usize, f64)> = others
            .par_iter()
            .filter_map(|&(_, k)| {
                (1..=plan.doublings).find_map(|doubling| {
                    let pull = plan.attraction.pull * f64::from(1u32 << doubling);
                    let settings = AttractionSettings { pull, ..plan.attraction };
                    // Distinct from the numbers used for samples.
                    let question = [u64::MAX - n as u64, (k as u64) << 8 | u64::from(doubling)];
                    let barrier =
                        lowest_barrier(landscape, own, &self.basins[k].minimum, &settings, plan.seed, question);
                    barrier.map(|barrier| (k, barrier))
                })
            })
            .collect();
        self.append(&JournalLine::Barriers { n, found: found.clone() })?;
        self.insert_barriers(n, &found);
        Ok(true)
    }

    fn insert_barriers(&mut self, n: usize, found: &[(usize, f64)]) {
        for &(k, barrier) in found {
            self.lower_barrier(n, k, barrier);
        }
        self.measured += 1;
    }

    /// Returns the number of basins with measured barriers.
    pub fn measured(&self) -> usize {
        self.measured
    }

    /// Returns the barriers as a list, each at least the energy of the higher minimum.
    pub fn edges(&self) -> Vec<(usize, usize, f64)> {
        let above = |a: usize, b: usize| self.basins[a].energy.max(self.basins[b].energy);
        self.barriers.iter().map(|(&(a, b), &barrier)| (a, b, barrier.max(above(a, b)))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::disconnectivity::tree;
    use super::super::multi_well::{MultiWell, samples};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn plan(pull: f64) -> MappingParameters {
        MappingParameters {
            attraction: AttractionSettings { pull, temperature: 0.03, near: 0.1, max_idle_steps: 150, chains: 4 },
            doublings: 4,
            neighbors: 3,
            seed: 7,
            subject: "wells".into(),
        }
    }

    fn finish(mut map: Mapping<[f64; 2]>, wells: &MultiWell) -> Mapping<[f64; 2]> {
        let all = samples(wells, 40, &mut ChaCha8Rng::seed_from_u64(5));
        for sample in &all[map.sorted..] {
            map.sort(wells, *sample).expect("no journal to fail");
        }
        while map.measure(wells).expect("no journal to fail") {}
        map
    }

    /// Four basins are found, each with all samples of its well, and the tree joins them at the exact barriers.
    #[test]
    fn four_wells_and_their_exact_tree() {
        let wells = MultiWell::uneven();
        let map = finish(Mapping::new(plan(0.6)), &wells);
        assert_eq!(map.basins.len(), 4);
        assert_eq!(map.basins.iter().map(|basin| basin.members.len()).sum::<usize>(), 40);
        let energies: Vec<f64> = map.basins.iter().map(|basin| basin.energy).collect();
        let found = tree(&energies, &map.edges());
        let at = |k: usize| map.basins[k].minimum.map(f64::round);
        for (a, b) in (0..4).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let (joined, exact) = (found.minimax(a, b).expect("joined"), wells.barrier(at(a), at(b)));
            // A warm chain crosses slightly above the saddle, and below it only by the discretisation of its steps.
            assert!(joined > exact - 0.03 && joined < exact + 0.15, "{:?} {:?}: {joined} {exact}", at(a), at(b));
            assert!((energies[a] - wells.energy(&at(a))).abs() < 0.01);
        }
    }

    /// A strong pull leaves one basin. A weak one leaves one per well.
    #[test]
    fn basins_over_pull() {
        let wells = MultiWell::uneven();
        assert_eq!(finish(Mapping::new(plan(8.0)), &wells).basins.len(), 1);
        assert_eq!(finish(Mapping::new(plan(0.4)), &wells).basins.len(), 4);
    }

    /// A run interrupted anywhere, even within a line, resumes to the same result.
    #[test]
    fn an_interrupted_run_loses_nothing() {
        let wells = MultiWell::uneven();
        let folder = std::env::temp_dir().join(format!("study-journal-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("journal.jsonl");
        let _ = std::fs::remove_file(&path);
        let open = |plan| Mapping::resume(plan, &path, |state| wells.energy(state));
        let whole = finish(open(plan(0.6)).expect("new"), &wells);
        let text = std::fs::read_to_string(&path).expect("written");
        for cut in [text.len() / 3, text.len() / 2 + 7, text.len() - 3] {
            std::fs::write(&path, &text[..cut]).expect("cut");
            let again = finish(open(plan(0.6)).expect("goes on"), &wells);
            assert_eq!((&again.basins, &again.barriers), (&whole.basins, &whole.barriers), "cut at {cut}");
            assert_eq!(std::fs::read_to_string(&path).expect("written"), text);
        }
        let other = open(plan(0.7)).expect_err("another plan").to_string();
        assert!(other.contains("journal.jsonl") && other.contains("0.7"), "{other}");
        std::fs::write(&path, text.replacen("\"reached\":[]", "\"reached\":[[9,1.0]]", 1)).expect("spoilt");
        let spoilt = open(plan(0.6)).expect_err("no such basin").to_string();
        assert!(spoilt.contains("journal.jsonl:2"), "{spoilt}");
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
