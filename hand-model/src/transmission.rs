//! The transmission: the action of a digit's actuator on the joints that it pulls.
//!
//! The actuator pulls through a cable against torsion springs. The cable may cross a joint between two guides, as in
//! the F-TAC Hand, or act on it at a constant moment arm ([`Lever`]). A constant arm models a pulley, the motor of a
//! joint whose controller is a spring, or a cable along a sliding joint.
//!
//! # Guides
//! A cable runs along both sides of the phalanges (the paper's Methods, hand fabrication; its finger schematic has
//! joint stiffness K_n, angle theta_n and cable force F). At each joint it spans from a guide point on the link before
//! to one on the link after. The free length between the two is l(q) = |R(q) b - a|, so the joint takes up an
//! **excursion** l(0) - l(q), and the cable acts on a **moment arm** r(q) = -dl/dq. A torsion spring K with rest at 0
//! opens the joint. In equilibrium without contact, K q = r(q) T. By virtual work, the map from tension to torque is
//! the transpose of the map from joint speeds to excursion rate; a test checks this.
//!
//! With [`friction`] in the guides the tension differs from span to span: the cable turns by the spans' angle at each
//! guide, and a joint feels the tension T_i of its own span, r_i(q) T_i. The work that is missing at the joints is
//! dissipated in the guides. Cable stretch (`[cable] stiffness`) is between the spool and the first span, where the
//! servo winds.

//!
//! ```
//! use hand_model::Hand;
//!
//! let hand = Hand::ftac();
//! let (transmission, index) = (&hand.transmission, 1);
//! // Joint angles (rad) at which the springs balance a tension of 4 N, and the cable that is then wound up.
//! let mut q = hand.open_angles();
//! for (joint, angle) in transmission.free_angles(index, 4.0) {
//!     q[joint] = angle;
//! }
//! println!("{:.1} mm of cable", 1e3 * transmission.cables[index].excursion(&q));
//! # assert!(transmission.cables[index].excursion(&q) > 1e-3);
//! ```

pub mod friction;

use friction::CableFriction;

use crate::HandVector;
use crate::bisection::bisect;

/// Largest number of joints that one cable crosses.
pub const MAX_SPANS: usize = 3;

/// The pair of guide points at one joint, in the plane perpendicular to its axis at angle zero: (along the link,
/// towards the palm side).
#[derive(Debug, Clone, Copy)]
pub struct GuidePair {
    /// Guide point on the link before the joint, m.
    pub before: [f64; 2],
    /// Guide point on the link after the joint, m.
    pub after: [f64; 2],
}

impl GuidePair {
    /// Computes the free cable length between the guides at angle `q` (rad), m.
    pub fn length(&self, q: f64) -> f64 {
        let [x, y] = self.rotated(q);
        (x - self.before[0]).hypot(y - self.before[1])
    }

    /// Computes the moment arm r(q) = -dl/dq, m.
    pub fn moment_arm(&self, q: f64) -> f64 {
        let [x, y] = self.rotated(q);
        let (dx, dy) = (x - self.before[0], y - self.before[1]);
        // d/dq of the rotated point is (-y, x).
        -(dx * -y + dy * x) / dx.hypot(dy)
    }

    /// Computes the excursion l(0) - l(q), m.
    pub fn excursion(&self, q: f64) -> f64 {
        self.length(0.0) - self.length(q)
    }

    /// Computes the wrap angles (rad) of the cable at the guides before and after the joint. Away from the joint the
    /// cable runs along the link.
    pub fn wraps(&self, q: f64) -> [f64; 2] {
        let [x, y] = self.rotated(q);
        let slope = (y - self.before[1]).atan2(x - self.before[0]);
        [slope.abs(), (q - slope).abs()]
    }

    fn rotated(&self, q: f64) -> [f64; 2] {
        let (sin, cos) = q.sin_cos();
        let [x, y] = self.after;
        [cos * x - sin * y, sin * x + cos * y]
    }
}

/// Action of a cable on a joint that it crosses.
#[derive(Debug, Clone, Copy)]
pub enum Lever {
    /// Straight line between two guide points.
    Guides(GuidePair),
    /// The same moment arm (m) in any posture; for a sliding joint, force over tension.
    Constant(f64),
}

