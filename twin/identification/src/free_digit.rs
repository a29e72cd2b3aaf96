//! The twin of one digit that moves freely: its servo, its cable and its joints, without the rest of the robot.
//!
//! The servo is the simulator's own. Each joint is an oscillator of its own: the inertia of what it carries, damping, spring, cable
//! and weight; what the joints of a digit feel of each other's acceleration is left out, and so is the arm. In a slow motion that is
//! a thousandth of the springs' torques.

use hand_model::hand::MassProperties;
use hand_model::robot::ServoGoal;
use hand_model::transmission::SPANS;
use hand_model::transmission::friction::CableLosses;
use hand_model::{ACTUATORS, Hand};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use sim::drive::OPPOSITION_STIFFNESS;
use sim::servo::ServoModel;

use crate::free_motion::FreeMotion;

/// Steps of the twin in a tick: as many as the simulator's.
const STEPS: usize = 2;
/// For so long a digit comes to rest before a motion, s.
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

/// The links of a digit from the palm out.
struct Chain<'a> {
    hand: &'a Hand,
    links: Vec<usize>,
    /// Of each of `links`.
    angles: Vec<f64>,
}

impl Chain<'_> {
    /// Weight's torque on each link's joint, N m, under `gravity` (palm axes, m/s2).
    fn weights(&self, gravity: &Vector3<f64>) -> Vec<f64> {
        let poses = self.poses();
        let torque = |joint: usize| {
            let axis = poses[joint] * self.hand.tree.joints[self.links[joint]].axis.into_inner();
            let carried = joint..self.links.len();
            carried
                .map(|link| {
                    let MassProperties { mass, com, .. } = &self.hand.masses[self.links[link]];
                    let lever = (poses[link] * com).coords - poses[joint].translation.vector;
                    axis.dot(&lever.cross(gravity)) * mass
                })
                .sum()
        };
        (0..self.links.len()).map(torque).collect()
    }

    /// Inertia about each link's joint of what it carries, kg m2.
    fn inertias(&self) -> Vec<f64> {
        let poses = self.poses();
        let inertia = |joint: usize| {
            let axis = poses[joint] * self.hand.tree.joints[self.links[joint]].axis.into_inner();
            let carried = joint..self.links.len();
            carried
                .map(|link| {
                    let MassProperties { mass, com, inertia } = &self.hand.masses[self.links[link]];
                    let lever = (poses[link] * com).coords - poses[joint].translation.vector;
                    let own = poses[link].rotation.inverse() * axis;
                    own.dot(&(inertia * own)) + mass * axis.cross(&lever).norm_squared()
                })
                .sum()
        };
        (0..self.links.len()).map(inertia).collect()
    }

    fn poses(&self) -> Vec<Isometry3<f64>> {
        let mut pose = Isometry3::identity();
        self.links
            .iter()
            .zip(&self.angles)
            .map(|(link, angle)| {
                let joint = &self.hand.tree.joints[*link];
                pose *= joint.origin * UnitQuaternion::from_axis_angle(&joint.axis, *angle);
                pose
            })
            .collect()
    }
}

/// One actuator with the digit on it.
struct FreeDigit<'a> {
    hand: &'a Hand,
    actuator: usize,
    losses: CableLosses,
    chain: Chain<'a>,
    /// Places in the chain of the joints that the actuator moves.
    moved: Vec<usize>,
    inertias: Vec<f64>,
    speeds: [f64; SPANS],
    slides: [f64; SPANS],
    servo: ServoModel,
}

/// Plays a motion's currents: what the twin of `hand` with `losses` in its guides and gears shows before each tick.
pub fn play(hand: &Hand, losses: CableLosses, motion: &FreeMotion) -> Vec<Shown> {
    let mut digit = FreeDigit::at_rest(hand, losses, motion);
    let mut shown = Vec::with_capacity(motion.currents.len());
    for (n, current) in motion.currents.iter().enumerate() {
        shown.push(digit.shown());
        digit.servo.goal = ServoGoal::Current(*current);
        digit.tick(motion, n, false);
    }
    shown
}

impl<'a> FreeDigit<'a> {
    /// Open, where a motion begins.
    fn at_rest(hand: &'a Hand, losses: CableLosses, motion: &FreeMotion) -> Self {
        let n = motion.actuator;
        let joints: Vec<usize> = match hand.transmission.cables.get(n) {
            Some(path) => path.joints.iter().map(|(joint, _)| *joint).collect(),
            None => vec![hand.transmission.opposition_joint],
        };
        let last = match n {
            // What the opposition carries is the whole thumb.
            5 => hand.transmission.cables[0].joints.last().map_or(joints[0], |(joint, _)| *joint),
            _ => joints[joints.len() - 1],
        };
        let links = hand.tree.chain(last);
        let moved: Vec<usize> = joints.iter().filter_map(|joint| links.iter().position(|link| link == joint)).collect();
        let angles: Vec<f64> = links.iter().map(|link| hand.transmission.rests[*link].max(0.0)).collect();
        let chain = Chain { hand, links, angles };
        let mut servo = ServoModel::new(hand.servos[n.min(ACTUATORS - 1)], losses.backlash);
        servo.angle = motion.angles.first().copied().unwrap_or_default();
        let inertias = chain.inertias();
        let (speeds, slides) = ([0.0; SPANS], [-1.0; SPANS]);
        let mut digit = Self { hand, actuator: n, losses, chain, moved, inertias, speeds, slides, servo };
        for _ in 0..(SETTLING / motion.tick) as usize {
            digit.tick(motion, 0, true);
        }
        digit
    }

