//! The physics sets, and the settings under which grasps hold.
//!
//! The values were measured with this hand's geometry (slip, penetration, jitter and cost over time step and
//! iterations). Smaller time steps are not systematically better.

use std::collections::HashSet;

use hand_model::GRAVITY;
use rapier3d_f64::prelude::*;
use world::physics::{self, Physics};

use crate::friction_anchor::FrictionAnchors;
use crate::gel::SoftCovers;

/// Length scale by which the solver judges distances and speeds, m: the breadth of a hand.
const LENGTH_UNIT: f64 = 0.1;

/// Upper bound for the rotation of a joint in one step, rad.
const LIMIT_SLACK: f64 = 0.2;

/// Solver settings.
#[derive(Debug, Clone, Copy)]
pub struct EngineSettings {
    /// Time step, s; 1/240 by default.
    pub dt: f64,
    /// Outer solver iterations (substeps).
    pub solver_iterations: usize,
    /// Inner PGS iterations.
    pub pgs_iterations: usize,
    /// Natural frequency of a contact's spring, Hz; a contact with a fixed body has twice that.
    pub contact_frequency: f64,
    /// Damping ratio of a contact's spring.
    pub contact_damping_ratio: f64,
    /// Friction coefficient of the table; an object's own applies where it is smaller.
    pub table_friction: f64,
    /// Rolling resistance coefficient of objects on the table (lever arm of the normal force over the height of the
    /// centre of mass): balls on felt or a short carpet have 0.02 to 0.07. The engine has no rolling friction.
    pub rolling_resistance: f64,
    /// Static friction model of the covers' contacts; without it they have the solver's friction, which creeps.
    pub bristle_friction: Option<physics::BristleFriction>,
}

impl Default for EngineSettings {
    fn default() -> Self {
        let Physics { contact, table, bristle_friction: sticking, .. } = Physics::standard();
        Self {
            dt: 1.0 / 240.0,
            solver_iterations: 1,
            pgs_iterations: 8,
            contact_frequency: contact.frequency,
            contact_damping_ratio: contact.damping_ratio,
            table_friction: table.friction,
            rolling_resistance: table.rolling_resistance,
            bristle_friction: Some(sticking),
        }
    }
}

/// All rapier sets of one world. Cloning it branches the run bit-exactly.
pub struct Engine {
    /// Settings with which it was created.
    pub settings: EngineSettings,
    /// Gravity, m/s2.
    pub gravity: Vector,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    /// Contact pairs.
    pub narrow_phase: NarrowPhase,
    pub bodies: RigidBodySet,
    /// Collision shapes.
    pub colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    /// Articulated bodies.
    pub multibodies: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    ccd: CCDSolver,
    /// Compliant covers; none if covers are rigid.
    pub soft_covers: Option<SoftCovers>,
    friction_anchors: Option<FrictionAnchors>,
    ignored_pairs: HashSet<(ColliderHandle, ColliderHandle)>,
}

/// Callbacks of the engine that filter and modify contacts.
struct Hooks<'a> {
    soft_covers: Option<&'a SoftCovers>,
    sticking: Option<&'a FrictionAnchors>,
    dt: f64,
    ignored_pairs: &'a HashSet<(ColliderHandle, ColliderHandle)>,
}

impl PhysicsHooks for Hooks<'_> {
    fn filter_contact_pair(&self, context: &PairFilterContext) -> Option<SolverFlags> {
        let (one, two) = (context.collider1, context.collider2);
        let passes = self.ignored_pairs.contains(&(one, two)) || self.ignored_pairs.contains(&(two, one));
        (!passes).then(SolverFlags::default)
    }

    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        if let Some(covers) = self.soft_covers {
            covers.modify_solver_contacts(context);
        }
        if let Some(sticking) = self.sticking {
            sticking.modify_solver_contacts(context, self.dt);
        }
    }
}

impl Engine {
    /// Creates an empty world.
    pub fn new(settings: EngineSettings) -> Self {
        let mut parameters = IntegrationParameters {
            dt: settings.dt,
            num_solver_iterations: settings.solver_iterations,
            num_internal_pgs_iterations: settings.pgs_iterations,
            length_unit: LENGTH_UNIT,
            contact_recycling: false,
            ..IntegrationParameters::default()
        };
        parameters.contact_softness =
            SpringCoefficients::new(settings.contact_frequency, settings.contact_damping_ratio);
        parameters.static_contact_softness =
            SpringCoefficients::new(2.0 * settings.contact_frequency, settings.contact_damping_ratio);
        Self {
            settings,
            gravity: Vector::new(0.0, 0.0, -GRAVITY),
            parameters,
            pipeline: PhysicsPipeline::new(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibodies: MultibodyJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            ccd: CCDSolver::new(),
            soft_covers: None,
            friction_anchors: settings.bristle_friction.map(FrictionAnchors::new),
            ignored_pairs: HashSet::new(),
        }
    }

    /// Returns the distance to a limit (rad) within which a joint must be at the start of a step for the limit to count
    /// in it. With one outer iteration the engine checks only the angle at the start; with more it checks again during
    /// the step.
    pub(crate) fn limit_slack(&self) -> f64 {
        if self.settings.solver_iterations > 1 { LIMIT_SLACK } else { 0.0 }
    }

    /// Lets two colliders pass through each other, regardless of their groups.
    pub fn ignore_collisions(&mut self, one: ColliderHandle, two: ColliderHandle) {
        for handle in [one, two] {
            let collider = &mut self.colliders[handle];
            collider.set_active_hooks(collider.active_hooks() | ActiveHooks::FILTER_CONTACT_PAIRS);
        }
        self.ignored_pairs.insert((one, two));
    }

    /// Removes a body and its colliders from the world.
    pub fn remove(&mut self, body: RigidBodyHandle) {
        self.bodies.remove(
            body,
            &mut self.islands,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut self.soft_bodies,
            true,
        );
    }

    /// Advances the world by one time step under gravity.
    pub fn step(&mut self) {
        let (soft_covers, sticking, dt) = (self.soft_covers.as_ref(), self.friction_anchors.as_ref(), self.settings.dt);
        let hooks = Hooks { soft_covers, sticking, dt, ignored_pairs: &self.ignored_pairs };
        self.pipeline.step(
            self.gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut self.soft_bodies,
            &mut self.ccd,
            &hooks,
            &(),
        );
        if let Some(covers) = &mut self.soft_covers {
            covers.relax(self.settings.dt, &self.narrow_phase, &self.colliders, &self.bodies);
        }
        if let Some(sticking) = &mut self.friction_anchors {
            sticking.follow(&self.narrow_phase, &self.colliders, &self.bodies);
        }
    }
}

impl Clone for Engine {
    fn clone(&self) -> Self {
        Self {
            settings: self.settings,
            gravity: self.gravity,
            parameters: self.parameters,
            // The pipeline holds only temporary buffers.
            pipeline: PhysicsPipeline::new(),
            islands: self.islands.clone(),
            broad_phase: self.broad_phase.clone(),
            narrow_phase: self.narrow_phase.clone(),
            bodies: self.bodies.clone(),
            colliders: self.colliders.clone(),
            impulse_joints: self.impulse_joints.clone(),
            multibodies: self.multibodies.clone(),
            soft_bodies: self.soft_bodies.clone(),
            ccd: self.ccd.clone(),
            soft_covers: self.soft_covers.clone(),
            friction_anchors: self.friction_anchors.clone(),
            ignored_pairs: self.ignored_pairs.clone(),
        }
    }
}