impl Lever {
    /// Computes the moment arm, torque (N m) per tension (N), m; for a sliding joint, force per tension.
    pub fn moment_arm(&self, q: f64) -> f64 {
        match self {
            Self::Guides(guides) => guides.moment_arm(q),
            Self::Constant(arm) => *arm,
        }
    }

    /// Computes the cable length taken up between 0 and `q`, m.
    pub fn excursion(&self, q: f64) -> f64 {
        match self {
            Self::Guides(guides) => guides.excursion(q),
            Self::Constant(arm) => arm * q,
        }
    }

    /// Computes the wrap angles (rad) of the cable before and after the joint; 0 without guides, which alone have
    /// friction.
    pub fn wraps(&self, q: f64) -> [f64; 2] {
        match self {
            Self::Guides(guides) => guides.wraps(q),
            Self::Constant(_) => [0.0, 0.0],
        }
    }
}

/// A joint that a cable crosses.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// Index in the hand's joint vector.
    pub joint: usize,
    /// Action of the cable on the joint.
    pub lever: Lever,
    /// Limits of the joint, rad or m.
    pub range: [f64; 2],
}

/// One cable.
#[derive(Debug, Clone)]
pub struct CablePath {
    /// The joints that the cable crosses, proximal first.
    pub joints: Vec<Crossing>,
}

impl CablePath {
    /// Computes the cable length taken up between q = 0 and `q` (of all joints, rad or m), m.
    pub fn excursion(&self, q: &[f64]) -> f64 {
        self.joints.iter().map(|Crossing { joint, lever, .. }| lever.excursion(q[*joint])).sum()
    }

    /// Computes the rate of the excursion, m/s.
    pub fn excursion_rate(&self, q: &[f64], qd: &[f64]) -> f64 {
        self.joints.iter().map(|Crossing { joint, lever, .. }| lever.moment_arm(q[*joint]) * qd[*joint]).sum()
    }

    /// Computes the sliding velocity of the cable over the guides before each span, m/s: the rate at which all spans
    /// from there on shorten.
    pub fn sliding_velocities(&self, q: &[f64], qd: &[f64]) -> [f64; MAX_SPANS] {
        let mut speeds = [0.0; MAX_SPANS];
        let mut sum = 0.0;
        for (n, Crossing { joint, lever, .. }) in self.joints.iter().enumerate().rev() {
            sum += lever.moment_arm(q[*joint]) * qd[*joint];
            speeds[n] = sum;
        }
        speeds
    }

    /// Computes the total wrap angle (rad) of the cable between the spool and each span, including the turn in the palm
    /// ([`CableFriction::routing`]).
    pub fn wraps(&self, q: &[f64], friction: &CableFriction) -> [f64; MAX_SPANS] {
        let mut wraps = [0.0; MAX_SPANS];
        let mut turned = friction.routing;
        for (wrap, Crossing { joint, lever, .. }) in wraps.iter_mut().zip(&self.joints) {
            let [before, after] = lever.wraps(q[*joint]);
            *wrap = turned + before;
            turned = *wrap + after;
        }
        wraps
    }

    /// Computes the tension of each span (N) for `tension` at the spool and guides in the given states of friction.
    pub fn span_tensions(
        &self,
        q: &[f64],
        tension: f64,
        friction: &CableFriction,
        states: &[f64; MAX_SPANS],
    ) -> [f64; MAX_SPANS] {
        let mut spans = [0.0; MAX_SPANS];
        let (mut carried, mut turned) = (tension, friction.routing);
        for (n, Crossing { joint, lever, .. }) in self.joints.iter().enumerate() {
            let [before, after] = lever.wraps(q[*joint]);
            carried *= friction.tension_ratio(states[n], turned + before);
            spans[n] = carried;
            turned = after;
        }
        spans
    }

    /// Computes the excursion of a closed digit, with every crossed joint at its upper limit, m.
    pub fn full_excursion(&self) -> f64 {
        self.joints.iter().map(|crossing| crossing.lever.excursion(crossing.range[1])).sum()
    }
}

/// A joint that a mechanism couples to another: q = multiplier * q_leader + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follower {
    /// Index of the following joint.
    pub joint: usize,
    /// Index of the joint that it follows.
    pub leader: usize,
    /// Ratio of its motion to the leader's.
    pub multiplier: f64,
    /// Offset, rad or m.
    pub offset: f64,
}

