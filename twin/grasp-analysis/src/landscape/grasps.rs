//! The energy of grasps as a landscape, over several objects at once.
//!
//! A state is a hand on one of the objects with its contact points. Two grasps are the same strategy if the hand holds
//! in the same way, whatever the object. The distance therefore compares joint angles and the position of the object's
//! centre in the palm, and grasps of different objects can be close. A chain stays on its object. If it is drawn
//! towards a grasp of another object, it tests whether its own object can be held in that way, and over which energy.

use dexterous_grasping::synthesis::chain::{max_noise, replace_contact};
use dexterous_grasping::synthesis::energy::{GraspEnergy, MAX_CONTACTS};
use dexterous_grasping::synthesis::frames::{HandState, LinkFrames, PIVOT};
use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array, pose_to_array};
use dexterous_grasping::synthesis::langevin::Langevin;
use hand_model::Hand;
use nalgebra::{Point3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Landscape;

/// Displacement of the object in the palm that counts as much as a radian in a joint, m.
const POSITION_SCALE: f64 = 0.03;
/// Share of the steps that replace a contact point.
const CONTACT_SHARE: f64 = 0.15;
/// Largest number of contact points of a state. The paper's grasps have 2 to 5.
const MAX_STATE_CONTACTS: usize = 5;

/// A state of the landscape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraspState {
    /// Index of the object.
    pub object: usize,
    /// `object_from_palm`: position, then the quaternion's i, j, k, w.
    pub pose: [f64; 7],
    /// Joint angles, rad.
    pub joints: Vec<f64>,
    pub contacts: Vec<usize>,
    /// Step and curvatures of the kernel, adapted at this state.
    kernel: (f64, Vec<f64>),
}

impl GraspState {
    fn hand(&self) -> HandState {
        HandState { object_from_palm: pose_from_array(&self.pose), joints: self.joints.clone() }
    }
}

/// Energies of one hand on several objects.
pub struct GraspLandscape<'a> {
    hand: &'a Hand,
    energies: Vec<GraspEnergy<'a>>,
}

/// A chain on one object.
pub struct GraspWalker {
    object: usize,
    frames: LinkFrames,
    kernel: Langevin,
    state: HandState,
    next: HandState,
    contacts: Vec<usize>,
    energy: f64,
    contact_energy: f64,
    gradient: Vec<f64>,
    next_gradient: Vec<f64>,
    displacement: Vec<f64>,
}

impl<'a> GraspLandscape<'a> {
    /// Creates a landscape of `hand` with one energy per object.
    pub fn new(hand: &'a Hand, energies: Vec<GraspEnergy<'a>>) -> Self {
        Self { hand, energies }
    }

    /// Finds the local minimum near a grasp held in physics: its contacts are moved to the nearest candidates, then a
    /// chain cools from `temperature`. Returns `None` for a grasp with fewer than two links in contact.
    pub fn minimum(
        &self,
        object: usize,
        grasp: &HeldGrasp,
        temperature: f64,
        steps: usize,
        rng: &mut ChaCha8Rng,
    ) -> Option<GraspState> {
        let contacts = self.candidates(object, grasp);
        if contacts.len() < 2 {
            return None;
        }
        let freedom = 6 + grasp.joints.len();
        let fresh = Langevin::new(0.3, &max_noise(freedom), temperature);
        let start = GraspState {
            object,
            pose: pose_to_array(&pose_from_array(&grasp.closed).inverse()),
            joints: grasp.joints.to_vec(),
            contacts,
            kernel: (fresh.step, fresh.curvature.clone()),
        };
        let mut walker = self.start_chain(&start);
        walker.kernel = fresh;
        let mut best = (walker.energy, walker.state.clone(), walker.contacts.clone());
        let mut learnt = start.kernel.clone();
        for step in 0..steps {
            // The first half adapts the kernel at the temperature, the second half cools to nearly 0.
            let cooling = (2.0 * step as f64 / steps as f64 - 1.0).max(0.0);
            let now = temperature * 1e-3_f64.powf(cooling);
            self.advance(&mut walker, None, now, true, rng);
            if 2 * step < steps {
                learnt = (walker.kernel.step, walker.kernel.curvature.clone());
            }
            if walker.energy < best.0 {
                best = (walker.energy, walker.state.clone(), walker.contacts.clone());
            }
        }
        let pose = pose_to_array(&best.1.object_from_palm);
        Some(GraspState { object, pose, joints: best.1.joints, contacts: best.2, kernel: learnt })
    }

