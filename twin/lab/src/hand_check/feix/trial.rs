//! Trial of one attempt in physics: contacts of the hand with the object, and stability under gravity from six
//! directions.

use std::sync::Arc;

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, Digit, Hand, HandVector};
use nalgebra::{Isometry3, Point3, Vector3};
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, tension_goals};

use super::attempt::GraspAttempt;
use super::types::{GraspType, Opposition};

/// Times to turn the thumb, to close, and to let the object settle after release, s.
const THUMB_TURN_TIME: f64 = 0.4;
const CLOSING_TIME: f64 = 1.4;
const SETTLING_TIME: f64 = 0.8;
/// Time of gravity from each direction, and interval of the checks on the object, s.
const PULL_TIME: f64 = 0.8;
const CHECK_INTERVAL: f64 = 0.1;
/// Hold criteria: maximum displacement of the object, m, and its maximum speed at the end, m/s.
const MAX_DISPLACEMENT: f64 = 0.01;
const MAX_FINAL_SPEED: f64 = 0.01;
/// Boundary between an abducted thumb, which opposes by more, and an adducted one, rad.
const ABDUCTION_LIMIT: f64 = 0.6;
/// Maximum sum of the flexions of the two last joints of a straight finger, rad.
const MAX_STRAIGHT_FLEXION: f64 = 0.6;
/// Cost of excess flexion of a straight finger, as a gap of its digit, m per rad.
const BEND_COST: f64 = 0.02;
/// Contact threshold on a force, N.
const CONTACT_FORCE_THRESHOLD: f64 = 0.01;
/// Maximum penetration of the object into the open hand at the start, m.
pub const MAX_START_PENETRATION: f64 = 1e-3;
/// Cost of a fault, and gap of a missing digit that costs 1 in addition, m.
const FAULT_COST: f64 = 10.0;
const MISSING_DIGIT_GAP: f64 = 0.005;
/// Directions of gravity with their names.
const GRAVITY_DIRECTIONS: [(Vector3<f64>, &str); 6] = [
    (Vector3::new(1.0, 0.0, 0.0), "thumb side"),
    (Vector3::new(-1.0, 0.0, 0.0), "little side"),
    (Vector3::new(0.0, 1.0, 0.0), "fingers"),
    (Vector3::new(0.0, -1.0, 0.0), "wrist"),
    (Vector3::new(0.0, 0.0, 1.0), "back"),
    (Vector3::new(0.0, 0.0, -1.0), "palm"),
];

/// Result of an attempt.
#[derive(Debug, Clone)]
pub struct AttemptResult {
    /// Reasons why the posture is not of its type, in words.
    pub faults: Vec<String>,
    /// Directions of gravity in which the object is lost; none are tried if the posture is not of the type.
    pub lost: Vec<&'static str>,
    /// Joint angles after settling, rad.
    pub angles: HandVector,
    /// `palm_from_object` after settling.
    pub place: Isometry3<f64>,
    /// Contact points of the hand on the object then, palm frame, m.
    pub contacts: Vec<Point3<f64>>,
    /// Cost that the search minimizes.
    pub cost: f64,
}

impl AttemptResult {
    /// True if all virtual fingers touch and nothing else does.
    pub fn formed(&self) -> bool {
        self.faults.is_empty()
    }

    /// True if formed, and held in all six directions.
    pub fn held(&self) -> bool {
        self.formed() && self.lost.is_empty()
    }
}

