//! The policies and the choice of grasps, on situations made up for the purpose: no simulator, no images.

use std::sync::Arc;

use control::executive::{Executive, Phase};
use control::motion::Protocol;
use control::odds::{Belief, Rehearsed, TryOutcome};
use control::percept::{Eyes, EyesError, Percept};
use control::perception::{Grip, KnownObject};
use control::policy::blind::Blind;
use control::policy::touch::Touch;
use control::policy::{Injected, Knowledge, Policy, Recovery, Step, Uncertainty};
use control::sensing::Senses;
use control::strategy::{Decision, Held, Situation, choose, object_solids};
use control::trajectory::PathLimits;
use control::workcell::Workcell;
use control::worth::Candidate;
use grasping::{Grasp, Repertoire, Role};
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{Observation, TactileImage};
use hand_model::transmission::friction::CableFriction;
use hand_model::{Arm, Hand};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use scenarios::Sensing;
use scenarios::objects::{ObjectModel, ObjectSet};
use touch::{PhotometricCalibration, TouchPipeline};

const TICK: f64 = 0.02;
const FIRST: &str = "cube_45";
const SECOND: &str = "golf_ball";
const TIME_LIMIT: f64 = 120.0;

fn grasp(id: u32, object: &str, role: Role, center: [f64; 3], score: f64) -> Grasp {
    let mut close_tension = [0.0; 5];
    for digit in role.digits() {
        close_tension[digit.index()] = 10.0;
    }
    Grasp {
        id,
        object: object.into(),
        role,
        yaw: 0.0,
        pitch: 0.0,
        roll: 0.0,
        center,
        pre_tension: [0.0; 5],
        close_tension,
        opposition: 0.5,
        raise: 0.0,
        thumb_delay: 0.0,
        held: None,
        held_joints: None,
        score,
    }
}

/// A robot above a table with two objects in front of it, and what is known about them.
struct Table {
    cell: Workcell,
    library: ObjectSet,
    repertoire: Repertoire,
    objects: [Arc<ObjectModel>; 2],
    known: KnownObject,
    pipeline: TouchPipeline,
}

impl Table {
    fn new() -> Self {
        let mut cell = Workcell {
            hand: Arc::new(Hand::ftac()),
            arm: Arc::new(Arm::gen3()),
            world_from_base: Isometry3::identity(),
            ready: Arm::home(),
        };
        let level = grasp(0, FIRST, Role::First, [0.0; 3], 1.0).palm_rotation(0.0);
        let above = Isometry3::from_parts(Translation3::new(0.55, 0.0, 0.30), level);
        cell.ready = cell.posture(&above, &Arm::home()).expect("within reach");
        let library = ObjectSet::standard().with_fallen();
        let objects = [FIRST, SECOND].map(|name| library.get(name).expect("a standard object").clone());
        let mut repertoire = Repertoire::default();
        repertoire.insert(grasp(0, FIRST, Role::First, [-0.02, 0.08, -0.05], 1.0));
        repertoire.insert(grasp(1, FIRST, Role::First, [-0.02, 0.09, -0.05], 0.9));
        let image = Arc::new(TactileImage { rgb: vec![100; 3 * IMAGE_SIZE * IMAGE_SIZE] });
        let calibration = PhotometricCalibration { version: 1, configurations: Default::default() };
        let backgrounds = vec![image; cell.hand.cameras.len()];
        let pipeline = TouchPipeline::new(&cell.hand, calibration, backgrounds).expect("made");
        Self { known: KnownObject::new(objects[0].clone()), cell, library, repertoire, objects, pipeline }
    }

    fn place(&self, index: usize) -> Isometry3<f64> {
        let object = &self.objects[index];
        let at = Translation3::new(0.55, [-0.10, 0.10][index], object.rest_height());
        Isometry3::from_parts(at, object.rest)
    }

    fn percept(&self, index: usize) -> Percept {
        Percept::of(&self.objects[index], &self.place(index))
    }

