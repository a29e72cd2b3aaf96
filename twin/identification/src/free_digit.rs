//! Model of one digit that moves freely: its servo, its cable and its joints, without the rest of the robot.
//!
//! The servo model is the simulator's. Dynamic coupling between the joints of a digit is in the mass matrix of its
//! [`chain`](crate::chain); compliance of the arm is neglected. Before a motion, the digit is led like the robot: its
//! servo follows the encoder, so that cable, guides and gear reach the same state of their hystereses.

use hand_model::Hand;
use hand_model::robot::ServoGoal;
use hand_model::transmission::Crossing;
use hand_model::transmission::MAX_SPANS;
use hand_model::transmission::friction::CableLosses;
use nalgebra::Point3;
use sim::drive::OPPOSITION_STIFFNESS;
use sim::servo::ServoModel;

use crate::chain::{DigitChain, JointDrive, MAX_LINKS};
use crate::free_motion::FreeMotion;
use crate::script::OPPOSITION_ACTUATOR;

/// Integration steps per tick, as in the simulator.
const STEPS_PER_TICK: usize = 2;
/// Time for which a digit settles before the lead-in, s.
const SETTLING_TIME: f64 = 0.8;

/// State of the digit model before a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DigitState {
    /// Output angle of the servo, rad.
    pub servo: f64,
    /// Speed of the servo, rad/s.
    pub speed: f64,
    /// Angles of the joints that it moves, from the palm out, rad.
    pub joints: [f64; MAX_SPANS],
}

/// One actuator with its digit.
struct FreeDigit<'a> {
    hand: &'a Hand,
    actuator: usize,
    losses: CableLosses,
    chain: DigitChain<'a>,
    /// Indices in the chain of the joints that the actuator moves.
    moved_joints: Vec<usize>,
    slides: [f64; MAX_SPANS],
    servo: ServoModel,
}

/// Runs a motion on the model of `hand` with `losses` in its guides and gears. Returns the state before each tick after
/// the lead-in.
pub fn simulate_motion(hand: &Hand, losses: CableLosses, motion: &FreeMotion) -> Vec<DigitState> {
    let mut digit = FreeDigit::at_rest(hand, losses, motion);
    for n in 0..motion.lead_in {
        digit.advance_lead_in(motion, n);
    }
    digit.servo.angle = motion.angles[motion.lead_in];
    (motion.lead_in..motion.goals.len())
        .map(|n| {
            let shown = digit.state();
            digit.servo.goal = motion.goals[n];
            digit.tick(motion, n);
            shown
        })
        .collect()
}

impl<'a> FreeDigit<'a> {
    /// Creates the open digit at the start of the lead-in.
    fn at_rest(hand: &'a Hand, losses: CableLosses, motion: &FreeMotion) -> Self {
        let n = motion.actuator;
        let joints: Vec<usize> = match hand.transmission.cables.get(n) {
            Some(path) => path.joints.iter().map(|crossing| crossing.joint).collect(),
            None => hand.transmission.opposition.into_iter().collect(),
        };
        let last = match n {
            // The opposition servo carries the whole thumb.
            OPPOSITION_ACTUATOR => {
                hand.transmission.cables[0].joints.last().map_or(joints[0], |crossing| crossing.joint)
            }
            _ => joints[joints.len() - 1],
        };
        let links = hand.tree.chain(last);
        let moved: Vec<usize> = joints.iter().filter_map(|joint| links.iter().position(|link| link == joint)).collect();
        let chain = DigitChain::at_rest(hand, links);
        let mut servo = ServoModel::new(hand.servos[n], losses.backlash);
        servo.goal = ServoGoal::Current(0.0);
        let mut digit =
            Self { hand, actuator: n, losses, chain, moved_joints: moved, slides: [-1.0; MAX_SPANS], servo };
        for _ in 0..(SETTLING_TIME / motion.tick) as usize {
            (digit.servo.angle, digit.servo.speed) = (motion.angles[0], 0.0);
            digit.tick(motion, 0);
        }
        digit
    }

    fn state(&self) -> DigitState {
        let mut joints = [0.0; MAX_SPANS];
        joints.iter_mut().zip(&self.moved_joints).for_each(|(joint, place)| *joint = self.chain.angles[*place]);
        DigitState { servo: self.servo.angle, speed: self.servo.speed, joints }
    }

    /// Advances by tick `n` of the lead-in, with the servo's angle and speed prescribed by the encoder.
    fn advance_lead_in(&mut self, motion: &FreeMotion, n: usize) {
        (self.servo.angle, self.servo.speed) =
            (motion.angles[n], (motion.angles[n + 1] - motion.angles[n]) / motion.tick);
        self.servo.goal = motion.goals[n];
        self.tick(motion, n);
    }

