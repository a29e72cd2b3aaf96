//! Recorded sessions at the rate at which a learner acts.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context as _, Result, ensure};
use bench::trial::Bench;
use bench::trial::step_recorder::{RecordedSteps, SetPoints, TrialStep};
use control::action::TICKS_PER_STEP;
use ftac::{read_task, session_bench};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use robot_session_log::frames::{SessionFrame, read_frames};
use robot_session_log::{RobotSizes, SessionEvent, SessionReader};

use crate::arrays::value_error;
use crate::steps::steps_dict;
use crate::threads::Threads;

/// Maximum size of a session's images, bytes.
const MAX_IMAGE_BYTES: u64 = 8 << 30;

/// The bench of the session read last, with the part of the task that decides it. Sessions of one run share it.
static LATEST_BENCH: Mutex<Option<(String, Bench)>> = Mutex::new(None);

/// Reads a session in steps of 1/20 s, with images of `side` pixels: the arrays of [`steps_dict`], the name of the
/// `robot`, and as JSON text the `outcome` of the trial.
#[pyfunction]
pub fn session(py: Python<'_>, path: PathBuf, side: usize) -> PyResult<Bound<'_, PyDict>> {
    let threads = Threads::of_process()?;
    let read = py.detach(|| read_session(&path, side, &threads));
    let (steps, robot, outcome) = read.map_err(|error| {
        let words = format!("{error:#}");
        let named = words.starts_with(&path.display().to_string());
        value_error(if named { words } else { format!("{}: {words}", path.display()) })
    })?;
    let all = steps_dict(py, steps, side)?;
    all.set_item("robot", robot)?;
    all.set_item("outcome", outcome.map(|text| String::from_utf8_lossy(&text).into_owned()))?;
    Ok(all)
}

fn read_session(path: &Path, side: usize, threads: &Threads) -> Result<(RecordedSteps, String, Option<Vec<u8>>)> {
    let (task, scenario) = read_task(path)?;
    ensure!(task.robot_model.is_none(), "robot_model: found another robot, expected the F-TAC Hand on a Gen3");
    // Everything but the trial itself.
    let key =
        serde_json::to_string(&(&task.scenario, task.seed, &task.instance, &task.pads, &task.places, &task.robot))?;
    let mut latest = LATEST_BENCH.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let fits = |(known, bench): &(String, Bench)| *known == key && task.combination < bench.grasp_pairs.pairs.len();
    if !latest.as_ref().is_some_and(fits) {
        *latest = Some((key, threads.run(|| session_bench(&task, scenario, path, true))?));
    }
    let (_, bench) = latest.as_ref().context("a bench")?;
    let sizes = || RobotSizes::from_robot(&bench.world.cell.robot);
    let mut reader = SessionReader::open(path, sizes())?;
    let tick = reader.session().tick_length;
    let expected = 1.0 / 120.0;
    ensure!((tick - expected).abs() < 1e-9, "tick_length: found {tick} s, expected {expected} s");
    let robot = reader.session().robot.clone();
    let (frames, outcome) = read_frames(&mut reader, TICKS_PER_STEP)?;
    ensure!(!frames.is_empty(), "found nothing measured, expected a session that began");
    let mut start = threads.run(|| bench.session_start(&task, side))?;
    if task.places.detector {
        let first = first_detections(&mut SessionReader::open(path, sizes())?, start.detected.len())?;
        for (n, pose) in first.into_iter().enumerate() {
            let object = if start.reversed { start.detected.len() - 1 - n } else { n };
            start.detected[object] = pose.unwrap_or(start.detected[object]);
        }
    }
    let pictures = start.pictures.rgb().len() as u64;
    let bytes = pictures.saturating_mul(frames.len() as u64);
    ensure!(
        bytes <= MAX_IMAGE_BYTES,
        "found {} steps with {} MB of images, expected at most {} MB: smaller images, or a shorter session",
        frames.len(),
        bytes >> 20,
        MAX_IMAGE_BYTES >> 20
    );
    let (mut shown, mut images) = (start.pictures.clone(), Vec::with_capacity(bytes as usize));
    let points = bench.set_point_reader();
    let mut steps = Vec::with_capacity(frames.len());
    for SessionFrame { time, servos, arm, commands, tactile, .. } in frames {
        // Before the first images the pads are shown as they are untouched.
        shown.show(&bench.world.cell.robot.hand, tactile);
        images.extend_from_slice(shown.rgb());
        let set_points: Result<Vec<SetPoints>> = commands.iter().map(|sent| points.set_points(sent)).collect();
        let palm = points.palm_pose(&arm.position);
        steps.push(TrialStep { time, servos, arm, palm, set_points: set_points? });
    }
    Ok((RecordedSteps { start, steps, images }, robot, outcome))
}

/// Returns the first detection of each object in a session.
fn first_detections(reader: &mut SessionReader, objects: usize) -> Result<Vec<Option<Isometry3<f64>>>> {
    let mut first = vec![None; objects];
    while let Some((_, event)) = reader.next_event()? {
        if let SessionEvent::Detection(object, Some((pose, _))) = event
            && let Some(unknown) = first.get_mut(object)
            && unknown.is_none()
        {
            let [x, y, z, i, j, k, w] = pose;
            let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
            *unknown = Some(Isometry3::from_parts(Translation3::new(x, y, z), rotation));
        }
        if first.iter().all(Option::is_some) {
            break;
        }
    }
    Ok(first)
}