    /// Second grasps; the first one is the plan. They differ in where the object is in the palm's frame.
    fn second(&self) -> Vec<Candidate> {
        [[0.02, 0.09, -0.05], [0.02, 0.09, -0.12]]
            .iter()
            .zip(0..)
            .map(|(center, id)| Candidate::new(grasp(id, SECOND, Role::Second, *center, 1.0), 1.0))
            .collect()
    }

    fn executive(&self) -> Executive {
        let first = self.repertoire.of(FIRST, Role::First).next().expect("a first grasp").clone();
        let servo = self.cell.arm_servo(self.cell.ready).expect("at rest");
        let (limits, friction) = (PathLimits::default(), CableFriction::NONE);
        let protocol = Protocol { lift: 0.12, carry: 0.1, hold: 0.5, limits, friction };
        let grasps = [(first, self.percept(0)), (self.second()[0].grasp.clone(), self.percept(1))];
        let [first, second] = grasps;
        Executive::new(self.cell.hand.clone(), servo, protocol, first, second, TICK).expect("a path")
    }

    fn knowledge(&self) -> Knowledge<'_> {
        Knowledge {
            cell: &self.cell,
            library: &self.library,
            repertoire: &self.repertoire,
            objects: self.objects.clone(),
            known: [&self.known, &self.known],
            second: self.second(),
            fallen: Vec::new(),
            others: Vec::new(),
            uncertainty: Uncertainty { arm: 0.005, eyes: 0.0065, eyes_lasting: 0.5 },
            time_limit: TIME_LIMIT,
            recovery: Recovery::FULL,
            explores: false,
        }
    }

    fn touch(&self) -> Touch<'_> {
        let senses = Senses::new(&self.pipeline, Sensing::TruePose).expect("made");
        let first = self.repertoire.of(FIRST, Role::First).next().expect("a first grasp");
        Touch::new(self.knowledge(), senses, first)
    }
}

/// Sees the objects in their places and counts how often it was asked.
struct Watchful<'a> {
    table: &'a Table,
    asked: [usize; 2],
    /// How often each object is still hidden.
    hidden: [usize; 2],
}

impl<'a> Watchful<'a> {
    fn new(table: &'a Table) -> Self {
        Self { table, asked: [0, 0], hidden: [0, 0] }
    }
}

impl Eyes for Watchful<'_> {
    fn look(&mut self, object: usize) -> Result<Option<Isometry3<f64>>, EyesError> {
        self.asked[object] += 1;
        if self.hidden[object] > 0 {
            self.hidden[object] -= 1;
            return Ok(None);
        }
        Ok(Some(self.table.place(object)))
    }
}

/// Ticks until `phase`, without any image: looks end by their time limit.
fn run_until(executive: &mut Executive, phase: Phase) {
    for _ in 0..100_000 {
        if executive.phase() >= phase {
            return;
        }
        executive.tick(&Observation::default()).expect("a command");
    }
    panic!("{phase} is not reached");
}

fn in_hand(first: bool, second: bool) -> Option<Injected> {
    let palm_from_object = Isometry3::translation(-0.02, 0.08, -0.05);
    Some(Injected { palm_from_object, grip: Grip { first, second } })
}

/// The choice with a bar of 16 mm x 16 mm x 120 mm, along the palm's normal, held at `x` (m, palm frame).
fn with_bar_at(x: f64) -> (bool, f64) {
    let table = Table::new();
    let mut executive = table.executive();
    run_until(&mut executive, Phase::Decide);
    let bar = bar();
    let digits = Role::First.digits();
    let [bar, target] = [&bar, &*table.objects[1]].map(object_solids);
    let held = Held {
        name: "bar",
        solids: &bar,
        pose: Isometry3::translation(x, 0.09, -0.02),
        joints: vec![0.0; hand_model::HAND_JOINTS],
        digits,
        sigma: 0.001,
    };
    let hand = &table.cell.hand;
    let belief = Belief::new(&Uncertainty::standard());
    let situation = Situation {
        executive: &executive,
        hand,
        held: &held,
        rehearsed: None,
        target: &target,
        target_sigma: 0.002,
        all: Arc::default(),
        belief: &belief,
        looks: 1,
        probe: Vector3::zeros(),
    };
    let decision = choose(&situation, &table.second()).expect("geometry").expect("a plan");
    (decision.switched, decision.plan.clearance)
}

