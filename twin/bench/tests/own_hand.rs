//! Perception distinguishes contact of the hand with itself from contact with objects, in hand postures from physics.

use bench::builtin::make_bench;
use bench::trial::Bench;
use control::perception::{ExpectedHold, HoldEvidence, HoldState, KnownObject, default_prior};
use control::tactile_snapshot::TactileSnapshot;
use hand_model::robot::{Observation, RobotCommand, ServoState};
use hand_model::{Digit, DigitVector, RobotModel};
use scenarios::Scenario;
use scenarios::effects::Effects;
use scenarios::noise::TrialNoise;
use sim::SimulatedRobot;
use sim::tactile::BrightnessDrift;
use tactile_perception::{ExpectedObject, PadTouch, Readings};

/// The benchmark's first combinations with only the effect of the pads.
fn pads_only(combos: usize) -> Bench {
    let mut scenario = Scenario::benchmark();
    scenario.effects = Effects { pads: scenario.effects.pads, ..Effects::default() };
    assert!(scenario.effects.pads.is_some_and(|pads| pads.self_contact));
    make_bench(&RobotModel::ftac_gen3(), scenario, combos, 1, true).expect("the built-in benchmark")
}

/// Returns the touches of the empty hand over the table as it pulls with `tensions` (N), the thumb last and opposed by
/// `opposition` (rad).
fn closed_on_nothing(
    bench: &Bench,
    tensions: DigitVector,
    opposition: f64,
) -> (Vec<PadTouch>, Observation, SimulatedRobot) {
    let (world, hand) = (&bench.world, &bench.world.cell.robot.hand);
    let drift = BrightnessDrift::new(vec![0.03; hand.cameras.len()], 30.0);
    let board = bench.cameras.with_noise(5).drifting(drift);
    let backgrounds = board.background_frames();
    let scene = world.bare_scene(world.cell.ready_posture, &TrialNoise::none());
    let mut robot = SimulatedRobot::new(&world.cell.robot, &scene, board);
    for tick in 0..360 {
        let thumb = if tick < 150 { 0.0 } else { tensions[0] };
        let tensions = [thumb, tensions[1], tensions[2], tensions[3], tensions[4]];
        let servos = hand.servo_goals(&tensions, opposition, hand.parameters.servo.current_limit);
        robot.send(&RobotCommand { arm: world.cell.ready_posture, servos, capture: tick == 359 });
        robot.wait_for_tick();
    }
    let seen = robot.observe();
    let pipeline = bench.pipeline.with_backgrounds(backgrounds).expect("a background of each camera");
    let snapshot = TactileSnapshot {
        images: &seen.tactile,
        sequences_before: &[],
        readings: Readings::without_gravity(&seen.servos),
    };
    let touches = pipeline.perceive_frames(snapshot.images, snapshot.sequences_before).expect("images").touches;
    (touches, seen, robot)
}

/// Returns the hold state perceived from pads and cables.
fn perceived_hold_state(
    bench: &Bench,
    touches: &[PadTouch],
    servos: &[ServoState],
    objects: &[ExpectedHold],
) -> HoldState {
    let hand = &bench.world.cell.robot.hand;
    let (q, sigma) = (&hand.open_angles()[..], bench.pipeline.pose.sigma_excursion);
    let limits = &hand.parameters.hold().expect("signs of a hold");
    HoldState::from_evidence(hand, &HoldEvidence { limits, touches, servos, q, objects, on_first: &[], sigma })
}

/// The thumb lies on the index finger and the hand is empty, although the grasp pair has objects there: pads are
/// pressed and no object is held.
#[test]
fn a_thumb_on_the_index_finger_is_no_object() {
    let bench = pads_only(1);
    let grasps = bench.grasp_pairs.pairs[0].grasps(&bench.world.cell.robot.hand, &bench.repertoire).expect("a plan");
    let objects = [&bench.grasp_pairs.pairs[0].first, &bench.grasp_pairs.pairs[0].second]
        .map(|name| KnownObject::new(bench.world.object(name).expect("an object")));
    let (first, second) = (&grasps.first, &grasps.second_candidates[0].grasp);
    let in_hand: Vec<ExpectedObject> = [first, second]
        .iter()
        .zip(&objects)
        .filter_map(|(grasp, object)| Some(ExpectedObject { shape: object, prior: default_prior(grasp.held?) }))
        .collect();
    assert_eq!(in_hand.len(), 2);
    let thumb_and_index = ([10.0, 10.0, 0.0, 0.0, 0.0], 1.0);
    let fists = [0.0, 0.3, 0.6, 1.0, 1.3].map(|opposition| ([8.0; 5], opposition));
    let (mut loaded, mut own, mut patches) = (0, 0, 0);
    for (tensions, opposition) in std::iter::once(thumb_and_index).chain(fists) {
        let (mut touches, seen, robot) = closed_on_nothing(&bench, tensions.into(), opposition);
        loaded += usize::from(robot.self_loads().iter().any(|load| load.force > 0.2));
        bench
            .pipeline
            .mark_self_contacts(&mut touches, Readings::without_gravity(&seen.servos), &in_hand)
            .expect("marked");
        let all = || touches.iter().flat_map(|touch| &touch.patches);
        (own, patches) = (own + all().filter(|patch| patch.self_contact).count(), patches + all().count());
        let grip = perceived_hold_state(&bench, &touches, &seen.servos, &[first, second].map(ExpectedHold::from_grasp));
        assert!(!grip.holds(0), "{tensions:?}, {opposition}: the hand's own contact is taken for the first object");
    }
    assert!(loaded >= 2 && patches >= 4, "too few contacts to judge: {loaded} postures, {patches} patches");
    assert!(4 * own >= 3 * patches, "{own} of {patches} patches are recognized as self-contact");
}

