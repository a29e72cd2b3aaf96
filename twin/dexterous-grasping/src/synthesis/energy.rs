//! Grasp energy of the paper's Methods with its gradient: E(T, q, x | O) for a pose T, joints q and contact points x.
//!
//! | term | requirement |
//! |---|---|
//! | balance, rank | the contacts can achieve force closure ([`super::closure_energy`]) |
//! | distance | every contact point is on the object's surface |
//! | facing | the pad is parallel to the surface it touches |
//! | penetration | no point of the hand's surface is inside the object |
//! | self-penetration | links keep clear of each other (balls that fill the covers) |
//! | limits | joints are within their limits |
//! | cable | a digit's joints are near the line along which its cable and springs move them |
//! | table | no point of the hand is below the table, if there is one |
//!
//! Terms are dimensionless after weighting. An evaluation allocates nothing, and skips whole links and then patches that
//! are too far from the object, by the bound on the distance's slope.

use hand_model::Hand;
use nalgebra::{Unit, Vector3};

use super::closure_energy::{Closure, closure_with_gradient};
use super::field::{DistanceField, LIPSCHITZ_BOUND};
use super::frames::{HandState, LinkFrames};
use super::mechanism::Mechanism;
use super::surface::HandSurface;

/// Largest number of contact points.
pub const MAX_CONTACTS: usize = 8;

/// Weights of the terms.
#[derive(Debug, Clone, Copy)]
pub struct EnergyWeights {
    /// Weight per unit of |G c| / n.
    pub balance: f64,
    /// Weight per unit of -log det.
    pub rank: f64,
    /// Weight of the distance of a contact point from the surface, 1/m, per contact.
    pub distance: f64,
    /// Weight of 1 + cos of the angle between pad and surface normal, per contact.
    pub facing: f64,
    /// Weight of the depth of a surface point, 1/m, per point (for 2,000 points on the hand; fewer weigh more).
    pub penetration: f64,
    /// Weight of the overlap of two balls, 1/m, per pair of balls.
    pub self_penetration: f64,
    /// Weight of exceeding a joint limit, 1/rad.
    pub limits: f64,
    /// Weight of the squared distance of a joint from its cable's line, 1/rad2.
    pub cable: f64,
    /// Weight of the depth below the table, 1/m, per patch.
    pub table: f64,
}

impl Default for EnergyWeights {
    fn default() -> Self {
        Self {
            balance: 12.0,
            rank: 0.05,
            distance: 40.0,
            facing: 1.5,
            penetration: 30.0,
            self_penetration: 60.0,
            limits: 10.0,
            cable: 3.0,
            table: 100.0,
        }
    }
}

/// A table top: the half space x . normal >= offset is free (object frame).
#[derive(Debug, Clone, Copy)]
pub struct TablePlane {
    /// Up direction.
    pub normal: Unit<Vector3<f64>>,
    /// Offset along the normal, m.
    pub offset: f64,
}

/// Weighted terms of the energy, and some of the quantities behind them.
#[derive(Debug, Clone, Copy, Default)]
pub struct EnergyTerms {
    /// Sum of the weighted terms.
    pub total: f64,
    /// Balance and rank.
    pub closure: f64,
    /// Contact points off the surface.
    pub distance: f64,
    /// Pads not parallel to the surfaces they touch.
    pub facing: f64,
    /// Hand inside the object.
    pub penetration: f64,
    /// Links of the hand inside each other.
    pub self_penetration: f64,
    /// Joint limits, cables and table.
    pub posture: f64,
    /// |G c| / n.
    pub balance: f64,
    /// Largest distance of a contact point from the surface, m.
    pub max_contact_distance: f64,
    /// Depth of the deepest surface point, m.
    pub max_depth: f64,
}

impl EnergyTerms {
    /// Returns the part that depends on the contact points.
    pub fn contact_terms(&self) -> f64 {
        self.closure + self.distance + self.facing
    }
}

/// Energy of one hand on one object.
///
/// ```
/// use dexterous_grasping::synthesis::chain::{chain_rng, random_start};
/// use dexterous_grasping::synthesis::energy::EnergyWeights;
/// use dexterous_grasping::synthesis::field::DistanceField;
/// use dexterous_grasping::synthesis::sampled_hand::SampledHand;
/// use hand_model::Hand;
/// use nalgebra::{Point3, Vector3};
///
/// # let corner = Point3::new(0.03, 0.03, 0.03);
/// # let field = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.003, 0.02, |p| {
/// #     (p.coords.norm() - 0.03, p.coords.try_normalize(1e-9).unwrap_or_else(Vector3::x))
/// # })?;
/// let hand = SampledHand::from_hand(&Hand::ftac(), 400);
/// let energy = hand.energy(&field, EnergyWeights::default(), None);
/// let state = random_start(&energy, &mut chain_rng(1, 0));
/// // Three contact candidates; the gradient is that of translation, rotation and joints.
/// let mut gradient = vec![0.0; state.freedom()];
/// let terms = energy.evaluate(&state, &[0, 200, 400], &mut hand.frames(), &mut gradient);
/// assert!(terms.total.is_finite() && gradient.iter().any(|slope| *slope != 0.0));
/// # Ok::<(), dexterous_grasping::synthesis::field::FieldError>(())
/// ```
#[derive(Debug, Clone)]
pub struct GraspEnergy<'a> {
    /// The object.
    pub field: &'a DistanceField,
    /// The hand's surface and contact candidates.
    pub surface: &'a HandSurface,
    /// Weights of the terms.
    pub weights: EnergyWeights,
    /// Places at which chains begin, object frame, m. If empty, they begin around the whole object.
    pub start_points: &'a [Vector3<f64>],
    table: Option<TablePlane>,
    mechanism: Mechanism,
    point_weight: f64,
}