/// Makes the attempt. Returns `None` if its cost is above `enough`, as early as this is known.
pub fn run(hand: &Arc<Hand>, kind: &GraspType, attempt: &GraspAttempt, enough: f64) -> Option<AttemptResult> {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    stand.run(&tension_goals(hand, &attempt.before, attempt.opposition), THUMB_TURN_TIME);
    let prop = stand.add_prop(kind.prop.clone(), &attempt.place());
    let buried = stand.prop_penetration(prop) > MAX_START_PENETRATION;
    if buried && enough < FAULT_COST {
        return None;
    }
    let mut goals = tension_goals(hand, &attempt.tensions, attempt.opposition);
    stand.run(&goals, CLOSING_TIME);
    if attempt.locked {
        goals = lock(&stand, goals);
    }
    stand.release_prop(prop);
    stand.run(&goals, SETTLING_TIME);
    let mut faults = faults(kind, &stand);
    if buried {
        faults.push("the object starts inside the hand".into());
    }
    let (angles, place) = (stand.angles(), stand.prop_pose(prop));
    let contacts = stand.contacts().iter().map(|contact| contact.point).collect();
    let mut lost = Vec::new();
    let away = |digit: &Digit| match kind.extended.contains(digit) {
        true => {
            gap(&stand, &digit.ftac_joints()[1..])
                + BEND_COST * (flexion_sum(&stand, *digit) - MAX_STRAIGHT_FLEXION).max(0.0)
        }
        false => gap(&stand, &digit.ftac_joints()),
    };
    let missing: f64 = kind.digits.iter().map(away).sum();
    let mut cost = FAULT_COST * faults.len() as f64 + (missing / MISSING_DIGIT_GAP).min(FAULT_COST - 1.0);
    if faults.is_empty() {
        cost = -FAULT_COST;
        for (way, name) in GRAVITY_DIRECTIONS {
            if cost > enough {
                return None;
            }
            let (stays, amiss) = pull(stand.clone(), &goals, &way);
            cost += amiss;
            if !stays {
                lost.push(name);
            }
        }
    }
    (cost <= enough).then_some(AttemptResult { faults, lost, angles, place, contacts, cost })
}

/// Applies gravity along `way`. Returns true if the object stays and is still at the end, and the cost: its
/// displacement over [`MAX_DISPLACEMENT`], or, if that exceeds 1, 1 plus the share of the time that was left.
fn pull(mut stand: HandTestStand, goals: &[ServoGoal], way: &Vector3<f64>) -> (bool, f64) {
    let from = stand.prop_pose(0).translation.vector;
    stand.set_gravity(&(way * 9.81));
    let mut moved = 0.0;
    let looks = (PULL_TIME / CHECK_INTERVAL).round() as usize;
    for look in 1..=looks {
        stand.run(goals, CHECK_INTERVAL);
        moved = (stand.prop_pose(0).translation.vector - from).norm();
        if moved > MAX_DISPLACEMENT {
            return (false, 1.0 + (looks - look) as f64 / looks as f64);
        }
    }
    (stand.prop_velocity(0).norm() <= MAX_FINAL_SPEED, moved / MAX_DISPLACEMENT)
}

/// Locks the servos that pull a cable: they hold their present angle instead of their current.
fn lock(stand: &HandTestStand, mut goals: ActuatorVector<ServoGoal>) -> ActuatorVector<ServoGoal> {
    let current_limit = stand.hand().parameters.servo.current_limit;
    for (goal, servo) in goals.iter_mut().zip(stand.servos()) {
        if matches!(goal, ServoGoal::Current(current) if *current > 0.0) {
            *goal = ServoGoal::Position { angle: servo.position, current_limit };
        }
    }
    goals
}

/// Returns the sum of the flexions of a digit's two last joints, rad.
fn flexion_sum(stand: &HandTestStand, digit: Digit) -> f64 {
    let [_, middle, last] = digit.ftac_joints();
    stand.angles()[middle] + stand.angles()[last]
}

/// Returns the gap between the skin of the links `own` and the object, m.
fn gap(stand: &HandTestStand, own: &[usize]) -> f64 {
    let (links, pose) = (stand.links(), stand.prop_pose(0));
    let skin = own.iter().flat_map(|link| {
        stand.hand().covers[*link].skin_elements(0.004).into_iter().map(move |element| (*link, element.point))
    });
    skin.map(|(link, point)| stand.prop(0).signed_distance(&pose.inverse_transform_point(&(links[link] * point))).0)
        .fold(f64::INFINITY, f64::min)
        .max(0.0)
}

