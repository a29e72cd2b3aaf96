//! Compliant covers: an object penetrates a cover as far as the gel yields under the force between them.
//!
//! The engine's contacts are rigid. This module shifts them: a cover and an object count as touching only when the
//! object is already [`CoverResponse::penetration`] deep in the cover, so that the force itself remains the solver's.
//! The depth follows from the pressure law and the shapes around the contact, which are those from which a pad's image
//! is made: the gel bears the sum of the pressures under the object's penetration ([`PressCurve`]). It approaches that
//! depth with a relaxation time.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::hand::CoverShape;
use hand_model::pads::Pad;
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use plant::GelViscoelasticity;
use rapier3d_f64::prelude::*;
use tactile_optics::GelFoundation;
use world::geometry::ObjectShape;
use world::objects::ObjectModel;

use crate::convert;
use crate::loaded_contacts::loaded_points;
use crate::press_curve::{PressCurve, PressedSurface, SurfaceGap};

/// A curve stays valid while the object has turned by less than this relative to the cover, rad.
const CURVE_ROTATION_TOLERANCE: f64 = 0.02;
/// A curve stays valid while the centre of its contact has moved by less than this, m.
const CURVE_POSITION_TOLERANCE: f64 = 5e-4;
/// A curve stays valid while the force is within this factor of the one for which it was computed, or while both are
/// below the second value (N).
const CURVE_FORCE_TOLERANCE: (f64, f64) = (2.0, 0.1);
/// Smallest number of steps between two curves of a contact.
const MIN_CURVE_INTERVAL: u32 = 4;
/// Smallest cosine between the normals of a contact and of the pad on which it lies.
const MIN_PAD_COSINE: f64 = 0.8;
/// Smallest fraction of a step's relaxation for a contact with a fixed object; the contact begins with it.
const MIN_RELAXATION_SHARE: f64 = 0.02;
/// Depth that counts as zero, m.
const ZERO_DEPTH: f64 = 1e-7;

/// A cover with a gel surface.
#[derive(Debug, Clone)]
struct SoftCover {
    collider: ColliderHandle,
    /// The cover as a solid, in the cover frame.
    solid: ObjectShape,
    /// The cover's pads, with `pad_from_cover`.
    pads: Vec<(Pad, Isometry3<f64>)>,
}

impl SoftCover {
    /// Returns the surface around `middle`, where the normal is `out`, and `cover_from_frame` of that surface's frame:
    /// that of a pad if there is one.
    fn surface(&self, middle: &Point3<f64>, out: &Unit<Vector3<f64>>) -> (PressedSurface<'_>, Isometry3<f64>) {
        let pressed = self.pads.iter().find(|(pad, pad_from_cover)| {
            let at = pad_from_cover * middle;
            (pad_from_cover * out.as_ref()).z > MIN_PAD_COSINE && at.x.abs() < 0.5 * pad.w && at.y.abs() < 0.5 * pad.h
        });
        match pressed {
            Some((pad, pad_from_cover)) => (PressedSurface::Pad(pad), pad_from_cover.inverse()),
            None => PressedSurface::around(&self.solid, middle, out),
        }
    }
}

/// An object that may press into covers.
#[derive(Debug, Clone)]
struct PressingObject {
    collider: ColliderHandle,
    model: Arc<ObjectModel>,
}

/// Load of an object on a cover in the last step.
#[derive(Debug, Clone, Copy, Default)]
struct CoverLoad {
    /// Sum of the normal forces, N.
    force: f64,
    /// Centre of the contact, world, m.
    middle: Vector3<f64>,
    /// Mean normal out of the cover, world, not of unit length.
    out: Vector3<f64>,
    /// Friction on the cover, world, N.
    friction: Vector3<f64>,
}

/// The state of one contact between a cover and an object.
#[derive(Debug, Clone)]
struct GelContact {
    cover: usize,
    object: usize,
    /// Depth of the object in the cover at which the two count as touching, m.
    penetration: f64,
    load: CoverLoad,
    curve: Option<CachedCurve>,
    /// Number of steps since `curve` was computed.
    age: u32,
    /// For a contact with a fixed object: the last relaxation fraction, and the last depth error (m).
    last: (f64, f64),
}

