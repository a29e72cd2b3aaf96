//! Checks of a closed grasp: (a) the friction-cone program, (b) penetration, (c) holding against forces in physics.

use anyhow::Result;
use dexterous_grasping::force_closure::{FrictionContact, soft_wrench_margin, wrench_margin};
use dexterous_grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use hand_model::hand::CoverShape;
use nalgebra::{Isometry3, Point3, Vector3};
use sim::hand_scene::{SceneContact, pose_difference};

use super::closing::{ClosedGrasp, PullingGrasp};
use super::grasping_hand::{ContactModel, GraspingHand};
use super::subject::PreparedObject;

/// Acceleration of the holding test, m/s2 (DexGraspBench).
pub const TEST_ACCELERATION: f64 = 10.0;
/// Force limit of the friction-cone program: sum of all normal forces, N (the paper's total grasp force).
pub const TOTAL_FORCE: f64 = 10.3;
/// (b) Largest penetration, m.
pub const MAX_PENETRATION: f64 = 1e-3;
/// (c) Time for each direction, s, and largest motion of the object: m, rad.
pub const HOLD_TIME: f64 = 2.0;
pub const MAX_MOTION: (f64, f64) = (0.05, 15.0 * std::f64::consts::PI / 180.0);
/// Steps between two samples of the object's pose in the holding test, and largest motion of the object and the joints
/// between two samples at rest: m, rad. At that rate the object would move less than a hundredth of the limits until the
/// end.
const SAMPLING_STEPS: usize = 24;
const REST_TOLERANCE: f64 = 1e-5;
/// Upper limit of the payload search, kg, and ratio to which the payload is determined.
const MAX_PAYLOAD: f64 = 10.0;
const PAYLOAD_RATIO: f64 = 1.1;

/// (a) Least wrench margin, N, with [`TOTAL_FORCE`]: the weight of 0.1 kg in the holding test. It judges the contact
/// positions whatever the weight of the object, because a heavier object may be pressed harder. The holding test (c)
/// decides if it is held.
pub const MIN_MARGIN: f64 = 1.0;

/// Computes the wrench margin of a closed grasp, N.
pub fn margin(hand: &GraspingHand, subject: &PreparedObject, closed: &ClosedGrasp) -> Result<f64> {
    let contact = |touch: &SceneContact| FrictionContact {
        point: touch.point,
        normal: touch.normal,
        friction: subject.model.friction,
    };
    let contacts: Vec<FrictionContact> = closed.touches.iter().map(contact).collect();
    let center = closed.scene.object() * subject.field.center;
    Ok(match hand.contacts {
        ContactModel::Hard => wrench_margin(&contacts, &center, subject.field.length, TOTAL_FORCE)?,
        ContactModel::Soft { torsion_arm, torque_arm } => {
            soft_wrench_margin(&contacts, torsion_arm, &center, torque_arm, TOTAL_FORCE)?
        }
    })
}

/// Computes the deepest penetration in a closed grasp, m.
pub fn penetration(hand: &GraspingHand, subject: &PreparedObject, closed: &ClosedGrasp) -> f64 {
    match &hand.named_hand {
        Some(named) => covers_penetration(named, &hand.sampled.surface, subject, closed),
        None => closed.scene.penetration(),
    }
}

/// Computes the penetration for a hand with covers: of the hand's points in the object, and of the object's points in
/// the hand.
fn covers_penetration(hand: &Hand, surface: &HandSurface, subject: &PreparedObject, closed: &ClosedGrasp) -> f64 {
    let palm_from_object = closed.scene.object();
    let object_from_palm = palm_from_object.inverse();
    let links = hand.tree.forward(closed.scene.angles());
    let pose = |link: usize| if link == 0 { Isometry3::identity() } else { links[link - 1] };
    let mut deepest = 0.0_f64;
    for (link, own) in surface.links.iter().enumerate() {
        let object_from_link = object_from_palm * pose(link);
        for p in &own.points {
            let (rough, _) = subject.field.distance_gradient(&(object_from_link * Point3::from(*p)).coords);
            // The error of the grid is some hundredths of a millimetre on a face and more at an edge, so the shape
            // itself is queried.
            if rough < 1e-3 {
                let (distance, _) = subject.model.shape.signed_distance(&(object_from_link * Point3::from(*p)));
                deepest = deepest.max(-distance);
            }
        }
        let cover = if link == 0 { &hand.palm_cover } else { &hand.covers[link - 1] };
        let cover_from_object = (pose(link) * cover.link_from_cover).inverse() * palm_from_object;
        for p in &subject.surface {
            deepest = deepest.max(-cover_distance(cover, &(cover_from_object * p)));
        }
    }
    deepest
}

/// Computes the signed distance to a rounded box in its own frame, m.
fn cover_distance(cover: &CoverShape, p: &Point3<f64>) -> f64 {
    let q = p.coords.abs() - cover.half.add_scalar(-cover.radius);
    q.map(|x| x.max(0.0)).norm() + q.max().min(0.0) - cover.radius
}