/// Lists the reasons why the posture is not of its type.
fn faults(kind: &GraspType, stand: &HandTestStand) -> Vec<String> {
    let mut forces = [0.0; 6];
    let mut sideways = [0.0; 6];
    let links = stand.links();
    for contact in stand.contacts() {
        let part = contact.link.map_or(5, |link| link / 3);
        forces[part] += contact.force.norm();
        if let Some(link) = contact.link {
            sideways[part] += (links[link].inverse_transform_vector(&contact.force)).z.abs();
        }
    }
    let mut faults = Vec::new();
    for digit in kind.extended {
        let (bent, [_, middle, last]) = (flexion_sum(stand, *digit), digit.ftac_joints());
        if bent > MAX_STRAIGHT_FLEXION {
            faults.push(format!("{} is bent by {:.0} deg", digit.name(), bent.to_degrees()));
        }
        if !stand.contacts().iter().any(|contact| contact.link == Some(middle) || contact.link == Some(last)) {
            faults.push(format!("the {} does not lie on the object beyond its first link", digit.name()));
        }
    }
    for digit in Digit::ALL {
        let touches = forces[digit.index()] > CONTACT_FORCE_THRESHOLD;
        let named = kind.digits.contains(&digit);
        if named && !touches {
            faults.push(format!(
                "{} does not touch, {:.1} mm off",
                digit.name(),
                gap(stand, &digit.ftac_joints()) * 1e3
            ));
        }
        if !named && touches && !kind.helpers.contains(&digit) {
            faults.push(format!("{} touches", digit.name()));
        }
    }
    let palm = forces[5] > CONTACT_FORCE_THRESHOLD;
    match kind.opposition {
        Opposition::Palm if !palm => faults.push("the palm does not touch".into()),
        Opposition::Pad if palm => faults.push("the palm touches".into()),
        Opposition::Side => {
            // The finger next to the thumb (or both fingers, if there is no thumb) must touch with its side.
            let of_side = |digit: Digit| sideways[digit.index()] > 0.5 * forces[digit.index()];
            let sided = match kind.digits {
                [Digit::Thumb, rest @ ..] => rest.iter().any(|digit| of_side(*digit)),
                fingers => fingers.iter().all(|digit| of_side(*digit)),
            };
            if !sided {
                faults.push("no finger touches with its side".into());
            }
        }
        _ => {}
    }
    let opposed = stand.angles()[Digit::Thumb.ftac_joints()[0]];
    if kind.digits.contains(&Digit::Thumb) || kind.helpers.contains(&Digit::Thumb) {
        if kind.abducted && opposed < ABDUCTION_LIMIT {
            faults.push("the thumb is not abducted".into());
        }
        if !kind.abducted && opposed > ABDUCTION_LIMIT {
            faults.push("the thumb is not adducted".into());
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::super::types;
    use super::*;

    fn hook(tension: f64) -> (GraspType, GraspAttempt) {
        let kind = types::all_types().swap_remove(14);
        let hand = Hand::ftac();
        let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
        let across = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let place = Isometry3::from_parts(Vector3::new(0.003, 0.0, skin - kind.half - 1e-3).into(), across);
        let fingers = [0.0, tension, tension, tension, tension];
        (kind, GraspAttempt::new(&place, fingers.into(), 0.0))
    }

    /// Four fingers around a rod at the palm hold it there; of an open hand, each is reported as off, with its gap.
    #[test]
    fn a_hook_is_formed_and_an_open_hand_is_not() {
        let hand = Arc::new(Hand::ftac());
        let (kind, closed) = hook(18.0);
        let trial = run(&hand, &kind, &closed, f64::INFINITY).expect("no bound");
        assert!(trial.formed() && !trial.lost.contains(&"palm") && trial.cost < 0.0, "{trial:?}");
        let (kind, open) = hook(0.0);
        let trial = run(&hand, &kind, &open, f64::INFINITY).expect("no bound");
        let off: Vec<&String> = trial.faults.iter().filter(|fault| fault.contains("mm off")).collect();
        assert!(!trial.formed() && off.len() == 4, "{trial:?}");
    }

    /// A bound above the cost changes nothing; one below ends the attempt.
    #[test]
    fn bounds_only_save_time() {
        let hand = Arc::new(Hand::ftac());
        let (kind, attempt) = hook(18.0);
        let whole = run(&hand, &kind, &attempt, f64::INFINITY).expect("no bound");
        let bounded = run(&hand, &kind, &attempt, whole.cost).expect("not above the bound");
        assert_eq!((whole.cost, whole.angles), (bounded.cost, bounded.angles));
        assert!(run(&hand, &kind, &attempt, whole.cost - 1e-6).is_none());
    }

    /// A locked servo keeps its angle; one that pulls no cable stays slack.
    #[test]
    fn only_pulled_cables_lock() {
        let hand = Arc::new(Hand::ftac());
        let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
        let goals = tension_goals(&hand, &[0.0, 8.0, 0.0, 0.0, 0.0], 0.3);
        stand.run(&goals, CLOSING_TIME);
        let locked = lock(&stand, goals);
        assert!(matches!(locked[1], ServoGoal::Position { angle, .. } if angle == stand.servos()[1].position));
        assert!(locked[0] == goals[0] && locked[2..] == goals[2..]);
    }
}
