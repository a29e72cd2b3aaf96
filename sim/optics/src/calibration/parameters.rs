//! The parameter vector of a fit: its order, its bounds, and the model it represents.
//!
//! Every lamp lights all three channels. Only the lamps' colours, the diffuse light and the response differ between
//! channels. The geometry is shared between them, which makes it identifiable.

use nalgebra::Point3;

use crate::calibration::assumptions::Assumptions;
use crate::camera::{CameraResponse, Pinhole};
use crate::elastomer::Elastomer;
use crate::lamps::Lamp;
use crate::model::{MIN_LAMP_DISTANCE, SensorModel};
use crate::reflectance::Reflectance;

// Indices into the parameter vector: first the parameters that move the surface, then those that change grey levels only,
// then the lamps.
pub(crate) const PIXEL: usize = 0;
pub(crate) const CONTACT: usize = 1;
pub(crate) const KERNEL: usize = 2;
pub(crate) const KERNEL_RATIO: usize = 3;
pub(crate) const COATING: usize = 4;
pub(crate) const CAMERA_X: usize = 5;
pub(crate) const CAMERA_Y: usize = 6;
pub(crate) const CAMERA_Z: usize = 7;
pub(crate) const ROUGHNESS: usize = 8;
/// Index from which on parameters change only grey levels: two of each channel's response, then the diffuse light.
pub(crate) const RESPONSE: usize = 9;
pub(crate) const AMBIENT: usize = 15;
/// Index of the first lamp's first parameter.
pub(crate) const FIRST_LAMP: usize = 18;
/// Parameters of a lamp: position (3), aim (2), mu, size, colour (3).
pub(crate) const PARAMETERS_PER_LAMP: usize = 10;
/// Offset of the colour among a lamp's parameters.
pub(crate) const COLOR_OFFSET: usize = 7;
/// Number of smoothing kernels of the elastomer.
const KERNEL_COUNT: i32 = 4;
/// Strength (m2) of a lamp with colour 1: radiance 1 at 10 mm.
const LAMP_STRENGTH: f64 = 1e-4;
/// Factor on the lamps' distance if the near field is left out.
const FAR_FIELD_FACTOR: f64 = 50.0;

/// Returns the lower and upper bounds of all parameters.
pub(crate) fn bounds(assumptions: &Assumptions, lamps: usize) -> Vec<(f64, f64)> {
    let fixed = |value: f64| (value, value);
    let pixel = assumptions.pixel.map_or((10e-6, 200e-6), fixed);
    let coating = if assumptions.pixel.is_some() { (0.0, 0.8e-3) } else { fixed(0.0) };
    let mut all = vec![pixel, (0.5, 1.5), (0.15e-3, 3e-3), (0.2, 0.8), coating];
    all.extend([(-5e-3, 5e-3), (-5e-3, 5e-3), (8e-3, 60e-3)]);
    all.push(if assumptions.oren_nayar { (0.0, 1.0) } else { fixed(0.0) });
    for _ in 0..3 {
        if assumptions.response {
            all.extend([(0.001, 1.0), (0.01, 0.98)]);
        } else {
            all.extend([fixed(1.0 / 3.0), fixed(0.5)]);
        }
    }
    all.extend([(0.0, 1.5); 3]);
    for _ in 0..lamps {
        // Inside the housing: 25 mm to each side, 1 to 30 mm behind the gel.
        let far = if assumptions.near_field { 1.0 } else { FAR_FIELD_FACTOR };
        all.extend([(-25e-3 * far, 25e-3 * far), (-25e-3 * far, 25e-3 * far), (MIN_LAMP_DISTANCE * far, 30e-3 * far)]);
        all.extend([(-20e-3, 20e-3); 2]);
        all.push(if assumptions.near_field { (0.0, 12.0) } else { fixed(0.0) });
        all.push((0.1e-3 * far, 6e-3 * far));
        all.extend([(0.0, 20.0); 3]);
    }
    all
}

/// Returns the names of the parameters, with units.
pub(crate) fn names(lamps: usize) -> Vec<String> {
    let mut names: Vec<String> = [
        "pixel (m)",
        "contact radius over visible radius",
        "widest kernel (m)",
        "kernel ratio",
        "coating (m)",
        "camera x (m)",
        "camera y (m)",
        "camera distance (m)",
        "roughness (rad)",
    ]
    .map(String::from)
    .to_vec();
    for c in ["red", "green", "blue"] {
        names.extend([format!("response {c}, first"), format!("response {c}, second")]);
    }
    names.extend(["red", "green", "blue"].map(|c| format!("diffuse light {c}")));
    for k in 0..lamps {
        let of_lamp =
            ["x (m)", "y (m)", "distance (m)", "aim x (m)", "aim y (m)", "mu", "size (m)", "red", "green", "blue"];
        names.extend(of_lamp.map(|what| format!("lamp {k} {what}")));
    }
    names
}

/// Returns initial parameters: `lamps` lamps on a ring, rotated by the fraction `turn` of their spacing.
pub(crate) fn start(pixel: f64, lamps: usize, turn: f64) -> Vec<f64> {
    let angle = |k: usize| (k as f64 + turn) / lamps as f64 * std::f64::consts::TAU;
    start_towards(pixel, &(0..lamps).map(angle).collect::<Vec<f64>>())
}

