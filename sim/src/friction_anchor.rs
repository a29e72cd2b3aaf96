//! Static friction without creep.
//!
//! The solver computes friction at the level of velocities and leaves an error in every step, so that a held object
//! slides slowly under a load that friction could bear. Here the tangential displacement of the surfaces is accumulated
//! for every contact of a cover, as in the bristle models of friction (Haessig and Friedland 1991), and the contact is
//! asked to undo a share of it in the next step. The displacement is capped at the elastic limit: anything beyond is
//! true sliding. The force remains the solver's, within the friction cone. Rolling adds nothing, because surfaces that
//! roll do not move along each other.

use nalgebra::{Isometry3, Point3, Vector3};
use rapier3d_f64::prelude::*;
use world::physics::BristleFriction as Limits;

use crate::convert;
use crate::loaded_contacts::loaded_points;

/// A contact between two colliders.
#[derive(Debug, Clone)]
struct AnchoredContact {
    pair: [ColliderHandle; 2],
    /// Centre of the loaded contact points, world, m.
    middle: Point3<f64>,
    /// `world_from_collider` of both.
    poses: [Isometry3<f64>; 2],
    /// Tangential displacement of the second surface relative to the first, world, m.
    displacement: Vector3<f64>,
    /// Rotation of the second surface relative to the first about the normal, rad.
    turn: f64,
    /// Unit normal, out of the first, world.
    normal: Vector3<f64>,
}

/// The friction anchors of all contacts. A clone continues bit-exactly like the original.
#[derive(Debug, Clone)]
pub struct FrictionAnchors {
    limits: Limits,
    contacts: Vec<AnchoredContact>,
}

impl FrictionAnchors {
    /// Creates the state of a world without contacts.
    pub fn new(limits: Limits) -> Self {
        Self { limits, contacts: Vec::new() }
    }

    /// Accumulates the motion of the surfaces after a step.
    pub fn follow(&mut self, narrow_phase: &NarrowPhase, colliders: &ColliderSet, bodies: &RigidBodySet) {
        let mut contacts = Vec::with_capacity(self.contacts.len() + 2);
        for pair in narrow_phase.contact_pairs() {
            let handles = [pair.collider1, pair.collider2];
            if handles.iter().filter(|handle| anchors_contacts(&colliders[**handle])).count() != 1 {
                continue;
            }
            let Some((middle, normal)) = self::middle(pair, bodies) else { continue };
            let poses = handles.map(|handle| convert::to_pose(colliders[handle].position()));
            let (mut displacement, mut turn) = (Vector3::zeros(), 0.0);
            if let Some(known) = self.contacts.iter().find(|known| known.pair == handles) {
                let moved: [Isometry3<f64>; 2] = std::array::from_fn(|n| poses[n] * known.poses[n].inverse());
                let slid = moved[1] * known.middle - moved[0] * known.middle;
                displacement = moved[0].rotation * known.displacement + slid;
                displacement -= normal * normal.dot(&displacement);
                displacement = displacement.cap_magnitude(self.limits.elastic);
                let turned = (moved[1].rotation * moved[0].rotation.inverse()).scaled_axis();
                turn = (known.turn + normal.dot(&turned)).clamp(-self.limits.elastic_turn, self.limits.elastic_turn);
            }
            contacts.push(AnchoredContact { pair: handles, middle, poses, displacement, turn, normal });
        }
        self.contacts = contacts;
    }

    /// Makes a contact undo a share of its displacement; `dt` is the length of a step, s.
    pub fn modify_solver_contacts(&self, context: &mut ContactModificationContext, dt: f64) {
        let pair = [context.collider1, context.collider2];
        let Some(known) = self.contacts.iter().find(|known| known.pair == pair) else { return };
        let Some(rigid) = context.rigid_mut() else { return };
        for contact in rigid.solver_contacts.iter_mut() {
            let arm = convert::to_vector(contact.anchor1) - known.middle.coords;
            let back = known.displacement + known.turn * known.normal.cross(&arm);
            // Prescribe a motion of the first surface, which the second one follows.
            contact.tangent_velocity = convert::vector(&(back * (-self.limits.back / dt)));
        }
    }
}

/// True if the contacts of a collider have friction anchors: it has contact modification enabled.
fn anchors_contacts(collider: &Collider) -> bool {
    collider.active_hooks().contains(ActiveHooks::MODIFY_SOLVER_CONTACTS)
}

