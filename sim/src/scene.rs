//! What a scene starts from: where arm and objects are.

use std::sync::Arc;

use hand_model::ARM_JOINTS;
use hand_model::transmission::friction::CableLosses;
use nalgebra::{Isometry3, UnitQuaternion};
use rapier3d_f64::prelude::*;
use scenarios::effects::Gel;
use scenarios::objects::ObjectModel;
use scenarios::physics::Physics;

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
    /// By how much the hand is really turned on its flange (calibration error).
    pub mount_error: UnitQuaternion<f64>,
    /// Arm posture at the start, rad.
    pub arm_start: [f64; ARM_JOINTS],
    /// Objects on the table.
    pub objects: Vec<ObjectPlacement>,
    /// What guides and gears take.
    pub cables: CableLosses,
    /// How covers give way; none: they are rigid.
    pub gel: Option<Gel>,
    pub engine: EngineSettings,
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
