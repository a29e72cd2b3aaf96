//! The hand alone, its palm fixed in space, with floating objects: the scene in which a grasp is closed and tested.
//!
//! The world frame is the root frame. Actuators pull with given tensions (servos in current control at rest), and an
//! opposition servo holds its angle. There is no gravity: the forces of the test protocol are applied instead. Separate
//! digits are separate multibodies, because without an arm they do not feel each other's inertia. A hand whose
//! joints may follow those of other digits is one multibody.

use std::sync::Arc;

use hand_model::hand_mechanism::{HandMechanism, JointDynamics};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;

use crate::collision_model::CollisionModel;
use crate::contacts::{ContactPoint, contacts_of};
use crate::convert;
use crate::drive::{JointEffort, OPPOSITION_STIFFNESS};
use crate::engine::EngineSettings;
use crate::scene::{ObjectPlacement, insert_object};
use crate::test_stand::{Linkage, LinkageModel, Prop};

/// Command of the hand: tensions of the actuators (N) and the opposition angle (rad).
#[derive(Debug, Clone, PartialEq)]
pub struct TensionCommand {
    /// Tensions of the actuators, N.
    pub tensions: Vec<f64>,
    /// Opposition angle, rad; unused by a hand without an opposition servo.
    pub opposition: f64,
}

impl TensionCommand {
    /// Creates a command with tensions (N) only.
    pub fn tensions(tensions: &[f64]) -> Self {
        Self { tensions: tensions.to_vec(), opposition: 0.0 }
    }
}

/// A contact between hand and object.
#[derive(Debug, Clone, Copy)]
pub struct SceneContact {
    /// Link of the hand; `None` for the root.
    pub link: Option<usize>,
    /// Contact point, root frame, m.
    pub point: Point3<f64>,
    /// Unit normal into the object, root frame.
    pub normal: UnitVector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// The scene. Cloning it branches the run bit-exactly.
#[derive(Clone)]
pub struct HandScene {
    hand: Arc<HandMechanism>,
    linkage: Linkage,
    objects: Vec<(RigidBodyHandle, ColliderHandle)>,
}

impl HandScene {
    /// Creates a scene with the hand's joints at `start` (rad or m) and no objects. Links collide with each other,
    /// except for those connected by a joint and those in [`CollisionModel::ignored_pairs`].
    pub fn new(model: &CollisionModel, start: &[f64]) -> Self {
        let hand = model.hand();
        let each = |value: fn(&JointDynamics) -> f64| hand.joint_dynamics.iter().map(value).collect::<Vec<f64>>();
        let (damping, armature) = (each(|feel| feel.damping), each(|feel| feel.armature));
        let (tree, masses) = (&hand.tree, &hand.masses);
        let mechanism = LinkageModel {
            tree,
            masses,
            damping: &damping,
            armature: &armature,
            separate_roots: hand.independent_digits,
        };
        let mut linkage = Linkage::new(EngineSettings::default(), &mechanism, model.colliders(), start);
        for (one, two) in model.ignored_pairs() {
            linkage.ignore_collisions(*one, *two);
        }
        for follower in &hand.followers {
            linkage.couple(follower);
        }
        linkage.set_gravity(&Vector3::zeros());
        Self { hand: hand.clone(), linkage, objects: Vec::new() }
    }

    /// Adds a floating object at `root_from_object`.
    pub fn add_object(&mut self, object: &Arc<ObjectModel>, root_from_object: &Isometry3<f64>) {
        let placement = ObjectPlacement { model: object.clone(), pose: *root_from_object };
        let (_, body, collider) = insert_object(self.linkage.engine_mut(), &placement);
        self.objects.push((body, collider));
    }

    /// Adds a prop at `root_from_prop`, held in place until [`Self::release_prop`].
    pub fn add_prop(&mut self, prop: &Prop, root_from_prop: &Isometry3<f64>) {
        self.objects.push(prop.insert(self.linkage.engine_mut(), root_from_prop));
    }

    /// Releases all props.
    pub fn release(&mut self) {
        self.each_body(|body| body.set_body_type(RigidBodyType::Dynamic, true));
    }

    fn each_body(&mut self, change: impl Fn(&mut RigidBody)) {
        for (body, _) in &self.objects {
            change(&mut self.linkage.engine_mut().bodies[*body]);
        }
    }

    /// Sets gravity (m/s2, root frame).
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.linkage.set_gravity(gravity);
    }

    /// Sets the damping of the objects' linear and angular motion, 1/s. It represents a table or a free hand while
    /// digits close.
    pub fn set_object_damping(&mut self, damping: f64) {
        self.each_body(|body| {
            body.set_linear_damping(damping);
            body.set_angular_damping(damping);
        });
    }

    /// Sets the friction coefficient between hand and objects.
    pub fn set_friction(&mut self, friction: f64) {
        for (_, collider) in &self.objects {
            self.linkage.engine_mut().colliders[*collider].set_friction(friction);
        }
    }

    /// Advances one time step, with the hand pulling and `force` (N, root frame) on every object's centre of mass.
    pub fn step(&mut self, pull: &TensionCommand, force: &Vector3<f64>) {
        self.each_body(|body| {
            body.reset_forces(true);
            body.add_force(convert::vector(force), true);
        });
        self.linkage.step(&joint_efforts(&self.hand, self.linkage.angles(), pull));
    }

