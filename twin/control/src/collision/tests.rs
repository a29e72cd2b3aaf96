use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::trajectory::PathLimits;

fn path(poses: &[Isometry3<f64>]) -> PosePath {
    PosePath::fastest(poses, PathLimits::default()).expect("valid")
}

fn check(path: &PosePath, moving: &[Solid], fixed: &[Solid]) -> Clearance {
    clearance_along(path, moving, fixed, 2000).expect("supported").expect("a pair")
}

#[test]
fn sphere_passes_sphere() {
    let ball = |name: &str, r, pose| Solid::new(name, SharedShape::ball(r), pose);
    let way = path(&[Isometry3::translation(-0.3, 0.0, 0.0), Isometry3::translation(0.4, 0.0, 0.0)]);
    let moving = [ball("held", 0.02, Isometry3::identity())];
    let fixed = [
        ball("target", 0.03, Isometry3::translation(0.05, 0.0, 0.08)),
        ball("far", 0.01, Isometry3::translation(0.0, 2.0, 0.0)),
    ];
    let found = check(&way, &moving, &fixed);
    assert!((0.03 - 1e-9..0.03 + CLEARANCE_TOLERANCE).contains(&found.min_distance), "{found:?}");
    assert!((way.sample(found.time).0.translation.x - 0.05).abs() < 0.01);
    assert_eq!((found.moving.as_str(), found.fixed.as_str()), ("held", "target"));
    assert!(found.queries < 150, "{found:?}");
    let through = check(&way, &moving, &[ball("target", 0.03, Isometry3::translation(0.05, 0.0, 0.01))]);
    assert!((through.min_distance + 0.04).abs() < CLEARANCE_TOLERANCE, "{through:?}");
}

/// The lowest point of a box that turns onto its edge while it goes down is known.
#[test]
fn box_over_table() {
    let down = Isometry3::new(Vector3::new(0.2, 0.0, 0.1), Vector3::x() * std::f64::consts::FRAC_PI_4);
    let way = path(&[Isometry3::translation(0.0, 0.0, 0.4), down, Isometry3::translation(0.0, 0.0, 0.4)]);
    let solid = Solid::rounded_box("box", Vector3::new(0.03, 0.03, 0.03), 0.005, Isometry3::identity());
    let found = check(&way, std::slice::from_ref(&solid), &[Solid::table(0.0)]);
    let expected = 0.1 - 0.025 * 2f64.sqrt() - 0.005;
    assert!((found.min_distance - expected).abs() < CLEARANCE_TOLERANCE, "{found:?} {expected}");
    let sunk = check(&way, &[solid], &[Solid::table(0.08)]);
    assert!((sunk.min_distance - expected + 0.08).abs() < CLEARANCE_TOLERANCE, "{sunk:?}");
}

/// A long lever passes a post only in the middle of a turn on the spot, which neither end pose shows.
#[test]
fn turning_lever_is_caught() {
    let way = path(&[Isometry3::identity(), Isometry3::rotation(Vector3::z() * FRAC_PI_2)]);
    let lever = Solid::new("lever", SharedShape::cuboid(0.1, 0.002, 0.002), Isometry3::translation(0.1, 0.0, 0.0));
    let at = Vector3::new(0.19, 0.0, 0.0);
    let post = Solid::new(
        "post",
        SharedShape::cylinder(0.05, 0.002),
        Isometry3::rotation(Vector3::z() * 0.8) * Isometry3::new(at, Vector3::x() * FRAC_PI_2),
    );
    let found = clearance_along(&way, &[lever], &[post], 2000).expect("supported").expect("a pair");
    assert!((found.min_distance + 0.004).abs() < CLEARANCE_TOLERANCE, "{found:?}");
}

