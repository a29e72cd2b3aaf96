//! Photometric stereo: from a tactile image to heights and slopes.

use std::sync::{Arc, LazyLock};

use bench::builtin::builtin_calibration;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use numpy::{PyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tactile_perception::colour_change::StereoOptions;
use tactile_perception::photometric_stereo::gradients;
use tactile_perception::poisson::{PoissonSolver, rest_level};
use tactile_perception::{PIXELS, PhotometricCalibration};

use crate::arrays::{failure, map, value_error};
use crate::hand::HAND;
use crate::threads::detach;

/// The built-in calibration, or the error of reading it.
static CALIBRATION: LazyLock<Result<PhotometricCalibration, anyhow::Error>> = LazyLock::new(builtin_calibration);

/// Indentation (m) and its slopes along x and y of the pad, at every pixel.
type Heights<'py> = [Bound<'py, PyArray2<f32>>; 3];

/// Reconstructs indentation and slopes from a camera's image and its background.
#[pyfunction]
pub fn heights<'py>(
    py: Python<'py>,
    camera: usize,
    image: PyReadonlyArray3<'py, u8>,
    background: PyReadonlyArray3<'py, u8>,
) -> PyResult<Heights<'py>> {
    let count = HAND.cameras.len();
    let view = HAND
        .cameras
        .get(camera)
        .ok_or_else(|| value_error(format!("camera: found {camera}, expected 0 to {}", count - 1)))?;
    let (image, background) = (pixels("image", &image)?, pixels("background", &background)?);
    let found = detach(py, || -> PyResult<_> {
        let calibration = CALIBRATION.as_ref().map_err(failure)?;
        let model = calibration.model(HAND.pads[view.pad].configuration).map_err(value_error)?;
        let Some(slopes) = gradients(&image, &background, model, &StereoOptions::default()) else {
            return Ok([const { Vec::new() }; 3].map(|_: Vec<f32>| vec![0.0; PIXELS]));
        };
        let mut height = PoissonSolver::new().solve(&slopes.gx, &slopes.gy, view.pixel_size());
        let level = rest_level(&height, slopes.region);
        height.iter_mut().for_each(|value| *value -= level);
        Ok([height, slopes.gx, slopes.gy])
    })??;
    let [height, gx, gy] = found;
    Ok([map(py, IMAGE_SIZE, height)?, map(py, IMAGE_SIZE, gx)?, map(py, IMAGE_SIZE, gy)?])
}

fn pixels(what: &str, image: &PyReadonlyArray3<u8>) -> PyResult<Arc<TactileImage>> {
    if image.shape() != [IMAGE_SIZE, IMAGE_SIZE, 3] {
        let shape = image.shape();
        return Err(value_error(format!("{what}: found shape {shape:?}, expected ({IMAGE_SIZE}, {IMAGE_SIZE}, 3)")));
    }
    Ok(Arc::new(TactileImage { rgb: image.as_slice().map_err(value_error)?.to_vec() }))
}