impl GelContact {
    /// Computes the relaxation fraction for a depth error `off` (m), at most `share`. A fixed object does not yield:
    /// force and penetration are coupled so strongly that the full fraction makes the contact chatter. Hence the
    /// fraction is halved when the error has changed sign since the last step, and grows while it has not (the rule of
    /// resilient propagation, Riedmiller and Braun 1993).
    fn relaxation_share(&mut self, off: f64, share: f64) -> f64 {
        let (before, way) = self.last;
        let next = match off * way {
            turned if turned < -ZERO_DEPTH * ZERO_DEPTH => 0.5 * before,
            same if same > ZERO_DEPTH * ZERO_DEPTH => 1.1 * before,
            _ => before,
        };
        self.last = (next.clamp(MIN_RELAXATION_SHARE * share, share), off);
        self.last.0
    }
}

/// A curve with the conditions for which it was computed.
#[derive(Debug, Clone)]
struct CachedCurve {
    curve: Arc<PressCurve>,
    object_from_cover: Isometry3<f64>,
    middle: Point3<f64>,
    force: f64,
}

/// Response of a cover to one object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoverResponse {
    /// Depth of the object in the cover, m.
    pub penetration: f64,
    /// Displacement of the surface along the friction force on it, world, m.
    pub shear: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// Compliant covers of a hand, and the contacts that press into them. A clone continues bit-exactly like the original.
#[derive(Debug, Clone)]
pub struct SoftCovers {
    gel: GelFoundation,
    relaxation: f64,
    shear: f64,
    covers: Vec<SoftCover>,
    objects: Vec<PressingObject>,
    /// Contacts, ordered by object and cover.
    contacts: Vec<GelContact>,
}

impl SoftCovers {
    /// Creates the model from a hand's gel, its `covers` as colliders with their links (none for the palm), and the
    /// `objects` that may press into them.
    pub fn new(
        hand: &Hand,
        effect: &GelViscoelasticity,
        covers: impl Iterator<Item = (ColliderHandle, Option<usize>)>,
        objects: impl Iterator<Item = (ColliderHandle, Arc<ObjectModel>)>,
        colliders: &mut ColliderSet,
    ) -> Self {
        let covers: Vec<SoftCover> = covers
            .map(|(collider, link)| {
                let CoverShape { link_from_cover, half, radius } =
                    link.map_or(hand.palm_cover, |link| hand.covers[link]);
                let pads = hand.pads.iter().filter(|pad| pad.link == link);
                let pads = pads.map(|pad| (pad.clone(), pad.link_from_pad.inverse() * link_from_cover)).collect();
                SoftCover { collider, solid: ObjectShape::Cuboid { half, radius }, pads }
            })
            .collect();
        for cover in &covers {
            let collider = &mut colliders[cover.collider];
            collider.set_active_hooks(collider.active_hooks() | ActiveHooks::MODIFY_SOLVER_CONTACTS);
        }
        Self {
            gel: GelFoundation::winkler(&hand.gel()),
            relaxation: effect.relaxation,
            shear: effect.shear,
            covers,
            objects: objects.map(|(collider, model)| PressingObject { collider, model }).collect(),
            contacts: Vec::new(),
        }
    }

    /// Returns the response of the `cover`-th cover to the `object`-th object; `None` if they do not touch.
    pub fn cover_response(&self, cover: usize, object: usize) -> Option<CoverResponse> {
        let at = self.contacts.iter().find(|contact| (contact.cover, contact.object) == (cover, object))?;
        let compliance = if at.load.force > 0.0 { at.penetration / at.load.force } else { 0.0 };
        Some(CoverResponse {
            penetration: at.penetration,
            shear: at.load.friction * (self.shear * compliance),
            force: at.load.force,
        })
    }

    /// Replaces the objects that may press into the covers.
    pub fn replace_objects(&mut self, objects: impl Iterator<Item = (ColliderHandle, Arc<ObjectModel>)>) {
        self.objects = objects.map(|(collider, model)| PressingObject { collider, model }).collect();
        self.contacts.clear();
    }