#[test]
fn meshes_compounds_and_no_pairs() {
    let vertices = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(|v| Vector::from(v) * 0.1);
    let mesh = SharedShape::trimesh(vertices.to_vec(), vec![[0, 1, 2]]).expect("mesh");
    let mesh = Solid::new("mesh", mesh, Isometry3::translation(0.0, 0.0, 0.2));
    let two = SharedShape::compound(vec![
        (Pose::translation(0.0, 0.0, 0.05), SharedShape::ball(0.01)),
        (Pose::translation(0.0, 0.0, -0.03), SharedShape::cylinder(0.02, 0.01)),
    ]);
    let two = Solid::new("two", two, Isometry3::translation(0.0, 0.0, 0.1));
    let at = Isometry3::identity();
    let of = |a: &Solid, b: &Solid| {
        clearance_at(&at, std::slice::from_ref(a), std::slice::from_ref(b))
            .expect("supported")
            .expect("a pair")
            .min_distance
    };
    assert!((of(&two, &mesh) - 0.04).abs() < 1e-9);
    assert!((of(&two, &Solid::table(0.0)) - 0.06).abs() < 1e-9);
    assert!((of(&mesh, &Solid::table(0.25)) + 0.05).abs() < 1e-9);
    assert_eq!(clearance_at(&at, &[], &[mesh]).expect("fine"), None);
    assert!(clearance_at(&at, &[Solid::table(0.0)], &[two]).is_err());
}

#[test]
fn hand_over_table() {
    let hand = Hand::ftac();
    let all =
        hand_solids(&hand, &[0.0; 15], &[Digit::Thumb, Digit::Index, Digit::Middle, Digit::Ring, Digit::Little], true);
    assert_eq!(all.len(), 16);
    let index = hand_solids(&hand, &[0.5; 15], &[Digit::Index], false);
    assert_eq!(index.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["index_1", "index_2", "index_3"]);
    // Palm down, fingers straight: the lower face of the palm's cover is its lowest point among palm and index.
    let at = Isometry3::translation(0.0, 0.0, 0.3);
    let palm = hand_solids(&hand, &[0.0; 15], &[], true);
    let found = clearance_at(&at, &palm, &[Solid::table(0.0)]).expect("supported").expect("a pair");
    assert!(
        (found.min_distance - (0.3 + hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z)).abs()
            < 1e-9
    );
}

/// Cost of a typical check: the whole hand with a held bottle, over a table with three objects.
#[test]
fn typical_motion_is_quick() {
    let hand = Hand::ftac();
    let mut moving = hand_solids(&hand, &[0.5; 15], &Digit::ALL, true);
    moving.push(Solid::new("held", SharedShape::cylinder(0.08, 0.03), Isometry3::translation(0.0, 0.02, -0.05)));
    let at = |x, y, z| Isometry3::translation(x, y, z);
    let hull: Vec<Vector> = (0..60)
        .map(|i| Vector::new((i as f64 * 0.7).cos(), (i as f64 * 0.7).sin(), i as f64 / 30.0 - 1.0) * 0.04)
        .collect();
    let fixed = [
        Solid::table(0.0),
        Solid::new("ball", SharedShape::ball(0.035), at(0.1, 0.3, 0.035)),
        Solid::new("box", SharedShape::cuboid(0.03, 0.05, 0.06), at(-0.15, 0.3, 0.06)),
        Solid::new("hull", SharedShape::convex_hull(&hull).expect("hull"), at(0.0, 0.45, 0.04)),
    ];
    let turned = Isometry3::new(Vector3::new(0.05, 0.3, 0.2), Vector3::y() * 1.0);
    let way = path(&[at(0.0, 0.0, 0.25), at(0.0, 0.0, 0.4), turned]);
    let start = std::time::Instant::now();
    let found = check(&way, &moving, &fixed);
    println!("{found:?} in {:.2} ms", start.elapsed().as_secs_f64() * 1e3);
    // No time on a fine grid gives a smaller distance.
    for n in 0..=400 {
        let (pose, _) = way.sample(way.duration() * n as f64 / 400.0);
        let grid = clearance_at(&pose, &moving, &fixed).expect("supported").expect("a pair");
        assert!(grid.min_distance >= found.min_distance - CLEARANCE_TOLERANCE, "{grid:?}");
    }
}