/// Motion of the object under one force, until it exceeded the limits.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ForcedMotion {
    /// Translation, m.
    distance: f64,
    /// Rotation, rad.
    angle: f64,
}

impl ForcedMotion {
    /// Returns the motion as a share of its limits. Above one, the object is not held.
    fn share(&self) -> f64 {
        (self.distance / MAX_MOTION.0).max(self.angle / MAX_MOTION.1)
    }

    fn is_held(&self) -> bool {
        self.distance <= MAX_MOTION.0 && self.angle <= MAX_MOTION.1
    }
}

/// Result of a holding test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldTestResult {
    /// True if the motion was within the limits in all six directions.
    pub held: bool,
    /// Largest motion in each direction as a share of the limit. Zero if an earlier direction failed.
    pub shares: [f64; 6],
}

impl HoldTestResult {
    /// Returns the directions, the one with the largest motion first.
    fn weakest_first(&self) -> [usize; 6] {
        let mut order = [0, 1, 2, 3, 4, 5];
        order.sort_by(|a, b| self.shares[*b].total_cmp(&self.shares[*a]));
        order
    }
}

/// (c) Runs the DexGraspBench protocol: from the closed grasp, the force of 10 m/s2 on `mass` (kg) along each of the
/// six axes for 2 s each, every time from the same state. It stops at the first direction that fails. Motion is
/// measured from the closed grasp.
pub fn run_hold_test(closed: &impl PullingGrasp, mass: f64) -> HoldTestResult {
    let mut hold = HoldTestResult { held: true, shares: [0.0; 6] };
    for direction in 0..6 {
        let motion = motion_along(closed, direction, mass);
        hold.shares[direction] = motion.share();
        if !motion.is_held() {
            return HoldTestResult { held: false, ..hold };
        }
    }
    hold
}

/// Returns the payload: the largest mass (kg) that is held in six directions, to within a tenth below it. The search
/// goes up from `mass`, for which `hold` was passed. The closed grasp remains the one of that mass.
pub fn payload(closed: &impl PullingGrasp, mass: f64, hold: &HoldTestResult) -> f64 {
    largest_held(mass, hold.weakest_first(), |direction, mass| motion_along(closed, direction, mass).is_held())
}

/// Returns the motion in one direction of the holding test. It stops early once everything is at rest, because nothing
/// moves after that.
fn motion_along(closed: &impl PullingGrasp, direction: usize, mass: f64) -> ForcedMotion {
    let (start, mut pulling) = (closed.object(), closed.clone());
    let sign = if direction.is_multiple_of(2) { 1.0 } else { -1.0 };
    let force = Vector3::ith(direction / 2, sign * TEST_ACCELERATION * mass);
    let steps = (HOLD_TIME / closed.dt()).round() as usize;
    let mut most = ForcedMotion { distance: 0.0, angle: 0.0 };
    let mut before = (start, closed.joints().to_vec());
    for step in 1..=steps {
        pulling.step(&force);
        if step.is_multiple_of(SAMPLING_STEPS) || step == steps {
            let now = (pulling.object(), pulling.joints().to_vec());
            let (distance, angle) = pose_difference(&start, &now.0);
            most = ForcedMotion { distance: most.distance.max(distance), angle: most.angle.max(angle) };
            if !most.is_held() || at_rest(&before, &now) {
                break;
            }
            before = now;
        }
    }
    most
}

/// True if object and joints did not move between two samples.
fn at_rest(before: &(Isometry3<f64>, Vec<f64>), now: &(Isometry3<f64>, Vec<f64>)) -> bool {
    let (distance, angle) = pose_difference(&before.0, &now.0);
    distance < REST_TOLERANCE
        && angle < REST_TOLERANCE
        && before.1.iter().zip(&now.1).all(|(a, b)| (a - b).abs() < REST_TOLERANCE)
}

/// Returns the masses among which a payload is searched for, in rising order from `held`: the doublings of `held`, each
/// interval halved geometrically until neighbours differ by at most [`PAYLOAD_RATIO`].
fn candidate_masses(held: f64) -> Vec<f64> {
    fn between(low: f64, high: f64, into: &mut Vec<f64>) {
        if high > PAYLOAD_RATIO * low {
            let middle = (low * high).sqrt();
            between(low, middle, into);
            between(middle, high, into);
        } else {
            into.push(low);
        }
    }
    let mut masses = Vec::new();
    let (mut low, mut high) = (held, 2.0 * held);
    while high < MAX_PAYLOAD {
        between(low, high, &mut masses);
        (low, high) = (high, 2.0 * high);
    }
    between(low, MAX_PAYLOAD.max(low), &mut masses);
    masses
}