impl<'a> GraspEnergy<'a> {
    /// Creates the energy of `hand` with its `surface` on the object of `field`, with or without a `table`.
    pub fn new(
        hand: &Hand,
        surface: &'a HandSurface,
        field: &'a DistanceField,
        weights: EnergyWeights,
        table: Option<TablePlane>,
    ) -> Self {
        Self::from_mechanism(Mechanism::from_hand(hand), surface, field, weights, table)
    }

    /// Creates the energy of any mechanism whose links have this `surface`.
    pub fn from_mechanism(
        mechanism: Mechanism,
        surface: &'a HandSurface,
        field: &'a DistanceField,
        weights: EnergyWeights,
        table: Option<TablePlane>,
    ) -> Self {
        Self {
            field,
            surface,
            weights,
            start_points: &[],
            table,
            mechanism,
            point_weight: weights.penetration * 2000.0 / surface.len() as f64,
        }
    }

    /// Returns the joint limits and actuator lines.
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    /// Returns the joint limits, rad or m.
    pub fn limits(&self) -> &[(f64, f64)] {
        &self.mechanism.limits
    }

    /// Evaluates the energy of `state` with the contact candidates `contacts`, and its gradient (overwritten):
    /// translation, rotation about the pivot, joints. `frames` is working space for the same hand, and is at `state`
    /// afterwards.
    ///
    /// # Panics
    /// With more than [`MAX_CONTACTS`] contacts.
    pub fn evaluate(
        &self,
        state: &HandState,
        contacts: &[usize],
        frames: &mut LinkFrames,
        gradient: &mut [f64],
    ) -> EnergyTerms {
        gradient.fill(0.0);
        frames.set_state(state);
        let mut terms = EnergyTerms::default();
        self.contacts(contacts, frames, &mut terms);
        for (link, surface) in self.surface.links.iter().enumerate() {
            frames.centers[link] = frames.point(link, &surface.bound.center);
        }
        self.penetration(frames, &mut terms);
        self.self_penetration(frames, &mut terms);
        frames.collect_gradient(gradient);
        self.posture(state, gradient, &mut terms);
        terms.total =
            terms.closure + terms.distance + terms.facing + terms.penetration + terms.self_penetration + terms.posture;
        terms
    }

    /// Evaluates the part of the energy that depends on the contact points, at the state of `frames`, whose wrenches
    /// are overwritten.
    pub fn contact_energy(&self, contacts: &[usize], frames: &mut LinkFrames) -> f64 {
        let mut terms = EnergyTerms::default();
        self.contacts(contacts, frames, &mut terms);
        terms.contact_terms()
    }

    fn contacts(&self, contacts: &[usize], frames: &mut LinkFrames, terms: &mut EnergyTerms) {
        let n = contacts.len();
        assert!(n <= MAX_CONTACTS, "{n} contacts, at most {MAX_CONTACTS}");
        let zero = [Vector3::zeros(); MAX_CONTACTS];
        let (mut points, mut arms, mut pushes) = (zero, zero, zero);
        let (mut by_arms, mut by_pushes) = (zero, zero);
        let mut samples = [None; MAX_CONTACTS];
        for (i, &index) in contacts.iter().enumerate() {
            let candidate = &self.surface.candidates[index];
            points[i] = frames.point(candidate.link, &candidate.point);
            let sample = self.field.sample_at(&points[i]);
            arms[i] = (points[i] - self.field.center.coords) / self.field.length;
            pushes[i] = -sample.normal;
            samples[i] = Some(sample);
        }
        let weights = &self.weights;
        let Closure { balance, rank } = closure_with_gradient(
            &arms[..n],
            &pushes[..n],
            (weights.balance, weights.rank),
            &mut by_arms[..n],
            &mut by_pushes[..n],
        );
        terms.balance = balance;
        terms.closure = weights.balance * balance + weights.rank * rank;
        for (i, &index) in contacts.iter().enumerate() {
            let Some(sample) = samples[i] else { continue };
            let candidate = &self.surface.candidates[index];
            let outward = frames.rotation[candidate.link] * candidate.normal;
            terms.distance += weights.distance * sample.distance.abs();
            terms.facing += weights.facing * (1.0 + outward.dot(&sample.normal));
            terms.max_contact_distance = terms.max_contact_distance.max(sample.distance.abs());
            let by_normal = outward * weights.facing - by_pushes[i];
            let force = by_arms[i] / self.field.length
                + sample.gradient * weights.distance.copysign(sample.distance)
                + sample.normal_jacobian.transpose() * by_normal;
            frames.add_point_gradient(candidate.link, &points[i], &force);
            frames.add_direction_gradient(candidate.link, &outward, &(sample.normal * weights.facing));
        }
    }

