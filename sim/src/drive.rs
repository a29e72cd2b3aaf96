//! Servos on the cable transmission: from servo goals to the torque and implicit stiffness of every finger joint.

use hand_model::robot::{ServoGoal, ServoState};
use hand_model::transmission::friction::{CableFriction, CableLosses};
use hand_model::transmission::{Crossing, MAX_SPANS};
use hand_model::{ActuatorVector, DigitVector, Hand, HandVector};

use crate::servo::ServoModel;

/// Stiffness of the shaft between the opposition servo and the thumb's CMC joint, N m/rad.
pub const OPPOSITION_STIFFNESS: f64 = 8.0;

/// Default state of a guide ([`CableFriction::next_state`]) whose cable was pulled in and then came to rest. Set by
/// hand: with it 30 of 30 planned grasps that hold from their own first grasp also hold when started from its posture;
/// with 0 and 1 it is 26 and 27.
const REST_GUIDE_STATE: f64 = 0.5;

/// Load on a finger joint during one physics step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointEffort {
    /// Torque at the present angle, N m.
    pub torque: f64,
    /// Stiffness, N m/rad: the decrease of the torque as the joint moves on.
    pub stiffness: f64,
}

/// The hand's servos with their cables.
#[derive(Debug, Clone)]
pub struct HandDrive {
    servos: Vec<ServoModel>,
    /// Guide friction of each cable.
    friction: Vec<CableFriction>,
    guide_states: DigitVector<[f64; MAX_SPANS]>,
    /// Length of cable that each spool has released, m: by slip, or more than the whole cable after a break.
    released_length: DigitVector,
    /// Cable tensions at the spools in the last step, N.
    pub tensions: DigitVector,
}

impl HandDrive {
    /// Creates the drive with slack cables, servos at rest, and these losses in guides and gears.
    pub fn new(hand: &Hand, losses: CableLosses) -> Self {
        Self {
            servos: hand.servos.iter().map(|servo| ServoModel::new(*servo, losses.backlash)).collect(),
            friction: (0..hand.cables.len()).map(|n| hand.cable_guide_friction(n, &losses.friction)).collect(),
            guide_states: hand.each_digit(|_| [0.0; MAX_SPANS]),
            released_length: hand.slack_tensions(),
            tensions: hand.slack_tensions(),
        }
    }

    /// Sets the servos to these angles (rad), and the guides of wound cables to [`REST_GUIDE_STATE`].
    #[must_use]
    pub fn with_angles(mut self, angles: &ActuatorVector) -> Self {
        for (servo, angle) in self.servos.iter_mut().zip(angles) {
            servo.angle = *angle;
        }
        for (slides, angle) in self.guide_states.iter_mut().zip(angles) {
            *slides = [if *angle > 0.0 { REST_GUIDE_STATE } else { 0.0 }; MAX_SPANS];
        }
        self
    }

    /// Sets the goal of each servo.
    pub fn set_goals(&mut self, goals: &[ServoGoal]) {
        for (servo, goal) in self.servos.iter_mut().zip(goals) {
            servo.goal = *goal;
        }
    }

    /// Returns the servo readings.
    pub fn states(&self) -> ActuatorVector<ServoState> {
        self.servos.iter().map(ServoModel::state).collect()
    }

    /// Releases `length` (m) more of cable `n` from its spool.
    pub fn release_cable(&mut self, n: usize, length: f64) {
        self.released_length[n] += length;
    }

    /// Scales the torque of servo `n` by `factor` from now on.
    pub fn weaken(&mut self, n: usize, factor: f64) {
        self.servos[n].weaken(factor);
    }

    /// Sets each servo to the measured angle and speed.
    pub fn set_measured(&mut self, measured: &[ServoState]) {
        for (servo, measured) in self.servos.iter_mut().zip(measured) {
            (servo.angle, servo.speed) = (measured.position, measured.velocity);
        }
    }

    /// Advances the servos by `dt` (s), with the joints at angles `q` (rad) and speeds `qd` (rad/s).
    pub fn step(&mut self, hand: &Hand, q: &[f64], qd: &[f64], dt: f64) -> HandVector<JointEffort> {
        let transmission = &hand.transmission;
        for (n, path) in transmission.cables.iter().enumerate() {
            let excursion = path.excursion(q);
            let rate = path.excursion_rate(q, qd);
            self.tensions[n] =
                self.servos[n].step_cable(&hand.cables[n], excursion + self.released_length[n], rate, dt);
        }
        let spans = self.span_tensions(hand, q, qd, dt);
        let torques = transmission.span_torques(q, spans.into_iter());
        let mut stiffness = transmission.springs;
        for ((path, tension), cable) in transmission.cables.iter().zip(&self.tensions).zip(&hand.cables) {
            if *tension > 0.0 {
                for Crossing { joint, lever, .. } in &path.joints {
                    stiffness[*joint] += cable.stiffness * lever.moment_arm(q[*joint]).powi(2);
                }
            }
        }
        let mut efforts = hand.each_joint(|joint| JointEffort { torque: torques[joint], stiffness: stiffness[joint] });
        if let Some(joint) = transmission.opposition {
            efforts[joint] = self.step_opposition(hand, (joint, q[joint]), dt);
        }
        efforts
    }

    /// Computes the tension of every span, N, after the guides' friction has followed the cables' motion.
    fn span_tensions(&mut self, hand: &Hand, q: &[f64], qd: &[f64], dt: f64) -> DigitVector<[f64; MAX_SPANS]> {
        hand.each_digit(|n| {
            let friction = &self.friction[n];
            if friction.coefficient == 0.0 {
                return [self.tensions[n]; MAX_SPANS];
            }
            let path = &hand.transmission.cables[n];
            for (state, speed) in self.guide_states[n].iter_mut().zip(path.sliding_velocities(q, qd)) {
                *state = friction.next_state(*state, speed * dt);
            }
            path.span_tensions(q, self.tensions[n], friction, &self.guide_states[n])
        })
    }

    /// Advances the last servo, which turns the thumb's CMC joint at `q` (rad) through a stiff shaft.
    fn step_opposition(&mut self, hand: &Hand, (joint, q): (usize, f64), dt: f64) -> JointEffort {
        let last = self.servos.len() - 1;
        let ratio = hand.servos[last].gear_ratio_opposition;
        let servo = &mut self.servos[last];
        let twist = servo.beyond_backlash(servo.angle / ratio - q, ratio);
        let torque = OPPOSITION_STIFFNESS * twist;
        servo.step_shaft(torque / ratio, dt);
        let spring = hand.transmission.spring_torque(joint, q);
        JointEffort { torque: torque - spring, stiffness: OPPOSITION_STIFFNESS }
    }
}
