//! Steps of a trial as arrays.

use bench::trial::step_recorder::{LearnerStart, RecordedSteps};
use control::action::TICKS_PER_STEP;
use external_policy::message::{arm_rows, servo_rows};
use numpy::ndarray::{Array2, Array3, Array5};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{array_of_rows, pictures, pose_row, value_error};

/// Returns the steps of a trial: the question at its beginning (`reset`, JSON), `detected`, images of the untouched pads,
/// and for each step the measurements (`time`, `servos`, `arm`, `palm`, `tactile`) and the set-points of its ticks
/// (`arm_goals`, `palm_goals`, `tensions`, `oppositions`). Images have `side` pixels.
pub fn steps_dict(py: Python<'_>, recorded: RecordedSteps, side: usize) -> PyResult<Bound<'_, PyDict>> {
    let RecordedSteps { start: LearnerStart { reset, detected, pictures: untouched, .. }, steps, images } = recorded;
    let count = steps.len();
    // A trial may end within a step; its last set-points then hold until the end of the step.
    let point = |step: usize, tick: usize| {
        let points = &steps[step].set_points;
        &points[tick.min(points.len() - 1)]
    };
    if let Some(empty) = steps.iter().position(|step| step.set_points.is_empty()) {
        return Err(value_error(format!("step {empty}: found no command, expected at least one")));
    }
    let servos: Vec<_> = steps.iter().map(|step| servo_rows(&step.servos)).collect();
    let arms: Vec<_> = steps.iter().map(|step| arm_rows(&step.arm)).collect();
    let (actuators, joints) = (servos.first().map_or(0, Vec::len), arms.first().map_or(0, Vec::len));
    let digits = steps.first().map_or(0, |step| step.set_points[0].tensions.len());
    let all = PyDict::new(py);
    all.set_item("reset", reset.to_string())?;
    all.set_item("detected", array_of_rows(py, detected.iter().map(pose_row)))?;
    all.set_item("time", PyArray1::from_iter(py, steps.iter().map(|step| step.time)))?;
    all.set_item("palm", array_of_rows(py, steps.iter().map(|step| pose_row(&step.palm))))?;
    let table = |shape, of: &dyn Fn((usize, usize, usize)) -> f64| Array3::from_shape_fn(shape, of).into_pyarray(py);
    let ticks = TICKS_PER_STEP;
    all.set_item("servos", table((count, actuators, 3), &|(n, servo, of)| servos[n][servo][of]))?;
    all.set_item("arm", table((count, joints, 3), &|(n, joint, of)| arms[n][joint][of]))?;
    all.set_item("arm_goals", table((count, ticks, joints), &|(n, tick, joint)| point(n, tick).arm[joint]))?;
    all.set_item("palm_goals", table((count, ticks, 7), &|(n, tick, of)| pose_row(&point(n, tick).palm)[of]))?;
    all.set_item("tensions", table((count, ticks, digits), &|(n, tick, digit)| point(n, tick).tensions[digit]))?;
    let oppositions = Array2::from_shape_fn((count, ticks), |(n, tick)| point(n, tick).opposition);
    all.set_item("oppositions", oppositions.into_pyarray(py))?;
    let pads = untouched.times().len();
    all.set_item("untouched", pictures(py, pads, side, untouched.rgb().to_vec())?)?;
    let images = Array5::from_shape_vec((count, pads, side, side, 3), images).map_err(value_error)?;
    all.set_item("tactile", images.into_pyarray(py))?;
    Ok(all)
}
