//! One chain: from a random start outside the object through annealing to sampling.
//!
//! An iteration either moves pose and joints by a Langevin proposal ([`super::langevin`]) or replaces one contact point
//! by a uniform draw from the candidates, a symmetric proposal with its own Metropolis decision. While the temperature
//! falls (burn-in) the chain adapts its preconditioner and step. At the final temperature both are fixed, and the chain
//! samples exp(-E / T) exactly. Chains share nothing: a chain is determined by its seed.

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::energy::{EnergyTerms, GraspEnergy};
use super::frames::{HandState, LinkFrames, PIVOT};
use super::langevin::Langevin;

/// Iterations and temperatures of a chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnnealingSchedule {
    /// Iterations while the temperature falls.
    pub burn_in: usize,
    /// Iterations at the final temperature.
    pub steady: usize,
    /// Initial temperature.
    pub initial_temperature: f64,
    /// Final temperature.
    pub final_temperature: f64,
    /// Share of the iterations that replace a contact point.
    pub contact_share: f64,
}

impl Default for AnnealingSchedule {
    fn default() -> Self {
        Self { burn_in: 3000, steady: 400, initial_temperature: 2.0, final_temperature: 0.02, contact_share: 0.3 }
    }
}

/// Largest distance of the object's surface behind the palm frame's origin at a start, along the palm's z, m.
const MAX_START_OVERLAP: f64 = 0.0156;
/// Largest standard deviations of the noise at step 1: translations (m), rotations and joints (rad).
const MAX_NOISE: [f64; 3] = [0.01, 0.15, 0.2];

/// A state of the chain.
#[derive(Debug, Clone)]
pub struct GraspSample {
    /// Pose and joints.
    pub state: HandState,
    /// Indices of the contact points in [`HandSurface::candidates`](super::surface::HandSurface::candidates).
    pub contacts: Vec<usize>,
    /// Terms of the energy.
    pub terms: EnergyTerms,
}

/// Result of a chain.
#[derive(Debug, Clone)]
pub struct ChainEnd {
    /// Lowest energy at the final temperature.
    pub best: GraspSample,
    /// Share of accepted Langevin proposals at the final temperature.
    pub acceptance: f64,
    /// Number of iterations.
    pub steps: usize,
}

/// Returns the random generator of chain number `chain`.
pub fn chain_rng(seed: u64, chain: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(chain);
    rng
}

/// Draws a random start. The palm faces the object from a random side at a small distance, with the object between
/// wrist and fingertips and joint angles scattered around a random mean. If the energy has places, one of them lies
/// between the fingers instead.
pub fn random_start(energy: &GraspEnergy, rng: &mut impl Rng) -> HandState {
    let away = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)).normalize();
    // The palm's z points away from the object; the rotation about it is random.
    let facing = UnitQuaternion::rotation_between(&Vector3::z(), &away)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..std::f64::consts::TAU));
    let tilt = Vector3::from_fn(|_, _| 0.2 * rng.sample::<f64, _>(StandardNormal));
    let rotation = UnitQuaternion::from_scaled_axis(tilt) * facing * UnitQuaternion::from_rotation_matrix(&roll);
    start_from_side(energy, rotation, &away, rng)
}

/// Draws a random start with the palm rotated by `rotation`, on the side of the object that `away` points to.
pub fn start_from_side(
    energy: &GraspEnergy,
    rotation: UnitQuaternion<f64>,
    away: &Vector3<f64>,
    rng: &mut impl Rng,
) -> HandState {
    let (low, high) = energy.field.extent();
    let reach = box_extent(&low.coords, &high.coords, &energy.field.center.coords, away);
    let center_in_palm = Vector3::new(
        rng.random_range(-0.03..0.03),
        rng.random_range(-0.06..0.05),
        MAX_START_OVERLAP - reach - rng.random_range(0.0..0.05),
    );
    let translation = match energy.start_points.len() {
        0 => energy.field.center.coords - rotation * center_in_palm,
        // Such a place starts between the fingers, because the rest of the object is too large to start outside it.
        count => energy.start_points[rng.random_range(0..count)] - rotation * PIVOT,
    };
    let mean = rng.random_range(0.15..0.9);
    let joints = energy
        .limits()
        .iter()
        .map(|&(lower, upper)| {
            let q = lower + (upper - lower) * mean + 0.1 * (upper - lower) * rng.sample::<f64, _>(StandardNormal);
            q.clamp(lower, upper)
        })
        .collect();
    HandState { object_from_palm: Isometry3::from_parts(Translation3::from(translation), rotation), joints }
}

/// Returns the extent of a box from `center` along `direction`.
fn box_extent(low: &Vector3<f64>, high: &Vector3<f64>, center: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
    (0..3)
        .map(|axis| {
            let corner = if direction[axis] > 0.0 { high[axis] } else { low[axis] };
            (corner - center[axis]) * direction[axis]
        })
        .sum()
}