fn bar() -> ObjectModel {
    let cube = ObjectSet::standard().get(FIRST).expect("a cube").clone();
    let shape = scenarios::Shape::Cuboid { half: Vector3::new(0.008, 0.008, 0.06), radius: 0.0 };
    ObjectModel { name: "bar".into(), shape, ..(*cube).clone() }
}

/// A held bar that stands where the plan closes on the next object makes the plan switch to the grasp that closes below it.
#[test]
fn a_bar_in_the_way_switches_the_grasp() {
    let (switched, clearance) = with_bar_at(0.02);
    assert!(clearance < 0.0, "the plan clears the bar by {clearance} m");
    assert!(switched);
}

/// The same bar beside the hand changes nothing.
#[test]
fn a_bar_out_of_the_way_keeps_the_plan() {
    let (switched, clearance) = with_bar_at(-0.10);
    assert!(clearance > 0.02, "the plan passes the bar at {clearance} m");
    assert!(!switched);
}

/// What a choice comes to with rehearsals (plan, other grasp) and a held object that is out of the way.
fn with_rehearsals(rehearsals: [fn(&Vector3<f64>) -> TryOutcome; 2]) -> Decision {
    let table = Table::new();
    let mut executive = table.executive();
    run_until(&mut executive, Phase::Decide);
    let bar = bar();
    let [bar, target] = [&bar, &*table.objects[1]].map(object_solids);
    let held = Held {
        name: "bar",
        solids: &bar,
        pose: Isometry3::translation(-0.10, 0.09, -0.02),
        joints: vec![0.0; hand_model::HAND_JOINTS],
        digits: Role::First.digits(),
        sigma: 0.001,
    };
    let belief = Belief::new(&Uncertainty::standard());
    let situation = Situation {
        executive: &executive,
        hand: &table.cell.hand,
        held: &held,
        rehearsed: None,
        target: &target,
        target_sigma: 0.002,
        all: Arc::default(),
        belief: &belief,
        looks: 1,
        probe: Vector3::zeros(),
    };
    let steps = || (-4..=4).map(|n| 0.004 * f64::from(n));
    let errors: Vec<_> = steps().flat_map(|x| steps().map(move |y| Vector3::new(x, y, 0.0))).collect();
    let rehearsed = |outcome: fn(&Vector3<f64>) -> TryOutcome| {
        errors.iter().map(|error| Rehearsed { error: *error, outcome: outcome(error) }).collect()
    };
    let candidates: Vec<_> = table
        .second()
        .into_iter()
        .zip(rehearsals)
        .map(|(candidate, how)| Candidate { rehearsed: rehearsed(how), ..candidate })
        .collect();
    choose(&situation, &candidates).expect("geometry").expect("a plan")
}

/// A plan that touches is left for a grasp that misses where the plan touches, because a miss can be tried again.
#[test]
fn a_miss_is_better_than_a_contact() {
    use TryOutcome::{Contact, Held, Missed};
    let decision = with_rehearsals([
        |error| if error.x.abs() < 0.006 { Held } else { Contact },
        |error| if error.x.abs() < 0.006 { Held } else { Missed },
    ]);
    assert!(decision.switched && decision.chosen.risk < 0.1 && decision.plan.risk > 0.3, "{}", decision.reason);
}

/// A plan that touches on one side only is kept and aimed away from it.
#[test]
fn the_aim_leaves_the_side_that_touches() {
    use TryOutcome::{Contact, Held};
    let decision = with_rehearsals([|error| if error.x < 0.0 { Contact } else { Held }, |_| Contact]);
    assert!(!decision.switched && decision.aim.x > 0.0, "{}", decision.reason);
    assert!(decision.chosen.risk < decision.plan.risk - 0.1, "{}", decision.reason);
}