/// The whole transmission: a cable for each digit, the opposition drive and the springs.
#[derive(Debug, Clone)]
pub struct Transmission {
    /// Cable of each digit.
    pub cables: Vec<CablePath>,
    /// Joint of the thumb's opposition, which the last actuator turns; none in a hand without it.
    pub opposition: Option<usize>,
    /// Joints that follow others.
    pub followers: Vec<Follower>,
    /// Spring stiffness of each joint, N m/rad or N/m.
    pub springs: HandVector,
    /// Rest angle of each spring, rad: 0 in the nominal hand, negative where the spring presses the open joint against
    /// its stop.
    pub spring_rests: HandVector,
}

impl Transmission {
    /// Computes the torque that holds `joint` at angle `q` (rad) against its spring, N m.
    pub fn spring_torque(&self, joint: usize, q: f64) -> f64 {
        self.springs[joint] * (q - self.spring_rests[joint])
    }

    /// Computes the joint torques (N m) of cable `tensions` (N) and springs at `q` (rad), without the opposition drive.
    pub fn torques(&self, q: &[f64], tensions: &[f64]) -> HandVector {
        self.span_torques(q, tensions.iter().map(|tension| [*tension; MAX_SPANS]))
    }

    /// Like [`Self::torques`], with the tension (N) of each span of the cables.
    pub fn span_torques(&self, q: &[f64], spans: impl Iterator<Item = [f64; MAX_SPANS]>) -> HandVector {
        let mut torques: HandVector = q.iter().enumerate().map(|(joint, q)| -self.spring_torque(joint, *q)).collect();
        for (cable, tensions) in self.cables.iter().zip(spans) {
            for (Crossing { joint, lever, .. }, tension) in cable.joints.iter().zip(tensions) {
                torques[*joint] += lever.moment_arm(q[*joint]) * tension;
            }
        }
        torques
    }

    /// Estimates the tension (N) that best explains `torque` on the joints of `cable` at `q` (least squares over its
    /// moment arms).
    pub fn tension_for(&self, cable: usize, q: &[f64], torque: &[f64]) -> f64 {
        let (mut num, mut den) = (0.0, 0.0);
        for Crossing { joint, lever, .. } in &self.cables[cable].joints {
            let r = lever.moment_arm(q[*joint]);
            num += r * (torque[*joint] + self.spring_torque(*joint, q[*joint]));
            den += r * r;
        }
        num / den
    }

    /// Computes the coordinates (rad or m) of the joints on `cable` in static equilibrium at `tension` (N) without
    /// contact, within their limits.
    pub fn free_angles(&self, cable: usize, tension: f64) -> Vec<(usize, f64)> {
        self.free_angles_with_friction(cable, tension, &CableFriction::NONE, 0.0)
    }

