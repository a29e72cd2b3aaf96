//! Tactile images of objects pressed into a pad.

use std::sync::Arc;

use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sim::tactile::unit_seed;
use tactile_optics::{GelFoundation, IndentationMap, Sensor, press};

use crate::arrays::{map, picture, value_error};
use crate::hand::HAND;
use crate::threads::detach;

/// A rendered press: image, indentation depth of the gel (m) at every pixel, force (N).
type RenderedPress<'py> = (Bound<'py, PyArray3<u8>>, Bound<'py, PyArray2<f32>>, f64);

fn camera(index: usize) -> PyResult<(&'static Pad, &'static PadCamera)> {
    let count = HAND.cameras.len();
    let camera = HAND
        .cameras
        .get(index)
        .ok_or_else(|| value_error(format!("camera: found {index}, expected 0 to {}", count - 1)))?;
    Ok((&HAND.pads[camera.pad], camera))
}

/// Returns the sensor of camera `index` of hand unit `unit`, or the nominal one.
fn sensor(index: usize, unit: Option<u64>) -> PyResult<Sensor> {
    let (pad, camera) = camera(index)?;
    Ok(match unit {
        Some(unit) => Sensor::unit(pad, camera, unit_seed(unit, index)),
        None => Sensor::nominal(pad, camera),
    })
}

fn check_positive(what: &str, value: f64, unit: &str) -> PyResult<()> {
    let good = value.is_finite() && value > 0.0;
    if good { Ok(()) } else { Err(value_error(format!("{what}: found {value}, expected more than 0 {unit}"))) }
}

fn render_press<'py>(
    py: Python<'py>,
    index: usize,
    (unit, noise): (Option<u64>, u64),
    pressed: impl FnOnce() -> PyResult<(IndentationMap, f64)> + Send,
) -> PyResult<RenderedPress<'py>> {
    let made = detach(py, || -> PyResult<_> {
        let sensor = sensor(index, unit)?;
        let (indentation, force) = pressed()?;
        let image = sensor.render(&indentation, &mut ChaCha8Rng::seed_from_u64(noise));
        Ok((image.rgb, indentation.to_depths(), force))
    })??;
    Ok((picture(py, IMAGE_SIZE, made.0)?, map(py, IMAGE_SIZE, made.1)?, made.2))
}

/// Renders the image of an untouched pad, without noise.
#[pyfunction]
pub fn background(py: Python<'_>, index: usize, unit: Option<u64>) -> PyResult<Bound<'_, PyArray3<u8>>> {
    let sensor = detach(py, || sensor(index, unit))??;
    picture(py, IMAGE_SIZE, sensor.background().rgb.clone())
}

/// Renders a ball pressed in by a depth (m) or with a force (N).
#[pyfunction]
#[pyo3(signature = (index, radius, depth, force, center, unit, noise))]
#[expect(clippy::too_many_arguments, reason = "the package calls it with names")]
pub fn press_sphere<'py>(
    py: Python<'py>,
    index: usize,
    radius: f64,
    depth: Option<f64>,
    force: Option<f64>,
    center: (f64, f64),
    unit: Option<u64>,
    noise: u64,
) -> PyResult<RenderedPress<'py>> {
    let (pad, camera) = camera(index)?;
    check_positive("radius", radius, "m")?;
    if !(center.0.is_finite() && center.1.is_finite()) {
        return Err(value_error(format!("center: found {center:?}, expected two finite lengths in m")));
    }
    let lowest = move |x: f64, y: f64| {
        let inside = radius * radius - (x - center.0).powi(2) - (y - center.1).powi(2);
        (inside > 0.0).then(|| radius - inside.sqrt())
    };
    match (depth, force) {
        (Some(depth), None) => {
            check_positive("depth", depth, "m")?;
            let most = HAND.gel().thickness;
            if depth > most {
                return Err(value_error(format!(
                    "depth: found {depth} m, expected at most {most} m, the gel's thickness"
                )));
            }
            render_press(py, index, (unit, noise), move || {
                let depths = pixels(camera).map(|(x, y)| {
                    lowest(x, y).map_or(0.0, |lowest| (pad.surface_height(x, y) - (lowest - depth)).max(0.0) as f32)
                });
                let depths: Vec<f32> = depths.collect();
                let gel = GelFoundation::winkler(&HAND.gel());
                let force = depths.iter().map(|depth| gel.pressure(f64::from(*depth))).sum::<f64>() * area(camera);
                Ok((IndentationMap::from_depth(depths).map_err(value_error)?, force))
            })
        }
        (None, Some(force)) => {
            render_press(py, index, (unit, noise), move || press_to_force(pad, camera, force, lowest))
        }
        _ => Err(value_error("expected either a depth or a force")),
    }
}

/// Renders a surface pressed in with a force (N). `surface` is its lowest point over every pixel (m, pad frame), NaN
/// where there is nothing.
#[pyfunction]
#[pyo3(signature = (index, surface, force, unit, noise))]
pub fn press_heights<'py>(
    py: Python<'py>,
    index: usize,
    surface: PyReadonlyArray2<'py, f64>,
    force: f64,
    unit: Option<u64>,
    noise: u64,
) -> PyResult<RenderedPress<'py>> {
    let (pad, camera) = camera(index)?;
    if surface.shape() != [IMAGE_SIZE, IMAGE_SIZE] {
        let shape = surface.shape();
        return Err(value_error(format!("surface: found shape {shape:?}, expected ({IMAGE_SIZE}, {IMAGE_SIZE})")));
    }
    let heights: Arc<[f64]> = surface.as_slice().map_err(value_error)?.into();
    let (dx, dy) = camera.pixel_size();
    let (x0, y0) = camera.pixel_center(0, 0);
    let lowest = move |x: f64, y: f64| {
        let nearest = |at: f64| (at.round().max(0.0) as usize).min(IMAGE_SIZE - 1);
        let height = heights[nearest((y0 - y) / dy) * IMAGE_SIZE + nearest((x - x0) / dx)];
        height.is_finite().then_some(height)
    };
    render_press(py, index, (unit, noise), move || press_to_force(pad, camera, force, lowest))
}

/// Presses an object in until the gel bears the force (N). Returns the indentation and the force, which is 0 if nothing is
/// above the pad. A force that compresses the gel fully is an error.
fn press_to_force(
    pad: &Pad,
    camera: &PadCamera,
    force: f64,
    lowest: impl FnMut(f64, f64) -> Option<f64>,
) -> PyResult<(IndentationMap, f64)> {
    let mut pressed = press(pad, &[camera], &HAND.gel(), force, lowest).map_err(value_error)?;
    let borne = pressed.force;
    if borne > 0.0 && borne < 0.99 * force {
        let words = "at most what the gel bears under this object";
        return Err(value_error(format!("force: found {force} N, expected {words}, {borne:.1} N")));
    }
    Ok((pressed.maps.pop().unwrap_or_else(IndentationMap::idle), pressed.force))
}

/// Returns the centres of a camera's pixels in the pad frame, m, row by row.
fn pixels(camera: &PadCamera) -> impl Iterator<Item = (f64, f64)> {
    let at = move |row: usize| (0..IMAGE_SIZE).map(move |column| camera.pixel_center(column, row));
    (0..IMAGE_SIZE).flat_map(at)
}

/// Returns the area of a pixel on the gel, m2.
fn area(camera: &PadCamera) -> f64 {
    let (dx, dy) = camera.pixel_size();
    dx * dy
}
