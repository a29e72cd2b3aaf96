//! Fit of one actuator's parameters, such that the model of its digit moves as in a session.
//!
//! Minimum squares over the servo's angle at every few ticks, with a prior from the nominal model: each deviation is
//! searched in units of its standard deviation and counts as one more residual. The residuals of the model are not
//! white noise: errors of neighbouring samples are correlated. They are therefore weighted by their own standard
//! deviation times the square root of their correlation length in samples, both estimated in the previous round. The
//! covariance is that of the last round and includes the parameters that the fit does not search
//! ([`interval`](crate::interval)).
//!
//! The cost has several minima: only small differences reveal which joint of a digit leaves its stop first. The search
//! is therefore restarted with the spring rests of neighbouring joints moved apart, in both directions. Dry friction
//! makes the residuals rough, so slopes are those of secants.

use ftac_least_squares::{FitProblem, FitResult, SolverOptions};
use hand_model::transmission::friction::CableLosses;
use hand_model::{ArmVector, Hand, RobotModel};
use nalgebra::DMatrix;
use plant::RobotInstance;
use plant::prior::{PlantParameter, Quantity};

use crate::free_digit::simulate_motion;
use crate::free_motion::FreeMotion;
use crate::interval::{SampleCluster, covariance};
use crate::kinematic_calibration::KinematicCalibration;

/// Number of ticks per sample.
const TICKS_PER_SAMPLE: usize = 6;
/// Standard deviation of an angle in the first round, rad.
const INITIAL_SIGMA: f64 = 0.01;
/// Standard deviation of the encoder's quantisation at 4096 steps per turn, rad: the minimum for a residual.
const QUANTISATION_SIGMA: f64 = 0.000_443;
/// Outlier threshold of the residuals, in standard deviations.
const OUTLIER_THRESHOLD: f64 = 4.0;
/// Bounds of the search for deviations, in prior standard deviations.
const SEARCH_RANGE: f64 = 4.0;
/// Prior standard deviation of the delay between a command and its measurement, s.
const DELAY_SIGMA: f64 = 0.01;
/// Half width of a secant in the search, in prior standard deviations.
const SECANT_STEP: f64 = 0.1;
/// Half width of a secant for intervals, in posterior standard deviations.
const SECANT_HALF_WIDTH: f64 = 2.0;
/// Bounds of that half width, in prior standard deviations.
const SECANT_BOUNDS: [f64; 2] = [0.02, 0.5];
/// Maximum number of steps of a search.
const MAX_STEPS: usize = 12;
/// Number of rounds of the search. Each round weights its residuals by those of the round before, which is correct for
/// the last round only.
const ROUND_COUNT: usize = 4;
/// Distance by which the rests of neighbouring joints are moved apart for another start, in prior standard deviations.
const START_OFFSET: f64 = 1.0;
/// Difference of every joint below which two postures of the arm count as one, rad.
const POSTURE_TOLERANCE: f64 = 0.05;

/// Result of the fit of one actuator.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorFit {
    /// Indices of the searched parameters in the instance.
    pub parameter_indices: Vec<usize>,
    /// Their deviations.
    pub deviations: Vec<f64>,
    /// Covariance of `deviations`.
    pub covariance: DMatrix<f64>,
    /// Delay between a command and its measurement, s.
    pub delay: f64,
    /// Root mean square residual of the servo angle, rad: with the nominal parameters, and with those fitted.
    pub residuals: [f64; 2],
    /// Correlation length of the residuals, in samples.
    pub correlation_length: f64,
    /// Number of samples.
    pub samples: usize,
    /// Number of motions.
    pub motions: usize,
}

/// Returns the indices of all parameters of `actuator` that a free motion may identify.
fn searched_parameters(individual: &RobotInstance, hand: &Hand, actuator: usize) -> Vec<usize> {
    let joints: Vec<usize> = match hand.transmission.cables.get(actuator) {
        Some(path) => path.joints.iter().map(|crossing| crossing.joint).collect(),
        None => hand.transmission.opposition.into_iter().collect(),
    };
    let own = |quantity| individual.parameter_index(quantity, actuator);
    let of_joints = |quantity| joints.iter().filter_map(move |joint| individual.parameter_index(quantity, *joint));
    let mut places: Vec<usize> = of_joints(Quantity::Spring).chain(of_joints(Quantity::SpringRest)).collect();
    places.extend(
        [Quantity::TorqueConstant, Quantity::ServoFriction, Quantity::ServoDamping].into_iter().filter_map(own),
    );
    if actuator < hand.cables.len() {
        let cable = [Quantity::SpoolRadius, Quantity::CableStiffness, Quantity::GuideFriction, Quantity::GuideTurn];
        places.extend(cable.into_iter().filter_map(own));
    }
    places
}

