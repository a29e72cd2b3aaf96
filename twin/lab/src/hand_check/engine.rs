//! Sweep of the engine's settings: slip, penetration, jitter and cost of three holds against time step and iterations.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use hand_model::{DigitVector, Hand};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Serialize;
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use world::ObjectShape;

use super::dumbbell;

/// Swept settings: time steps per second, and outer and inner iterations.
const STEP_RATES: [f64; 3] = [120.0, 240.0, 480.0];
const ITERATION_COUNTS: [(usize, usize); 4] = [(1, 4), (1, 8), (2, 4), (4, 4)];
/// Time over which slip is measured after settling, s.
const SLIP_TIME: f64 = 5.0;

/// Result of one setting in one scene.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct EngineResult {
    pub scene: &'static str,
    /// Time steps per second.
    pub rate: f64,
    /// Outer and inner iterations.
    pub iterations: (usize, usize),
    /// Slip: displacement of the held object in the hand in five seconds, mm.
    pub slip_mm: f64,
    /// Largest penetration at the end, mm.
    pub overlap_mm: f64,
    /// Root-mean-square speed of the held object, mm/s.
    pub jitter_mm_s: f64,
    /// Wall time per step, us.
    pub step_us: f64,
    /// Real-time factor: simulated over wall time.
    pub real_time: f64,
}

struct EngineScene {
    name: &'static str,
    prop: Prop,
    place: Isometry3<f64>,
    tensions: DigitVector,
    /// Sequence of tensions with their times after the release of the prop, before its weight acts, N and s.
    grip_sequence: Vec<(DigitVector, f64)>,
    opposition: f64,
    gravity: Vector3<f64>,
}

fn scenes(hand: &Hand) -> Vec<EngineScene> {
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    let place = |y: f64, half: f64| Isometry3::from_parts(Vector3::new(0.0, y, skin - half - 5e-4).into(), across);
    let down = Vector3::new(0.0, 0.0, -9.81);
    vec![
        EngineScene {
            name: "cylinder 300 g",
            prop: Prop::new("cylinder", ObjectShape::Cylinder { radius: 0.025, half_height: 0.06 }, 0.3, 0.8),
            place: place(-0.005, 0.025),
            tensions: [20.0; 5].into(),
            grip_sequence: vec![([20.0; 5].into(), 1.0)],
            opposition: 1.0,
            gravity: down,
        },
        EngineScene {
            name: "ball 60 g",
            prop: Prop::new("ball", ObjectShape::Sphere { radius: 0.03 }, 0.06, 0.8),
            place: place(0.0, 0.03),
            tensions: [15.0; 5].into(),
            grip_sequence: vec![([15.0; 5].into(), 1.0)],
            opposition: 1.1,
            gravity: down,
        },
        EngineScene {
            name: "dumbbell 2.5 kg",
            prop: dumbbell::dumbbell_prop(),
            place: dumbbell::handle_pose(hand),
            tensions: dumbbell::tensions(),
            grip_sequence: dumbbell::grip_sequence(),
            opposition: 0.0,
            gravity: Vector3::new(0.0, 9.81, 0.0),
        },
    ]
}

fn run(hand: &Arc<Hand>, scene: &EngineScene, rate: f64, (outer, inner): (usize, usize)) -> EngineResult {
    let settings =
        EngineSettings { dt: 1.0 / rate, solver_iterations: outer, pgs_iterations: inner, ..EngineSettings::default() };
    let mut stand = HandTestStand::new(hand.clone(), settings);
    let prop = stand.add_prop(scene.prop.clone(), &scene.place);
    let clock = Instant::now();
    let goals = tension_goals(hand, &scene.tensions, scene.opposition);
    stand.run(&tension_goals(hand, &[0.0; 5], scene.opposition), 0.6);
    stand.run(&goals, 2.0);
    stand.release_prop(prop);
    for (tensions, seconds) in &scene.grip_sequence {
        stand.run(&tension_goals(hand, tensions, scene.opposition), *seconds);
    }
    stand.set_gravity(&scene.gravity);
    stand.run(&goals, 1.0);
    let before = stand.prop_pose(prop).translation.vector;
    let steps = (SLIP_TIME * rate) as usize;
    let mut square = 0.0;
    for _ in 0..steps {
        stand.step(&goals);
        square += stand.prop_velocity(prop).norm_squared();
    }
    let wall = clock.elapsed().as_secs_f64();
    EngineResult {
        scene: scene.name,
        rate,
        iterations: (outer, inner),
        slip_mm: (stand.prop_pose(prop).translation.vector - before).norm() * 1e3,
        overlap_mm: stand.prop_penetration(prop) * 1e3,
        jitter_mm_s: (square / steps as f64).sqrt() * 1e3,
        step_us: wall / (stand.time() * rate) * 1e6,
        real_time: stand.time() / wall,
    }
}

/// Runs every setting in every scene, one after the other because the cost is measured.
pub fn sweep(hand: &Arc<Hand>) -> Result<Vec<EngineResult>> {
    let mut found = Vec::new();
    for scene in &scenes(hand) {
        for rate in STEP_RATES {
            for iterations in ITERATION_COUNTS {
                found.push(run(hand, scene, rate, iterations));
            }
        }
    }
    Ok(found)
}

/// Returns the table as text; the default setting is marked.
pub fn table(found: &[EngineResult]) -> String {
    let default = EngineSettings::default();
    let mut text = format!(
        "{:16} {:>5} {:>10} {:>11} {:>11} {:>12} {:>8} {:>7}\n",
        "held", "Hz", "iterations", "slip mm", "overlap mm", "jitter mm/s", "us/step", "x real"
    );
    for s in found {
        let chosen = (s.rate * default.dt - 1.0).abs() < 1e-9
            && s.iterations == (default.solver_iterations, default.pgs_iterations);
        let slip = if s.slip_mm > 50.0 { "dropped".to_string() } else { format!("{:.3}", s.slip_mm) };
        text += &format!(
            "{:16} {:>5.0} {:>6} x {} {:>11} {:>11.3} {:>12.2} {:>8.0} {:>7.1}{}\n",
            s.scene,
            s.rate,
            s.iterations.0,
            s.iterations.1,
            slip,
            s.overlap_mm,
            s.jitter_mm_s,
            s.step_us,
            s.real_time,
            if chosen { "  <- default" } else { "" }
        );
    }
    text
}