/// Returns initial parameters: lamps in these directions (rad) on a ring of 14 mm radius; sRGB-like response.
pub(crate) fn start_towards(pixel: f64, directions: &[f64]) -> Vec<f64> {
    let mut p = vec![pixel, 1.0, 0.8e-3, 0.5, 0.1e-3, 0.0, 0.0, 25e-3, 0.2];
    p.extend([0.03, 0.25, 0.03, 0.25, 0.03, 0.25, 0.2, 0.2, 0.2]);
    for direction in directions {
        let (sin, cos) = direction.sin_cos();
        p.extend([14e-3 * cos, 14e-3 * sin, 6e-3, 0.0, 0.0, 1.0, 2e-3, 0.5, 0.5, 0.5]);
    }
    p
}

/// Replaces each lamp by two of half its light, 4 mm to either side along the ring.
pub(crate) fn split_lamps(p: &[f64]) -> Vec<f64> {
    let mut split = p[..FIRST_LAMP].to_vec();
    for lamp in p[FIRST_LAMP..].chunks_exact(PARAMETERS_PER_LAMP) {
        let norm = lamp[0].hypot(lamp[1]).max(1e-3);
        for side in [-4e-3, 4e-3] {
            let mut half = lamp.to_vec();
            half[0] -= side * lamp[1] / norm;
            half[1] += side * lamp[0] / norm;
            half[6] = 3e-3;
            half[COLOR_OFFSET..].iter_mut().for_each(|color| *color = 0.5 * *color + 0.02);
            split.extend(half);
        }
    }
    split
}

/// Moves the lamps far away in the same directions.
pub(crate) fn move_far(p: &mut [f64]) {
    for lamp in p[FIRST_LAMP..].chunks_exact_mut(PARAMETERS_PER_LAMP) {
        lamp[..3].iter_mut().for_each(|coordinate| *coordinate *= FAR_FIELD_FACTOR);
        lamp[6] *= FAR_FIELD_FACTOR;
        let distance = (lamp[0] * lamp[0] + lamp[1] * lamp[1] + lamp[2] * lamp[2])
            / (FAR_FIELD_FACTOR * FAR_FIELD_FACTOR)
            / LAMP_STRENGTH;
        lamp[COLOR_OFFSET..].iter_mut().for_each(|color| *color /= distance.max(0.1));
    }
}

/// Returns a channel's response: a rising cubic by its inner control values b1 < b2 < 1, `b1 = p0`, `b2 = b1 + p1 (1 -
/// b1)`.
pub(crate) fn response(p: &[f64], channel: usize) -> CameraResponse {
    let b1 = p[RESPONSE + 2 * channel];
    let b2 = b1 + p[RESPONSE + 2 * channel + 1] * (1.0 - b1);
    CameraResponse { coefficients: [3.0 * b1, 3.0 * (b2 - 2.0 * b1), 1.0 + 3.0 * (b1 - b2)] }
}

/// Returns lamp `k`. Its strength is fixed; the colours, which may exceed 1, scale it.
pub(crate) fn lamp(p: &[f64], k: usize, near_field: bool) -> Lamp {
    let q = &p[FIRST_LAMP + PARAMETERS_PER_LAMP * k..FIRST_LAMP + PARAMETERS_PER_LAMP * (k + 1)];
    let eta = if near_field { LAMP_STRENGTH } else { LAMP_STRENGTH * FAR_FIELD_FACTOR * FAR_FIELD_FACTOR };
    let position = Point3::new(q[0], q[1], -q[2]);
    let target = Point3::new(q[3], q[4], 0.0);
    Lamp { size: q[6], ..Lamp::aimed(position, target, eta, q[5], [q[7], q[8], q[9]]) }
}

pub(crate) fn camera(p: &[f64]) -> Pinhole {
    Pinhole { position: Point3::new(p[CAMERA_X], p[CAMERA_Y], -p[CAMERA_Z]) }
}

pub(crate) fn reflectance(p: &[f64]) -> Reflectance {
    Reflectance { albedo: [1.0; 3], roughness: p[ROUGHNESS] }
}

pub(crate) fn elastomer(p: &[f64]) -> Elastomer {
    Elastomer { kernels: (0..KERNEL_COUNT).map(|i| p[KERNEL] * p[KERNEL_RATIO].powi(i)).collect(), coating: p[COATING] }
}

/// Builds the sensor model of the parameters, with `noise` grey levels of read-out noise.
pub(crate) fn model(p: &[f64], near_field: bool, noise: f64) -> SensorModel {
    let lamps = (0..(p.len() - FIRST_LAMP) / PARAMETERS_PER_LAMP).map(|k| lamp(p, k, near_field)).collect();
    SensorModel {
        gain: [1.0; 3],
        noise,
        texture: [0.0; 2],
        ambient: [p[AMBIENT], p[AMBIENT + 1], p[AMBIENT + 2]],
        camera: camera(p),
        reflectance: reflectance(p),
        response: std::array::from_fn(|c| response(p, c)),
        elastomer: elastomer(p),
        lamps,
    }
}
