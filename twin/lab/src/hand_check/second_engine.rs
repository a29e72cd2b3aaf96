//! Export of scenes for a second engine: MJCF files, the actuator commands, and the results of the built-in engine.
//!
//! `tests/mujoco/compare.py` runs the same commands in MuJoCo and prints the results of both engines.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use ftac_platform::data::write_atomically;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::robot::RobotCommand;
use hand_model::transmission::friction::CableFriction;
use hand_model::{DigitVector, Hand, RobotModel};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use sim::collision_model::CollisionModel;
use sim::engine::EngineSettings;
use sim::mjcf::{self, MjcfScene};
use sim::tactile::TactileBoard;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectSet;
use world::{ObjectModel, ObjectShape};

use super::dumbbell;

/// Sampling interval of the motion, s.
const SAMPLE_INTERVAL: f64 = 0.05;
/// Settling time after the release of a prop, and time over which slip is measured, s.
const SETTLING_TIME: f64 = 1.0;
const SLIP_TIME: f64 = 5.0;

/// Outer iterations with which friction against a fixed body converges. With one, as in trials, a finger pulled hard
/// against a fixed object slides where it should stick.
const CONVERGED_ITERATIONS: usize = 4;

/// Factors by which the time step of a closing is shortened, to observe the convergence of each engine's posture.
const STEP_DIVISORS: [u32; 5] = [1, 2, 4, 8, 16];

/// A period of constant commands.
#[derive(Clone)]
struct CommandPhase {
    seconds: f64,
    tensions: DigitVector,
    opposition: f64,
}

#[derive(Clone)]
struct StandTest {
    name: &'static str,
    prop: Option<(Prop, Isometry3<f64>)>,
    phases: Vec<CommandPhase>,
    /// Commands after the release of the prop, before its weight acts; empty if it is not released.
    grip_phases: Vec<CommandPhase>,
    /// Gravity after the release of the prop, palm frame, m/s2.
    gravity: Vector3<f64>,
    /// True if the prop is released.
    releases_prop: bool,
}

impl StandTest {
    /// Returns a test in which all digits close on `prop` at a tension (N) with the thumb opposed (rad).
    fn closing(name: &'static str, prop: Prop, place: Isometry3<f64>, tension: f64, opposition: f64) -> Self {
        let phases = vec![
            CommandPhase { seconds: 0.6, tensions: [0.0; 5].into(), opposition },
            CommandPhase { seconds: 2.4, tensions: [tension; 5].into(), opposition },
        ];
        Self {
            name,
            prop: Some((prop, place)),
            phases,
            grip_phases: Vec::new(),
            gravity: Vector3::zeros(),
            releases_prop: false,
        }
    }

    /// As [`Self::closing`], but the prop is released after another second and held against gravity out of the palm.
    fn holding(name: &'static str, prop: Prop, place: Isometry3<f64>, tension: f64, opposition: f64) -> Self {
        Self {
            grip_phases: vec![CommandPhase { seconds: 1.0, tensions: [tension; 5].into(), opposition }],
            gravity: Vector3::new(0.0, 0.0, -9.81),
            releases_prop: true,
            ..Self::closing(name, prop, place, tension, opposition)
        }
    }
}

