//! The test stand: a hand without the arm, its palm bolted to the world, and props that are put into it by hand.
//!
//! The world frame is the palm frame; the direction of gravity is free to choose. A prop can be held in place (fixed)
//! while the digits close, and released afterwards. [`Linkage`] is the mechanism alone, for any tree of joints whose
//! efforts come from outside; [`HandTestStand`] is a hand on it, driven by its servos.

mod linkage;
mod prop;

use std::sync::Arc;

use hand_model::robot::{ServoGoal, ServoState};
use hand_model::transmission::friction::{CableFriction, CableLosses};
use hand_model::{ActuatorVector, DigitVector, Hand, HandVector};
use nalgebra::{Isometry3, Point3, Vector3};
use rapier3d_f64::prelude::{ColliderHandle, RigidBodyHandle, RigidBodyType};

pub use linkage::{Linkage, LinkageModel};
pub(crate) use linkage::{are_connected, penetration_depth};
pub use prop::Prop;

use crate::body::cover_collider;
use crate::collision_model::link_groups;
use crate::contacts::contacts_of;
use crate::convert;
use crate::drive::HandDrive;
use crate::engine::EngineSettings;

/// A loaded contact between a prop and the hand.
#[derive(Debug, Clone, Copy)]
pub struct PropContact {
    /// Index of the prop.
    pub prop: usize,
    /// Link of the hand; `None` for the palm.
    pub link: Option<usize>,
    /// Contact point, palm frame, m.
    pub point: Point3<f64>,
    /// Normal force on the prop, N, palm frame.
    pub force: Vector3<f64>,
}

/// The F-TAC Hand on the stand. Cloning it branches the run bit-exactly.
#[derive(Clone)]
pub struct HandTestStand {
    hand: Arc<Hand>,
    linkage: Linkage,
    drive: HandDrive,
    props: Vec<(Prop, RigidBodyHandle, ColliderHandle)>,
    time: f64,
}

impl HandTestStand {
    /// Creates the open hand without gravity; the guide friction of its cables is that of its parameters.
    pub fn new(hand: Arc<Hand>, settings: EngineSettings) -> Self {
        let friction = hand.parameters.cable.friction;
        Self::with_friction(hand, settings, friction)
    }

    /// Like [`Self::new`], with a different guide friction of the cables.
    pub fn with_friction(hand: Arc<Hand>, settings: EngineSettings, friction: CableFriction) -> Self {
        let mut linkage = hand_linkage(&hand, settings, &hand.open_angles());
        linkage.set_gravity(&Vector3::zeros());
        Self {
            drive: HandDrive::new(&hand, CableLosses::from_friction(friction)),
            hand,
            linkage,
            props: Vec::new(),
            time: 0.0,
        }
    }

    pub fn hand(&self) -> &Arc<Hand> {
        &self.hand
    }

