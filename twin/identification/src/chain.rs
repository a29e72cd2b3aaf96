//! Dynamics of a digit's links from the palm out: torques of weight and velocity, mass matrix, and an implicit step of
//! the joints.

use hand_model::Hand;
use hand_model::hand::MassProperties;
use nalgebra::{Isometry3, Matrix4, UnitQuaternion, Vector3, Vector4};

/// Maximum number of joints between palm and fingertip.
pub const MAX_LINKS: usize = 4;

/// Drive of a joint during a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointDrive {
    /// Torque at the present angle, N m, and the stiffness by which it decreases as the joint moves, N m/rad.
    Effort(f64, f64),
    /// Speed prescribed by a stronger drive, rad/s.
    PrescribedSpeed(f64),
}

/// Links of a digit from the palm out.
#[derive(Debug, Clone)]
pub struct DigitChain<'a> {
    pub hand: &'a Hand,
    /// Indices of the joints.
    pub links: Vec<usize>,
    /// Angle of each joint, rad.
    pub angles: [f64; MAX_LINKS],
    /// Speed of each joint, rad/s.
    pub speeds: [f64; MAX_LINKS],
}

/// Loads and inertia of a chain in one posture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    /// Torque of weight, Coriolis and centrifugal forces on each joint, N m.
    pub loads: [f64; MAX_LINKS],
    /// Mass matrix, kg m2; rows and columns without a joint are those of the identity matrix.
    pub masses: Matrix4<f64>,
}

impl<'a> DigitChain<'a> {
    /// Creates a chain at rest, each joint at the rest angle of its spring.
    pub fn at_rest(hand: &'a Hand, links: Vec<usize>) -> Self {
        let mut angles = [0.0; MAX_LINKS];
        angles.iter_mut().zip(&links).for_each(|(angle, link)| *angle = hand.transmission.spring_rests[*link].max(0.0));
        Self { hand, links, angles, speeds: [0.0; MAX_LINKS] }
    }

    /// Computes the dynamics under `gravity` (palm axes, m/s2).
    pub fn dynamics(&self, gravity: &Vector3<f64>) -> Dynamics {
        let poses = self.poses();
        let count = self.links.len();
        let mut axes = [Vector3::zeros(); MAX_LINKS];
        for (axis, (pose, link)) in axes.iter_mut().zip(poses.iter().zip(&self.links)) {
            *axis = pose * self.hand.tree.joints[*link].axis.into_inner();
        }
        let (mut loads, mut masses) = ([0.0; MAX_LINKS], Matrix4::identity());
        masses.view_mut((0, 0), (count, count)).fill(0.0);
        // State of the current link: its angular velocity, and its angular acceleration and its joint's acceleration
        // with zero joint accelerations.
        let (mut turn, mut turning, mut rising) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let mut origin = Vector3::zeros();
        for link in 0..count {
            let MassProperties { mass, com, inertia } = &self.hand.masses[self.links[link]];
            let at = poses[link].translation.vector;
            let speeding = |lever: Vector3<f64>, turn: Vector3<f64>, turning: Vector3<f64>| {
                turning.cross(&lever) + turn.cross(&turn.cross(&lever))
            };
            rising += speeding(at - origin, turn, turning);
            origin = at;
            let own = axes[link] * self.speeds[link];
            turning += turn.cross(&own);
            turn += own;
            let middle = (poses[link] * com).coords;
            let axes_of = poses[link].rotation.to_rotation_matrix().into_inner();
            let inertia = axes_of * inertia * axes_of.transpose();
            let push = (gravity - rising - speeding(middle - at, turn, turning)) * *mass;
            let twist = -(inertia * turning + turn.cross(&(inertia * turn)));
            let mut carries = [Vector3::zeros(); MAX_LINKS];
            for joint in 0..=link {
                carries[joint] = axes[joint].cross(&(middle - poses[joint].translation.vector));
                loads[joint] += carries[joint].dot(&push) + axes[joint].dot(&twist);
                for other in 0..=joint {
                    let shared = mass * carries[joint].dot(&carries[other]) + axes[joint].dot(&(inertia * axes[other]));
                    masses[(joint, other)] += shared;
                    if other < joint {
                        masses[(other, joint)] += shared;
                    }
                }
            }
        }
        Dynamics { loads, masses }
    }

