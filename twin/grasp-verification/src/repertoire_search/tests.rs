use hand_model::RobotModel;
use nalgebra::{Isometry3, UnitQuaternion};
use scenarios::Scenario;
use world::geometry::ObjectShape;

use super::*;

fn object(name: &str) -> ObjectModel {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).expect("the world");
    (*world.object(name).expect("known")).clone()
}

/// The half sizes of a box are along the axes of the world in which it rests, not of its own frame.
#[test]
fn extents_are_those_of_the_resting_object() {
    let half = Vector3::new(0.01, 0.02, 0.03);
    let upright = ObjectModel { shape: ObjectShape::Cuboid { half, radius: 0.0 }, ..object("golf_ball") };
    let standing = object_extent(&ObjectModel { rest: UnitQuaternion::identity(), ..upright.clone() });
    assert!((standing.half - half).norm() < 1e-9, "{}", standing.half);
    // Tipped about x: its y edge stands.
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let tipped = object_extent(&ObjectModel { rest: quarter, ..upright });
    assert!((tipped.half - Vector3::new(0.01, 0.03, 0.02)).norm() < 1e-9, "{}", tipped.half);
}

/// Balls have one radius in all directions and no yaw. Objects that have a yaw are searched over it.
#[test]
fn yaw_matters_unless_the_object_is_a_ball() {
    let ball = object("golf_ball");
    let found = object_extent(&ball);
    let radius = ball.shape.bounding_radius();
    assert!((found.half - Vector3::repeat(radius)).norm() < 1e-6, "{} {radius}", found.half);
    assert!(!found.yaw_matters);
    let turned = ObjectModel { symmetry: Symmetry::None, ..ball };
    assert!(object_extent(&turned).yaw_matters);
}

/// The height of a resting object's centre is its vertical extent, for every object of the benchmark.
#[test]
fn the_vertical_extent_is_the_rest_height() {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).expect("the world");
    for name in world.scenario.object_names() {
        let object = world.object(&name).expect("known");
        let pose = Isometry3::from_parts(Vector3::z().scale(object.rest_height()).into(), object.rest);
        let (vertices, ..) = object.shape.triangles();
        let lowest = vertices.iter().map(|vertex| (pose * vertex).z).fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 1.5e-3, "{name}: its lowest point is {lowest} m above the table");
        assert_eq!(object_extent(&object).half.z, object.rest_height());
    }
}

fn grasp(id: u32, score: f64, x: f64) -> Grasp {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let any = repertoire.for_digits("golf_ball", &[Digit::Thumb, Digit::Index, Digit::Middle]).next().expect("a grasp");
    Grasp { id, score, center: [x, 0.0, -0.05], ..any.clone() }
}

/// The best grasp of each neighbourhood stays. The list is in order of score, and the neighbours of a kept grasp are
/// removed.
#[test]
fn neighbours_are_thinned_out() {
    let mut all = vec![grasp(1, 0.5, 0.0), grasp(2, 0.9, 0.003), grasp(3, 0.5, 0.02), grasp(0, 0.5, 0.04)];
    sort_by_score(&mut all);
    assert_eq!(all.iter().map(|grasp| grasp.id).collect::<Vec<_>>(), [2, 0, 1, 3]);
    let kept: Vec<u32> = keep_distinct(all.clone(), 9).iter().map(|grasp| grasp.id).collect();
    assert_eq!(kept, [2, 0, 3], "1 is 3 mm from 2");
    assert_eq!(keep_distinct(all, 2).len(), 2);
}

/// A grasp's score is the share of tries that held. A grasp that fails too often, or without any error, is dropped at
/// once.
#[test]
fn scores_are_shares_of_tries() {
    let held = HoldOutcome {
        held: true,
        palm_from_object: Isometry3::identity(),
        slip: 0.0,
        joints: Vec::new(),
        contacts: Vec::new(),
    };
    let errors = verification_errors(4);
    let failing = |count: usize| {
        let held = held.clone();
        let errors = errors.clone();
        move |_: &Grasp, noise: &TrialNoise| {
            let fails = errors.iter().take(count).any(|bad| bad == noise);
            Ok((!fails).then(|| held.clone()))
        }
    };
    let score = |bad: usize, failures: usize| {
        let verified = verify_grasp(grasp(1, 0.0, 0.0), &errors, failures, &failing(bad)).expect("tried");
        verified.map(|grasp| grasp.score)
    };
    assert_eq!(score(0, 0), Some(1.0));
    assert_eq!(score(2, 4), Some(0.6));
    assert_eq!(score(2, 1), None);
    let never = |_: &Grasp, _: &TrialNoise| Ok(None);
    assert!(verify_grasp(grasp(1, 0.0, 0.0), &errors, 4, &never).expect("tried").is_none());
}