    /// Sets gravity (m/s2, palm frame).
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.linkage.set_gravity(gravity);
    }

    /// Adds a prop at `palm_from_prop`, held in place until [`Self::release_prop`]. Returns its index.
    pub fn add_prop(&mut self, prop: Prop, palm_from_prop: &Isometry3<f64>) -> usize {
        let (body, collider) = prop.insert(self.linkage.engine_mut(), palm_from_prop);
        self.props.push((prop, body, collider));
        self.props.len() - 1
    }

    /// Releases a prop.
    pub fn release_prop(&mut self, prop: usize) {
        let body = self.props[prop].1;
        self.linkage.engine_mut().bodies[body].set_body_type(RigidBodyType::Dynamic, true);
    }

    /// Advances one physics step with these servo goals.
    pub fn step(&mut self, goals: &[ServoGoal]) {
        let dt = self.linkage.engine().settings.dt;
        self.drive.set_goals(goals);
        let (q, qd) = (self.angles(), HandVector::from_iter(self.linkage.speeds().iter().copied()));
        let efforts = self.drive.step(&self.hand, &q, &qd, dt);
        self.linkage.step(&efforts);
        self.time += dt;
    }

    /// Runs for `seconds` with these servo goals.
    pub fn run(&mut self, goals: &[ServoGoal], seconds: f64) {
        let steps = (seconds / self.linkage.engine().settings.dt).round() as usize;
        for _ in 0..steps {
            self.step(goals);
        }
    }

    /// Returns the time since the stand was set up, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Returns the joint angles, rad.
    pub fn angles(&self) -> HandVector {
        self.linkage.angles().iter().copied().collect()
    }

    /// Returns the joint speeds, rad/s.
    pub fn speeds(&self) -> &[f64] {
        self.linkage.speeds()
    }

    /// Returns the cable tensions, N.
    pub fn tensions(&self) -> DigitVector {
        self.drive.tensions
    }

    /// Returns the servo readings.
    pub fn servos(&self) -> ActuatorVector<ServoState> {
        self.drive.states()
    }

    /// Returns `palm_from_link` of all links.
    pub fn links(&self) -> Vec<Isometry3<f64>> {
        self.linkage.links()
    }

    /// Returns the prop with index `index`.
    pub fn prop(&self, index: usize) -> &Prop {
        &self.props[index].0
    }

    /// Returns the number of props.
    pub fn prop_count(&self) -> usize {
        self.props.len()
    }

    /// Returns `palm_from_prop`.
    pub fn prop_pose(&self, prop: usize) -> Isometry3<f64> {
        convert::to_pose(self.linkage.engine().bodies[self.props[prop].1].position())
    }

    /// Returns the velocity of a prop's body, m/s.
    pub fn prop_velocity(&self, prop: usize) -> Vector3<f64> {
        convert::to_vector(self.linkage.engine().bodies[self.props[prop].1].linvel())
    }

    /// Returns all loaded contacts of props with the hand in the last step.
    pub fn contacts(&self) -> Vec<PropContact> {
        let mut found = Vec::new();
        for (prop, (_, _, collider)) in self.props.iter().enumerate() {
            for contact in contacts_of(self.linkage.engine(), *collider) {
                if let Some(link) = self.linkage.cover_of(contact.other) {
                    found.push(PropContact {
                        prop,
                        link,
                        point: contact.point,
                        force: -contact.normal * contact.force,
                    });
                }
            }
        }
        found
    }

    /// Returns the deepest penetration between a prop and the hand's covers, m; 0 without contact.
    pub fn prop_penetration(&self, prop: usize) -> f64 {
        self.linkage.penetration(self.props[prop].2)
    }

    /// Returns the deepest penetration between any two covers of the hand that no joint connects, m.
    pub fn self_penetration(&self) -> f64 {
        self.linkage.self_penetration(&self.hand.tree)
    }
}

/// Builds the hand's mechanism at joint angles `start` (rad), with its covers. Digits of which no joint follows another's
/// are separate multibodies: on a fixed palm they do not feel each other's inertia.
fn hand_linkage(hand: &Hand, settings: EngineSettings, start: &[f64]) -> Linkage {
    let separate_roots = hand.transmission.followers.is_empty();
    let covers = std::iter::once((None, &hand.palm_cover))
        .chain(hand.covers.iter().enumerate().map(|(link, cover)| (Some(link), cover)))
        .map(|(link, cover)| {
            (link, cover_collider(cover).collision_groups(link_groups(&hand.tree, link, separate_roots)))
        })
        .collect();
    let (damping, armature) = (hand.each_joint(|n| hand.joint_damping(n)), hand.each_joint(|n| hand.joint_armature(n)));
    let (tree, masses) = (&hand.tree, &hand.masses);
    let mechanism = LinkageModel { tree, masses, damping: &damping, armature: &armature, separate_roots };
    Linkage::new(settings, &mechanism, covers, start)
}

/// Computes the deepest penetration between any two covers of the hand that no joint connects, with its joints at
/// `angles` (rad), m.
pub fn self_penetration_at(hand: &Hand, angles: &[f64]) -> f64 {
    hand_linkage(hand, EngineSettings::default(), angles).self_penetration(&hand.tree)
}

/// Computes the servo goals for the five cable tensions (N, held by current control) and the angle of the opposition
/// joint (rad).
pub fn tension_goals(hand: &Hand, tensions: &[f64], opposition: f64) -> ActuatorVector<ServoGoal> {
    hand.servo_goals(tensions, opposition, hand.parameters.servo.current_limit)
}
