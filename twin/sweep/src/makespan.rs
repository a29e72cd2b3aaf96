//! Predicted duration (makespan) of a sweep on more cores: a replay of its units' recorded times.
//!
//! Free workers take the units in the plan's order. A worker needs `start_s` before its first unit. The file system
//! serves one operation after the other at a given rate. If the workers together request more, units end later by the
//! excess. The times are those recorded during the run of the units. Cores that share memory channels are slower
//! together; the replay does not model this.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use schemars::JsonSchema;
use serde::Serialize;

/// Assumptions of the replay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Assumptions {
    /// Delay before a worker's first unit: its place in the queue and the program's start, s.
    pub start_s: f64,
    /// Number of metadata operations of the file system per unit: claims, temporary files, renames.
    pub operations: f64,
    /// Rate at which the file system serves them, all workers together, 1/s.
    pub operations_per_s: f64,
    /// Number of these operations per worker and unit of the plan in the search for open units.
    pub looks: f64,
}

impl Assumptions {
    /// Typical values: a small NFS server, and workers that start within seconds.
    pub const TYPICAL: Self = Self { start_s: 10.0, operations: 16.0, operations_per_s: 500.0, looks: 0.01 };
}

/// Result of a replay on a number of cores.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct MakespanPoint {
    pub cores: usize,
    /// Time until the last unit is finished, s.
    pub makespan_s: f64,
    /// Time of the units over cores x makespan, 0 to 1.
    pub efficiency: f64,
    /// Mean rate of file system operations, 1/s.
    pub operations_per_s: f64,
    /// Share of the makespan in which some core has nothing left to do.
    pub tail: f64,
}

/// Replays units of these times (s), in order, on `cores`.
pub fn replay(units: &[f64], cores: usize, assumed: &Assumptions) -> MakespanPoint {
    // Times in integer microseconds, because these have a total order.
    let whole = |seconds: f64| (1e6 * seconds.max(0.0)) as u64;
    let cores = cores.max(1);
    let look = assumed.looks * units.len() as f64;
    let served = 1.0 / assumed.operations_per_s;
    // The server's own time: it has served all earlier requests by then.
    let mut server = 0.0_f64;
    let mut free: BinaryHeap<Reverse<u64>> = (0..cores).map(|_| Reverse(whole(assumed.start_s))).collect();
    let mut operations = 0.0;
    let mut ask = |at: f64, count: f64| {
        operations += count;
        server = server.max(at) + count * served;
        server
    };
    // Each worker reads the folder once at its start.
    free = free.into_iter().map(|Reverse(at)| Reverse(whole(ask(at as f64 / 1e6, look)))).collect();
    let (mut last, mut first_idle) = (0, u64::MAX);
    for seconds in units {
        let Some(Reverse(at)) = free.pop() else { break };
        let end = whole(ask(at as f64 / 1e6, assumed.operations) + seconds);
        last = last.max(end);
        free.push(Reverse(end));
    }
    if let Some(Reverse(at)) = free.peek() {
        first_idle = first_idle.min(*at);
    }
    let makespan_s = last as f64 / 1e6;
    let work: f64 = units.iter().sum();
    MakespanPoint {
        cores,
        makespan_s,
        efficiency: work / (cores as f64 * makespan_s).max(1e-9),
        operations_per_s: operations / makespan_s.max(1e-9),
        tail: (last.saturating_sub(first_idle)) as f64 / (last as f64).max(1.0),
    }
}

/// Numbers of cores in the report.
pub const CORE_COUNTS: [usize; 10] = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

#[cfg(test)]
mod tests {
    use super::*;

    const NO_OVERHEAD: Assumptions = Assumptions { start_s: 0.0, operations: 0.0, operations_per_s: 1.0, looks: 0.0 };

    #[test]
    fn equal_units_divide_evenly_until_there_are_too_few() {
        let units = [100.0; 60];
        for (cores, makespan) in [(1, 6000.0), (2, 3000.0), (7, 900.0), (60, 100.0), (1000, 100.0)] {
            let point = replay(&units, cores, &NO_OVERHEAD);
            assert!((point.makespan_s - makespan).abs() < 1e-6, "{cores}: {point:?}");
            assert!((point.efficiency - 6000.0 / (cores as f64 * makespan)).abs() < 1e-9);
        }
    }

    /// Graham's bound of list scheduling: work / cores + the longest unit.
    #[test]
    fn no_replay_is_longer_than_the_bound() {
        let units: Vec<f64> = (0..200).map(|n| f64::from(n * 7919 % 101) + 1.0).collect();
        let work: f64 = units.iter().sum();
        for cores in 1..50 {
            let makespan = replay(&units, cores, &NO_OVERHEAD).makespan_s;
            assert!(makespan <= work / cores as f64 + 101.0 + 1e-3 && makespan >= work / cores as f64 - 1e-3);
        }
    }

    /// 100 units of 1 s and 10 operations each cannot end before the server has done 1000 operations.
    #[test]
    fn the_file_system_is_a_limit() {
        let assumed = Assumptions { operations: 10.0, operations_per_s: 20.0, ..NO_OVERHEAD };
        let point = replay(&[1.0; 100], 1000, &assumed);
        assert!((point.makespan_s - 51.0).abs() < 1e-3, "{point:?}");
    }
}