#[test]
fn blind_carries_out_the_plan_and_never_looks() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let mut blind = Blind::new(table.second()[0].grasp.clone());
    for (phase, then) in [
        (Phase::Decide, Step::Play(Phase::Confirm)),
        (Phase::Confirm, Step::Play(Phase::Done)),
        (Phase::Done, Step::Finish),
    ] {
        run_until(&mut executive, phase);
        blind.perceive(&executive, in_hand(false, false)).expect("nothing to perceive");
        assert_eq!(blind.decide(&mut executive, &mut eyes, 0.0).expect("decided"), then);
    }
    assert_eq!(eyes.asked, [0, 0]);
    assert!(blind.story().is_as_planned() && blind.story().reasons.is_empty());
}

/// With the first object felt in the hand the second is looked at once more and approached; with both, they are carried; then the trial is over.
#[test]
fn touch_goes_on_while_everything_is_in_the_hand() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let mut touch = table.touch();
    for (phase, grip, then) in [
        (Phase::Decide, in_hand(true, false), Step::Play(Phase::Confirm)),
        (Phase::Confirm, in_hand(true, true), Step::Play(Phase::Done)),
        (Phase::Done, in_hand(true, true), Step::Finish),
    ] {
        run_until(&mut executive, phase);
        touch.perceive(&executive, grip).expect("perceived");
        assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), then);
    }
    assert_eq!((eyes.asked, touch.story().retries, touch.story().decisions), ([0, 1], 0, 1));
    let felt = touch.felt().expect("felt").estimate.palm_from_object;
    assert_eq!(felt, in_hand(true, false).expect("injected").palm_from_object);
}

/// Where it may, it touches the second object before it takes it; what it does not feel is taken where it is seen.
#[test]
fn touch_feels_for_the_second_object_first() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let first = table.repertoire.of(FIRST, Role::First).next().expect("a first grasp");
    let touch_with = |sensing: Sensing| {
        let senses = Senses::new(&table.pipeline, sensing).expect("made");
        Touch::new(Knowledge { explores: true, ..table.knowledge() }, senses, first)
    };
    run_until(&mut executive, Phase::Decide);
    // The held cube is out of the way of the fingers.
    let palm_from_object = Isometry3::translation(-0.03, -0.04, -0.03);
    let behind = in_hand(true, false).map(|injected| Injected { palm_from_object, ..injected });
    for (sensing, then) in [
        (Sensing::ServosOnly, (Step::Play(Phase::Confirm), Phase::ApproachSecond)),
        (Sensing::TruePose, (Step::Play(Phase::LocateSecond), Phase::ReachSecond)),
    ] {
        let (mut touch, mut executive) = (touch_with(sensing), executive.clone());
        touch.perceive(&executive, behind).expect("perceived");
        let step = touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
        assert_eq!((step, executive.phase()), then, "{sensing:?}");
        if executive.phase() == Phase::ReachSecond {
            let seen = executive.second().1;
            run_until(&mut executive, Phase::LocateSecond);
            touch.perceive(&executive, None).expect("perceived");
            let step = touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
            assert_eq!((step, executive.phase()), (Step::Play(Phase::Confirm), Phase::ApproachSecond));
            assert_eq!(executive.second().1, seen);
            assert!(touch.story().reasons.iter().any(|reason| reason.contains("nothing was felt")));
        }
    }
}

