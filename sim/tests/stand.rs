//! The stand's physics: energy of a free chain, momentum in a collision, branching, and equal bits on every thread.

use std::sync::Arc;

use hand_model::hand::MassProperties;
use hand_model::kinematics::{Joint, JointKind, Tree};
use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use sim::drive::JointEffort;
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Linkage, LinkageModel, Prop, tension_goals};
use world::ObjectShape;

/// A chain of three rods that swings freely about y conserves its energy.
#[test]
fn a_free_pendulum_chain_keeps_its_energy() {
    let (length, mass) = (0.1, 0.05);
    let joint = |parent: Option<usize>| Joint {
        name: "swing".into(),
        parent,
        kind: JointKind::Turn,
        origin: Isometry3::translation(if parent.is_some() { length } else { 0.0 }, 0.0, 0.0),
        axis: Vector3::y_axis(),
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
    };
    let tree = Tree { joints: vec![joint(None), joint(Some(0)), joint(Some(1))] };
    let rod = MassProperties {
        mass,
        com: Point3::new(0.5 * length, 0.0, 0.0),
        inertia: Matrix3::from_diagonal(&Vector3::new(1e-7, 1.0, 1.0).map(|part| part * mass * length * length / 12.0)),
    };
    let masses = [rod; 3];
    let settings = EngineSettings { dt: 1.0 / 4000.0, ..EngineSettings::default() };
    let mechanism =
        LinkageModel { tree: &tree, masses: &masses, damping: &[0.0; 3], armature: &[0.0; 3], separate_roots: false };
    let mut chain = Linkage::new(settings, &mechanism, Vec::new(), &[0.3, 0.4, -0.2]);
    let g = 9.81;
    chain.set_gravity(&Vector3::new(0.0, 0.0, -g));
    let energy = |chain: &Linkage| -> f64 {
        let links = tree.forward(chain.angles());
        (0..3)
            .map(|link| {
                let jacobian = tree.jacobian(&links, link, &masses[link].com);
                let twist = jacobian * nalgebra::DVector::from_row_slice(chain.speeds());
                let (v, w) = (twist.fixed_rows::<3>(0).into_owned(), twist.fixed_rows::<3>(3).into_owned());
                let turn = links[link].rotation.to_rotation_matrix();
                let inertia = turn * masses[link].inertia * turn.transpose();
                let height = (links[link] * masses[link].com).z;
                0.5 * mass * v.norm_squared() + 0.5 * w.dot(&(inertia * w)) + mass * g * height
            })
            .sum()
    };
    let start = energy(&chain);
    // Energy range that can turn into motion: from the start to hanging straight down.
    let range = start + mass * g * length * (0.5 + 1.5 + 2.5);
    let none = [JointEffort { torque: 0.0, stiffness: 1e-12 }; 3];
    let mut farthest = 0.0f64;
    let mut swing = 0.0f64;
    for _ in 0..4000 {
        chain.step(&none);
        farthest = farthest.max((energy(&chain) - start).abs());
        swing = swing.max((chain.angles()[0] - 0.3).abs());
    }
    println!("energy off by {:.2} % of the range, swing {swing} rad", 100.0 * farthest / range);
    assert!(swing > 0.5, "it swings: {swing}");
    assert!(farthest < 0.02 * range, "{farthest} J of {range} J");
}

fn grip(hand: &Arc<Hand>) -> (HandTestStand, ActuatorVector<ServoGoal>) {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    stand.add_prop(
        Prop::new("ball", ObjectShape::Sphere { radius: 0.03 }, 0.06, 0.8),
        &Isometry3::translation(0.0, 0.0, -0.015),
    );
    let goals = tension_goals(hand, &[12.0; 5], 1.0);
    stand.run(&goals, 0.8);
    stand.release_prop(0);
    stand.set_gravity(&Vector3::new(0.0, 0.0, -9.81));
    (stand, goals)
}

/// Returns the bits of everything that moves.
fn bits(stand: &HandTestStand) -> Vec<u64> {
    let pose = stand.prop_pose(0);
    let place = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
    stand.angles().iter().chain(place).chain(&stand.tensions()).map(|value| value.to_bits()).collect()
}

/// A branch continues exactly like the run from which it was taken.
#[test]
fn a_branch_is_the_run_itself() {
    let hand = Arc::new(Hand::ftac());
    let (mut stand, goals) = grip(&hand);
    let mut branch = stand.clone();
    stand.run(&goals, 0.5);
    branch.run(&goals, 0.5);
    assert_eq!(bits(&stand), bits(&branch));
}

/// Four concurrent threads give the same bits as one alone.
#[test]
fn threads_change_nothing() {
    let hand = Arc::new(Hand::ftac());
    let run = || {
        let (mut stand, goals) = grip(&hand);
        stand.run(&goals, 0.3);
        bits(&stand)
    };
    let alone = run();
    let together: Vec<Vec<u64>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(run)).collect();
        threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    assert!(together.iter().all(|bits| *bits == alone));
}

/// A prop released far from the hand falls freely according to Newton.
#[test]
fn free_fall() {
    let hand = Arc::new(Hand::ftac());
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    stand.add_prop(
        Prop::new("ball", ObjectShape::Sphere { radius: 0.02 }, 0.1, 0.5),
        &Isometry3::translation(0.0, 0.0, -0.3),
    );
    stand.release_prop(0);
    stand.set_gravity(&Vector3::new(0.0, 0.0, -9.81));
    stand.run(&tension_goals(&hand, &[0.0; 5], 0.0), 0.5);
    let fallen = -0.3 - stand.prop_pose(0).translation.z;
    // Semi-implicit Euler is ahead by half a step's distance.
    assert!((fallen - 0.5 * 9.81 * 0.25).abs() < 0.012, "{fallen}");
}

