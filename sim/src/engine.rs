//! The physics sets and the settings under which grasps hold.
//!
//! The values were found by measurement with this hand's geometry (slip, penetration, jitter and cost over time step and
//! iterations); smaller time steps are not systematically better.

use rapier3d_f64::prelude::*;

/// Solver settings.
#[derive(Debug, Clone, Copy)]
pub struct EngineSettings {
    /// Time step, s. 1/240.
    pub dt: f64,
    /// Outer solver iterations (substeps).
    pub solver_iterations: usize,
    /// Inner PGS iterations.
    pub pgs_iterations: usize,
    /// Contact natural frequency (Hz); the damping ratio is 5. Half the frequency of contacts with fixed bodies.
    pub contact_frequency: f64,
    /// Friction coefficient of the table; an object's own applies where it is smaller.
    pub table_friction: f64,
    /// Rolling resistance coefficient of objects on the table (lever arm of the normal force over the height of the centre of
    /// mass): balls on felt or a short carpet have 0.02 to 0.07. The engine has no rolling friction of its own.
    pub rolling_resistance: f64,
}

impl Default for EngineSettings {
    fn default() -> Self {
        Self {
            dt: 1.0 / 240.0,
            solver_iterations: 1,
            pgs_iterations: 8,
            contact_frequency: 240.0,
            table_friction: 0.5,
            rolling_resistance: 0.03,
        }
    }
}

/// All rapier sets of one world. Cloning it branches the run bit-exactly.
pub struct Engine {
    /// Settings it was made with.
    pub settings: EngineSettings,
    /// Gravity, m/s2.
    pub gravity: Vector,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    /// Contact pairs.
    pub narrow_phase: NarrowPhase,
    /// Rigid bodies.
    pub bodies: RigidBodySet,
    /// Collision shapes.
    pub colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    /// Articulated bodies.
    pub multibodies: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    ccd: CCDSolver,
}

impl Engine {
    /// An empty world.
    pub fn new(settings: EngineSettings) -> Self {
        let mut parameters = IntegrationParameters {
            dt: settings.dt,
            num_solver_iterations: settings.solver_iterations,
            num_internal_pgs_iterations: settings.pgs_iterations,
            length_unit: 0.1,
            contact_recycling: false,
            ..IntegrationParameters::default()
        };
        parameters.contact_softness = SpringCoefficients::new(settings.contact_frequency, 5.0);
        parameters.static_contact_softness = SpringCoefficients::new(2.0 * settings.contact_frequency, 5.0);
        Self {
            settings,
            gravity: Vector::new(0.0, 0.0, -9.81),
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
        }
    }

    /// One time step under gravity.
    pub fn step(&mut self) {
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
            &(),
            &(),
        );
    }
}

impl Clone for Engine {
    fn clone(&self) -> Self {
        Self {
            settings: self.settings,
            gravity: self.gravity,
            parameters: self.parameters,
            // The pipeline is only workspace.
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
        }
    }
}
