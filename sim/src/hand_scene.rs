//! The hand alone, its palm fixed in space, with one floating object: the scene in which a grasp is closed and tested.
//!
//! World axes are the palm's. Without an arm the five digits do not feel each other's inertia, so each is a multibody of three
//! joints on the fixed palm; that costs a fraction of one body of all joints. Cables pull with given tensions (servos in current
//! control at rest), the opposition servo holds its angle. There is no gravity: the protocol's forces are applied instead.

use std::sync::Arc;

use hand_model::hand::CoverShape;
use hand_model::{DigitVector, Hand, HandVector};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;

use crate::body::{cover_collider, groups, link_body, load_hinge, revolute};
use crate::contacts::contacts_of;
use crate::convert;
use crate::drive::OPPOSITION_STIFFNESS;
use crate::engine::{Engine, EngineSettings};
use crate::scene::{ObjectPlacement, insert_object};

/// Collision group of the palm's cover.
const PALM: Group = Group::GROUP_5;

/// Command of the hand: tensions of the cables (N) and the opposition angle (rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull {
    /// N.
    pub tensions: DigitVector,
    /// rad.
    pub opposition: f64,
}

/// A contact between hand and object.
#[derive(Debug, Clone, Copy)]
pub struct Touch {
    /// Hand link, `None` for the palm.
    pub link: Option<usize>,
    /// Palm frame, m.
    pub point: Point3<f64>,
    /// Unit normal into the object, palm frame.
    pub normal: UnitVector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// The scene. Cloning it branches the run bit-exactly.
#[derive(Clone)]
pub struct HandScene {
    hand: Arc<Hand>,
    engine: Engine,
    joints: Vec<MultibodyJointHandle>,
    covers: Vec<ColliderHandle>,
    body: RigidBodyHandle,
    collider: ColliderHandle,
    angles: HandVector,
}

impl HandScene {
    /// The hand with its joints at `angles` (rad) and `object` at rest at `palm_from_object`.
    pub fn new(hand: &Arc<Hand>, object: &Arc<ObjectModel>, palm_from_object: &Isometry3<f64>, angles: &[f64]) -> Self {
        let mut engine = Engine::new(EngineSettings::default());
        engine.gravity = Vector::ZERO;
        let palm = engine.bodies.insert(RigidBodyBuilder::fixed());
        // Neighbouring links do not collide. The engine sees to that along a digit; between the palm's cover and the first
        // links, which hang on roots of their own, groups do.
        let links_only = groups::HAND | groups::OBJECT;
        let cover = |engine: &mut Engine, shape: &CoverShape, body, member: Group, filter: Group| {
            let collider = cover_collider(shape)
                .collision_groups(InteractionGroups::all().with_memberships(member).with_filter(filter));
            engine.colliders.insert_with_parent(collider, body, &mut engine.bodies)
        };
        let mut covers = vec![cover(&mut engine, &hand.palm_cover, palm, PALM, links_only)];
        let mut joints = Vec::with_capacity(hand.tree.len());
        let mut links: Vec<RigidBodyHandle> = Vec::with_capacity(hand.tree.len());
        let poses = hand.tree.forward(&hand.open());
        for (i, joint) in hand.tree.joints.iter().enumerate() {
            let body = engine.bodies.insert(link_body(&poses[i], &hand.masses[i]));
            // A root for each digit: digits that share one become one multibody of all joints.
            let parent = match joint.parent {
                Some(parent) => links[parent],
                None => engine.bodies.insert(RigidBodyBuilder::fixed()),
            };
            let limits = [joint.lower, joint.upper];
            joints.extend(engine.multibodies.insert(parent, body, revolute(&joint.origin, &joint.axis, limits), true));
            let filter = if joint.parent.is_some() { links_only | PALM } else { links_only };
            covers.push(cover(&mut engine, &hand.covers[i], body, groups::HAND, filter));
            links.push(body);
        }
        let placement = ObjectPlacement { model: object.clone(), pose: *palm_from_object };
        let (_, body, collider) = insert_object(&mut engine, &placement);
        let mut scene = Self {
            hand: hand.clone(),
            engine,
            joints,
            covers,
            body,
            collider,
            angles: angles.iter().copied().collect(),
        };
        scene.settle_freedom(angles);
        scene
    }

    /// Sets up every digit's degrees of freedom at its starting angles.
    fn settle_freedom(&mut self, angles: &[f64]) {
        let mut first = 0;
        while first < angles.len() {
            let bodies = &self.engine.bodies;
            let Some((multibody, _)) = self.engine.multibodies.get_mut(self.joints[first]) else { return };
            multibody.set_self_contacts_enabled(true);
            // A fixed root first appears as a free one; this settles the degrees of freedom.
            multibody.forward_kinematics(bodies, true);
            let count = multibody.ndofs();
            for n in 0..count {
                multibody.damping_mut()[n] = self.hand.joint_damping(first + n);
                multibody.armature_mut()[n] = self.hand.joint_armature(first + n);
            }
            multibody.apply_displacements(&angles[first..first + count]);
            multibody.forward_kinematics(bodies, false);
            multibody.update_rigid_bodies(&mut self.engine.bodies, true);
            first += count;
        }
    }