    /// Updates the gel after a step of `dt` (s): it relaxes towards the depth at which it bears the solver's force.
    pub fn relax(&mut self, dt: f64, narrow_phase: &NarrowPhase, colliders: &ColliderSet, bodies: &RigidBodySet) {
        let share = if self.relaxation > 0.0 { 1.0 - (-dt / self.relaxation).exp() } else { 1.0 };
        let mut contacts = Vec::with_capacity(self.contacts.len() + 2);
        for (object, presser) in self.objects.iter().enumerate() {
            for (cover, soft) in self.covers.iter().enumerate() {
                let known = self.contacts.iter().position(|contact| (contact.cover, contact.object) == (cover, object));
                let Some(pair) = narrow_phase.contact_pair(soft.collider, presser.collider) else { continue };
                let load = contact_load(pair, soft.collider, dt, bodies);
                if load.force <= 0.0 && known.is_none() {
                    continue;
                }
                let last = (MIN_RELAXATION_SHARE * share, 0.0);
                let fresh =
                    GelContact { cover, object, penetration: 0.0, load, curve: None, age: MIN_CURVE_INTERVAL, last };
                let mut contact = known.map_or(fresh, |at| self.contacts[at].clone());
                contact.load = load;
                self.renew_curve(&mut contact, colliders);
                let depth = match &contact.curve {
                    Some(shared) if load.force > 0.0 => shared.curve.depth(load.force),
                    _ => 0.0,
                };
                let off = depth - contact.penetration;
                let parent = colliders[presser.collider].parent();
                let fastened = parent.is_some_and(|body| bodies[body].is_fixed());
                let share = if fastened { contact.relaxation_share(off, share) } else { share };
                contact.penetration += share * off;
                if contact.penetration > ZERO_DEPTH || load.force > 0.0 {
                    contacts.push(contact);
                }
            }
        }
        self.contacts = contacts;
    }

    /// Recomputes a contact's curve if it is out of date.
    fn renew_curve(&self, contact: &mut GelContact, colliders: &ColliderSet) {
        contact.age = contact.age.saturating_add(1);
        if contact.load.force <= 0.0 || contact.age < MIN_CURVE_INTERVAL {
            return;
        }
        let (soft, presser) = (&self.covers[contact.cover], &self.objects[contact.object]);
        let world_from_cover = convert::to_pose(colliders[soft.collider].position());
        let world_from_object = convert::to_pose(colliders[presser.collider].position());
        let object_from_cover = world_from_object.inverse() * world_from_cover;
        let middle = world_from_cover.inverse_transform_point(&Point3::from(contact.load.middle));
        let force = contact.load.force;
        let good = contact.curve.as_ref().is_some_and(|shared| {
            let ratio = (force / shared.force).max(shared.force / force);
            (shared.middle - middle).norm() < CURVE_POSITION_TOLERANCE
                && shared.object_from_cover.rotation.angle_to(&object_from_cover.rotation) < CURVE_ROTATION_TOLERANCE
                && (ratio < CURVE_FORCE_TOLERANCE.0 || force.max(shared.force) < CURVE_FORCE_TOLERANCE.1)
        });
        if good {
            return;
        }
        contact.age = 0;
        let out = world_from_cover.inverse_transform_vector(&contact.load.out);
        let Some(out) = Unit::try_new(out, 1e-3) else { return };
        let (surface, cover_from_frame) = soft.surface(&middle, &out);
        let object_from_frame = object_from_cover * cover_from_frame;
        let gap = SurfaceGap { surface, object: &presser.model.shape, object_from_frame };
        if let Some(curve) = PressCurve::from_gap(&gap, &self.gel, force) {
            contact.curve = Some(CachedCurve { curve: Arc::new(curve), object_from_cover, middle, force });
        }
    }
}

/// Extracts the solver's load between a cover and an object.
fn contact_load(pair: &ContactPair, cover: ColliderHandle, dt: f64, bodies: &RigidBodySet) -> CoverLoad {
    let out = if pair.collider1 == cover { 1.0 } else { -1.0 };
    let mut load = CoverLoad::default();
    for at in loaded_points(pair, bodies) {
        let force = at.data.impulse / dt;
        load.force += force;
        load.middle += at.point * force;
        load.out += at.normal * out * force;
        // The solver's tangent impulses are those of the second body on the first.
        load.friction += convert::to_vector(at.data.warmstart_tangent_world) * (out / dt);
    }
    if load.force > 0.0 {
        load.middle /= load.force;
        load.out /= load.force;
    }
    load
}

impl PhysicsHooks for SoftCovers {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let (one, two) = (context.collider1, context.collider2);
        let found = self.contacts.iter().find_map(|contact| {
            let (cover, object) = (self.covers[contact.cover].collider, self.objects[contact.object].collider);
            let first = (cover, object) == (one, two);
            (first || (object, cover) == (one, two)).then_some((contact.penetration, first))
        });
        let (Some((sink, cover_is_first)), Some(rigid)) = (found, context.rigid_mut()) else { return };
        let normal = *rigid.normal;
        for contact in rigid.solver_contacts.iter_mut() {
            contact.dist += sink;
            // Shift the cover's point inwards; if the cover is the first body, the engine does that itself.
            if !cover_is_first {
                contact.anchor2 += normal * sink;
            }
        }
    }
}

#[cfg(test)]
mod tests;