/// Returns the tests. `friction` is the coefficient of ball, cylinder and box.
fn stand_tests(hand: &Hand, friction: f64) -> Vec<StandTest> {
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    let under = |x: f64, y: f64, half: f64, turn: UnitQuaternion<f64>| {
        Isometry3::from_parts(Vector3::new(x, y, skin - half - 5e-4).into(), turn)
    };
    let ball = Prop::new("ball", ObjectShape::Sphere { radius: 0.03 }, 0.06, friction);
    let cylinder = Prop::new("cylinder", ObjectShape::Cylinder { radius: 0.025, half_height: 0.06 }, 0.3, friction);
    let half = Vector3::new(0.045, 0.022, 0.022);
    let block = Prop::new("box", ObjectShape::Cuboid { half, radius: 0.002 }, 0.2, friction);
    let (at_ball, at_cylinder, at_block) = (
        under(0.0, 0.0, 0.03, UnitQuaternion::identity()),
        under(0.0, -0.005, 0.025, across),
        under(0.0, -0.003, 0.022, UnitQuaternion::identity()),
    );
    // Without friction there is one rest pose, independent of the path to it.
    let slick = |prop: &Prop| Prop { friction: 0.0, ..prop.clone() };
    let (slick_cylinder, slick_box) = (slick(&cylinder), slick(&block));
    let gripping = dumbbell::grip_sequence().into_iter();
    vec![
        StandTest {
            name: "free",
            prop: None,
            phases: vec![
                CommandPhase { seconds: 1.5, tensions: [2.0, 3.0, 4.0, 5.0, 6.0].into(), opposition: 0.4 },
                CommandPhase { seconds: 1.5, tensions: [5.0, 7.0, 3.0, 8.0, 1.0].into(), opposition: 0.9 },
                CommandPhase { seconds: 1.5, tensions: [0.0; 5].into(), opposition: 0.0 },
            ],
            grip_phases: Vec::new(),
            gravity: Vector3::new(0.0, 0.0, -9.81),
            releases_prop: true,
        },
        StandTest::holding("ball", ball, at_ball, 15.0, 1.1),
        StandTest::holding("cylinder", cylinder, at_cylinder, 20.0, 1.0),
        StandTest::holding("box", block, at_block, 20.0, 1.0),
        StandTest {
            name: "dumbbell",
            prop: Some((dumbbell::dumbbell_prop(), dumbbell::handle_pose(hand))),
            phases: vec![CommandPhase { seconds: 2.0, tensions: dumbbell::tensions(), opposition: 0.0 }],
            grip_phases: gripping
                .map(|(tensions, seconds)| CommandPhase { seconds, tensions, opposition: 0.0 })
                .collect(),
            gravity: Vector3::new(0.0, 9.81, 0.0),
            releases_prop: true,
        },
        StandTest::closing("slick cylinder", slick_cylinder, at_cylinder, 20.0, 1.0),
        StandTest::closing("slick box", slick_box, at_block, 20.0, 1.0),
    ]
}

fn scene_file(name: &str) -> String {
    format!("{}.xml", name.replace(' ', "_"))
}

/// Returns the rest postures of the digits on a fixed prop, with [`CONVERGED_ITERATIONS`] outer iterations and shorter
/// and shorter steps.
fn refined_postures(hand: &Arc<Hand>, test: &StandTest) -> Vec<Value> {
    let closing = StandTest { releases_prop: false, grip_phases: Vec::new(), ..test.clone() };
    let standard = EngineSettings::default();
    STEP_DIVISORS
        .iter()
        .map(|&shorter| {
            let dt = standard.dt / f64::from(shorter);
            let run = run_own_engine(
                hand,
                &closing,
                EngineSettings { dt, solver_iterations: CONVERGED_ITERATIONS, ..standard },
            );
            let rest = run["angles"].as_array().and_then(|motion| motion.last());
            json!({ "rate": 1.0 / dt, "angles": rest, "closing_force_n": run["result"]["closing_force_n"] })
        })
        .collect()
}

