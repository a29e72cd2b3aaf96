//! The hand: kinematics, Jacobians, pads, cable transmission.

use hand_model::robot::ServoState;
use hand_model::transmission::Crossing;
use std::sync::{Arc, LazyLock};

use hand_model::{Hand, HandVector, RobotModel, statics};
use nalgebra::Point3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Numbers, array_of_rows, finite_array, matrices, value_error};

/// The built-in F-TAC Hand.
pub static HAND: LazyLock<Arc<Hand>> = LazyLock::new(|| RobotModel::ftac_gen3().hand);

fn angles(q: &Numbers) -> PyResult<HandVector> {
    finite_array::<15>("q", q).map(|q| q.into_iter().collect())
}

/// Returns names, limits and constants of the hand.
#[pyfunction]
pub fn hand(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let (hand, all) = (&*HAND, PyDict::new(py));
    all.set_item("joints", hand.tree.joints.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>())?;
    all.set_item("limits", array_of_rows(py, hand.tree.joints.iter().map(|joint| [joint.lower, joint.upper])))?;
    all.set_item("springs", PyArray1::from_slice(py, &hand.transmission.springs))?;
    let pads: Vec<_> = hand
        .pads
        .iter()
        .map(|pad| {
            let cameras: Vec<&str> = pad.cameras.iter().map(|n| hand.cameras[*n].name.as_str()).collect();
            (pad.name.as_str(), pad.link, pad.configuration, pad.w, pad.h, cameras)
        })
        .collect();
    all.set_item("pads", pads)?;
    let cameras: Vec<_> = hand
        .cameras
        .iter()
        .map(|camera| (camera.name.as_str(), camera.pad, camera.center_y, camera.w, camera.h))
        .collect();
    all.set_item("cameras", cameras)?;
    all.set_item("spool_radius", hand.parameters.cable.spool_radius)?;
    all.set_item("torque_constant", hand.parameters.servo.torque_constant)?;
    all.set_item("tension", control::slip::max_tension(hand))?;
    Ok(all)
}

/// Returns `palm_from_link` of the 15 links, 15 x 4 x 4.
#[pyfunction]
pub fn forward<'py>(py: Python<'py>, q: Numbers<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
    Ok(matrices(py, &HAND.tree.forward(&angles(&q)?)))
}

/// Returns `palm_from_pad` of the 17 pads, 17 x 4 x 4.
#[pyfunction]
pub fn pad_poses<'py>(py: Python<'py>, q: Numbers<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
    Ok(matrices(py, &HAND.pad_poses(&HAND.tree.forward(&angles(&q)?))))
}

/// Returns the geometric Jacobian of a point of a link, 6 x 15, palm frame.
#[pyfunction]
pub fn jacobian<'py>(
    py: Python<'py>,
    q: Numbers<'py>,
    link: usize,
    point: Numbers<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    if link >= HAND.tree.len() {
        return Err(value_error(format!("link: found {link}, expected 0 to {}", HAND.tree.len() - 1)));
    }
    let (poses, point) = (HAND.tree.forward(&angles(&q)?), Point3::from(finite_array::<3>("point", &point)?));
    let jacobian = HAND.tree.jacobian(&poses, link, &point);
    Ok(Array2::from_shape_fn((6, HAND.tree.len()), |at| jacobian[at]).into_pyarray(py))
}

/// Returns the cable excursion of each digit between posture 0 and q, m.
#[pyfunction]
pub fn excursions<'py>(py: Python<'py>, q: Numbers<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let q = angles(&q)?;
    Ok(PyArray1::from_iter(py, HAND.transmission.cables.iter().map(|cable| cable.excursion(&q))))
}

/// Returns the moment arm of every cable at every joint, 5 x 15, m.
#[pyfunction]
pub fn moment_arms<'py>(py: Python<'py>, q: Numbers<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let q = angles(&q)?;
    let mut arms = Array2::zeros((HAND.transmission.cables.len(), HAND.tree.len()));
    for (cable, path) in HAND.transmission.cables.iter().enumerate() {
        for Crossing { joint, lever, .. } in &path.joints {
            arms[(cable, *joint)] = lever.moment_arm(q[*joint]);
        }
    }
    Ok(arms.into_pyarray(py))
}

/// Returns the joint torques of cables and springs, N m.
#[pyfunction]
pub fn torques<'py>(py: Python<'py>, q: Numbers<'py>, tensions: Numbers<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let torques = HAND.transmission.torques(&angles(&q)?, &finite_array::<5>("tensions", &tensions)?);
    Ok(PyArray1::from_slice(py, &torques))
}

/// Returns the joint angles of the equilibrium without contact, rad.
#[pyfunction]
pub fn resting_posture<'py>(
    py: Python<'py>,
    tensions: Numbers<'py>,
    opposition: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    if !opposition.is_finite() {
        return Err(value_error(format!("opposition: found {opposition}, expected a finite angle in rad")));
    }
    let tensions = finite_array::<5>("tensions", &tensions)?;
    if let Some(n) = tensions.iter().position(|tension| *tension < 0.0) {
        return Err(value_error(format!("tensions[{n}]: found {}, expected 0 N or more", tensions[n])));
    }
    Ok(PyArray1::from_slice(py, &statics::free_equilibrium(&HAND, &tensions, opposition)))
}

/// Returns the tensions at the spools (N) for which closing digits feel `tensions` (N) at their middle joints, with the
/// servos at the output angles `spools` (rad) and the guide friction of the hand's data file.
#[pyfunction]
pub fn friction_compensated<'py>(
    py: Python<'py>,
    tensions: Numbers<'py>,
    spools: Numbers<'py>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let tensions = finite_array::<5>("tensions", &tensions)?;
    let angles = finite_array::<6>("spools", &spools)?;
    let servos = angles.map(|position| ServoState { position, ..ServoState::default() });
    let friction = &HAND.parameters.cable.friction;
    Ok(PyArray1::from_slice(py, &control::motion::tension::friction_compensated(&HAND, friction, &servos, &tensions)))
}