    /// Returns the candidates nearest to a grasp's contacts: one per link, largest force first.
    fn candidates(&self, object: usize, grasp: &HeldGrasp) -> Vec<usize> {
        let surface = self.energies[object].surface;
        let links = self.hand.tree.forward(&grasp.joints);
        let mut by_link: Vec<(usize, f64, Vector3<f64>)> = Vec::new();
        for contact in &grasp.contacts {
            let link = contact.link.map_or(0, |link| link + 1);
            let at = Vector3::from(contact.point) * contact.force;
            match by_link.iter_mut().find(|known| known.0 == link) {
                Some(known) => {
                    known.1 += contact.force;
                    known.2 += at;
                }
                None => by_link.push((link, contact.force, at)),
            }
        }
        by_link.retain(|(_, force, _)| *force > 0.0);
        by_link.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        by_link.truncate(MAX_STATE_CONTACTS.min(MAX_CONTACTS));
        let nearest = |(link, force, sum): &(usize, f64, Vector3<f64>)| {
            let at = Point3::from(sum / *force);
            let local = if *link == 0 { at } else { links[link - 1].inverse_transform_point(&at) };
            let own = surface.candidates.iter().enumerate().filter(|(_, candidate)| candidate.link == *link);
            let squared = |point: &Vector3<f64>| (point - local.coords).norm_squared();
            own.min_by(|a, b| squared(&a.1.point).total_cmp(&squared(&b.1.point))).map(|(index, _)| index)
        };
        by_link.iter().filter_map(nearest).collect()
    }

    /// Returns the position of the object's centre in the palm frame, m.
    fn center(&self, object: usize, hand: &HandState) -> Vector3<f64> {
        hand.object_from_palm.inverse_transform_point(&self.energies[object].field.center).coords
    }

    fn distance_to_target(&self, object: usize, hand: &HandState, target: &ChainTarget) -> f64 {
        let joints: f64 = hand.joints.iter().zip(&target.joints).map(|(a, b)| (a - b) * (a - b)).sum();
        (joints + ((self.center(object, hand) - target.center) / POSITION_SCALE).norm_squared()).sqrt()
    }

    /// Adds the gradient of the pull towards `target` to `gradient`. Returns the pull's energy.
    fn pull(&self, object: usize, hand: &HandState, target: &ChainTarget, weight: f64, gradient: &mut [f64]) -> f64 {
        let distance = self.distance_to_target(object, hand, target).max(1e-9);
        let scale = weight / distance;
        for (joint, (q, wanted)) in hand.joints.iter().zip(&target.joints).enumerate() {
            gradient[6 + joint] += scale * (q - wanted);
        }
        // The centre's position in the palm is R'(c - t): translating the palm by d shifts it by -R'd, rotating by w
        // about the pivot p by -R'(w x (c - p)).
        let pose = &hand.object_from_palm;
        let by_center =
            pose.rotation * ((self.center(object, hand) - target.center) * (scale / (POSITION_SCALE * POSITION_SCALE)));
        let pivot = pose.rotation * PIVOT + pose.translation.vector;
        let by_turn = by_center.cross(&(self.energies[object].field.center.coords - pivot));
        for axis in 0..3 {
            gradient[axis] -= by_center[axis];
            gradient[3 + axis] += by_turn[axis];
        }
        weight * distance
    }