/// A trial that waits for it begins with a touch of the first object, without images with the planned grasp. The digits that
/// touched keep still until the hand has risen.
#[test]
fn touch_feels_for_the_first_object_too() {
    let table = Table::new();
    let mut eyes = Watchful::new(&table);
    let first = table.repertoire.of(FIRST, Role::First).next().expect("a first grasp");
    for (sensing, then) in [
        (Sensing::ServosOnly, (Step::Play(Phase::Decide), Phase::ApproachFirst)),
        (Sensing::Full, (Step::Play(Phase::LocateFirst), Phase::ReachFirst)),
    ] {
        let senses = Senses::new(&table.pipeline, sensing).expect("made");
        let mut touch = Touch::new(Knowledge { explores: true, ..table.knowledge() }, senses, first);
        let mut executive = table.executive();
        executive.wait_to_begin().expect("at rest");
        touch.perceive(&executive, None).expect("perceived");
        let step = touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
        assert_eq!((step, executive.phase()), then, "{sensing:?}");
        assert_eq!(executive.first().0.id, first.id);
        if executive.phase() == Phase::ReachFirst {
            run_until(&mut executive, Phase::LocateFirst);
            let (height, still) = (executive.end().translation.z, executive.wanted_tensions());
            touch.perceive(&executive, None).expect("perceived");
            let step = touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
            assert_eq!((step, executive.phase()), (Step::Play(Phase::Decide), Phase::ApproachFirst));
            assert_eq!(executive.wanted_tensions(), still);
            run_until(&mut executive, Phase::GraspFirst);
            assert!(executive.wanted_tensions() != still && executive.end().translation.z < height + 0.1);
        }
    }
}

/// An empty hand makes it look at both objects and try the first one again; a grasp that failed gives way to the other.
#[test]
fn touch_tries_again_what_is_missing() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let mut touch = table.touch();
    run_until(&mut executive, Phase::Decide);
    touch.perceive(&executive, in_hand(false, false)).expect("perceived");
    assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::Play(Phase::Decide));
    assert_eq!((executive.phase(), eyes.asked), (Phase::ApproachFirst, [1, 1]));
    // 1.0 halved by its failure is less than 0.9 x 0.9 of the grasp that was not planned.
    assert_eq!((executive.first().0.id, touch.story().retries), (1, 1));
    assert!(!touch.story().is_as_planned() && touch.story().take_announcements().len() == 1);
}

/// With only the second object in the hand, it is put down, and the first one comes next without another look at the hand.
#[test]
fn touch_puts_down_the_second_object_when_the_first_is_lost() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let mut touch = table.touch();
    run_until(&mut executive, Phase::Decide);
    touch.perceive(&executive, in_hand(true, false)).expect("perceived");
    touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
    run_until(&mut executive, Phase::Confirm);
    touch.perceive(&executive, in_hand(false, true)).expect("perceived");
    assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::Play(Phase::Decide));
    assert_eq!((executive.phase(), eyes.asked), (Phase::PutDown, [0, 1]));
    while executive.phase() == Phase::PutDown {
        executive.tick(&Observation::default()).expect("a command");
    }
    touch.perceive(&executive, in_hand(true, true)).expect("perceived");
    assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::Play(Phase::Decide));
    assert_eq!((executive.phase(), eyes.asked), (Phase::ApproachFirst, [1, 2]));
}

/// Plays the way aside to the decision after it.
fn aside(executive: &mut Executive) {
    assert_eq!(executive.phase(), Phase::StepAside);
    while executive.phase() == Phase::StepAside {
        executive.tick(&Observation::default()).expect("a command");
    }
    assert_eq!(executive.phase(), Phase::Decide);
}

/// What is needed and hidden is looked for from aside; what comes later is looked for when its turn comes.
#[test]
fn touch_steps_aside_to_see_what_it_needs() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful { hidden: [1, 3], ..Watchful::new(&table) };
    let mut touch = table.touch();
    run_until(&mut executive, Phase::Decide);
    touch.perceive(&executive, in_hand(false, false)).expect("perceived");
    let mut decide = |executive: &mut Executive, touch: &mut Touch, grip: Option<Injected>| {
        touch.perceive(executive, grip).expect("perceived");
        touch.decide(executive, &mut eyes, 0.0).expect("decided")
    };
    assert_eq!(decide(&mut executive, &mut touch, in_hand(false, false)), Step::Play(Phase::Decide));
    let last = executive.second().1;
    aside(&mut executive);
    // The grip of a moment ago stands: nothing is felt on the way aside.
    assert_eq!(decide(&mut executive, &mut touch, None), Step::Play(Phase::Decide));
    assert_eq!((executive.phase(), executive.second().1), (Phase::ApproachFirst, last));
    run_until(&mut executive, Phase::Decide);
    assert_eq!(decide(&mut executive, &mut touch, in_hand(true, false)), Step::Play(Phase::Decide));
    aside(&mut executive);
    assert_eq!(decide(&mut executive, &mut touch, None), Step::Play(Phase::Confirm));
    assert_eq!((executive.phase(), touch.story().retries), (Phase::ApproachSecond, 1));
    assert_eq!((eyes.asked, eyes.hidden), ([2, 4], [0, 0]));
}