/// Of a held object, almost nothing is mistaken for self-contact: its pose is estimated as before.
#[test]
fn a_held_object_is_felt_as_before() {
    // First objects that two fingers and the palm enclose: balls, a box, a polyhedron, a peanut.
    const COMBINATIONS: [usize; 6] = [1, 5, 6, 12, 14, 22];
    let bench = pads_only(23);
    let (mut held, mut marked, mut patches) = (0, 0, 0);
    let mut errors = [Vec::new(), Vec::new()];
    for combination in COMBINATIONS {
        let Some(grasp) = bench.held_grasp(combination, 0).expect("run") else { continue };
        held += 1;
        let known = &bench.known_objects[&grasp.object];
        let mut board = bench.cameras.with_noise(combination as u64);
        let objects = [(&known.model.shape, grasp.truth)];
        let hand = &bench.world.cell.robot.hand;
        let frames = board.capture(hand, 0.0, &grasp.pads, &grasp.forces, &objects);
        let mut touches = bench.pipeline.perceive_frames(&frames, &[]).expect("images").touches;
        let (servos, prior) = (grasp.servos(), grasp.prior);
        let readings = grasp.readings(&servos);
        for (n, errors) in errors.iter_mut().enumerate() {
            let estimate = bench.pipeline.estimate_pose(&touches, readings, &prior, known).expect("a pose");
            let apart = estimate.palm_from_object.translation.vector - grasp.truth.translation.vector;
            errors.push(apart.norm());
            if n == 0 {
                bench
                    .pipeline
                    .mark_self_contacts(&mut touches, readings, &[ExpectedObject { shape: known, prior }])
                    .expect("marked");
            }
        }
        patches += touches.iter().map(|touch| touch.patches.len()).sum::<usize>();
        marked += touches.iter().flat_map(|touch| &touch.patches).filter(|patch| patch.self_contact).count();
        let first = ExpectedHold { digits: &[Digit::Ring, Digit::Little], joints: None };
        assert!(perceived_hold_state(&bench, &touches, &servos, &[first]).holds(0), "combination {combination}");
    }
    assert!(held >= 4 && patches > 2 * held, "{held} {patches}");
    assert!(20 * marked <= patches, "{marked} of {patches} patches are mistaken for self-contact");
    let mean = errors.each_ref().map(|errors| 1e3 * errors.iter().sum::<f64>() / errors.len() as f64);
    assert!((mean[1] - mean[0]).abs() < 0.1 && mean[1] < 1.5, "mm before and after: {mean:?}");
}

/// Idle pads of cameras that drift by several per cent report no contact.
#[test]
fn drift_alone_is_no_touch() {
    let bench = pads_only(1);
    let hand = &bench.world.cell.robot.hand;
    let poses = hand.pad_poses(&hand.tree.forward(&hand.open_angles()));
    for rate in [-0.06, -0.02, 0.0, 0.02, 0.06] {
        let mut board = bench
            .cameras
            .with_noise(9)
            .drifting(BrightnessDrift::new(vec![rate; bench.world.cell.robot.hand.cameras.len()], 30.0));
        let pipeline = bench.pipeline.with_backgrounds(board.background_frames()).expect("a background of each camera");
        let frames = board.capture(hand, 30.0, &poses, &vec![0.0; hand.pads.len()], &[]);
        let felt = pipeline.perceive_frames(&frames, &[]).expect("images");
        assert!(felt.faults.is_empty() && felt.touches.iter().all(|touch| touch.heights.is_empty()), "{rate}");
    }
}