    /// Takes an implicit step of `dt` (s) of all joints, limited by their stops:
    /// `(M + A + dt D + dt2 K) v' = (M + A) v + dt torque`, with armature `A`, damping `D` and stiffness `K`.
    pub fn advance(&mut self, dynamics: &Dynamics, drives: &[JointDrive; MAX_LINKS], dt: f64) {
        let defaults = self.hand.parameters.joint_defaults;
        let mut masses = dynamics.masses;
        let mut implicit = [0.0; MAX_LINKS];
        let mut torques = Vector4::zeros();
        let mut turned = [None; MAX_LINKS];
        for n in 0..self.links.len() {
            masses[(n, n)] += defaults.armature;
            match drives[n] {
                JointDrive::Effort(torque, stiffness) => {
                    torques[n] = torque + dynamics.loads[n];
                    implicit[n] = dt * defaults.damping + dt * dt * stiffness;
                }
                JointDrive::PrescribedSpeed(speed) => turned[n] = Some(speed),
            }
        }
        let right = masses * Vector4::from(self.speeds) + dt * torques;
        let system = masses + Matrix4::from_diagonal(&Vector4::from(implicit));
        let mut speeds = solve_with_known(&system, &right, &turned);
        let mut stopped = [false; MAX_LINKS];
        for n in 0..self.links.len() {
            let joint = &self.hand.tree.joints[self.links[n]];
            let to = self.angles[n] + dt * speeds[n];
            let stop = to.clamp(joint.lower, joint.upper);
            if turned[n].is_none() && stop != to {
                (turned[n], stopped[n]) = (Some((stop - self.angles[n]) / dt), true);
            }
        }
        if stopped.contains(&true) {
            speeds = solve_with_known(&system, &right, &turned);
        }
        for n in 0..self.links.len() {
            let joint = &self.hand.tree.joints[self.links[n]];
            self.angles[n] = (self.angles[n] + dt * speeds[n]).clamp(joint.lower, joint.upper);
            self.speeds[n] = if stopped[n] { 0.0 } else { speeds[n] };
        }
    }

    fn poses(&self) -> [Isometry3<f64>; MAX_LINKS] {
        let mut poses = [Isometry3::identity(); MAX_LINKS];
        let mut pose = Isometry3::identity();
        for ((own, link), angle) in poses.iter_mut().zip(&self.links).zip(&self.angles) {
            let joint = &self.hand.tree.joints[*link];
            pose *= joint.origin * UnitQuaternion::from_axis_angle(&joint.axis, *angle);
            *own = pose;
        }
        poses
    }
}