/// Returns the largest of [`candidate_masses`] that `holds` in every direction. The first one holds. A mass that holds
/// in one direction mostly holds in the next, so one query per direction is usually enough, above all if the weakest
/// comes first.
fn largest_held(held: f64, directions: [usize; 6], holds: impl Fn(usize, f64) -> bool) -> f64 {
    let masses = candidate_masses(held);
    let [weakest, others @ ..] = directions;
    let mut best = masses[1..].partition_point(|mass| holds(weakest, *mass));
    for direction in others {
        let (mut low, mut high, mut stride) = (best, best + 1, 1);
        while low > 0 && !holds(direction, masses[low]) {
            (low, high) = (low.saturating_sub(stride), low);
            stride *= 2;
        }
        best = low + masses[low + 1..high].partition_point(|mass| holds(direction, *mass));
    }
    masses[best]
}

#[cfg(test)]
mod tests {
    use super::*;
    use dexterous_grasping::synthesis::posture::project;
    use sim::hand_scene::TensionCommand;
    use std::sync::Arc;

    #[test]
    fn distance_to_a_rounded_box() {
        let half = Vector3::new(0.02, 0.01, 0.01);
        let cover = CoverShape { link_from_cover: Isometry3::identity(), half, radius: 0.005 };
        let at = |x: f64, y: f64, z: f64| cover_distance(&cover, &Point3::new(x, y, z));
        assert!((at(0.03, 0.0, 0.0) - 0.01).abs() < 1e-12, "over a face");
        assert!((at(0.0, 0.0, 0.004) + 0.006).abs() < 1e-12, "inside");
        let corner = 0.005 * (3.0_f64.sqrt() - 1.0);
        assert!((at(0.02, 0.01, 0.01) - corner).abs() < 1e-12, "the corner is rounded off");
    }

    /// The payload is found to a tenth, from below, whichever direction is weakest. It is never below the mass that
    /// holds, and never above the largest mass that is tried.
    #[test]
    fn the_largest_mass_is_found() {
        for most in [0.1, 0.137, 0.4, 2.9, 9.0] {
            for weakest in 0..6 {
                let holds = |direction, mass| mass <= if direction == weakest { most } else { 1.5 * most };
                let found = largest_held(0.1, [0, 1, 2, 3, 4, 5], holds);
                assert!(found <= most && 1.1 * found >= most, "{found} for {most} in direction {weakest}");
            }
        }
        assert!((9.0..=10.0).contains(&largest_held(0.1, [0, 1, 2, 3, 4, 5], |_, _| true)));
        assert_eq!(largest_held(12.0, [0, 1, 2, 3, 4, 5], |_, _| true), 12.0);
        assert_eq!(largest_held(0.1, [0, 1, 2, 3, 4, 5], |_, _| false), 0.1);
    }

    /// Each mass is at most a tenth above the one before, and the doublings of the first are among them.
    #[test]
    fn masses_are_close() {
        let masses = candidate_masses(0.1);
        assert!(masses.windows(2).all(|pair| pair[0] < pair[1] && pair[1] <= PAYLOAD_RATIO * pair[0]), "{masses:?}");
        assert!([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4].iter().all(|doubled| masses.contains(doubled)), "{masses:?}");
    }

    /// An object that jumps away after a second, and a joint that turns at this rate, rad per step.
    #[derive(Clone)]
    struct LateJump {
        steps: usize,
        turn: f64,
        joint: [f64; 1],
    }

    impl PullingGrasp for LateJump {
        fn dt(&self) -> f64 {
            1.0 / 240.0
        }

        fn object(&self) -> Isometry3<f64> {
            Isometry3::translation(if self.steps > 240 { 1.0 } else { 0.0 }, 0.0, 0.0)
        }

        fn joints(&self) -> &[f64] {
            &self.joint
        }

        fn step(&mut self, _: &Vector3<f64>) {
            self.steps += 1;
            self.joint[0] += self.turn;
        }
    }

    /// The test ends early only if object and joints are all at rest.
    #[test]
    fn a_joint_that_creeps_keeps_the_test_going() {
        let held = |turn| motion_along(&LateJump { steps: 0, turn, joint: [0.0] }, 0, 0.1).is_held();
        assert!(!held(1e-6), "the motion of the object is detected");
        assert!(held(0.0), "nothing moves");
    }

    /// An object that nothing touches flies off. The test can fail, and it reports the direction of the motion.
    #[test]
    fn a_floating_object_is_not_held() {
        let hand = Arc::new(Hand::ftac());
        let subject = PreparedObject::from_set("ball").expect("the ball");
        let away = Isometry3::translation(0.0, 0.0, -0.5);
        let scene = GraspingHand::from_hand(hand.clone()).scene(&subject, &away, &hand.open_angles());
        let pull = TensionCommand::tensions(&hand.slack_tensions());
        let open = project(&hand, &hand.open_angles());
        let closed = ClosedGrasp { scene, pull, open, start: away, moved: (0.0, 0.0), touches: Vec::new() };
        let hold = run_hold_test(&closed, 0.1);
        assert!(!hold.held && hold.shares[0] > 1.0 && hold.shares[1..] == [0.0; 5], "{hold:?}");
    }
}