/// What is not seen from aside either is nowhere: the trial is given up, and the reason says what is missing.
#[test]
fn touch_gives_up_what_is_nowhere_to_be_seen() {
    for (phase, grip, missing) in
        [(Phase::Decide, in_hand(false, false), FIRST), (Phase::Confirm, in_hand(true, false), SECOND)]
    {
        let table = Table::new();
        let mut executive = table.executive();
        let mut eyes = Watchful { hidden: [9, 9], ..Watchful::new(&table) };
        let mut touch = table.touch();
        run_until(&mut executive, Phase::Decide);
        if phase == Phase::Confirm {
            touch.perceive(&executive, in_hand(true, false)).expect("perceived");
            touch.decide(&mut executive, &mut eyes, 0.0).expect("decided");
            run_until(&mut executive, Phase::Confirm);
        }
        touch.perceive(&executive, grip).expect("perceived");
        assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::Play(Phase::Decide));
        aside(&mut executive);
        touch.perceive(&executive, None).expect("perceived");
        assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::NotSeen);
        let reason = touch.story().reasons.last().expect("a reason").clone();
        assert_eq!(reason, format!("{missing} is nowhere to be seen"));
    }
}

/// Near the time limit no new try begins, whatever is missing.
#[test]
fn touch_begins_no_try_that_cannot_end_in_time() {
    let table = Table::new();
    let mut executive = table.executive();
    let mut eyes = Watchful::new(&table);
    let mut touch = table.touch();
    run_until(&mut executive, Phase::Decide);
    touch.perceive(&executive, in_hand(false, false)).expect("perceived");
    let step = touch.decide(&mut executive, &mut eyes, TIME_LIMIT - 1.0).expect("decided");
    assert_eq!((step, touch.story().retries), (Step::Play(Phase::Confirm), 0));
}

/// A target that no turn brings within reach ends the trial, and the reason says where it is.
#[test]
fn touch_gives_up_what_is_out_of_reach() {
    let table = Table::new();
    let mut executive = table.executive();
    let far = Percept { position: [3.0, 0.0, 0.02].into(), ..table.percept(1) };
    executive.see_second(far);
    // It is not seen better.
    let mut eyes = Watchful { hidden: [0, 1], ..Watchful::new(&table) };
    let mut touch = table.touch();
    run_until(&mut executive, Phase::Decide);
    touch.perceive(&executive, in_hand(true, false)).expect("perceived");
    assert_eq!(touch.decide(&mut executive, &mut eyes, 0.0).expect("decided"), Step::GiveUp);
    let reason = touch.story().reasons.last().expect("a reason").clone();
    assert!(reason.contains(SECOND) && reason.contains("3.00"), "{reason}");
}

/// The pose that a percept reports is the pose it was made of.
#[test]
fn a_percept_keeps_the_pose() {
    let table = Table::new();
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.4);
    let pose = Isometry3::from_parts(Translation3::new(0.5, 0.1, 0.02), turned * table.objects[0].rest);
    let percept = Percept::of(&table.objects[0], &pose);
    assert!((percept.pose().translation.vector - pose.translation.vector).norm() < 1e-12);
    assert!(percept.pose().rotation.angle_to(&pose.rotation) < 1e-9);
}
