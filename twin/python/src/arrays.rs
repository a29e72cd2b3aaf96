//! Conversion between numpy arrays and the libraries' types.

pub use external_policy::message::pose_row;
use nalgebra::Isometry3;
use numpy::ndarray::{Array2, Array3, Array4};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArray4, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// An array of numbers from the package, which has made it contiguous float64.
pub type Numbers<'py> = PyReadonlyArray1<'py, f64>;

/// Returns a `ValueError`, for bad input.
pub fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Returns a `RuntimeError` with its causes, for all other errors.
pub fn failure(error: &anyhow::Error) -> PyErr {
    PyRuntimeError::new_err(format!("{error:#}"))
}

/// Converts exactly `N` numbers.
pub fn fixed_length<const N: usize>(what: &str, numbers: &Numbers) -> PyResult<[f64; N]> {
    let shape = || value_error(format!("{what}: found {} numbers, expected {N}", numbers.len()));
    numbers.as_slice().map_err(value_error)?.try_into().map_err(|_| shape())
}

/// Converts at most `most` numbers. The callee checks the exact number.
pub fn bounded_length<T: FromIterator<f64>>(what: &str, numbers: &Numbers, most: usize) -> PyResult<T> {
    let found = numbers.as_slice().map_err(value_error)?;
    if found.len() > most {
        return Err(value_error(format!("{what}: found {} numbers, expected at most {most}", found.len())));
    }
    Ok(found.iter().copied().collect())
}

/// Converts exactly `N` finite numbers.
pub fn finite_array<const N: usize>(what: &str, numbers: &Numbers) -> PyResult<[f64; N]> {
    let found: [f64; N] = fixed_length(what, numbers)?;
    match found.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(value_error(format!("{what}[{index}]: found {}, expected a finite number", found[index]))),
        None => Ok(found),
    }
}

/// Returns an n x `N` array.
pub fn array_of_rows<'py, const N: usize>(
    py: Python<'py>,
    rows: impl ExactSizeIterator<Item = [f64; N]>,
) -> Bound<'py, PyArray2<f64>> {
    let mut table = Array2::zeros((rows.len(), N));
    for (mut line, row) in table.outer_iter_mut().zip(rows) {
        line.iter_mut().zip(row).for_each(|(to, from)| *to = from);
    }
    table.into_pyarray(py)
}

/// Returns poses as homogeneous matrices, n x 4 x 4.
pub fn matrices<'py>(py: Python<'py>, poses: &[Isometry3<f64>]) -> Bound<'py, PyArray3<f64>> {
    let mut all = Array3::zeros((poses.len(), 4, 4));
    for (mut to, pose) in all.outer_iter_mut().zip(poses) {
        let matrix = pose.to_homogeneous();
        to.indexed_iter_mut().for_each(|(at, to)| *to = matrix[at]);
    }
    all.into_pyarray(py)
}

/// Returns pictures, count x rows x columns x RGB.
pub fn pictures(py: Python<'_>, count: usize, side: usize, rgb: Vec<u8>) -> PyResult<Bound<'_, PyArray4<u8>>> {
    Ok(Array4::from_shape_vec((count, side, side, 3), rgb).map_err(value_error)?.into_pyarray(py))
}

/// Returns one picture, rows x columns x RGB.
pub fn picture(py: Python<'_>, side: usize, rgb: Vec<u8>) -> PyResult<Bound<'_, PyArray3<u8>>> {
    Ok(Array3::from_shape_vec((side, side, 3), rgb).map_err(value_error)?.into_pyarray(py))
}

/// Returns a map of a picture's pixels, rows x columns.
pub fn map(py: Python<'_>, side: usize, values: Vec<f32>) -> PyResult<Bound<'_, PyArray2<f32>>> {
    Ok(Array2::from_shape_vec((side, side), values).map_err(value_error)?.into_pyarray(py))
}