    fn penetration(&self, frames: &mut LinkFrames, terms: &mut EnergyTerms) {
        for (link, surface) in self.surface.links.iter().enumerate() {
            let center = frames.centers[link];
            self.below_table(link, &center, surface.bound.radius, frames, terms);
            if self.field.distance(&center) > LIPSCHITZ_BOUND * surface.bound.radius {
                continue;
            }
            let (rotation, translation) = (frames.rotation[link], frames.translation[link]);
            let (mut force, mut torque, mut depth) = (Vector3::zeros(), Vector3::zeros(), 0.0);
            for patch in &surface.patches {
                let center = rotation * patch.bound.center + translation;
                let reach = LIPSCHITZ_BOUND * patch.bound.radius;
                if self.field.is_clear(&center, reach) || self.field.distance(&center) > reach {
                    continue;
                }
                for local in &surface.points[patch.range.clone()] {
                    let x = rotation * local + translation;
                    if !self.field.is_clear(&x, 0.0) && self.field.distance(&x) < 0.0 {
                        let (distance, slope) = self.field.distance_gradient(&x);
                        depth -= distance;
                        terms.max_depth = terms.max_depth.max(-distance);
                        force -= slope;
                        torque -= x.cross(&slope);
                    }
                }
            }
            terms.penetration += self.point_weight * depth;
            frames.wrench[link].force += force * self.point_weight;
            frames.wrench[link].torque += torque * self.point_weight;
        }
    }

    fn below_table(
        &self,
        link: usize,
        center: &Vector3<f64>,
        radius: f64,
        frames: &mut LinkFrames,
        terms: &mut EnergyTerms,
    ) {
        let Some(table) = &self.table else { return };
        if center.dot(&table.normal) - radius > table.offset {
            return;
        }
        for patch in &self.surface.links[link].patches {
            let x = frames.point(link, &patch.bound.center);
            let below = table.offset - x.dot(&table.normal);
            if below > 0.0 {
                terms.posture += self.weights.table * below;
                frames.add_point_gradient(link, &x, &(-table.normal.into_inner() * self.weights.table));
            }
        }
    }

    fn self_penetration(&self, frames: &mut LinkFrames, terms: &mut EnergyTerms) {
        let weight = self.weights.self_penetration;
        for &(a, b) in &self.surface.pairs {
            let (left, right) = (&self.surface.links[a], &self.surface.links[b]);
            let apart = frames.centers[a] - frames.centers[b];
            let reach = left.bound.radius + right.bound.radius;
            if apart.norm_squared() > reach * reach {
                continue;
            }
            for x in &left.spheres {
                let px = frames.point(a, &x.center);
                // One ball against the other link first.
                let away = (px - frames.centers[b]).norm_squared();
                let near = x.radius + right.bound.radius;
                if away > near * near {
                    continue;
                }
                for y in &right.spheres {
                    let py = frames.point(b, &y.center);
                    let between = px - py;
                    let touch = x.radius + y.radius;
                    if between.norm_squared() >= touch * touch {
                        continue;
                    }
                    let distance = between.norm().max(1e-9);
                    terms.self_penetration += weight * (touch - distance);
                    let force = between * (-weight / distance);
                    frames.add_point_gradient(a, &px, &force);
                    frames.add_point_gradient(b, &py, &-force);
                }
            }
        }
    }

    fn posture(&self, state: &HandState, gradient: &mut [f64], terms: &mut EnergyTerms) {
        for (joint, &(lower, upper)) in self.mechanism.limits.iter().enumerate() {
            let q = state.joints[joint];
            let weight = self.weights.limits * self.mechanism.scale[joint];
            if q > upper {
                terms.posture += weight * (q - upper);
                gradient[6 + joint] += weight;
            } else if q < lower {
                terms.posture += weight * (lower - q);
                gradient[6 + joint] -= weight;
            }
        }
        for line in &self.mechanism.lines {
            let n = line.joints.len() as f64;
            // Position along the line: the mean of the joint coordinates, signed by the line's direction.
            let along = |k: usize| line.share[k].signum() * (state.joints[line.joints[k]] - line.offset[k]);
            let mean = (0..line.joints.len()).map(along).sum::<f64>() / n;
            let off = |k: usize| state.joints[line.joints[k]] - line.offset[k] - line.share[k] * mean;
            let square = |k: usize| self.mechanism.scale[line.joints[k]] * self.mechanism.scale[line.joints[k]];
            let shared: f64 = (0..line.joints.len()).map(|k| square(k) * off(k) * line.share[k]).sum::<f64>() / n;
            for (k, joint) in line.joints.iter().enumerate() {
                terms.posture += self.weights.cable * square(k) * off(k) * off(k);
                gradient[6 + joint] +=
                    2.0 * self.weights.cable * (square(k) * off(k) - line.share[k].signum() * shared);
            }
        }
    }
}

#[cfg(test)]
mod tests;
