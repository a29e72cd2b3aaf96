//! The built-in grasps as JSON text: the package makes arrays of them.

use pyo3::prelude::*;

use crate::arrays::{failure, value_error};
use crate::threads::detach;

/// Returns the benchmark's grasps by object.
#[pyfunction]
pub fn repertoire(py: Python<'_>) -> PyResult<String> {
    detach(py, || {
        let repertoire = grasp_verification::builtin::repertoire().map_err(|error| failure(&error))?;
        serde_json::to_string(&repertoire.grasps).map_err(value_error)
    })?
}

/// Returns the synthesized grasps, object by object.
#[pyfunction]
pub fn collection(py: Python<'_>) -> PyResult<String> {
    detach(py, || {
        let collection = grasp_verification::synthesis::grasp_file::built_in().map_err(|error| failure(&error))?;
        let grasps: Vec<_> = collection.objects.into_iter().flat_map(|object| object.grasps).collect();
        serde_json::to_string(&grasps).map_err(value_error)
    })?
}