    /// Like [`Self::free_angles`], with all guides in the same `state` of friction: 1 after closing, -1 after opening.
    pub fn free_angles_with_friction(
        &self,
        cable: usize,
        tension: f64,
        friction: &CableFriction,
        state: f64,
    ) -> Vec<(usize, f64)> {
        let (mut carried, mut turned) = (tension, friction.routing);
        let mut angles = Vec::with_capacity(MAX_SPANS);
        for Crossing { joint, lever, range: [lower, upper] } in &self.cables[cable].joints {
            let span = |q: f64| carried * friction.tension_ratio(state, turned + lever.wraps(q)[0]);
            // K q - r(q) T increases as long as the spring term grows faster than r. Bisection never diverges.
            let residual = |q: f64| self.spring_torque(*joint, q) - lever.moment_arm(q) * span(q);
            let angle = if residual(*upper) <= 0.0 { *upper } else { bisect(residual, [*lower, *upper], 60) };
            carried = span(angle);
            turned = lever.wraps(angle)[1];
            angles.push((*joint, angle));
        }
        angles
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Hand;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    proptest! {
        #[test]
        fn moment_arm_is_derivative_of_excursion(q in 0.01f64..1.55, cable in 0usize..5) {
            let hand = Hand::ftac();
            for Crossing { lever, .. } in &hand.transmission.cables[cable].joints {
                let h = 1e-6;
                let difference = (lever.excursion(q + h) - lever.excursion(q - h)) / (2.0 * h);
                prop_assert!((difference - lever.moment_arm(q)).abs() < 1e-9);
            }
        }

        /// Virtual work: tension times excursion rate equals cable torque times joint speed.
        #[test]
        fn reciprocity(q in proptest::collection::vec(0.0f64..1.57, 15), qd in proptest::collection::vec(-3.0f64..3.0, 15), t in proptest::collection::vec(0.0f64..40.0, 5)) {
            let hand = Hand::ftac();
            let tensions = [t[0], t[1], t[2], t[3], t[4]];
            let torques = hand.transmission.torques(&q, &tensions);
            let joint_power: f64 = (0..15).map(|j| (torques[j] + hand.transmission.springs[j] * q[j]) * qd[j]).sum();
            let cable_power: f64 = hand.transmission.cables.iter().zip(&tensions).map(|(c, t)| t * c.excursion_rate(&q, &qd)).sum();
            prop_assert!((joint_power - cable_power).abs() < 1e-9);
        }

        /// With friction the joints receive less work than the spool supplies; the sliding guides dissipate the
        /// difference.
        #[test]
        fn guides_take_the_missing_work(q in proptest::collection::vec(0.0f64..1.57, 15), qd in proptest::collection::vec(0.0f64..3.0, 15), tension in 0.0f64..40.0, cable in 0usize..5, closing: bool) {
            let hand = Hand::ftac();
            let path = &hand.transmission.cables[cable];
            let friction = hand.parameters.cable.friction;
            let (state, qd) = if closing { (1.0, qd) } else { (-1.0, qd.iter().map(|v| -v).collect()) };
            let spans = path.span_tensions(&q, tension, &friction, &[state; MAX_SPANS]);
            let given = tension * path.excursion_rate(&q, &qd);
            let got: f64 = path.joints.iter().zip(spans).map(|(c, t)| c.lever.moment_arm(q[c.joint]) * t * qd[c.joint]).sum();
            let sliding = path.sliding_velocities(&q, &qd);
            let taken: f64 = (0..path.joints.len()).map(|n| (if n == 0 { tension } else { spans[n - 1] } - spans[n]) * sliding[n]).sum();
            prop_assert!(taken >= 0.0);
            prop_assert!((given - got - taken).abs() < 1e-9, "{given} {got} {taken}");
        }

        /// A cable between symmetric guides turns by the joint's angle, half of it at each guide.
        #[test]
        fn turns_add_up_to_the_joint_angle(q in 0.0f64..1.57) {
            let hand = Hand::ftac();
            let [before, after] = hand.transmission.cables[1].joints[0].lever.wraps(q);
            prop_assert!((before + after - q).abs() < 1e-12 && (before - after).abs() < 1e-12);
        }

        #[test]
        fn tension_back_from_torque(q in proptest::collection::vec(0.0f64..1.57, 15), tension in 0.1f64..40.0, cable in 0usize..5) {
            let hand = Hand::ftac();
            let mut tensions = [0.0; 5];
            tensions[cable] = tension;
            let torques = hand.transmission.torques(&q, &tensions);
            prop_assert!((hand.transmission.tension_for(cable, &q, &torques) - tension).abs() < 1e-9);
        }
    }

    /// Mean moment arms near 9 / 7.5 / 6 mm, the design's intent.
    #[test]
    fn mean_moment_arms() {
        let hand = Hand::ftac();
        let mean: Vec<f64> =
            hand.transmission.cables[1].joints.iter().map(|own| own.lever.excursion(FRAC_PI_2) / FRAC_PI_2).collect();
        for (got, want) in mean.iter().zip([0.009, 0.0075, 0.006]) {
            assert!((got - want).abs() < 0.0008, "{mean:?}");
        }
    }

    /// Free equilibrium: spring torque equals cable torque at every joint inside its range.
    #[test]
    fn free_equilibrium() {
        let hand = Hand::ftac();
        for (joint, q) in hand.transmission.free_angles(1, 4.0) {
            let mut angles = [0.0; 15];
            angles[joint] = q;
            let mut tensions = [0.0; 5];
            tensions[1] = 4.0;
            assert!(hand.transmission.torques(&angles, &tensions)[joint].abs() < 1e-9);
        }
    }
}
