//! Payload that the hand lifts: its parameters in the script, and the arm motions that pick it up.
//!
//! The arm stands in some postures with an empty hand, and in the same ones with the payload in it. The difference of
//! its torques is due to the weight of the payload, which is known from a scale. It gives the gains of the torque
//! sensors ([`payload_calibration`](crate::payload_calibration)).

use std::path::Path;

use control::inverse_kinematics::Joints;
use control::motion::approach::APPROACH_DISTANCE;
use dexterous_grasping::Grasp;
use dexterous_grasping::grasp::pregrasp_pose;
use ftac_platform::data::DataError;
use hand_model::{ArmVector, Hand, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use world::objects::{ObjectModel, ObjectSet};

use crate::ball::keeps_elbow_side;
use crate::ball_clearance::{grid_points, kinematics, posed_covers, straight_line};

/// A posture of the arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptPosture {
    pub name: String,
    /// Angles added to those of the ready posture, rad.
    pub turn: ArmVector,
}

/// Minimum difference of some joint between two postures of a script, rad, so that they can be distinguished in a
/// session.
pub const MIN_POSTURE_DIFFERENCE: f64 = 0.05;
/// Number of headings of the hand that are tried about a rotationally symmetric object.
const HEADING_COUNT: usize = 16;
/// Length of a piece of the straight path to the object and up from it, m.
const PATH_STEP: f64 = 0.005;
/// Maximum rotation of a joint between two pieces, rad: a jump to another branch of the inverse kinematics is not a
/// straight path.
const MAX_JOINT_STEP: f64 = 0.3;
/// Minimum clearance of the hand's links from the table on the path to the object, m.
const TABLE_CLEARANCE: f64 = 0.01;
/// Number of points of the path at which the clearance is checked.
const CLEARANCE_CHECK_COUNT: usize = 20;

/// An object of known mass that is lifted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Name among the built-in objects.
    pub object: String,
    /// Mass measured by a scale, kg.
    pub mass: f64,
    /// Standard deviation of `mass`, kg.
    pub mass_uncertain: f64,
    /// Position of its centre on the arm's table, in the frame of the arm's base, m; its yaw is 0. An operator places
    /// it there.
    pub place: [f64; 2],
    /// Standard deviation of `place` along each axis, m.
    pub place_uncertain: f64,
    /// Height by which it is lifted before it is carried, m.
    pub lift: f64,
    /// Time for which the arm stands in each posture, s.
    pub hold: f64,
    /// Postures in which it is held.
    pub posture: Vec<ScriptPosture>,
}

/// Part of payload calibration that is done in one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PayloadStep {
    /// The arm stands in the posture of this index with an empty hand.
    Empty(usize),
    /// The object is picked up, held in every posture, and put down again.
    Lifted,
}

/// Arm trajectory that picks up an object.
#[derive(Debug, Clone, PartialEq)]
pub struct PickUpPath {
    pub grasp: Grasp,
    /// Postures from before the object to the closing of the digits.
    pub approach: Vec<Joints>,
    /// Postures from there on, while the digits close.
    pub raise: Vec<Joints>,
    /// Postures of the lift, straight up.
    pub lift: Vec<Joints>,
}

impl Payload {
    /// Returns the object's model; none for an unknown object, which [`Payload::check`] refuses.
    pub fn model(&self) -> Option<ObjectModel> {
        ObjectSet::standard().get(&self.object).map(|model| (**model).clone())
    }

    /// Returns all parts, in order.
    pub fn payload_steps(&self) -> Vec<PayloadStep> {
        (0..self.posture.len()).map(PayloadStep::Empty).chain([PayloadStep::Lifted]).collect()
    }

    /// Returns the joint angles in posture `n` of an arm whose ready posture is `ready`, rad.
    pub fn posture_joints(&self, n: usize, ready: &Joints) -> Joints {
        ready.iter().zip(self.posture[n].turn).map(|(ready, turn)| ready + turn).collect()
    }