/// Solves a symmetric system in which some unknowns are prescribed.
fn solve_with_known(system: &Matrix4<f64>, right: &Vector4<f64>, known: &[Option<f64>; MAX_LINKS]) -> Vector4<f64> {
    let (mut reduced, mut rest) = (*system, *right);
    for (n, value) in known.iter().enumerate() {
        let Some(value) = value else { continue };
        rest -= system.column(n) * *value;
        reduced.row_mut(n).fill(0.0);
        reduced.column_mut(n).fill(0.0);
        reduced[(n, n)] = 1.0;
    }
    for (n, value) in known.iter().enumerate() {
        if let Some(value) = value {
            rest[n] = *value;
        }
    }
    // Positive definite: the mass matrix is, and the terms added to its diagonal are not negative.
    reduced.cholesky().map_or_else(Vector4::zeros, |root| root.solve(&rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAVITY: Vector3<f64> = Vector3::new(2.0, -5.0, 8.0);

    /// Returns an undamped middle finger, in the middle of its travel, moving.
    fn swinging(hand: &Hand) -> DigitChain<'_> {
        let mut chain = DigitChain::at_rest(hand, hand.tree.chain(8));
        chain.angles = [0.6, 0.8, 0.7, 0.0];
        chain.speeds = [2.0, -3.0, 4.0, 0.0];
        chain
    }

    fn undamped() -> Hand {
        let mut hand = Hand::ftac();
        (hand.parameters.joint_defaults.damping, hand.parameters.joint_defaults.armature) = (0.0, 0.0);
        hand
    }

    /// Returns the potential energy, J.
    fn potential(chain: &DigitChain) -> f64 {
        let poses = chain.poses();
        let of = |(pose, link): (&Isometry3<f64>, &usize)| {
            let MassProperties { mass, com, .. } = &chain.hand.masses[*link];
            -mass * GRAVITY.dot(&(pose * com).coords)
        };
        poses.iter().zip(&chain.links).map(of).sum()
    }

    /// Returns the kinetic energy, J, from finite differences of the links' poses over `dt` (s).
    fn kinetic(chain: &DigitChain, dt: f64) -> f64 {
        let at = |way: f64| {
            let mut moved = chain.clone();
            moved.angles.iter_mut().zip(&chain.speeds).for_each(|(angle, speed)| *angle += way * dt * speed);
            moved.poses()
        };
        let (before, after) = (at(-0.5), at(0.5));
        let of = |(n, link): (usize, &usize)| {
            let MassProperties { mass, com, inertia } = &chain.hand.masses[*link];
            let speed = (after[n] * com - before[n] * com) / dt;
            let turn = (before[n].rotation.inverse() * after[n].rotation).scaled_axis() / dt;
            0.5 * mass * speed.norm_squared() + 0.5 * turn.dot(&(inertia * turn))
        };
        chain.links.iter().enumerate().map(of).sum()
    }

    /// At rest, the load is that of the weight: the negative gradient of the potential energy.
    #[test]
    fn a_load_at_rest_is_the_potential_s_gradient() {
        let hand = Hand::ftac();
        let mut chain = swinging(&hand);
        chain.speeds = [0.0; MAX_LINKS];
        let loads = chain.dynamics(&GRAVITY).loads;
        for (n, load) in loads.iter().enumerate().take(chain.links.len()) {
            let moved = |way: f64| {
                let mut moved = chain.clone();
                moved.angles[n] += way;
                potential(&moved)
            };
            let gradient = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((load + gradient).abs() < 1e-9, "{n} {load} {gradient}");
        }
    }

    #[test]
    fn the_mass_matrix_has_the_links_kinetic_energy() {
        let hand = Hand::ftac();
        let chain = swinging(&hand);
        let speeds = Vector4::from(chain.speeds);
        let energy = 0.5 * speeds.dot(&(chain.dynamics(&GRAVITY).masses * speeds));
        let links = kinetic(&chain, 1e-5);
        assert!((energy - links).abs() < 1e-6 * links, "{energy} {links}");
    }

    /// Only weight acts on the chain; Coriolis and centrifugal forces do no work.
    #[test]
    fn a_chain_without_damping_keeps_its_energy() {
        let hand = undamped();
        let mut chain = swinging(&hand);
        let energy = |chain: &DigitChain| {
            let speeds = Vector4::from(chain.speeds);
            0.5 * speeds.dot(&(chain.dynamics(&GRAVITY).masses * speeds)) + potential(chain)
        };
        let (before, kinetic) = (energy(&chain), energy(&chain) - potential(&chain));
        for _ in 0..20_000 {
            let dynamics = chain.dynamics(&GRAVITY);
            chain.advance(&dynamics, &[JointDrive::Effort(0.0, 0.0); MAX_LINKS], 2e-6);
        }
        assert!(chain.angles[..3].iter().all(|angle| (0.1..1.5).contains(angle)), "{:?}", chain.angles);
        let after = energy(&chain);
        assert!((after - before).abs() < 1e-3 * kinetic, "{before} {after} of {kinetic}");
    }

    /// A joint with a prescribed speed moves at that speed, and one at its stop stays there.
    #[test]
    fn turned_joints_turn_and_stops_stop() {
        let hand = Hand::ftac();
        let mut chain = swinging(&hand);
        chain.angles[2] = hand.tree.joints[chain.links[2]].lower;
        chain.speeds = [0.0; MAX_LINKS];
        let mut drives = [JointDrive::Effort(-0.1, 0.0); MAX_LINKS];
        drives[0] = JointDrive::PrescribedSpeed(0.5);
        let dynamics = chain.dynamics(&GRAVITY);
        chain.advance(&dynamics, &drives, 1e-3);
        assert!((chain.angles[0] - 0.6005).abs() < 1e-12 && chain.speeds[0] == 0.5, "{chain:?}");
        assert_eq!((chain.angles[2], chain.speeds[2]), (hand.tree.joints[chain.links[2]].lower, 0.0));
        assert!(chain.angles[1] < 0.8);
    }
}
