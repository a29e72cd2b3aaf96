//! Plotted signals: one entity per quantity, with one line per digit, joint or pad.

use hand_model::{ActuatorVector, ArmVector, DigitVector, HandVector, RobotModel};
use rerun::{RecordingStream, Scalars, SeriesLines};

use crate::entities;
use crate::error::TelemetryError;
use crate::mesh::DrawnObject;
use crate::scene::{DIGIT_COLORS, PALM_COLOR, digit_name, link_color};

/// Error of a pose estimate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseError {
    /// Position error, mm.
    pub mm: f64,
    /// Rotation error, degrees.
    pub deg: f64,
}

/// Scalar signals of one moment. Unknown ones stay `None` (or empty) and leave a gap.
#[derive(Debug, Clone, Default)]
pub struct SignalFrame {
    /// Cable tensions, N.
    pub tensions: Option<DigitVector>,
    /// Servo currents, A.
    pub currents: Option<ActuatorVector>,
    /// Finger joint angles, rad.
    pub joint_angles: Option<HandVector>,
    /// Arm joint angles, rad.
    pub arm_angles: Option<ArmVector>,
    /// Force on each pad, N.
    pub pad_forces: Option<Vec<f64>>,
    /// Error of each object's pose estimate, in the order of the recorder's objects; NaN or `None` if there is none.
    pub pose_errors: Vec<Option<PoseError>>,
}

/// Returns a darker shade for each `step`, so that the three lines of a digit are distinguishable.
fn shade(color: [u8; 3], step: usize) -> [u8; 3] {
    let factor = [1.0, 0.72, 0.5][step.min(2)];
    color.map(|c| (f64::from(c) * factor) as u8)
}

fn series_lines(names: Vec<String>, colors: Vec<[u8; 3]>) -> SeriesLines {
    SeriesLines::new().with_names(names).with_colors(colors).with_widths([1.6f32])
}

/// Logs names and colours of the lines, once.
pub fn log_static(rec: &RecordingStream, robot: &RobotModel, objects: &[DrawnObject]) -> Result<(), TelemetryError> {
    let RobotModel { hand, arm, .. } = robot;
    let digits: Vec<String> = (0..hand.cables.len()).map(|i| digit_name(i).to_owned()).collect();
    rec.log_static(entities::TENSIONS, &series_lines(digits.clone(), DIGIT_COLORS.to_vec()))?;
    let servos = digits.iter().cloned().chain(["opposition".to_owned()]).collect();
    rec.log_static(entities::CURRENTS, &series_lines(servos, DIGIT_COLORS.into_iter().chain([PALM_COLOR]).collect()))?;
    let joints = hand.tree.joints.iter().map(|joint| joint.name.replace('_', " ")).collect();
    let along = |link: Option<usize>| {
        let chain = hand.digit_of(link).map(|digit| hand.links(digit));
        chain.and_then(|chain| chain.iter().position(|own| link == Some(*own))).unwrap_or(0)
    };
    let colors = (0..hand.tree.len()).map(|i| shade(link_color(hand, Some(i)), along(Some(i)))).collect();
    rec.log_static(entities::JOINT_ANGLES, &series_lines(joints, colors))?;
    let palette = |i: usize| DIGIT_COLORS.get(i).copied().unwrap_or(shade(PALM_COLOR, i % 2));
    let arm_joints = arm.tree.joints.iter().map(|joint| joint.name.replace('_', " ")).collect();
    rec.log_static(entities::ARM_ANGLES, &series_lines(arm_joints, (0..arm.tree.len()).map(palette).collect()))?;
    let pads = hand.pads.iter().map(|pad| pad.name.replace('_', " ")).collect();
    let colors = hand.pads.iter().map(|pad| shade(link_color(hand, pad.link), along(pad.link))).collect();
    rec.log_static(entities::PAD_FORCES, &series_lines(pads, colors))?;
    rec.log_static(entities::RESIDUAL_LOADS, &series_lines(digits, DIGIT_COLORS.to_vec()))?;
    let axes = ["x", "y", "z"].map(|axis| format!("{axis} (N)")).to_vec();
    rec.log_static(entities::RESIDUAL_FORCE, &series_lines(axes, DIGIT_COLORS[..3].to_vec()))?;
    for (path, unit) in [(entities::POSE_ERROR_MM, "mm"), (entities::POSE_ERROR_DEG, "deg")] {
        let names = objects.iter().map(|object| format!("{} ({unit})", object.name)).collect();
        let step = if unit == "mm" { 0 } else { 1 };
        rec.log_static(path, &series_lines(names, objects.iter().map(|object| shade(object.color, step)).collect()))?;
    }
    Ok(())
}

/// Logs the residuals between a robot and its reference model: cable loads (N), and the force on the hand (N, world
/// axes).
pub fn log_residuals(rec: &RecordingStream, loads: &[f64], force: &[f64; 3]) -> Result<(), TelemetryError> {
    let rounded = |values: &[f64]| Scalars::new(values.iter().map(|v| (v * 1e3).round() * 1e-3).collect::<Vec<_>>());
    rec.log(entities::RESIDUAL_LOADS, &rounded(loads))?;
    Ok(rec.log(entities::RESIDUAL_FORCE, &rounded(force))?)
}

/// Logs one moment.
pub fn log(rec: &RecordingStream, frame: &SignalFrame) -> Result<(), TelemetryError> {
    let send = |path: &str, values: Option<&[f64]>, scale: f64| match values {
        // Three decimals are enough for a plot, and short numbers compress better.
        Some(values) => rec.log(path, &Scalars::new(values.iter().map(|v| (v * scale * 1e3).round() * 1e-3))),
        None => Ok(()),
    };
    let degrees = 1f64.to_degrees();
    send(entities::TENSIONS, frame.tensions.as_ref().map(|v| &v[..]), 1.0)?;
    send(entities::CURRENTS, frame.currents.as_ref().map(|v| &v[..]), 1.0)?;
    send(entities::JOINT_ANGLES, frame.joint_angles.as_ref().map(|v| &v[..]), degrees)?;
    send(entities::ARM_ANGLES, frame.arm_angles.as_ref().map(|v| &v[..]), degrees)?;
    send(entities::PAD_FORCES, frame.pad_forces.as_deref(), 1.0)?;
    if frame.pose_errors.iter().any(Option::is_some) {
        let part = |pick: fn(&PoseError) -> f64| -> Vec<f64> {
            frame.pose_errors.iter().map(|error| error.as_ref().map_or(f64::NAN, pick)).collect()
        };
        send(entities::POSE_ERROR_MM, Some(&part(|e| e.mm)), 1.0)?;
        send(entities::POSE_ERROR_DEG, Some(&part(|e| e.deg)), 1.0)?;
    }
    Ok(())
}