/// Runs a test in the built-in engine. Returns the motion, the result, and the time per step.
fn run_own_engine(hand: &Arc<Hand>, test: &StandTest, settings: EngineSettings) -> Value {
    // MuJoCo's tendons have the same tension along their whole length.
    let mut stand = HandTestStand::with_friction(hand.clone(), settings, CableFriction::NONE);
    let prop = test.prop.as_ref().map(|(prop, pose)| stand.add_prop(prop.clone(), pose));
    if prop.is_none() {
        stand.set_gravity(&test.gravity);
    }
    let mut motion = vec![stand.angles().to_vec()];
    let mut wall = 0.0;
    let mut advance = |stand: &mut HandTestStand, phase: &CommandPhase, seconds: f64| {
        let goals = tension_goals(hand, &phase.tensions, phase.opposition);
        for _ in 0..(seconds / SAMPLE_INTERVAL).round() as usize {
            let start = Instant::now();
            stand.run(&goals, SAMPLE_INTERVAL);
            wall += start.elapsed().as_secs_f64();
            motion.push(stand.angles().to_vec());
        }
    };
    for phase in &test.phases {
        advance(&mut stand, phase, phase.seconds);
    }
    let sum = |stand: &HandTestStand| stand.contacts().iter().map(|contact| contact.force.norm()).sum::<f64>();
    let closed = sum(&stand);
    let mut result = json!({ "closing_force_n": closed });
    if let (true, Some(prop), Some(last)) = (test.releases_prop, prop, test.phases.last()) {
        stand.release_prop(prop);
        for phase in &test.grip_phases {
            advance(&mut stand, phase, phase.seconds);
        }
        stand.set_gravity(&test.gravity);
        advance(&mut stand, last, SETTLING_TIME);
        let before = stand.prop_pose(prop).translation.vector;
        advance(&mut stand, last, SLIP_TIME);
        let slip = (stand.prop_pose(prop).translation.vector - before).norm();
        let net: Vector3<f64> = stand.contacts().iter().map(|contact| contact.force).sum();
        result = json!({
            "closing_force_n": closed,
            "holding_force_n": sum(&stand),
            "slip_mm": slip * 1e3,
            "held": slip < 0.02,
            "net_normal_force_n": net.as_slice(),
            "penetration_mm": stand.prop_penetration(prop) * 1e3,
        });
    }
    let steps = stand.time() / settings.dt;
    json!({ "angles": motion, "result": result, "step_us": wall / steps * 1e6 })
}

/// Describes a test for the second engine, and adds the results of the built-in one: with the settings of hands without
/// an arm, with [`CONVERGED_ITERATIONS`] outer iterations, and, if requested, with these and shorter steps.
fn describe_test(hand: &Arc<Hand>, test: &StandTest, refine: bool) -> Value {
    let settings = EngineSettings::default();
    let told = |phase: &CommandPhase| json!({ "seconds": phase.seconds, "tensions": phase.tensions, "opposition": phase.opposition });
    json!({
        "name": test.name,
        "model": scene_file(test.name),
        "prop": test.prop.as_ref().map(|(prop, _)| prop.name.clone()),
        "prop_mass": test.prop.as_ref().map(|(prop, _)| prop.mass),
        "gravity": test.gravity.as_slice(),
        "let_go": test.releases_prop,
        "phases": test.phases.iter().map(told).collect::<Vec<_>>(),
        "gripping": test.grip_phases.iter().map(told).collect::<Vec<_>>(),
        "settle": SETTLING_TIME,
        "hold": SLIP_TIME,
        "ours": run_own_engine(hand, test, settings),
        "fine": run_own_engine(hand, test, EngineSettings { solver_iterations: CONVERGED_ITERATIONS, ..settings }),
        "refined": if refine && test.prop.is_some() { refined_postures(hand, test) } else { Vec::new() },
    })
}