    fn shown(&self) -> Shown {
        let mut joints = [0.0; SPANS];
        joints.iter_mut().zip(&self.moved).for_each(|(joint, place)| *joint = self.chain.angles[*place]);
        Shown { servo: self.servo.angle, speed: self.servo.speed, joints }
    }

    /// Lets tick `n` of the motion pass; `held`: with the servo where it is.
    fn tick(&mut self, motion: &FreeMotion, n: usize, held: bool) {
        if self.actuator < 5 && self.chain.links[0] == self.hand.transmission.opposition_joint {
            self.chain.angles[0] = motion.opposition[n] / self.hand.servos[5].gear_ratio_opposition;
        }
        let weights = self.chain.weights(&motion.gravity[n]);
        if self.actuator >= 5 {
            self.hang(&weights);
        }
        let dt = motion.tick / STEPS as f64;
        for _ in 0..STEPS {
            let before = (self.servo.angle, self.servo.speed);
            let efforts = if self.actuator < 5 { self.pull(dt) } else { self.turn(dt) };
            if held {
                (self.servo.angle, self.servo.speed) = before;
            }
            self.advance(&efforts, &weights, dt);
        }
    }

    /// The thumb's other joints hang on their springs while the opposition turns it; their cable is slack.
    fn hang(&mut self, weights: &[f64]) {
        for (place, link) in self.chain.links.iter().enumerate().filter(|(place, _)| !self.moved.contains(place)) {
            let joint = &self.hand.tree.joints[*link];
            let springs = &self.hand.transmission;
            let hanging = springs.rests[*link] + weights[place] / springs.springs[*link];
            self.chain.angles[place] = hanging.clamp(joint.lower, joint.upper);
        }
    }

    /// Torque at the present angle (N m) and stiffness (N m/rad) of each joint on the cable, as in the simulator's drive.
    fn pull(&mut self, dt: f64) -> [(f64, f64); SPANS] {
        let (hand, n) = (self.hand, self.actuator);
        let (path, cable) = (&hand.transmission.cables[n], &hand.cables[n]);
        let (mut excursion, mut rate) = (0.0, 0.0);
        let mut arms = [0.0; SPANS];
        for (slot, (_, guides)) in path.joints.iter().enumerate() {
            let q = self.chain.angles[self.moved[slot]];
            arms[slot] = guides.moment_arm(q);
            excursion += guides.excursion(q);
            rate += arms[slot] * self.speeds[slot];
        }
        let tension = self.servo.step_cable(cable, excursion, rate, dt);
        let friction = hand.guides(n, &self.losses.friction);
        let mut sliding = 0.0;
        for slot in (0..path.joints.len()).rev() {
            sliding += arms[slot] * self.speeds[slot];
            self.slides[slot] = friction.slid(self.slides[slot], sliding * dt);
        }
        let (mut carried, mut turned) = (tension, friction.routing);
        let mut efforts = [(0.0, 0.0); SPANS];
        for (slot, (joint, guides)) in path.joints.iter().enumerate() {
            let q = self.chain.angles[self.moved[slot]];
            let [before, after] = guides.wraps(q);
            carried *= friction.ratio(self.slides[slot], turned + before);
            turned = after;
            let taut = if tension > 0.0 { cable.stiffness * arms[slot] * arms[slot] } else { 0.0 };
            let torque = arms[slot] * carried - hand.transmission.spring_torque(*joint, q);
            efforts[slot] = (torque, hand.transmission.springs[*joint] + taut);
        }
        efforts
    }

    /// The same of the opposition joint on its shaft.
    fn turn(&mut self, dt: f64) -> [(f64, f64); SPANS] {
        let joint = self.hand.transmission.opposition_joint;
        let (q, ratio) = (self.chain.angles[self.moved[0]], self.hand.servos[5].gear_ratio_opposition);
        let twist = self.servo.beyond_play(self.servo.angle / ratio - q, ratio);
        let torque = OPPOSITION_STIFFNESS * twist;
        self.servo.step_shaft(torque / ratio, dt);
        let spring = self.hand.transmission.spring_torque(joint, q);
        let mut efforts = [(0.0, 0.0); SPANS];
        efforts[0] = (torque - spring, OPPOSITION_STIFFNESS);
        efforts
    }

    /// An implicit step of every joint, which stops at its stops.
    fn advance(&mut self, efforts: &[(f64, f64); SPANS], weights: &[f64], dt: f64) {
        let defaults = self.hand.parameters.joint_defaults;
        for (slot, place) in self.moved.iter().enumerate() {
            let (torque, stiffness) = efforts[slot];
            let inertia = defaults.armature + self.inertias[*place];
            let speed = (inertia * self.speeds[slot] + dt * (torque + weights[*place]))
                / (inertia + dt * defaults.damping + dt * dt * stiffness);
            let joint = &self.hand.tree.joints[self.chain.links[*place]];
            let angle = self.chain.angles[*place] + dt * speed;
            let stopped = angle.clamp(joint.lower, joint.upper);
            self.speeds[slot] = if stopped == angle { speed } else { 0.0 };
            self.chain.angles[*place] = stopped;
        }
    }
}

/// A point at the tip of a digit's last link, in its frame: the end of its cover's middle line, m.
pub fn fingertip(hand: &Hand, link: usize) -> Point3<f64> {
    let cover = &hand.covers[link];
    cover.link_from_cover * Point3::new(cover.half.x, 0.0, 0.0)
}