    /// Advances by tick `n` of the motion.
    fn tick(&mut self, motion: &FreeMotion, n: usize) {
        let turning = (self.actuator != OPPOSITION_ACTUATOR
            && Some(self.chain.links[0]) == self.hand.transmission.opposition)
            .then(|| self.move_thumb(motion, n));
        let dt = motion.tick / STEPS_PER_TICK as f64;
        for _ in 0..STEPS_PER_TICK {
            let dynamics = self.chain.dynamics(&motion.gravity[n]);
            let mut drives =
                if self.actuator == OPPOSITION_ACTUATOR { self.opposition_drives(dt) } else { self.pull_drives(dt) };
            if let Some(speed) = turning {
                drives[0] = JointDrive::PrescribedSpeed(speed);
            }
            self.chain.advance(&dynamics, &drives, dt);
        }
    }

    /// Moves the thumb to the angle of its opposition servo. Returns its speed, rad/s.
    fn move_thumb(&mut self, motion: &FreeMotion, n: usize) -> f64 {
        let ratio = self.hand.servos[OPPOSITION_ACTUATOR].gear_ratio_opposition;
        let joint = &self.hand.tree.joints[self.chain.links[0]];
        let at = |n: usize| (motion.opposition[n] / ratio).clamp(joint.lower, joint.upper);
        self.chain.angles[0] = at(n);
        (at((n + 1).min(motion.opposition.len() - 1)) - at(n)) / motion.tick
    }

    /// Returns the drives of the joints of a cable-driven digit, as in the simulator's drive.
    fn pull_drives(&mut self, dt: f64) -> [JointDrive; MAX_LINKS] {
        let (hand, n) = (self.hand, self.actuator);
        let (path, cable) = (&hand.transmission.cables[n], &hand.cables[n]);
        let (mut excursion, mut rate) = (0.0, 0.0);
        let mut arms = [0.0; MAX_SPANS];
        for (slot, Crossing { lever, .. }) in path.joints.iter().enumerate() {
            let place = self.moved_joints[slot];
            let q = self.chain.angles[place];
            arms[slot] = lever.moment_arm(q);
            excursion += lever.excursion(q);
            rate += arms[slot] * self.chain.speeds[place];
        }
        let tension = self.servo.step_cable(cable, excursion, rate, dt);
        let friction = hand.cable_guide_friction(n, &self.losses.friction);
        let mut sliding = 0.0;
        for slot in (0..path.joints.len()).rev() {
            sliding += arms[slot] * self.chain.speeds[self.moved_joints[slot]];
            self.slides[slot] = friction.next_state(self.slides[slot], sliding * dt);
        }
        let (mut carried, mut turned) = (tension, friction.routing);
        let mut drives = self.spring_drives();
        for (slot, Crossing { joint, lever, .. }) in path.joints.iter().enumerate() {
            let q = self.chain.angles[self.moved_joints[slot]];
            let [before, after] = lever.wraps(q);
            carried *= friction.tension_ratio(self.slides[slot], turned + before);
            turned = after;
            let taut = if tension > 0.0 { cable.stiffness * arms[slot] * arms[slot] } else { 0.0 };
            let torque = arms[slot] * carried - hand.transmission.spring_torque(*joint, q);
            drives[self.moved_joints[slot]] = JointDrive::Effort(torque, hand.transmission.springs[*joint] + taut);
        }
        drives
    }

    /// Returns the drives of the thumb's joints while the opposition servo turns its shaft. The other joints hang on
    /// their springs, and their cable is slack.
    fn opposition_drives(&mut self, dt: f64) -> [JointDrive; MAX_LINKS] {
        let joint = self.chain.links[self.moved_joints[0]];
        let (q, ratio) =
            (self.chain.angles[self.moved_joints[0]], self.hand.servos[OPPOSITION_ACTUATOR].gear_ratio_opposition);
        let twist = self.servo.beyond_backlash(self.servo.angle / ratio - q, ratio);
        let torque = OPPOSITION_STIFFNESS * twist;
        self.servo.step_shaft(torque / ratio, dt);
        let spring = self.hand.transmission.spring_torque(joint, q);
        let mut drives = self.spring_drives();
        drives[self.moved_joints[0]] = JointDrive::Effort(torque - spring, OPPOSITION_STIFFNESS);
        drives
    }

    /// Returns the drives by the springs only.
    fn spring_drives(&self) -> [JointDrive; MAX_LINKS] {
        let mut drives = [JointDrive::PrescribedSpeed(0.0); MAX_LINKS];
        for ((drive, link), angle) in drives.iter_mut().zip(&self.chain.links).zip(&self.chain.angles) {
            let springs = &self.hand.transmission;
            *drive = JointDrive::Effort(-springs.spring_torque(*link, *angle), springs.springs[*link]);
        }
        drives
    }
}

/// Returns a point at the tip of a digit's last link, in its frame: the end of its cover's centre line, m.
pub fn fingertip(hand: &Hand, link: usize) -> Point3<f64> {
    let cover = &hand.covers[link];
    cover.link_from_cover * Point3::new(cover.half.x, 0.0, 0.0)
}