    /// Damping of the object's motion, 1/s, linear and angular: what stands in for a table or a free hand while digits close.
    pub fn set_object_damping(&mut self, damping: f64) {
        let body = &mut self.engine.bodies[self.body];
        body.set_linear_damping(damping);
        body.set_angular_damping(damping);
    }

    /// Friction coefficient between hand and object.
    pub fn set_friction(&mut self, friction: f64) {
        self.engine.colliders[self.collider].set_friction(friction);
    }

    /// One time step with the hand pulling and `force` (N, palm frame) on the object's centre of mass.
    pub fn step(&mut self, pull: &Pull, force: &Vector3<f64>) {
        let transmission = &self.hand.transmission;
        let torques = transmission.torques(&self.angles, &pull.tensions);
        let slack = self.engine.limit_slack();
        for (joint, free) in torques.into_iter().enumerate() {
            let (torque, stiffness) = if transmission.opposition == Some(joint) {
                let servo = &self.hand.servos[self.hand.cables.len()];
                let limit = servo.stall_torque * servo.gear_ratio_opposition;
                let servo = (OPPOSITION_STIFFNESS * (pull.opposition - self.angles[joint])).clamp(-limit, limit);
                (servo - transmission.spring_torque(joint, self.angles[joint]), OPPOSITION_STIFFNESS)
            } else {
                (free, transmission.springs[joint])
            };
            if let Some((multibody, link)) = self.engine.multibodies.get_mut(self.joints[joint])
                && let Some(link) = multibody.link_mut(link)
            {
                load_hinge(&mut link.joint, self.angles[joint], torque, stiffness, slack);
            }
        }
        let body = &mut self.engine.bodies[self.body];
        body.reset_forces(true);
        body.add_force(convert::vector(force), true);
        self.engine.step();
        for (joint, handle) in self.joints.iter().enumerate() {
            if let Some((multibody, link)) = self.engine.multibodies.get(*handle)
                && let Some(link) = multibody.link(link)
            {
                self.angles[joint] = link.joint.coords()[3];
            }
        }
    }

    /// Length of a step, s.
    pub fn dt(&self) -> f64 {
        self.engine.settings.dt
    }

    /// Joint angles, rad.
    pub fn angles(&self) -> &[f64] {
        &self.angles
    }

    /// `palm_from_object`.
    pub fn object(&self) -> Isometry3<f64> {
        convert::to_pose(self.engine.bodies[self.body].position())
    }

    /// Linear (m/s) and angular (rad/s) speed of the object.
    pub fn object_speed(&self) -> (f64, f64) {
        let body = &self.engine.bodies[self.body];
        (body.linvel().length(), body.angvel().length())
    }

    /// Loaded contacts between hand and object, as of the last step.
    pub fn touches(&self) -> Vec<Touch> {
        contacts_of(&self.engine, self.collider)
            .into_iter()
            .filter_map(|contact| {
                let cover = self.covers.iter().position(|c| *c == contact.other)?;
                Some(Touch {
                    link: cover.checked_sub(1),
                    point: contact.point,
                    normal: UnitVector3::new_normalize(-contact.normal),
                    force: contact.force,
                })
            })
            .collect()
    }
}

/// How far and by what angle `b` is from `a`: m, rad.
pub fn displacement(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use world::objects::ObjectSet;

    fn far_away() -> Isometry3<f64> {
        Isometry3::translation(0.0, 0.0, -0.5)
    }

    /// Without contact a pulled digit comes to rest where spring and cable balance, as the transmission says.
    #[test]
    fn a_pulled_digit_rests_in_free_equilibrium() {
        let hand = Arc::new(Hand::ftac());
        let object = ObjectSet::standard().get("ball_45").expect("an object").clone();
        let mut scene = HandScene::new(&hand, &object, &far_away(), &hand.each_joint(|_| 0.1));
        let pull = Pull { tensions: [0.0, 3.0, 0.0, 0.0, 0.0].into(), opposition: 0.4 };
        for _ in 0..1500 {
            scene.step(&pull, &Vector3::zeros());
        }
        for (joint, expected) in hand.transmission.free_angles(1, 3.0) {
            assert!((scene.angles()[joint] - expected).abs() < 0.01, "{joint}: {} {expected}", scene.angles()[joint]);
        }
        for joint in [6, 7, 8] {
            assert!(scene.angles()[joint].abs() < 0.02, "a slack digit opens: {}", scene.angles()[joint]);
        }
        assert!((scene.angles()[0] - 0.4).abs() < 0.01, "opposition holds its angle");
    }

    /// A floating object under a force obeys Newton.
    #[test]
    fn a_free_object_accelerates() {
        let hand = Arc::new(Hand::ftac());
        let object = ObjectSet::standard().get("ball_45").expect("an object").clone();
        let mut scene = HandScene::new(&hand, &object, &far_away(), &hand.open());
        scene.set_object_damping(0.0);
        let pull = Pull { tensions: hand.slack(), opposition: 0.0 };
        for _ in 0..240 {
            scene.step(&pull, &Vector3::new(0.1, 0.0, 0.0));
        }
        let expected = 0.1 / object.mass;
        assert!((scene.object_speed().0 - expected).abs() < 1e-3 * expected);
        assert!(scene.touches().is_empty());
    }
}