    /// Runs one step on the energy plus the pull, if there is one. `learning` adapts the kernel.
    fn advance(
        &self,
        walker: &mut GraspWalker,
        pull: Option<(&ChainTarget, f64)>,
        temperature: f64,
        learning: bool,
        rng: &mut ChaCha8Rng,
    ) {
        let energy = &self.energies[walker.object];
        let w = walker;
        if rng.random::<f64>() < CONTACT_SHARE {
            w.frames.set_state(&w.state);
            if replace_contact(energy, &mut w.frames, &mut w.contacts, w.contact_energy, temperature, rng).is_some() {
                let terms = energy.evaluate(&w.state, &w.contacts, &mut w.frames, &mut w.gradient);
                w.energy = terms.total;
                w.contact_energy = terms.contact_terms();
            }
            return;
        }
        // The pull's gradient depends on the target. The landscape's own gradient is kept in the walker.
        let mut slope = w.gradient.clone();
        let before = w.energy + pull.map_or(0.0, |(to, weight)| self.pull(w.object, &w.state, to, weight, &mut slope));
        w.kernel.propose(&slope, temperature, rng, &mut w.displacement);
        w.next.set_moved(&w.state, &w.displacement);
        let terms = energy.evaluate(&w.next, &w.contacts, &mut w.frames, &mut w.next_gradient);
        let mut slope_there = w.next_gradient.clone();
        let after =
            terms.total + pull.map_or(0.0, |(to, weight)| self.pull(w.object, &w.next, to, weight, &mut slope_there));
        let log = w.kernel.log_ratio((before, &slope), (after, &slope_there), &w.displacement, temperature);
        if rng.random::<f64>().ln() < log {
            std::mem::swap(&mut w.state, &mut w.next);
            std::mem::swap(&mut w.gradient, &mut w.next_gradient);
            w.energy = terms.total;
            w.contact_energy = terms.contact_terms();
        }
        if learning {
            w.kernel.adapt(&w.gradient, log.exp().min(1.0), temperature);
        }
    }
}

/// Target of a chain.
struct ChainTarget {
    joints: Vec<f64>,
    center: Vector3<f64>,
}