/// Computes the centre of the loaded points of a contact, world, m, and the unit normal out of the first collider.
fn middle(pair: &ContactPair, bodies: &RigidBodySet) -> Option<(Point3<f64>, Vector3<f64>)> {
    let (mut middle, mut normal, mut sum) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for at in loaded_points(pair, bodies) {
        let impulse = at.data.impulse;
        middle += at.point * impulse;
        normal += at.normal * impulse;
        sum += impulse;
    }
    Some((Point3::from(middle / sum), normal.try_normalize(1e-12)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{Engine, EngineSettings};

    const FRICTION: f64 = 0.6;

    /// Builds a plate whose contacts have friction anchors if the settings enable them, with a body of `mass` (kg) and
    /// `inertia` (kg m2, about any axis) on it.
    fn on_plate(
        settings: EngineSettings,
        (body, mass, inertia): (RigidBodyBuilder, f64, f64),
        shape: ColliderBuilder,
    ) -> (Engine, RigidBodyHandle) {
        let mut engine = Engine::new(settings);
        engine.gravity = Vector::new(0.0, 0.0, -9.81);
        let plate = ColliderBuilder::cuboid(20.0, 20.0, 0.01)
            .translation(Vector::new(0.0, 0.0, -0.01))
            .friction(FRICTION)
            .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS);
        engine.colliders.insert(plate);
        let spread = Matrix::from_diagonal(Vector::splat(inertia));
        let properties = MassProperties::with_inertia_matrix(Vector::ZERO, mass, spread);
        let body = engine.bodies.insert(body.can_sleep(false).additional_mass_properties(properties));
        engine.colliders.insert_with_parent(shape.density(0.0).friction(FRICTION), body, &mut engine.bodies);
        (engine, body)
    }

    /// Returns the distance (m) that a cube on a plate travels in two seconds under a pull of `share` of its weight
    /// along the plate, and its final speed (m/s).
    fn pulled(settings: EngineSettings, share: f64) -> (f64, f64) {
        let (mass, half) = (0.2, 0.02);
        let body = RigidBodyBuilder::dynamic().translation(Vector::new(0.0, 0.0, half));
        let inertia = mass * half * half * 2.0 / 3.0;
        let (mut engine, cube) = on_plate(settings, (body, mass, inertia), ColliderBuilder::cuboid(half, half, half));
        for _ in 0..120 {
            engine.step();
        }
        engine.gravity.x = share * 9.81;
        let start = engine.bodies[cube].translation();
        for _ in 0..480 {
            engine.step();
        }
        let body = &engine.bodies[cube];
        ((body.translation() - start).length(), body.linvel().x)
    }

    /// Within the friction cone nothing moves farther than the elastic limit, and then not at all. Outside it the cube
    /// slides as it does without a friction anchor.
    #[test]
    fn a_cube_sticks_within_the_cone_of_friction() {
        let sticking = EngineSettings::default();
        for share in [0.1, 0.3, 0.55] {
            let (way, speed) = pulled(sticking, share);
            assert!(way < 1e-5 && speed.abs() < 1e-5, "{share}: {way} m, {speed} m/s");
        }
        for share in [0.7, 0.9] {
            let (way, speed) = pulled(sticking, share);
            let acceleration = (share - FRICTION) * 9.81;
            assert!((way / (0.5 * acceleration * 4.0) - 1.0).abs() < 0.02, "{share}: {way} m");
            assert!((speed / (2.0 * acceleration) - 1.0).abs() < 0.02, "{share}: {speed} m/s");
        }
    }

    /// A surface that rolls on another leaves no displacement: the ball rolls as far as without friction anchors.
    #[test]
    fn a_rolling_ball_is_not_held() {
        let rolled = |settings| {
            let (mass, radius) = (0.2, 0.02);
            let body = RigidBodyBuilder::dynamic()
                .translation(Vector::new(0.0, 0.0, radius))
                .linvel(Vector::new(0.3, 0.0, 0.0))
                .angvel(Vector::new(0.0, 0.3 / radius, 0.0));
            let inertia = 0.4 * mass * radius * radius;
            let (mut engine, ball) = on_plate(settings, (body, mass, inertia), ColliderBuilder::ball(radius));
            for _ in 0..240 {
                engine.step();
            }
            engine.bodies[ball].translation().x
        };
        let default = EngineSettings::default();
        let (free, sticking) = (rolled(EngineSettings { bristle_friction: None, ..default }), rolled(default));
        assert!(free > 0.2 && (sticking / free - 1.0).abs() < 0.01, "{free} m, {sticking} m");
    }
}
