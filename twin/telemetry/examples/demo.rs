//! Records 5 s of synthetic motion of the real hand and arm: `cargo run --example demo -- demo.rrd`.

use std::error::Error;
use std::f64::consts::{PI, TAU};

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use hand_model::{ArmVector, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use telemetry::{DrawnObject, LogLevel, PoseError, Recorder, SignalFrame, TrialProperties};

fn ball(radius: f64) -> DrawnObject {
    const SEGMENT_COUNT: u32 = 24;
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..=SEGMENT_COUNT / 2 {
        for i in 0..SEGMENT_COUNT {
            let (a, b) =
                (TAU * f64::from(i) / f64::from(SEGMENT_COUNT), PI * f64::from(j) / f64::from(SEGMENT_COUNT / 2));
            points.push(Point3::new(a.cos() * b.sin(), a.sin() * b.sin(), -b.cos()) * radius);
            let (here, right) = (j * SEGMENT_COUNT + i, j * SEGMENT_COUNT + (i + 1) % SEGMENT_COUNT);
            if j < SEGMENT_COUNT / 2 {
                triangles.extend([
                    [here, right, here + SEGMENT_COUNT],
                    [right, right + SEGMENT_COUNT, here + SEGMENT_COUNT],
                ]);
            }
        }
    }
    DrawnObject::from_mesh("ball", &points, &triangles, [235, 120, 60])
}

/// Synthetic tactile image with its height map: three-coloured light, and a dent of `depth` (0 to 1) at `place` (shares
/// of the image side from its centre).
fn image(depth: f64, place: [f64; 2]) -> (TactileImage, Vec<f32>) {
    let n = IMAGE_SIZE as f64;
    let mut rgb = Vec::new();
    let mut heights = Vec::new();
    for i in 0..IMAGE_SIZE * IMAGE_SIZE {
        let (x, y) = ((i % IMAGE_SIZE) as f64 / n - 0.5, (i / IMAGE_SIZE) as f64 / n - 0.5);
        let (dx, dy) = (x - place[0], y - place[1]);
        let bump = depth * (-(dx * dx + dy * dy) / 0.02).exp();
        let (gx, gy) = (bump * dx * 100.0, bump * dy * 100.0);
        let light = |a: f64| {
            (105.0 + 40.0 * (x * a.cos() + y * a.sin()) + 12.0 * (gx * a.cos() + gy * a.sin())).clamp(0.0, 255.0) as u8
        };
        rgb.extend([light(0.0), light(TAU / 3.0), light(2.0 * TAU / 3.0)]);
        heights.push((bump * 1e-3) as f32);
    }
    (TactileImage { rgb }, heights)
}

/// Signals at time `t` (s) of a hand closed by the share `close`. `off` scales the remaining error of the pose
/// estimate.
fn signals(t: f64, close: f64, pads: usize, joints: [f64; 15], arm: ArmVector, off: Option<f64>) -> SignalFrame {
    let ripple = |i: usize| 0.4 * (t * 5.0 + i as f64).sin();
    SignalFrame {
        tensions: Some((0..5).map(|i| 12.0 * close + ripple(i)).collect()),
        currents: Some((0..6).map(|i| 0.2 * close + 0.02 * ripple(i)).collect()),
        joint_angles: Some(joints.into_iter().collect()),
        arm_angles: Some(arm),
        pad_forces: Some((0..pads).map(|pad| force(close, pad)).collect()),
        pose_errors: vec![off.map(|off| PoseError { mm: 12.0 * off + 4.0 + ripple(0), deg: 17.0 * off })],
    }
}

/// Force on a pad, N. Every third pad is touched once the hand is nearly closed.
fn force(close: f64, pad: usize) -> f64 {
    if close > 0.6 && pad % 3 == 1 { (close - 0.6) * (1.0 + 0.2 * pad as f64) } else { 0.0 }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or_else(|| "demo.rrd".to_owned());
    let duration: f64 = arguments.next().map_or(Ok(5.0), |text| text.parse())?;
    let robot = RobotModel::ftac_gen3();
    let RobotModel { hand, arm, .. } = &robot;
    let mut recorder = Recorder::create(&path, &robot, &[ball(0.035)])?;
    recorder.log_properties(&TrialProperties {
        combination: "ball".into(),
        trial: 1,
        condition: "touch".into(),
        robot: "demo".into(),
        seed: 7,
    })?;
    let phases = [(0.0, "approach"), (0.25, "close"), (0.45, "lift"), (0.8, "hold"), (0.95, "judge")];
    let mut phase = 0;
    // The hand points down and a little sideways.
    let mut q = ArmVector::from([0.0, 0.6, PI, -1.9, 0.0, -0.64, PI / 2.0]);
    for tick in 0..=(duration * 100.0) as usize {
        let t = tick as f64 * 0.01;
        let s = t / duration;
        recorder.set_time(t);
        if let Some((start, name)) = phases.get(phase)
            && s >= *start
        {
            recorder.log_phase(name)?;
            phase += 1;
        }
        if tick == 260 {
            recorder.log_text(LogLevel::Warn, "index_distal: contact lost for 40 ms")?;
        }
        let close = ((s - 0.15) / 0.3).clamp(0.0, 1.0);
        let lift = ((s - 0.45) / 0.35).clamp(0.0, 1.0);
        q[1] = 0.6 - 0.15 * lift;
        q[0] = 0.1 * (s * TAU).sin();
        let angles: [f64; 15] =
            std::array::from_fn(|j| if j == 0 { 0.9 * close } else { (0.65 + 0.05 * (j % 3) as f64) * close });
        let arm_links = arm.tree.forward(&q);
        let palm = arm_links[6] * arm.last_from_tool * hand.palm_from_flange.inverse();
        let links = hand.tree.forward(&angles);
        recorder.log_robot(&arm_links, &palm, &links)?;
        let held = palm * Isometry3::translation(0.0, 0.01, -0.045);
        recorder.log_object("ball", &held)?;
        let off = Isometry3::from_parts(
            Translation3::new(0.012 * (1.0 - close), 0.01, 0.004),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3 * (1.0 - close)),
        );
        let known = s > 0.2 && s < 0.9;
        recorder.log_estimate("ball", known.then(|| held * off).as_ref())?;
        let pads = hand.pad_poses(&links);
        let on: Vec<usize> = (0..hand.pads.len()).filter(|pad| force(close, *pad) > 0.0).collect();
        let points: Vec<_> = on.iter().map(|pad| palm * pads[*pad] * Point3::origin()).collect();
        let forces: Vec<_> = on.iter().map(|pad| palm * pads[*pad] * Vector3::z() * force(close, *pad)).collect();
        recorder.log_contacts(&points, &forces, &[])?;
        if tick % 20 == 0 {
            for (camera, view) in hand.cameras.iter().enumerate() {
                let wobble = 0.15 * (t * 2.0 + camera as f64).sin();
                let (picture, heights) = image(force(close, view.pad).min(1.0), [wobble, 0.5 * wobble]);
                recorder.log_tactile(camera, &picture)?;
                recorder.log_height(camera, &heights, IMAGE_SIZE, IMAGE_SIZE)?;
            }
        }
        let pose_error = known.then_some(1.0 - close);
        recorder.log_scalars(&signals(t, close, hand.pads.len(), angles, q, pose_error))?;
    }
    recorder.log_outcome("success: ball held 3 s, lifted 0.15 m")?;
    recorder.finish()?;
    println!("{path}: {} bytes", std::fs::metadata(&path)?.len());
    Ok(())
}
