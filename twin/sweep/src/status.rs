//! Progress of a sweep, from its folder.

use std::fs;
use std::time::SystemTime;

use anyhow::Result;

use crate::claim::Claims;
use crate::columns::TableKind;
use crate::folder::{Failure, SweepFolder};

/// Progress of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepStatus {
    /// Number of finished units.
    pub finished: usize,
    /// Number of all units.
    pub total_units: usize,
    /// Number of units in progress.
    pub running: usize,
    /// Units whose last attempt failed.
    pub failed: Vec<(String, Failure)>,
    /// Number of trials of the finished units.
    pub trials: usize,
    /// Number of all trials.
    pub total_trials: usize,
    /// Trials per minute, over the last quarter of an hour in which units were finished.
    pub trials_per_minute: Option<f64>,
    /// Time left at that rate, s.
    pub left_s: Option<f64>,
}

/// Window before the newest finished unit over which the rate is computed, s.
const RATE_WINDOW: f64 = 900.0;

/// Reads the progress from the folder.
pub fn status(folder: &SweepFolder) -> Result<SweepStatus> {
    let finished = folder.finished()?;
    let plan = &folder.plan;
    let failed: Vec<_> = folder.failures()?.into_iter().filter(|(id, _)| !finished.contains(id)).collect();
    let claimed = Claims::all(&folder.path)?;
    let mut times: Vec<(SystemTime, usize)> = Vec::new();
    for unit in plan.units.iter().filter(|unit| finished.contains(&unit.id)) {
        let data = fs::metadata(folder.unit_path(TableKind::Trials, &unit.id));
        times.extend(data.and_then(|data| data.modified()).map(|at| (at, unit.count)));
    }
    times.sort();
    let of_trials = plan.units.iter().map(|unit| unit.count).sum();
    let trials: usize = times.iter().map(|(_, count)| count).sum();
    let trials_per_minute = rate(&times);
    Ok(SweepStatus {
        finished: finished.len(),
        total_units: plan.units.len(),
        running: claimed.iter().filter(|(id, _)| !finished.contains(id)).count(),
        failed,
        trials,
        total_trials: of_trials,
        trials_per_minute,
        left_s: trials_per_minute.filter(|rate| *rate > 0.0).map(|rate| 60.0 * (of_trials - trials) as f64 / rate),
    })
}

/// Returns the trials per minute between the first and the last of the times in the window. The trials of the first one
/// were run before.
fn rate(times: &[(SystemTime, usize)]) -> Option<f64> {
    let (last, _) = times.last()?;
    let age = |at: &SystemTime| last.duration_since(*at).unwrap_or_default().as_secs_f64();
    let recent: Vec<_> = times.iter().filter(|(at, _)| age(at) <= RATE_WINDOW).collect();
    let span = recent.first().map(|(at, _)| age(at)).filter(|span| *span > 0.0)?;
    Some(60.0 * recent[1..].iter().map(|(_, count)| *count as f64).sum::<f64>() / span)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_while() {
        let at = |seconds: u64, count: usize| (SystemTime::UNIX_EPOCH + Duration::from_secs(seconds), count);
        assert_eq!(rate(&[]), None);
        assert_eq!(rate(&[at(5, 10)]), None);
        assert_eq!(rate(&[at(0, 10), at(60, 10), at(120, 20)]), Some(15.0));
        // A preceding pause of a day has no influence.
        assert_eq!(rate(&[at(0, 999), at(86_400, 10), at(86_460, 12)]), Some(12.0));
    }
}
