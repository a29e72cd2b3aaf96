//! Digital twin of one digit that moves freely: its servo, its cable and its joints, without the rest of the robot.
//!
//! The servo model is the simulator's. Dynamic coupling between the joints of a digit is in the mass matrix of its
//! [`chain`](crate::chain); compliance of the arm is neglected. Before a motion, the digit is led as the robot was: its servo
//! follows the encoder, so that cable, guides and gear reach the same state of their hystereses.

use hand_model::Hand;
use hand_model::robot::ServoGoal;
use hand_model::transmission::Crossing;
use hand_model::transmission::SPANS;
use hand_model::transmission::friction::CableLosses;
use nalgebra::Point3;
use sim::drive::OPPOSITION_STIFFNESS;
use sim::servo::ServoModel;

use crate::chain::{Chain, Drive, MOST_LINKS};
use crate::free_motion::FreeMotion;
use crate::script::OPPOSITION;

/// Integration steps per tick, as in the simulator.
const STEPS: usize = 2;
/// Time for which a digit settles before the lead-in, s.
const SETTLING: f64 = 0.8;

/// State of the digital twin before a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Output angle of the servo, rad.
    pub servo: f64,
    /// Speed of the servo, rad/s.
    pub speed: f64,
    /// Angles of the joints that it moves, from the palm out, rad.
    pub joints: [f64; SPANS],
}

/// One actuator with its digit.
struct FreeDigit<'a> {
    hand: &'a Hand,
    actuator: usize,
    losses: CableLosses,
    chain: Chain<'a>,
    /// Places in the chain of the joints that the actuator moves.
    moved: Vec<usize>,
    slides: [f64; SPANS],
    servo: ServoModel,
}