/// Returns the indices of parameters that influence a free motion of `actuator` but cannot be identified from it:
/// direction of gravity, and links on their stops.
fn unsearched_parameters(individual: &RobotInstance, hand: &Hand, actuator: usize) -> Vec<usize> {
    let cables = &hand.transmission.cables;
    // The opposition servo turns the thumb.
    let last = cables.get(actuator).unwrap_or(&cables[0]).joints.last();
    let carried = last.map_or_else(Vec::new, |crossing| hand.tree.chain(crossing.joint));
    let moves = |parameter: &PlantParameter| match parameter.quantity {
        Quantity::ArmEncoder | Quantity::MountTurn => true,
        Quantity::JointZero => carried.contains(&parameter.index),
        _ => false,
    };
    (0..individual.parameters().len()).filter(|place| moves(&individual.parameters()[*place])).collect()
}

/// A search over one actuator's motions.
struct MotionSearch<'a> {
    robot: &'a RobotModel,
    losses: CableLosses,
    motions: &'a [FreeMotion],
    places: &'a [usize],
    from: &'a RobotInstance,
}

impl MotionSearch<'_> {
    /// Returns the instance with deviations at `p`, in standard deviations from their means.
    fn robot_instance(&self, p: &[f64]) -> RobotInstance {
        let mut individual = self.from.clone();
        for (place, z) in self.places.iter().zip(p) {
            let spread = individual.parameters()[*place].prior.clone();
            let deviation = spread.mean + z * spread.sigma;
            // Friction only dissipates, so it cannot be negative.
            let friction = individual.parameters()[*place].quantity == Quantity::ServoFriction;
            individual.set(*place, if friction { deviation.max(0.0) } else { deviation });
        }
        individual
    }

    /// Returns the residuals of all samples, rad. The last element of `p` is the delay (s) in units of [`DELAY_SIGMA`].
    fn angles(&self, p: &[f64]) -> Vec<f64> {
        let hand = self.robot_instance(&p[..self.places.len()]).apply_to_hand(&self.robot.hand);
        let delay = p[self.places.len()] * DELAY_SIGMA;
        angle_residuals(&hand, self.losses, self.motions, delay)
    }

    /// Returns the change of the samples' residuals at `p` (rad) per prior standard deviation of the parameter at
    /// `place`, by a secant over `half` a standard deviation to either side.
    fn secant_change(&self, p: &[f64], place: usize, half: f64) -> Vec<f64> {
        let delay = p[self.places.len()] * DELAY_SIGMA;
        let moved = |way: f64| {
            let mut individual = self.robot_instance(&p[..self.places.len()]);
            let moved = individual.deviations()[place] + way * individual.parameters()[place].prior.sigma;
            individual.set(place, moved);
            let robot = individual.apply_to_robot(self.robot);
            let motions: Vec<FreeMotion> = self.motions.iter().map(|motion| motion.with_robot(&robot)).collect();
            angle_residuals(&robot.hand, self.losses, &motions, delay)
        };
        moved(half).iter().zip(moved(-half)).map(|(up, down)| (up - down) / (2.0 * half)).collect()
    }

    /// Returns the slopes of [`Self::residuals`] over secants with half widths `halves`.
    fn slopes(&self, p: &[f64], sigma: f64, halves: &[f64]) -> DMatrix<f64> {
        let column = |n: usize| {
            let moved = |way: f64| {
                let mut moved = p.to_vec();
                moved[n] += way;
                self.residuals(&moved, sigma)
            };
            let (up, down) = (moved(halves[n]), moved(-halves[n]));
            up.into_iter().zip(down).map(|(up, down)| (up - down) / (2.0 * halves[n])).collect::<Vec<f64>>()
        };
        let columns: Vec<f64> = (0..p.len()).flat_map(column).collect();
        DMatrix::from_vec(columns.len() / p.len(), p.len(), columns)
    }

    /// Returns the minimum near `start`.
    fn minimise(&self, start: &[f64], sigma: f64) -> FitResult {
        let bounds = vec![(-SEARCH_RANGE, SEARCH_RANGE); start.len()];
        let jacobian = |p: &[f64], _: &[f64]| self.slopes(p, sigma, &vec![SECANT_STEP; p.len()]);
        let problem =
            FitProblem { residuals: |p: &[f64]| self.residuals(p, sigma), jacobian, bounds, groups: Vec::new() };
        problem.minimise(start, &SolverOptions { max_steps: MAX_STEPS, scale: OUTLIER_THRESHOLD, tolerance: 1e-4 })
    }

    /// Returns the lowest of the minima near `start`, and near it with the rests of neighbouring joints moved apart.
    fn lowest_minimum(&self, start: &[f64], sigma: f64) -> Vec<f64> {
        let is_rest = |n: &usize| self.from.parameters()[self.places[*n]].quantity == Quantity::SpringRest;
        let rests: Vec<usize> = (0..self.places.len()).filter(is_rest).collect();
        let mut best = self.minimise(start, sigma);
        for pair in rests.windows(2) {
            for way in [START_OFFSET, -START_OFFSET] {
                let mut other = best.parameters.clone();
                other[pair[0]] += way;
                other[pair[1]] -= way;
                let other = self.minimise(&other, sigma);
                if other.cost < best.cost {
                    best = other;
                }
            }
        }
        best.parameters
    }

    fn residuals(&self, p: &[f64], sigma: f64) -> Vec<f64> {
        let mut residuals: Vec<f64> = self.angles(p).into_iter().map(|residual| residual / sigma).collect();
        residuals.extend_from_slice(p);
        residuals
    }
}