/// Returns the widest noise ([`Langevin::new`]) for a state with `freedom` degrees of freedom: translation (m),
/// rotation, joints (rad).
pub fn max_noise(freedom: usize) -> Vec<f64> {
    (0..freedom).map(|n| MAX_NOISE[(n / 3).min(2)]).collect()
}

/// Runs the contact move: proposes to replace one of the contact points `held` by a uniform draw from the candidates.
/// Returns the contact points' new energy if the move is accepted. `before` is their energy, and `frames` must be at
/// the chain's state.
pub fn replace_contact(
    energy: &GraspEnergy,
    frames: &mut LinkFrames,
    held: &mut [usize],
    before: f64,
    temperature: f64,
    rng: &mut impl Rng,
) -> Option<f64> {
    let (slot, candidate) = (rng.random_range(0..held.len()), rng.random_range(0..energy.surface.candidates.len()));
    let old = std::mem::replace(&mut held[slot], candidate);
    let after = energy.contact_energy(held, frames);
    if rng.random::<f64>().ln() < (before - after) / temperature {
        return Some(after);
    }
    held[slot] = old;
    None
}

/// Runs a chain from a random start with `contacts` contact points. `frames` is working space for the same hand.
///
/// # Panics
/// With more contacts than [`MAX_CONTACTS`](super::energy::MAX_CONTACTS), without contacts, or with a surface without
/// candidates.
///
/// ```
/// use dexterous_grasping::synthesis::chain::{self, AnnealingSchedule};
/// use dexterous_grasping::synthesis::energy::EnergyWeights;
/// use dexterous_grasping::synthesis::field::DistanceField;
/// use dexterous_grasping::synthesis::sampled_hand::SampledHand;
/// use hand_model::Hand;
/// use nalgebra::{Point3, Vector3};
///
/// // A ball of 30 mm radius, by its signed distance and outward normal.
/// let corner = Point3::new(0.03, 0.03, 0.03);
/// let field = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.003, 0.02, |p| {
///     (p.coords.norm() - 0.03, p.coords.try_normalize(1e-9).unwrap_or_else(Vector3::x))
/// })?;
/// let hand = SampledHand::from_hand(&Hand::ftac(), 400);
/// let energy = hand.energy(&field, EnergyWeights::default(), None);
/// let schedule = AnnealingSchedule { burn_in: 400, steady: 50, ..AnnealingSchedule::default() };
/// // Seed 1, chain 0: the same grasp in every run.
/// let end = chain::run(&energy, &mut hand.frames(), 4, &schedule, &mut chain::chain_rng(1, 0));
/// assert_eq!(end.best.contacts.len(), 4);
/// println!("energy {:.2}, deepest point {:.1} mm", end.best.terms.total, 1e3 * end.best.terms.max_depth);
/// # Ok::<(), dexterous_grasping::synthesis::field::FieldError>(())
/// ```
pub fn run(
    energy: &GraspEnergy,
    frames: &mut LinkFrames,
    contacts: usize,
    schedule: &AnnealingSchedule,
    rng: &mut impl Rng,
) -> ChainEnd {
    let state = random_start(energy, rng);
    run_from(energy, frames, state, contacts, schedule, rng)
}

/// Runs a chain as [`run`] does, but from `state`.
///
/// # Panics
/// As [`run`].
pub fn run_from(
    energy: &GraspEnergy,
    frames: &mut LinkFrames,
    mut state: HandState,
    contacts: usize,
    schedule: &AnnealingSchedule,
    rng: &mut impl Rng,
) -> ChainEnd {
    let candidates = energy.surface.candidates.len();
    let mut held: Vec<usize> = (0..contacts).map(|_| rng.random_range(0..candidates)).collect();
    let freedom = state.freedom();
    let (mut gradient, mut there) = (vec![0.0; freedom], vec![0.0; freedom]);
    let mut displacement = vec![0.0; freedom];
    let mut next = state.clone();
    let mut widest = max_noise(freedom);
    widest[6..].iter_mut().zip(&energy.mechanism().scale).for_each(|(width, scale)| *width /= scale);
    let mut kernel = Langevin::new(0.5, &widest, schedule.initial_temperature);
    let mut terms = energy.evaluate(&state, &held, frames, &mut gradient);
    // True if `frames` is at `state`. A rejected proposal leaves it elsewhere.
    let mut placed = true;
    let mut best: Option<GraspSample> = None;
    let (mut proposed, mut accepted) = (0usize, 0usize);
    let cooling =
        (schedule.final_temperature / schedule.initial_temperature).powf(1.0 / schedule.burn_in.max(1) as f64);
    for step in 0..schedule.burn_in + schedule.steady {
        let learning = step < schedule.burn_in;
        let temperature = if learning {
            schedule.initial_temperature * cooling.powi(step as i32)
        } else {
            schedule.final_temperature
        };
        if rng.random::<f64>() < schedule.contact_share {
            if !placed {
                frames.set_state(&state);
                placed = true;
            }
            if replace_contact(energy, frames, &mut held, terms.contact_terms(), temperature, rng).is_some() {
                terms = energy.evaluate(&state, &held, frames, &mut gradient);
            }
        } else {
            kernel.propose(&gradient, temperature, rng, &mut displacement);
            next.set_moved(&state, &displacement);
            let reached = energy.evaluate(&next, &held, frames, &mut there);
            let log = kernel.log_ratio((terms.total, &gradient), (reached.total, &there), &displacement, temperature);
            placed = rng.random::<f64>().ln() < log;
            if placed {
                std::mem::swap(&mut state, &mut next);
                std::mem::swap(&mut gradient, &mut there);
                terms = reached;
            }
            if learning {
                kernel.adapt(&gradient, log.exp().min(1.0), temperature);
            } else {
                proposed += 1;
                accepted += usize::from(placed);
            }
        }
        if !learning && best.as_ref().is_none_or(|best| terms.total < best.terms.total) {
            best = Some(GraspSample { state: state.clone(), contacts: held.clone(), terms });
        }
    }
    ChainEnd {
        best: best.unwrap_or(GraspSample { state, contacts: held, terms }),
        acceptance: accepted as f64 / proposed.max(1) as f64,
        steps: schedule.burn_in + schedule.steady,
    }
}