/// Exports the whole scene, arm and hand above a table with two objects on it, to compare the speed.
fn export_whole_scene(robot: &RobotModel, folder: &Path) -> Result<Value> {
    let RobotModel { hand, arm, .. } = robot;
    let objects = ObjectSet::standard();
    let start = arm.home;
    let placed: Vec<(Arc<ObjectModel>, Isometry3<f64>)> = objects
        .iter()
        .filter(|object| !matches!(object.shape, ObjectShape::Mesh(_)))
        .take(2)
        .enumerate()
        .map(|(n, object)| {
            let at = Vector3::new(0.5, 0.15 * n as f64 - 0.075, object.rest_height());
            (object.clone(), Isometry3::from_parts(at.into(), object.rest))
        })
        .collect();
    let props: Vec<(Prop, Isometry3<f64>)> = placed
        .iter()
        .map(|(model, pose)| (Prop::new(&model.name, model.shape.clone(), model.mass, model.friction), *pose))
        .collect();
    let settings = EngineSettings::default();
    let model = CollisionModel::new(Arc::new(HandMechanism::from_hand(hand, "ftac")));
    let scene = MjcfScene {
        hand: &model,
        arm: Some((arm, start, hand)),
        props: &props,
        start: None,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        dt: settings.dt,
    };
    write_atomically(&folder.join("whole.xml"), mjcf::write(&scene).as_bytes())?;
    let setup = SceneSetup {
        objects: placed.into_iter().map(|(model, pose)| ObjectPlacement { model, pose }).collect(),
        engine: settings,
        ..SceneSetup::ideal(Isometry3::identity(), start)
    };
    let mut robot = SimulatedRobot::new(robot, &setup, TactileBoard::blank());
    let tensions = [4.0; 5];
    let servos = tension_goals(hand, &tensions, 0.5);
    let clock = Instant::now();
    let mut ticks = 0;
    while robot.observe().time < 3.0 {
        robot.send(&RobotCommand { arm: start, servos, capture: false });
        robot.wait_for_tick();
        ticks += 1;
    }
    let steps = f64::from(ticks) * robot.tick_length() / settings.dt;
    Ok(json!({
        "model": "whole.xml",
        "seconds": 3.0,
        "tensions": tensions,
        "opposition": 0.5,
        "ours": { "step_us": clock.elapsed().as_secs_f64() / steps * 1e6, "angles": robot.truth().hand },
    }))
}

/// Writes the scenes to `folder`: one MJCF file each, and `scenes.json`. `friction` is the coefficient of ball,
/// cylinder and box. `refine` adds closings with shorter steps, which take a minute.
pub fn export(robot: &RobotModel, folder: &Path, friction: f64, refine: bool) -> Result<()> {
    let hand = &robot.hand;
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let settings = EngineSettings::default();
    let model = CollisionModel::new(Arc::new(HandMechanism::from_hand(hand, "ftac")));
    let mut scenes = Vec::new();
    for test in stand_tests(hand, friction) {
        let props: Vec<_> = test.prop.iter().cloned().collect();
        // A fixed prop is not subject to gravity, which is turned on with the release.
        let gravity = if test.prop.is_some() { Vector3::zeros() } else { test.gravity };
        let scene = MjcfScene { hand: &model, arm: None, props: &props, start: None, gravity, dt: settings.dt };
        write_atomically(&folder.join(scene_file(test.name)), mjcf::write(&scene).as_bytes())?;
        scenes.push(describe_test(hand, &test, refine));
    }
    let servo = hand.parameters.servo;
    let cable = hand.parameters.cable;
    let text = json!({
        "sample": SAMPLE_INTERVAL,
        "rate": 1.0 / settings.dt,
        "joints": hand.tree.joints.iter().map(|joint| joint.name.clone()).collect::<Vec<_>>(),
        "cables": hand.parameters.actuator.iter().take(5).map(|actuator| actuator.name.clone()).collect::<Vec<_>>(),
        "servo": {
            "torque_constant": servo.torque_constant, "stall_torque": servo.stall_torque,
            "no_load_speed": servo.no_load_speed, "current_limit": servo.current_limit,
            "rotor_inertia": servo.rotor_inertia, "damping": servo.damping,
        },
        "shaft_stiffness": sim::drive::OPPOSITION_STIFFNESS,
        "cable": { "spool_radius": cable.spool_radius, "stiffness": cable.stiffness },
        "scenes": scenes,
        "whole": export_whole_scene(robot, folder)?,
    });
    Ok(write_atomically(&folder.join("scenes.json"), serde_json::to_string_pretty(&text)?.as_bytes())?)
}
