//! Recorded sessions at a reduced rate, for learning.

use std::path::PathBuf;

use hand_model::{ActuatorVector, ArmVector, RobotModel};
use learning_environment::PadImages;
use numpy::ndarray::Array5;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use robot_session_log::frames::{SessionFrame, read_frames};
use robot_session_log::{RobotSizes, SessionLogError, SessionReader};

use crate::arrays::{rows, value_error};
use crate::hand::HAND;

/// Maximum size of a session's images, bytes.
const MAX_IMAGE_BYTES: u64 = 8 << 30;

/// Reads a session with a frame every `ticks` ticks: measurements, commands, images of `side` pixels, and as JSON text
/// the task and the outcome of the trial.
#[pyfunction]
pub fn session(py: Python<'_>, path: PathBuf, ticks: usize, side: usize) -> PyResult<Bound<'_, PyDict>> {
    let read = py.detach(|| -> Result<_, SessionLogError> {
        let mut reader = SessionReader::open(&path, RobotSizes::from_robot(&RobotModel::ftac_gen3()))?;
        let (frames, outcome) = read_frames(&mut reader, ticks)?;
        Ok((reader.session().clone(), frames, outcome))
    });
    let (about, frames, outcome) = read.map_err(value_error)?;
    let all = PyDict::new(py);
    all.set_item("robot", about.robot)?;
    all.set_item("tick", about.tick_length)?;
    all.set_item("task", String::from_utf8_lossy(&about.task))?;
    all.set_item("outcome", outcome.map(|text| String::from_utf8_lossy(&text).into_owned()))?;
    all.set_item("time", PyArray1::from_iter(py, frames.iter().map(|frame| frame.time)))?;
    let each = |pick: fn(&SessionFrame) -> ArmVector| frames.iter().map(pick).collect::<Vec<_>>();
    all.set_item("arm", rows(py, &each(|frame| frame.arm.position)))?;
    all.set_item("arm_velocity", rows(py, &each(|frame| frame.arm.velocity)))?;
    all.set_item("arm_torque", rows(py, &each(|frame| frame.arm.torque)))?;
    let servos = |pick: fn(&hand_model::robot::ServoState) -> f64| {
        let of = |frame: &SessionFrame| frame.servos.iter().map(pick).collect::<ActuatorVector>();
        rows(py, &frames.iter().map(of).collect::<Vec<_>>())
    };
    all.set_item("servos", servos(|servo| servo.position))?;
    all.set_item("servo_velocity", servos(|servo| servo.velocity))?;
    all.set_item("servo_current", servos(|servo| servo.current))?;
    all.set_item("arm_goal", rows(py, &each(|frame| frame.sent.arm)))?;
    all.set_item("servo_goal", rows(py, &frames.iter().map(SessionFrame::servo_goals).collect::<Vec<_>>()))?;
    let (count, pads) = (frames.len(), HAND.pads.len());
    let bytes = [count, pads, side, side, 3].iter().fold(1, |bytes: u64, part| bytes.saturating_mul(*part as u64));
    if bytes > MAX_IMAGE_BYTES {
        let (found, most) = (bytes >> 20, MAX_IMAGE_BYTES >> 20);
        let words = format!(
            "{count} frames with {found} MB of images, expected at most {most} MB: smaller images, or fewer frames"
        );
        return Err(value_error(format!("{}: found {words}", path.display())));
    }
    let rgb = py.detach(|| pictures(frames, side)).map_err(value_error)?;
    let rgb = Array5::from_shape_vec((count, pads, side, side, 3), rgb).map_err(value_error)?;
    all.set_item("tactile", rgb.into_pyarray(py))?;
    Ok(all)
}

/// Returns the newest picture of every pad for every frame; black before the first.
fn pictures(frames: Vec<SessionFrame>, side: usize) -> Result<Vec<u8>, learning_environment::ImageSizeError> {
    let mut images = PadImages::new(&HAND, side)?;
    let mut rgb = Vec::with_capacity(frames.len() * images.rgb().len());
    for frame in frames {
        images.show(&HAND, frame.tactile);
        rgb.extend_from_slice(images.rgb());
    }
    Ok(rgb)
}