    /// Runs for `seconds` with the hand pulling.
    pub fn run(&mut self, pull: &TensionCommand, seconds: f64) {
        let steps = (seconds / self.dt()).round() as usize;
        for _ in 0..steps {
            self.step(pull, &Vector3::zeros());
        }
    }

    /// Returns the length of a time step, s.
    pub fn dt(&self) -> f64 {
        self.linkage.engine().settings.dt
    }

    /// Returns the joint coordinates, rad or m.
    pub fn angles(&self) -> &[f64] {
        self.linkage.angles()
    }

    /// Returns `root_from_link` of every moving link.
    pub fn links(&self) -> Vec<Isometry3<f64>> {
        self.linkage.links()
    }

    /// Returns `root_from_object` of every object.
    pub fn objects(&self) -> Vec<Isometry3<f64>> {
        let bodies = &self.linkage.engine().bodies;
        self.objects.iter().map(|(body, _)| convert::to_pose(bodies[*body].position())).collect()
    }

    /// Returns `root_from_object` of the first object.
    ///
    /// # Panics
    /// If the scene has no objects.
    pub fn object(&self) -> Isometry3<f64> {
        self.objects()[0]
    }

    /// Returns the linear (m/s) and angular (rad/s) speed of the first object.
    ///
    /// # Panics
    /// If the scene has no objects.
    pub fn object_speed(&self) -> (f64, f64) {
        let body = &self.linkage.engine().bodies[self.objects[0].0];
        (body.linvel().length(), body.angvel().length())
    }

    /// Returns the loaded contacts between hand and objects in the last step.
    pub fn contacts(&self) -> Vec<SceneContact> {
        let contacts = self.objects.iter().flat_map(|(_, object)| contacts_of(self.linkage.engine(), *object));
        let touch = |contact: ContactPoint| {
            Some(SceneContact {
                link: self.linkage.cover_of(contact.other)?,
                point: contact.point,
                normal: UnitVector3::new_normalize(-contact.normal),
                force: contact.force,
            })
        };
        contacts.filter_map(touch).collect()
    }

    /// Sums the normal force of each moving link on the objects, N.
    pub fn link_forces(&self) -> Vec<f64> {
        let mut forces = vec![0.0; self.hand.tree.len()];
        for touch in self.contacts() {
            if let Some(link) = touch.link {
                forces[link] += touch.force;
            }
        }
        forces
    }

    /// Returns the deepest penetration between hand and objects, or between two links that collide, m.
    pub fn penetration(&self) -> f64 {
        let objects = self.objects.iter().map(|(_, object)| self.linkage.penetration(*object));
        objects.fold(self.self_penetration(), f64::max)
    }

    /// Returns the deepest penetration between two links that collide, m.
    pub fn self_penetration(&self) -> f64 {
        self.linkage.self_penetration(&self.hand.tree)
    }
}

/// Computes the effort of each joint under `pull` at `q` (rad or m).
fn joint_efforts(hand: &HandMechanism, q: &[f64], pull: &TensionCommand) -> Vec<JointEffort> {
    let torques = hand.torques(q, &pull.tensions).into_iter().enumerate();
    let effort = |(joint, torque): (usize, f64)| match hand.opposition {
        Some(servo) if servo.joint == joint => {
            let torque =
                (OPPOSITION_STIFFNESS * (pull.opposition - q[joint])).clamp(-servo.max_torque, servo.max_torque);
            JointEffort { torque: torque - hand.spring_effort(joint, q[joint]), stiffness: OPPOSITION_STIFFNESS }
        }
        _ => JointEffort { torque, stiffness: hand.joint_dynamics[joint].spring },
    };
    torques.map(effort).collect()
}

/// Computes the distance (m) and the angle (rad) between `a` and `b`.
pub fn pose_difference(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::Hand;
    use world::objects::ObjectSet;

    fn scene(hand: &Hand, object: &Arc<ObjectModel>, angles: &[f64]) -> HandScene {
        let mut scene = HandScene::new(&CollisionModel::new(Arc::new(HandMechanism::from_hand(hand, "hand"))), angles);
        scene.add_object(object, &far_away());
        scene
    }

    fn far_away() -> Isometry3<f64> {
        Isometry3::translation(0.0, 0.0, -0.5)
    }

    /// Without contact, a pulled digit comes to rest at the balance of spring and cable that the transmission predicts.
    #[test]
    fn a_pulled_digit_rests_in_free_equilibrium() {
        let hand = Hand::ftac();
        let object = ObjectSet::standard().get("ball_45").expect("an object").clone();
        let mut scene = scene(&hand, &object, &hand.each_joint(|_| 0.1));
        let pull = TensionCommand { tensions: vec![0.0, 3.0, 0.0, 0.0, 0.0], opposition: 0.4 };
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

    /// A floating object under a force obeys Newton's second law.
    #[test]
    fn a_free_object_accelerates() {
        let hand = Hand::ftac();
        let object = ObjectSet::standard().get("ball_45").expect("an object").clone();
        let mut scene = scene(&hand, &object, &hand.open_angles());
        scene.set_object_damping(0.0);
        let pull = TensionCommand::tensions(&hand.slack_tensions());
        for _ in 0..240 {
            scene.step(&pull, &Vector3::new(0.1, 0.0, 0.0));
        }
        let expected = 0.1 / object.mass;
        assert!((scene.object_speed().0 - expected).abs() < 1e-3 * expected);
        assert!(scene.contacts().is_empty());
    }
}