/// Iterates over the ticks of a motion that are samples. An encoder at rest has a constant quantisation error, so it
/// counts only once.
fn samples(motion: &FreeMotion) -> impl Iterator<Item = usize> + '_ {
    let angles = motion.measured();
    let mut last = f64::NAN;
    (0..angles.len()).step_by(TICKS_PER_SAMPLE).filter(move |n| std::mem::replace(&mut last, angles[*n]) != angles[*n])
}

/// Returns the residuals of the samples of `motions`: angle of the model of `hand` less the measured angle, rad.
fn angle_residuals(hand: &Hand, losses: CableLosses, motions: &[FreeMotion], delay: f64) -> Vec<f64> {
    let of = |motion: &FreeMotion| {
        let shown = simulate_motion(hand, losses, motion);
        samples(motion).map(|n| shown[n].servo - delay * shown[n].speed - motion.measured()[n]).collect::<Vec<f64>>()
    };
    motions.iter().flat_map(of).collect()
}

/// Fits the parameters of one actuator to its `motions`, with the instance `from` as the prior. `touches` gives the
/// uncertainty of arm, mount and links.
pub fn fit_actuator(
    robot: &RobotModel,
    losses: CableLosses,
    motions: &[FreeMotion],
    from: &RobotInstance,
    touches: &KinematicCalibration,
) -> ActuatorFit {
    let hand = &robot.hand;
    let actuator = motions.first().map_or(0, |motion| motion.actuator);
    let places = searched_parameters(from, hand, actuator);
    let search = MotionSearch { robot, losses, motions, places: &places, from };
    let n = places.len() + 1;
    let mut p = vec![0.0; n];
    let designed = rms(&angle_residuals(hand, losses, motions, 0.0));
    let (mut sigma, mut correlated, mut left) = (INITIAL_SIGMA, 1.0, Vec::new());
    for round in 0..ROUND_COUNT {
        p = match round {
            1 => search.lowest_minimum(&p, sigma),
            _ => search.minimise(&p, sigma).parameters,
        };
        left = search.angles(&p);
        correlated = series_correlation_length(&left);
        sigma = rms(&left).max(QUANTISATION_SIGMA) * correlated.sqrt();
    }
    let at: Vec<f64> = left.iter().map(|residual| residual / sigma).chain(p.iter().copied()).collect();
    let others = unsearched_parameters(from, hand, actuator);
    let root = touches.covariance_root(&others);
    let half = |deviation: f64| (SECANT_HALF_WIDTH * deviation).clamp(SECANT_BOUNDS[0], SECANT_BOUNDS[1]);
    let change = |(n, place): (usize, &usize)| search.secant_change(&p, *place, half(root.row(n).norm()));
    let changes: Vec<f64> = others.iter().enumerate().flat_map(change).collect();
    let changes = DMatrix::from_vec(left.len(), others.len(), changes) * root / sigma;
    let pieces = by_posture(motions, &at);
    let within = |halves: &[f64]| covariance(&search.slopes(&p, sigma, halves), &changes, &pieces);
    let first = within(&vec![SECANT_STEP; n]);
    let halves: Vec<f64> = first.diagonal().iter().map(|variance| half(variance.sqrt())).collect();
    let covariance = within(&halves);
    let found = search.robot_instance(&p[..places.len()]);
    let spread: Vec<f64> = places.iter().map(|place| from.parameters()[*place].prior.sigma).collect();
    ActuatorFit {
        deviations: places.iter().map(|place| found.deviations()[*place]).collect(),
        covariance: DMatrix::from_fn(n - 1, n - 1, |i, j| covariance[(i, j)] * spread[i] * spread[j]),
        delay: p[n - 1] * DELAY_SIGMA,
        residuals: [designed, rms(&left)],
        correlation_length: correlated,
        samples: left.len(),
        motions: motions.len(),
        parameter_indices: places,
    }
}