/// Plays a motion on the digital twin of `hand` with `losses` in its guides and gears. Returns the state before each
/// tick after the lead-in.
pub fn play(hand: &Hand, losses: CableLosses, motion: &FreeMotion) -> Vec<Shown> {
    let mut digit = FreeDigit::at_rest(hand, losses, motion);
    for n in 0..motion.lead_in {
        digit.led(motion, n);
    }
    digit.servo.angle = motion.angles[motion.lead_in];
    (motion.lead_in..motion.goals.len())
        .map(|n| {
            let shown = digit.shown();
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
            OPPOSITION => hand.transmission.cables[0].joints.last().map_or(joints[0], |crossing| crossing.joint),
            _ => joints[joints.len() - 1],
        };
        let links = hand.tree.chain(last);
        let moved: Vec<usize> = joints.iter().filter_map(|joint| links.iter().position(|link| link == joint)).collect();
        let chain = Chain::at_rest(hand, links);
        let mut servo = ServoModel::new(hand.servos[n], losses.backlash);
        servo.goal = ServoGoal::Current(0.0);
        let mut digit = Self { hand, actuator: n, losses, chain, moved, slides: [-1.0; SPANS], servo };
        for _ in 0..(SETTLING / motion.tick) as usize {
            (digit.servo.angle, digit.servo.speed) = (motion.angles[0], 0.0);
            digit.tick(motion, 0);
        }
        digit
    }

    fn shown(&self) -> Shown {
        let mut joints = [0.0; SPANS];
        joints.iter_mut().zip(&self.moved).for_each(|(joint, place)| *joint = self.chain.angles[*place]);
        Shown { servo: self.servo.angle, speed: self.servo.speed, joints }
    }

    /// Advances by tick `n` of the lead-in, with the servo's angle and speed prescribed by the encoder.
    fn led(&mut self, motion: &FreeMotion, n: usize) {
        (self.servo.angle, self.servo.speed) =
            (motion.angles[n], (motion.angles[n + 1] - motion.angles[n]) / motion.tick);
        self.servo.goal = motion.goals[n];
        self.tick(motion, n);
    }

    /// Advances by tick `n` of the motion.
    fn tick(&mut self, motion: &FreeMotion, n: usize) {
        let turning = (self.actuator != OPPOSITION && Some(self.chain.links[0]) == self.hand.transmission.opposition)
            .then(|| self.turned_thumb(motion, n));
        let dt = motion.tick / STEPS as f64;
        for _ in 0..STEPS {
            let dynamics = self.chain.dynamics(&motion.gravity[n]);
            let mut drives = if self.actuator == OPPOSITION { self.turn(dt) } else { self.pull(dt) };
            if let Some(speed) = turning {
                drives[0] = Drive::Turned(speed);
            }
            self.chain.advance(&dynamics, &drives, dt);
        }
    }

    /// Moves the thumb to the angle of its opposition servo. Returns its speed, rad/s.
    fn turned_thumb(&mut self, motion: &FreeMotion, n: usize) -> f64 {
        let ratio = self.hand.servos[OPPOSITION].gear_ratio_opposition;
        let joint = &self.hand.tree.joints[self.chain.links[0]];
        let at = |n: usize| (motion.opposition[n] / ratio).clamp(joint.lower, joint.upper);
        self.chain.angles[0] = at(n);
        (at((n + 1).min(motion.opposition.len() - 1)) - at(n)) / motion.tick
    }

    /// Returns the drives of the joints of a cable-driven digit, as in the simulator's drive.
    fn pull(&mut self, dt: f64) -> [Drive; MOST_LINKS] {
        let (hand, n) = (self.hand, self.actuator);
        let (path, cable) = (&hand.transmission.cables[n], &hand.cables[n]);
        let (mut excursion, mut rate) = (0.0, 0.0);
        let mut arms = [0.0; SPANS];
        for (slot, Crossing { lever, .. }) in path.joints.iter().enumerate() {
            let place = self.moved[slot];
            let q = self.chain.angles[place];
            arms[slot] = lever.moment_arm(q);
            excursion += lever.excursion(q);
            rate += arms[slot] * self.chain.speeds[place];
        }
        let tension = self.servo.step_cable(cable, excursion, rate, dt);
        let friction = hand.guides(n, &self.losses.friction);
        let mut sliding = 0.0;
        for slot in (0..path.joints.len()).rev() {
            sliding += arms[slot] * self.chain.speeds[self.moved[slot]];
            self.slides[slot] = friction.slid(self.slides[slot], sliding * dt);
        }
        let (mut carried, mut turned) = (tension, friction.routing);
        let mut drives = self.springs();
        for (slot, Crossing { joint, lever, .. }) in path.joints.iter().enumerate() {
            let q = self.chain.angles[self.moved[slot]];
            let [before, after] = lever.wraps(q);
            carried *= friction.ratio(self.slides[slot], turned + before);
            turned = after;
            let taut = if tension > 0.0 { cable.stiffness * arms[slot] * arms[slot] } else { 0.0 };
            let torque = arms[slot] * carried - hand.transmission.spring_torque(*joint, q);
            drives[self.moved[slot]] = Drive::Effort(torque, hand.transmission.springs[*joint] + taut);
        }
        drives
    }

    /// Returns the drives of the thumb's joints while the opposition servo turns its shaft. The other joints hang on
    /// their springs, and their cable is slack.
    fn turn(&mut self, dt: f64) -> [Drive; MOST_LINKS] {
        let joint = self.chain.links[self.moved[0]];
        let (q, ratio) = (self.chain.angles[self.moved[0]], self.hand.servos[OPPOSITION].gear_ratio_opposition);
        let twist = self.servo.beyond_play(self.servo.angle / ratio - q, ratio);
        let torque = OPPOSITION_STIFFNESS * twist;
        self.servo.step_shaft(torque / ratio, dt);
        let spring = self.hand.transmission.spring_torque(joint, q);
        let mut drives = self.springs();
        drives[self.moved[0]] = Drive::Effort(torque - spring, OPPOSITION_STIFFNESS);
        drives
    }

    /// Returns the drives by the springs alone.
    fn springs(&self) -> [Drive; MOST_LINKS] {
        let mut drives = [Drive::Turned(0.0); MOST_LINKS];
        for ((drive, link), angle) in drives.iter_mut().zip(&self.chain.links).zip(&self.chain.angles) {
            let springs = &self.hand.transmission;
            *drive = Drive::Effort(-springs.spring_torque(*link, *angle), springs.springs[*link]);
        }
        drives
    }
}

/// Returns a point at the tip of a digit's last link, in its frame: the end of its cover's centre line, m.
pub fn fingertip(hand: &Hand, link: usize) -> Point3<f64> {
    let cover = &hand.covers[link];
    cover.link_from_cover * Point3::new(cover.half.x, 0.0, 0.0)
}
