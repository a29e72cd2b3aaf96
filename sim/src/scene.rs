//! Initial state of a scene: poses of arm and objects.

use std::sync::Arc;

use hand_model::transmission::friction::CableLosses;
use hand_model::{ActuatorVector, ArmVector, Hand, HandVector};
use nalgebra::Isometry3;
use plant::ArmDefects;
use plant::GelViscoelasticity;
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;
use world::physics::Physics;

use crate::body::groups;
use crate::collision_shape;
use crate::convert;
use crate::engine::{Engine, EngineSettings};
use crate::test_stand::penetration_depth;

/// An object and its initial pose.
#[derive(Debug, Clone)]
pub struct ObjectPlacement {
    pub model: Arc<ObjectModel>,
    /// `world_from_object`.
    pub pose: Isometry3<f64>,
}

impl ObjectPlacement {
    /// Returns how deep two objects are in each other, m; 0 if they stand clear.
    pub fn overlap(&self, other: &Self) -> f64 {
        let shape = |placed: &Self| collision_shape::collision_shape(&placed.model.shape);
        let pose = |placed: &Self| convert::pose(&placed.pose);
        penetration_depth(&pose(self), &*shape(self).0, &pose(other), &*shape(other).0)
    }
}

/// Initial state and configuration of a scene.
#[derive(Debug, Clone)]
pub struct SceneSetup {
    /// True pose of the arm's base; the controller assumes the nominal one.
    pub world_from_base: Isometry3<f64>,
    /// Deviations of the arm from the one that the controller assumes.
    pub arm_defects: ArmDefects,
    /// Initial arm posture as the encoders show it, rad.
    pub arm_start: ArmVector,
    /// Objects on the table.
    pub objects: Vec<ObjectPlacement>,
    /// Latency from a camera's exposure to its frame in the controller, s.
    pub frame_delay: f64,
    /// Height of the floor, m; if none, an object that leaves the table falls for ever.
    pub floor: Option<f64>,
    /// True if pads also feel the hand's other links and the table.
    pub self_contact: bool,
    /// Losses in guides and gears.
    pub cables: CableLosses,
    /// Compliance of the covers; none for rigid covers.
    pub gel: Option<GelViscoelasticity>,
    pub engine: EngineSettings,
}

impl SceneSetup {
    /// Returns a scene with an arm without defects, a hand without losses, and only a table around them.
    pub fn ideal(world_from_base: Isometry3<f64>, arm_start: ArmVector) -> Self {
        Self {
            world_from_base,
            arm_defects: ArmDefects::default(),
            arm_start,
            objects: Vec::new(),
            frame_delay: 0.0,
            floor: None,
            self_contact: false,
            cables: CableLosses::NONE,
            gel: None,
            engine: EngineSettings::default(),
        }
    }
}

/// Initial posture of the hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPosture {
    /// Joint angles, rad.
    pub joints: HandVector,
    /// Servo angles, rad.
    pub servos: ActuatorVector,
}

impl HandPosture {
    /// Returns the posture of an open hand with slack cables.
    pub fn open(hand: &Hand) -> Self {
        Self { joints: hand.open_angles(), servos: hand.each_actuator(|_| 0.0) }
    }
}

/// Half extents of the floor, m: a rolling object stops long before the edge, and nothing is fast enough to pass
/// through the floor in one step.
const FLOOR_HALF_EXTENTS: [f64; 3] = [20.0, 20.0, 0.5];

/// Inserts a floor with its surface at `height` (m) into the engine, with the table's friction.
pub(crate) fn insert_floor(engine: &mut Engine, height: f64) -> ColliderHandle {
    let [x, y, z] = FLOOR_HALF_EXTENTS;
    let floor = ColliderBuilder::cuboid(x, y, z)
        .position(Pose::from_translation(Vector::new(0.0, 0.0, height - z)))
        .friction(engine.settings.table_friction)
        .friction_combine_rule(CoefficientCombineRule::Min)
        .collision_groups(InteractionGroups::all().with_memberships(groups::TABLE).with_filter(groups::OBJECT));
    engine.colliders.insert(floor)
}

/// Inserts an object into the engine; returns its model, body and collider.
pub(crate) fn insert_object(
    engine: &mut Engine,
    placement: &ObjectPlacement,
) -> (Arc<ObjectModel>, RigidBodyHandle, ColliderHandle) {
    let model = &placement.model;
    let (com, inertia) = model.shape.inertia(model.mass);
    let body = RigidBodyBuilder::dynamic()
        .pose(convert::pose(&placement.pose))
        .can_sleep(false)
        .angular_damping(Physics::standard().contact.spin_damping)
        .additional_mass_properties(MassProperties::with_inertia_matrix(
            convert::point(&com),
            model.mass,
            convert::matrix(&inertia),
        ));
    let handle = engine.bodies.insert(body);
    let shape = collision_shape::collision_shape(&model.shape);
    let collider = ColliderBuilder::new(shape)
        .density(0.0)
        .friction(model.friction)
        .collision_groups(InteractionGroups::all().with_memberships(groups::OBJECT));
    let collider = engine.colliders.insert_with_parent(collider, handle, &mut engine.bodies);
    (placement.model.clone(), handle, collider)
}
