//! The film of a run's first trial, which its report shows.

use std::path::Path;

use anyhow::Result;
use ftac_platform::data::write_atomically;
use report::film::Film;
use scenarios::record::Condition;

use crate::journal::{RunRequest, WorkUnit};
use crate::trial::Bench;
use crate::trial::filming::{self, COMPARED_CONDITIONS, Filming};

/// True for the trial that is filmed.
pub fn is_filmed(unit: WorkUnit) -> bool {
    unit.combination == 0 && unit.trial == Some(0)
}

/// Returns a watcher for each condition of the film: those compared if `request` runs them, else `shown`.
pub fn cameras(bench: &Bench, request: &RunRequest, shown: Condition) -> Vec<Filming> {
    let run = request.noisy_conditions();
    let compared = COMPARED_CONDITIONS.iter().all(|condition| run.contains(condition));
    let conditions = if compared { COMPARED_CONDITIONS.to_vec() } else { vec![shown] };
    conditions.into_iter().map(|condition| Filming::for_animation(bench, condition)).collect()
}

/// Writes the film into the result folder; none if a trial ended before its first frame.
pub fn write(bench: &Bench, unit: WorkUnit, cameras: Vec<Filming>, folder: &Path) -> Result<()> {
    let films: Vec<Film> = cameras.into_iter().map(|camera| camera.film).collect();
    if films.iter().any(|film| film.frames.is_empty()) {
        return Ok(());
    }
    let animation = filming::film_stage(bench, unit.combination)?.animation(&films, true)?;
    Ok(write_atomically(&report::pictures::film_file(folder), &animation)?)
}
