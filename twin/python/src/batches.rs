//! Batches of episodes: steps, and tactile images, on several threads.

use std::sync::Mutex;

use bench::workers;
use numpy::ndarray::Array5;
use numpy::{IntoPyArray, PyArray5};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::arrays::{failure, value_error};
use crate::pickling::SteppedScene;
use crate::scene::{ActionArguments, Episode, JudgementTuple, action, lock_stepped, step_and_judge};
use crate::threads::Threads;

/// Steps a batch of episodes on `jobs` threads. If one action is refused, no episode is stepped.
#[pyfunction]
pub fn step_all(
    py: Python<'_>,
    episodes: Vec<Py<Episode>>,
    actions: Vec<ActionArguments<'_>>,
    jobs: usize,
) -> PyResult<Vec<JudgementTuple>> {
    if actions.len() != episodes.len() {
        return Err(value_error(format!("actions: found {}, expected {}", actions.len(), episodes.len())));
    }
    let actions = actions.into_iter().map(action).collect::<PyResult<Vec<_>>>()?;
    let mut guards = episodes.iter().map(|episode| lock_stepped(&episode.get().0)).collect::<PyResult<Vec<_>>>()?;
    let mut work = Vec::with_capacity(guards.len());
    for (number, (guard, action)) in guards.iter_mut().zip(actions).enumerate() {
        let refused = |error| value_error(format!("environment {number}: {error}"));
        guard.scene.scene.limits().check(&action).map_err(refused)?;
        let stepped: &mut SteppedScene<_, _> = guard;
        work.push(Mutex::new((stepped, Some(action), None)));
    }
    let threads = Threads::of_process()?;
    let done = py.detach(|| {
        workers::for_each(jobs, &work, |_, item| {
            let mut item = item.lock().map_err(|_| anyhow::anyhow!("a step failed half-way"))?;
            let (stepped, action, judgement) = &mut *item;
            *judgement = action.take().map(|action| threads.run(|| step_and_judge(stepped, action))).transpose()?;
            Ok(())
        })
    });
    done.map_err(|error| failure(&error))?;
    let judgement =
        |item: Mutex<(_, _, Option<JudgementTuple>)>| item.into_inner().ok().and_then(|(_, _, judged)| judged);
    let missing = || PyRuntimeError::new_err("a step failed half-way: make new environments");
    work.into_iter().map(|item| judgement(item).ok_or_else(missing)).collect()
}

/// Returns the newest tactile images of a batch of episodes of one size, episodes x pads x rows x columns x RGB, copied on
/// `jobs` threads; with `change`, half of their differences from the untouched pads, and 128 where nothing has changed.
#[pyfunction]
pub fn tactile_of_all<'py>(
    py: Python<'py>,
    episodes: Vec<Py<Episode>>,
    change: bool,
    jobs: usize,
) -> PyResult<Bound<'py, PyArray5<u8>>> {
    let guards = episodes.iter().map(|episode| lock_stepped(&episode.get().0)).collect::<PyResult<Vec<_>>>()?;
    let none = || value_error("tactile: found an episode without images, expected one with images");
    let mut sources = Vec::with_capacity(guards.len());
    for guard in &guards {
        let scene = &guard.scene.scene;
        sources.push((scene.images().ok_or_else(none)?, scene.untouched().ok_or_else(none)?));
    }
    let (side, pads) = sources.first().map_or((0, 0), |(images, _)| (images.side(), images.times().len()));
    let size = pads * side * side * 3;
    if let Some((images, _)) = sources.iter().find(|(images, _)| images.rgb().len() != size) {
        return Err(value_error(format!(
            "tactile: found {} bytes, expected {size} as in the first",
            images.rgb().len()
        )));
    }
    let mut all = vec![0; sources.len() * size];
    let work: Vec<Mutex<_>> = all.chunks_exact_mut(size.max(1)).zip(sources).map(Mutex::new).collect();
    let done = py.detach(|| {
        workers::for_each(jobs, &work, |_, item| {
            let mut item = item.lock().map_err(|_| anyhow::anyhow!("a copy failed half-way"))?;
            let (to, (images, untouched)) = &mut *item;
            if change {
                let pairs = images.rgb().iter().zip(untouched.rgb());
                // Rounded down, as in `ftac.features`: 0 to 255.
                let half = |(now, before): (&u8, &u8)| (128 + ((i16::from(*now) - i16::from(*before)) >> 1)) as u8;
                to.iter_mut().zip(pairs).for_each(|(to, pair)| *to = half(pair));
            } else {
                to.copy_from_slice(images.rgb());
            }
            Ok(())
        })
    });
    done.map_err(|error| failure(&error))?;
    drop(work);
    Ok(Array5::from_shape_vec((guards.len(), pads, side, side, 3), all).map_err(value_error)?.into_pyarray(py))
}
