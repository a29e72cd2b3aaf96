//! The twin of one digit that moves freely: its servo, its cable and its joints, without the rest of the robot.
//!
//! The servo is the simulator's own. What the joints of a digit feel of each other's acceleration is in their [`chain`](crate::chain)'s mass
//! matrix; what the arm gives way is left out. Before a motion the digit is led as the robot
//! was: its servo goes where the encoder showed it, so that cable, guides and gear come to the end of their hystereses at which they were.

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

/// Steps of the twin in a tick: as many as the simulator's.
const STEPS: usize = 2;
/// For so long a digit comes to rest before it is led, s.
const SETTLING: f64 = 0.8;

/// What the twin shows before a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Servo's output angle, rad.
    pub servo: f64,
    /// Its speed, rad/s.
    pub speed: f64,
    /// Angles of the joints that it moves, in their order on it, rad.
    pub joints: [f64; SPANS],
}

/// One actuator with the digit on it.
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

/// Plays a motion: what the twin of `hand` with `losses` in its guides and gears shows before each tick behind the lead-in.
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
    /// Open, where the lead-in begins.
    fn at_rest(hand: &'a Hand, losses: CableLosses, motion: &FreeMotion) -> Self {
        let n = motion.actuator;
        let joints: Vec<usize> = match hand.transmission.cables.get(n) {
            Some(path) => path.joints.iter().map(|crossing| crossing.joint).collect(),
            None => hand.transmission.opposition.into_iter().collect(),
        };
        let last = match n {
            // What the opposition carries is the whole thumb.
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

    /// Lets tick `n` of the lead-in pass, with the servo where and as fast as the encoder showed it.
    fn led(&mut self, motion: &FreeMotion, n: usize) {
        (self.servo.angle, self.servo.speed) =
            (motion.angles[n], (motion.angles[n + 1] - motion.angles[n]) / motion.tick);
        self.servo.goal = motion.goals[n];
        self.tick(motion, n);
    }

    /// Lets tick `n` of the motion pass.
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

    /// Puts the thumb where its opposition servo is, and says how fast that turns it, rad/s.
    fn turned_thumb(&mut self, motion: &FreeMotion, n: usize) -> f64 {
        let ratio = self.hand.servos[OPPOSITION].gear_ratio_opposition;
        let joint = &self.hand.tree.joints[self.chain.links[0]];
        let at = |n: usize| (motion.opposition[n] / ratio).clamp(joint.lower, joint.upper);
        self.chain.angles[0] = at(n);
        (at((n + 1).min(motion.opposition.len() - 1)) - at(n)) / motion.tick
    }

    /// What moves each joint of the cable's digit, as in the simulator's drive.
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

    /// What moves each of the thumb's joints while the opposition turns on its shaft: the others hang on their springs, their cable is slack.
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

    /// What springs alone do.
    fn springs(&self) -> [Drive; MOST_LINKS] {
        let mut drives = [Drive::Turned(0.0); MOST_LINKS];
        for ((drive, link), angle) in drives.iter_mut().zip(&self.chain.links).zip(&self.chain.angles) {
            let springs = &self.hand.transmission;
            *drive = Drive::Effort(-springs.spring_torque(*link, *angle), springs.springs[*link]);
        }
        drives
    }
}

/// A point at the tip of a digit's last link, in its frame: the end of its cover's middle line, m.
pub fn fingertip(hand: &Hand, link: usize) -> Point3<f64> {
    let cover = &hand.covers[link];
    cover.link_from_cover * Point3::new(cover.half.x, 0.0, 0.0)
}
