//! What a scene starts from: where arm and objects are.

use std::sync::Arc;

use hand_model::transmission::friction::CableLosses;
use hand_model::{ActuatorVector, ArmVector, Hand, HandVector};
use nalgebra::Isometry3;
use plant::ArmDefects;
use plant::Gel;
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;
use world::physics::Physics;

use crate::body::groups;
use crate::collision_shape;
use crate::convert;
use crate::engine::{Engine, EngineSettings};

/// An object and where it stands at the start.
#[derive(Debug, Clone)]
pub struct ObjectPlacement {
    pub model: Arc<ObjectModel>,
    /// `world_from_object`.
    pub pose: Isometry3<f64>,
}

/// Everything a scene starts from.
#[derive(Debug, Clone)]
pub struct SceneSetup {
    /// Where the arm's base *really* is; the controller believes in its nominal place.
    pub world_from_base: Isometry3<f64>,
    /// How the arm differs from the one that the controller believes in.
    pub arm_defects: ArmDefects,
    /// Arm posture at the start as the encoders show it, rad.
    pub arm_start: ArmVector,
    /// Objects on the table.
    pub objects: Vec<ObjectPlacement>,
    /// From a camera's exposure to its frame in the controller, s.
    pub frame_delay: f64,
    /// Height of the floor, m; none: what leaves the table falls for ever.
    pub floor: Option<f64>,
    /// Whether pads feel the hand's other links and the table too.
    pub self_contact: bool,
    /// What guides and gears take.
    pub cables: CableLosses,
    /// How covers give way; none: they are rigid.
    pub gel: Option<Gel>,
    pub engine: EngineSettings,
}

impl SceneSetup {
    /// An arm without defects and a hand without losses, nothing but a table around them.
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

/// How the hand is when a scene begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPosture {
    /// Joint angles, rad.
    pub joints: HandVector,
    /// Servo angles, rad.
    pub servos: ActuatorVector,
}

impl HandPosture {
    /// Of an open hand with slack cables.
    pub fn open(hand: &Hand) -> Self {
        Self { joints: hand.open(), servos: hand.each_actuator(|_| 0.0) }
    }
}

/// Half extents of the floor, m: what rolls stops long before its edge, and nothing is fast enough to pass through it in a step.
const FLOOR: [f64; 3] = [20.0, 20.0, 0.5];

/// Puts a floor with its surface at `height` (m) into the engine, of the table's friction.
pub(crate) fn insert_floor(engine: &mut Engine, height: f64) -> ColliderHandle {
    let [x, y, z] = FLOOR;
    let floor = ColliderBuilder::cuboid(x, y, z)
        .position(Pose::from_translation(Vector::new(0.0, 0.0, height - z)))
        .friction(engine.settings.table_friction)
        .friction_combine_rule(CoefficientCombineRule::Min)
        .collision_groups(InteractionGroups::all().with_memberships(groups::TABLE).with_filter(groups::OBJECT));
    engine.colliders.insert(floor)
}

/// Puts an object into the engine: its model, its body and its collider.
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
    let shape = collision_shape::shape(&model.shape);
    let collider = ColliderBuilder::new(shape)
        .density(0.0)
        .friction(model.friction)
        .collision_groups(InteractionGroups::all().with_memberships(groups::OBJECT));
    let collider = engine.colliders.insert_with_parent(collider, handle, &mut engine.bodies);
    (placement.model.clone(), handle, collider)
}