/// Groups the samples' residuals `at` into clusters, one for all motions in one posture of the arm.
fn by_posture(motions: &[FreeMotion], at: &[f64]) -> Vec<SampleCluster> {
    let mut pieces: Vec<(ArmVector, SampleCluster)> = Vec::new();
    let mut row = 0;
    for motion in motions {
        let shown = motion.arm[motion.lead_in];
        let near = |other: &[f64]| shown.iter().zip(other).all(|(a, b)| (a - b).abs() < POSTURE_TOLERANCE);
        let known = pieces.iter().position(|(other, _)| near(other));
        let piece = known.unwrap_or_else(|| {
            pieces.push((shown, Vec::new()));
            pieces.len() - 1
        });
        let samples = samples(motion).count();
        pieces[piece].1.extend((row..row + samples).map(|n| (n, at[n])));
        row += samples;
    }
    pieces.into_iter().map(|(_, piece)| piece).collect()
}

/// Returns the root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Returns the correlation length of a series in samples: the two-sided sum of its autocorrelation up to its first
/// value below 0.05.
fn series_correlation_length(series: &[f64]) -> f64 {
    let power: f64 = series.iter().map(|value| value * value).sum();
    if power <= 0.0 {
        return 1.0;
    }
    let at = |lag: usize| series.iter().zip(&series[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
    1.0 + 2.0 * (1..series.len() / 4).map(at).take_while(|share| *share > 0.05).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use hand_model::robot::ServoGoal;
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn neighbours_of_a_moving_average_are_alike_over_its_length() {
        use rand::{RngExt as _, SeedableRng as _};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let white: Vec<f64> = (0..20_000).map(|_| rng.random_range(-1.0..1.0)).collect();
        assert!(series_correlation_length(&white) < 1.2, "{}", series_correlation_length(&white));
        let mean: Vec<f64> = white.windows(8).map(|window| window.iter().sum()).collect();
        assert!((series_correlation_length(&mean) / 8.0 - 1.0).abs() < 0.15, "{}", series_correlation_length(&mean));
    }

    /// Returns a motion of the model of `hand` as measured by an encoder. The current rises and falls in `time` (s)
    /// each; `gravity` is in palm axes.
    fn shown(hand: &Hand, losses: CableLosses, actuator: usize, time: f64, gravity: Vector3<f64>) -> FreeMotion {
        let tick = 1.0 / 120.0;
        let ramp = (time / tick) as usize;
        let current = |n: usize| 0.07 * (n.min(2 * ramp - n.min(2 * ramp)) as f64 / ramp as f64);
        let goals: Vec<ServoGoal> =
            (0..2 * ramp).map(|n| ServoGoal::Current((1e3 * current(n)).round() / 1e3)).collect();
        let n = goals.len();
        let (arm, opposition, gravity) = (vec![[0.0; 7].into(); n], vec![0.0; n], vec![gravity; n]);
        let mut motion =
            FreeMotion { actuator, tick, lead_in: 0, goals, angles: vec![0.0; n], opposition, arm, gravity };
        let step = std::f64::consts::TAU / 4096.0;
        motion.angles =
            simulate_motion(hand, losses, &motion).iter().map(|shown| (shown.servo / step).round() * step).collect();
        motion
    }

    /// The joint that leaves its stop first is found, although the search starts with both leaving at the same time.
    #[test]
    fn springs_whose_rests_are_far_apart_are_found() {
        let robot = RobotModel::ftac_gen3();
        let hand = &robot.hand;
        let losses = CableLosses { friction: hand.parameters.cable.friction, backlash: 0.0 };
        let mut truth = RobotInstance::nominal(&robot);
        let rests = [4, 5].map(|joint| truth.parameter_index(Quantity::SpringRest, joint).unwrap());
        for (place, rest) in rests.into_iter().zip([0.06, -0.05]) {
            truth.set(place, rest);
        }
        let sides = [Vector3::new(0.0, 0.0, -9.8), Vector3::new(0.0, 0.0, 9.8)];
        let motions = sides.map(|gravity| shown(&truth.apply_to_hand(hand), losses, 1, 2.0, gravity));
        let designed = RobotInstance::nominal(&robot);
        // The arm of these motions is a placeholder.
        let touches = KinematicCalibration::from_prior(&designed);
        let found = fit_actuator(&robot, losses, &motions, &designed, &touches);
        for (place, rest) in rests.into_iter().zip([0.06, -0.05]) {
            let n = found.parameter_indices.iter().position(|searched| *searched == place).unwrap();
            assert!((found.deviations[n] - rest).abs() < 0.01, "{} {rest}", found.deviations[n]);
        }
    }
}