#[cfg(test)]
mod tests {
    use super::super::energy::EnergyWeights;
    use super::super::field::tests::ball;
    use super::super::surface::HandSurface;
    use super::*;
    use hand_model::Hand;

    fn ends(chains: u64, schedule: &AnnealingSchedule) -> Vec<ChainEnd> {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 1000);
        let field = ball(0.03);
        let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
        let mut frames = LinkFrames::new(&hand.tree);
        (0..chains).map(|chain| run(&energy, &mut frames, 4, schedule, &mut chain_rng(7, chain))).collect()
    }

    #[test]
    fn same_seed_same_chain() {
        let schedule = AnnealingSchedule { burn_in: 100, steady: 50, ..AnnealingSchedule::default() };
        let (a, b) = (ends(3, &schedule), ends(3, &schedule));
        for (a, b) in a.iter().zip(&b) {
            assert_eq!(a.best.state, b.best.state);
            assert_eq!(a.best.contacts, b.best.contacts);
        }
        assert_ne!(a[0].best.state, a[1].best.state);
    }

    /// Most chains on a ball end with balanced forces, little penetration and contact points that are on average a few
    /// millimetres from the surface. Closing in physics then brings them into contact.
    #[test]
    fn chains_find_grasps_of_a_ball() {
        let ends = ends(12, &AnnealingSchedule::default());
        let weight = EnergyWeights::default().distance;
        let good = ends.iter().filter(|end| {
            let terms = &end.best.terms;
            terms.distance / (4.0 * weight) < 6e-3 && terms.max_depth < 4e-3 && terms.balance < 0.1
        });
        for end in &ends {
            assert!((0.02..0.98).contains(&end.acceptance), "acceptance {}", end.acceptance);
        }
        assert!(good.count() >= 8, "{:?}", ends.iter().map(|end| end.best.terms).collect::<Vec<_>>());
    }

    /// Two contacts on five candidates with a fixed hand: the frequencies of the 25 pairs follow exp(-E / T).
    #[test]
    fn contact_moves_sample_their_density() {
        let hand = Hand::ftac();
        let mut surface = HandSurface::new(&hand, 300);
        let every = surface.candidates.len() / 5;
        surface.candidates = surface.candidates.iter().step_by(every).take(5).copied().collect();
        let field = ball(0.03);
        let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
        let mut frames = LinkFrames::new(&hand.tree);
        let mut rng = chain_rng(2, 0);
        frames.set_state(&random_start(&energy, &mut rng));
        let temperature = 1.5;
        let pairs: Vec<[usize; 2]> = (0..25).map(|n| [n / 5, n % 5]).collect();
        let weights: Vec<f64> =
            pairs.iter().map(|pair| (-energy.contact_energy(pair, &mut frames) / temperature).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mut held = [0, 0];
        let mut now = energy.contact_energy(&held, &mut frames);
        let mut seen = [0u32; 25];
        let moves = 200_000;
        for _ in 0..moves {
            now = replace_contact(&energy, &mut frames, &mut held, now, temperature, &mut rng).unwrap_or(now);
            seen[5 * held[0] + held[1]] += 1;
        }
        let off: f64 = (0..25).map(|n| (f64::from(seen[n]) / f64::from(moves) - weights[n] / total).abs()).sum();
        assert!(off < 0.03, "total variation {off}");
        let flat: f64 = weights.iter().map(|w| (w / total - 0.04).abs()).sum();
        assert!(flat > 0.1, "the density is not flat: {flat}");
    }

    #[test]
    fn starts_face_the_object() {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 300);
        let field = ball(0.03);
        let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
        let mut rng = chain_rng(1, 1);
        for _ in 0..50 {
            let state = random_start(&energy, &mut rng);
            let center = state.object_from_palm.inverse_transform_point(&field.center);
            assert!(center.z < -0.01, "in front of the palm: {center}");
        }
    }
}