impl Landscape for GraspLandscape<'_> {
    type State = GraspState;
    type Walker = GraspWalker;

    fn start_chain(&self, state: &GraspState) -> GraspWalker {
        let hand = state.hand();
        let freedom = hand.freedom();
        let mut frames = LinkFrames::new(&self.hand.tree);
        let mut gradient = vec![0.0; freedom];
        let terms = self.energies[state.object].evaluate(&hand, &state.contacts, &mut frames, &mut gradient);
        let mut kernel = Langevin::new(state.kernel.0, &vec![1.0; freedom], 1.0);
        kernel.curvature.clone_from(&state.kernel.1);
        GraspWalker {
            object: state.object,
            frames,
            kernel,
            next: hand.clone(),
            state: hand,
            contacts: state.contacts.clone(),
            energy: terms.total,
            contact_energy: terms.contact_terms(),
            gradient,
            next_gradient: vec![0.0; freedom],
            displacement: vec![0.0; freedom],
        }
    }

    fn step(
        &self,
        walker: &mut GraspWalker,
        target: &GraspState,
        pull: f64,
        temperature: f64,
        rng: &mut ChaCha8Rng,
    ) -> (f64, f64) {
        let target = ChainTarget { joints: target.joints.clone(), center: self.center(target.object, &target.hand()) };
        self.advance(walker, Some((&target, pull)), temperature, false, rng);
        (walker.energy, self.distance_to_target(walker.object, &walker.state, &target))
    }

    fn energy(&self, state: &GraspState) -> f64 {
        self.start_chain(state).energy
    }

    fn distance(&self, a: &GraspState, b: &GraspState) -> f64 {
        let target = ChainTarget { joints: b.joints.clone(), center: self.center(b.object, &b.hand()) };
        self.distance_to_target(a.object, &a.hand(), &target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::attraction::{AttractionSettings, lowest_barrier};
    use crate::test_grasp::grasp;
    use dexterous_grasping::synthesis::energy::EnergyWeights;
    use dexterous_grasping::synthesis::field::DistanceField;
    use dexterous_grasping::synthesis::surface::HandSurface;
    use rand::SeedableRng;

    fn ball(radius: f64) -> DistanceField {
        let (low, high) = (Point3::from([-radius; 3]), Point3::from([radius; 3]));
        DistanceField::sample(&low, &high, &Point3::origin(), 0.003, 0.02, |p| {
            (p.coords.norm() - radius, p.coords.try_normalize(1e-9).unwrap_or_else(Vector3::z))
        })
        .expect("a ball")
    }

    fn held(bend: f64) -> HeldGrasp {
        let touches = [(None, 5.0), (Some(2), 3.0), (Some(5), 3.0), (Some(8), 3.0)];
        grasp(bend, &touches.map(|(link, force)| (link, [0.0, 0.0, 1.0], force)))
    }

    /// The pull's gradient is its finite difference, on pose and joints.
    #[test]
    fn gradient_of_the_pull() {
        let (hand, field) = (Hand::ftac(), ball(0.03));
        let surface = HandSurface::new(&hand, 500);
        let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
        let landscape = GraspLandscape::new(&hand, vec![energy]);
        let pose = nalgebra::Isometry3::new(Vector3::new(0.01, -0.02, 0.03), Vector3::new(0.3, -0.5, 0.2));
        let state = HandState { object_from_palm: pose, joints: (0..15).map(|q| 0.05 * f64::from(q)).collect() };
        let target = ChainTarget { joints: vec![0.4; 15], center: Vector3::new(0.004, 0.01, -0.05) };
        let mut gradient = vec![0.0; 21];
        landscape.pull(0, &state, &target, 1.7, &mut gradient);
        for n in 0..21 {
            let at = |by: f64| {
                let mut displacement = vec![0.0; 21];
                displacement[n] = by;
                1.7 * landscape.distance_to_target(0, &state.moved(&displacement), &target)
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((slope - gradient[n]).abs() < 1e-5, "{n}: {slope} {}", gradient[n]);
        }
    }

    /// Minima are below their starts, the distance is symmetric between objects, a near grasp is reached over a barrier
    /// not below the ends, and the same seed gives the same result.
    #[test]
    fn two_grasps_on_two_balls() {
        let (hand, fields) = (Hand::ftac(), [ball(0.03), ball(0.034)]);
        let surface = HandSurface::new(&hand, 500);
        let energies = fields
            .iter()
            .map(|field| GraspEnergy::new(&hand, &surface, field, EnergyWeights::default(), None))
            .collect();
        let landscape = GraspLandscape::new(&hand, energies);
        let minimum = |object: usize, bend: f64| {
            let mut rng = ChaCha8Rng::seed_from_u64(4);
            landscape.minimum(object, &held(bend), 0.1, 600, &mut rng).expect("four links touch")
        };
        let (a, b) = (minimum(0, 0.7), minimum(1, 0.75));
        let start = GraspState { joints: vec![0.7; 15], pose: [0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 1.0], ..a.clone() };
        assert!(landscape.energy(&a) < landscape.energy(&start));
        assert!((landscape.distance(&a, &b) - landscape.distance(&b, &a)).abs() < 1e-9);
        assert_eq!(landscape.distance(&a, &a), 0.0);
        let settings = AttractionSettings { pull: 20.0, temperature: 0.1, near: 0.8, max_idle_steps: 300, chains: 2 };
        let found = lowest_barrier(&landscape, &a, &b, &settings, 3, [0, 0]);
        let barrier = found.expect("a hard pull arrives");
        assert!(barrier >= landscape.energy(&a).max(landscape.energy(&b)));
        assert_eq!(found, lowest_barrier(&landscape, &a, &b, &settings, 3, [0, 0]));
    }
}