/// Two balls that collide off centre, with friction, exchange linear and angular momentum without loss.
#[test]
fn a_collision_keeps_momentum() {
    use rapier3d_f64::prelude::*;
    let mut engine = sim::engine::Engine::new(EngineSettings::default());
    engine.gravity = Vector::ZERO;
    let mut ball = |x: f64, y: f64, speed: Vector, mass: f64, radius: f64| {
        let spread = Matrix::from_diagonal(Vector::splat(0.4 * mass * radius * radius));
        let inertia = MassProperties::with_inertia_matrix(Vector::ZERO, mass, spread);
        let place = Pose::from_translation(Vector::new(x, y, 0.0));
        let body = RigidBodyBuilder::dynamic().pose(place).linvel(speed).additional_mass_properties(inertia);
        let body = engine.bodies.insert(body.can_sleep(false));
        let collider = ColliderBuilder::ball(radius).density(0.0).friction(0.6);
        engine.colliders.insert_with_parent(collider, body, &mut engine.bodies);
        (body, mass, 0.4 * mass * radius * radius)
    };
    let balls = [
        ball(-0.06, 0.0, Vector::new(0.4, 0.0, 0.0), 0.1, 0.02),
        ball(0.0, 0.012, Vector::new(-0.1, 0.05, 0.02), 0.3, 0.03),
    ];
    let momenta = |engine: &sim::engine::Engine| {
        let mut sum = (Vector::ZERO, Vector::ZERO);
        for (handle, mass, inertia) in balls {
            let body = &engine.bodies[handle];
            sum.0 += body.linvel() * mass;
            sum.1 += body.translation().cross(body.linvel() * mass) + body.angvel() * inertia;
        }
        sum
    };
    let before = momenta(&engine);
    for _ in 0..120 {
        engine.step();
    }
    let after = momenta(&engine);
    let first = engine.bodies[balls[0].0].linvel();
    assert!((first - Vector::new(0.4, 0.0, 0.0)).length() > 0.1, "they met: {first}");
    assert!((after.0 - before.0).length() < 1e-12, "{} {}", before.0, after.0);
    // The engine applies the impulses at points that are a contact's gap apart, so angular momentum is conserved less
    // accurately.
    assert!((after.1 - before.1).length() < 0.05 * before.1.length(), "{} {}", before.1, after.1);
}

/// A joint pushed against a limit stops there, for any number of outer iterations per step, and leaves it when pushed
/// back.
#[test]
fn a_limit_stops_a_joint() {
    let joint = Joint {
        name: "door".into(),
        parent: None,
        kind: JointKind::Turn,
        origin: Isometry3::identity(),
        axis: Vector3::z_axis(),
        lower: -0.2,
        upper: 0.5,
    };
    let tree = Tree { joints: vec![joint] };
    let masses = [MassProperties { mass: 0.05, com: Point3::new(0.05, 0.0, 0.0), inertia: Matrix3::identity() * 4e-5 }];
    for solver_iterations in [1, 4] {
        let settings = EngineSettings { solver_iterations, ..EngineSettings::default() };
        let mechanism =
            LinkageModel { tree: &tree, masses: &masses, damping: &[1e-3], armature: &[1e-4], separate_roots: false };
        let mut endpoint = Linkage::new(settings, &mechanism, Vec::new(), &[0.0]);
        for (torque, limit) in [(0.05, 0.5), (-0.05, -0.2), (0.05, 0.5)] {
            for _ in 0..240 {
                endpoint.step(&[JointEffort { torque, stiffness: 1e-3 }]);
            }
            let angle = endpoint.angles()[0];
            assert!((angle - limit).abs() < 0.02, "{solver_iterations} iterations, {torque} N m: {angle}, not {limit}");
        }
    }
}

/// A bar held by four fingers creeps if friction is left to the solver, and stays with friction anchors.
#[test]
fn a_held_bar_does_not_creep_where_it_sticks() {
    let hand = Arc::new(Hand::ftac());
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    let place = Isometry3::from_parts(Vector3::new(0.0026, 0.013, skin - 0.0165).into(), across);
    let slip = |settings| {
        let mut stand = HandTestStand::new(hand.clone(), settings);
        let bar = stand.add_prop(Prop::dumbbell(0.016, 0.12, 0.045, 0.045, 2.5), &place);
        let [goals, hard] = [60.0, 100.0].map(|pull| tension_goals(&hand, &[0.0, pull, pull, pull, pull], 0.0));
        stand.run(&goals, 1.5);
        stand.release_prop(bar);
        stand.run(&goals, 1.0);
        // Gripping hard brings bar and phalanges to rest.
        for _ in 0..6 {
            stand.run(&hard, 0.5);
            stand.run(&goals, 0.5);
        }
        stand.set_gravity(&Vector3::new(0.0, 9.81, 0.0));
        stand.run(&goals, 1.0);
        let before = stand.prop_pose(bar);
        stand.run(&goals, 5.0);
        (stand.prop_pose(bar).translation.vector - before.translation.vector).norm()
    };
    let default = EngineSettings::default();
    let (creeping, sticking) = (slip(EngineSettings { bristle_friction: None, ..default }), slip(default));
    assert!(sticking < 5e-5 && creeping > 4.0 * sticking, "{creeping} m, {sticking} m");
}