    /// Refuses an object that cannot be lifted. `others` are the script's other postures; `path` is used in errors.
    pub fn check(&self, others: &[ScriptPosture], path: &Path) -> Result<(), DataError> {
        let fault =
            |field: String, found: String, expected: String| Err(DataError::field(path, field, found, expected));
        let values = [
            ("mass", self.mass, 0.02, 2.0),
            ("mass_uncertain", self.mass_uncertain, 1e-5, 0.1 * self.mass),
            ("place", self.place[0], 0.3, 0.75),
            ("place", self.place[1], -0.5, 0.5),
            ("place_uncertain", self.place_uncertain, 1e-4, 0.01),
            ("lift", self.lift, 0.03, 0.3),
            ("hold", self.hold, 0.2, 10.0),
        ];
        for (field, value, low, high) in values {
            if !(value.is_finite() && (low..=high).contains(&value)) {
                return fault(format!("weight.{field}"), value.to_string(), format!("{low} to {high} (SI units)"));
            }
        }
        if self.model().is_none() {
            let expected = "the name of a built-in object".to_owned();
            return fault("weight.object".into(), format!("`{}`", self.object), expected);
        }
        if self.posture.is_empty() {
            return fault("weight.posture".into(), "none".into(), "at least one".into());
        }
        for (n, posture) in self.posture.iter().enumerate() {
            let field = || format!("weight.posture[{}].turn", posture.name);
            if let Some(turn) = posture.turn.iter().find(|turn| !(turn.is_finite() && turn.abs() <= 4.0)) {
                return fault(field(), turn.to_string(), "angles within 4 rad".into());
            }
            if let Some(same) = others.iter().chain(&self.posture[..n]).find(|other| !posture.differs_from(other)) {
                let expected = format!("{MIN_POSTURE_DIFFERENCE} rad in some joint from every other posture");
                return fault(field(), format!("that of `{}`", same.name), expected);
            }
        }
        Ok(())
    }

    /// Plans how the arm of `robot` picks up the object at its place, coming from posture `from`: for each of `grasps`,
    /// with the first heading that the arm reaches without going below the table.
    pub fn plan_pick_ups<'a>(
        &'a self,
        robot: &'a RobotModel,
        object: &'a ObjectModel,
        grasps: &'a [Grasp],
        from: &'a Joints,
    ) -> impl Iterator<Item = PickUpPath> + 'a {
        let [x, y] = self.place;
        let middle = Point3::new(x, y, object.rest_height());
        let turns = if object.round_about_vertical(&object.rest) { HEADING_COUNT } else { 1 };
        let yaws = (0..turns).map(move |n| std::f64::consts::TAU * n as f64 / turns as f64);
        grasps.iter().filter_map(move |grasp| {
            yaws.clone().find_map(|yaw| self.plan_pick_up(robot, grasp, &grasp.palm_pose(&middle, yaw), from))
        })
    }

    fn plan_pick_up(
        &self,
        robot: &RobotModel,
        grasp: &Grasp,
        target: &Isometry3<f64>,
        from: &Joints,
    ) -> Option<PickUpPath> {
        let hand = &robot.hand;
        let kinematics = kinematics(robot);
        let before = pregrasp_pose(hand, target, APPROACH_DISTANCE);
        let begin = kinematics.solve(&before, from)?;
        // Straight lines in joint space lead there and back: none may lead round to the other side of the arm.
        if !keeps_elbow_side(from, &begin) {
            return None;
        }
        let line = |from: &Joints, start: &Isometry3<f64>, end: &Isometry3<f64>| {
            let way = end.translation.vector - start.translation.vector;
            let pieces = (way.norm() / PATH_STEP).ceil().max(1.0) as usize;
            let mut joints: Vec<Joints> = Vec::with_capacity(pieces);
            for piece in 1..=pieces {
                let along = start.translation.vector + way * (piece as f64 / pieces as f64);
                let seed = joints.last().unwrap_or(from);
                let next = kinematics.solve(&Isometry3::from_parts(Translation3::from(along), start.rotation), seed)?;
                if (0..next.len()).any(|joint| (next[joint] - seed[joint]).abs() > MAX_JOINT_STEP) {
                    return None;
                }
                joints.push(next);
            }
            Some(joints)
        };
        let above = |pose: &Isometry3<f64>, height: f64| Translation3::from(Vector3::z() * height) * pose;
        let (raised, lifted) = (above(target, grasp.raise), above(target, grasp.raise + self.lift));
        let mut approach = vec![begin];
        approach.extend(line(&begin, &before, target)?);
        let raise = line(approach.last()?, target, &raised)?;
        let lift = line(raise.last()?, &raised, &lifted)?;
        straight_line(from, &begin, CLEARANCE_CHECK_COUNT)
            .all(|at| is_over_table(hand, &kinematics.palm_pose(&at)))
            .then(|| PickUpPath { grasp: grasp.clone(), approach, raise, lift })
    }
}

/// True if the open hand with its palm at `palm` is clear of the table.
fn is_over_table(hand: &Hand, palm: &Isometry3<f64>) -> bool {
    posed_covers(hand, palm).all(|(_, pose, cover)| grid_points(cover).all(|point| (pose * point).z > TABLE_CLEARANCE))
}
