use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::field::tests::ball;
use super::*;

fn random_state(rng: &mut ChaCha8Rng) -> HandState {
    let mut draw = |low: f64, high: f64| rng.random_range(low..high);
    let rotation = UnitQuaternion::from_euler_angles(draw(-0.5, 0.5), draw(-0.5, 0.5), draw(-3.0, 3.0));
    let place = Translation3::new(draw(-0.03, 0.03), draw(-0.05, 0.03), draw(0.01, 0.06));
    HandState {
        object_from_palm: Isometry3::from_parts(place, rotation),
        joints: (0..15).map(|_| draw(-0.2, 1.7)).collect(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// All terms at once, in deep penetration, over a table, out of limits.
    #[test]
    fn gradient_is_finite_differences(seed in 0u64..10_000) {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 800);
        let field = ball(0.03);
        let table = TablePlane { normal: Vector3::z_axis(), offset: -0.03 };
        let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), Some(table));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let state = random_state(&mut rng);
        let contacts: Vec<usize> = (0..5).map(|_| rng.random_range(0..surface.candidates.len())).collect();
        let mut frames = LinkFrames::new(&hand.tree);
        let (mut gradient, mut unused) = ([0.0; 21], [0.0; 21]);
        let here = energy.evaluate(&state, &contacts, &mut frames, &mut gradient);
        prop_assert!(here.total.is_finite());
        let mut along = [0.0; 21];
        for value in &mut along { *value = rng.random_range(-1.0..1.0) * 0.05; }
        for value in &mut along[6..] { *value *= 4.0; }
        // Kinks (a point entering the object, a cell's border) make one-sided slopes differ: the central difference over a
        // tiny step must lie between them, and shrink to the analytic slope away from kinks.
        let mut at = |h: f64| {
            let by: Vec<f64> = along.iter().map(|x| x * h).collect();
            energy.evaluate(&state.moved(&by), &contacts, &mut frames, &mut unused).total
        };
        let slope: f64 = gradient.iter().zip(&along).map(|(g, d)| g * d).sum();
        let h = 1e-5;
        let (forth, back) = ((at(h) - here.total) / h, (here.total - at(-h)) / h);
        let tolerance = 0.01 * slope.abs().max(0.05) + (forth - back).abs();
        prop_assert!((0.5 * (forth + back) - slope).abs() < tolerance, "{} {} {}", slope, forth, back);
    }
}

/// Skipping far links and patches changes nothing, compared with evaluating every point.
#[test]
fn early_out_is_exact() {
    let hand = Hand::ftac();
    let surface = HandSurface::new(&hand, 2000);
    let field = ball(0.03);
    let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut frames = LinkFrames::new(&hand.tree);
    let mut met = 0;
    for _ in 0..40 {
        let state = random_state(&mut rng);
        let terms = energy.evaluate(&state, &[0, 1, 2], &mut frames, &mut [0.0; 21]);
        let mut depth = 0.0;
        for (link, own) in surface.links.iter().enumerate() {
            for p in &own.points {
                depth += (-field.distance(&frames.point(link, p))).max(0.0);
            }
        }
        met += usize::from(depth > 0.0);
        assert!((terms.penetration - energy.point_weight * depth).abs() < 1e-9 * (1.0 + terms.penetration));
    }
    assert!(met > 20, "the test meets penetration");
}

/// Joints that turn in opposite directions on one line, like a gripper's: the posture term's gradient agrees with finite
/// differences, and joints on their line cost nothing.
#[test]
fn lines_of_mixed_sense() {
    use super::super::mechanism::ActuatorLine;
    let hand = Hand::ftac();
    let surface = HandSurface::new(&hand, 300);
    let field = ball(0.03);
    let line = ActuatorLine { joints: vec![0, 3, 7], share: vec![1.0, -0.5, 1.5], offset: vec![0.0, 0.1, 0.0] };
    let mechanism = Mechanism { limits: vec![(-2.0, 2.0); 15], scale: vec![1.0; 15], lines: vec![line] };
    let energy = GraspEnergy::from_mechanism(mechanism, &surface, &field, EnergyWeights::default(), None);
    let at = |joints: &[f64], gradient: &mut [f64]| {
        let state = HandState { object_from_palm: Isometry3::identity(), joints: joints.to_vec() };
        let mut terms = EnergyTerms::default();
        energy.posture(&state, gradient, &mut terms);
        terms.posture
    };
    let mut joints = [0.1; 15];
    let (mut gradient, mut unused) = ([0.0; 21], [0.0; 21]);
    at(&joints, &mut gradient);
    for joint in [0, 3, 7] {
        let h = 1e-6;
        let (mut forth, mut back) = (joints, joints);
        forth[joint] += h;
        back[joint] -= h;
        let slope = (at(&forth, &mut unused) - at(&back, &mut unused)) / (2.0 * h);
        assert!((slope - gradient[6 + joint]).abs() < 1e-6, "{joint}: {slope} {}", gradient[6 + joint]);
    }
    // 0.2 along the line; the second joint's offset is 0.1.
    (joints[0], joints[3], joints[7]) = (0.2, 0.0, 0.3);
    assert!(at(&joints, &mut unused) < 1e-12);
}
