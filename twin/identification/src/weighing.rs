//! What the arm's torque sensors show of a known weight: their gains.
//!
//! By how much a joint's torque differs between a full and an empty hand, in the same posture, is its gain times the weight's lever. One
//! scale gives all gains a common unit (drive gains by a known payload: Gautier and Briot 2011). Where the object's weight acts is not known: its middle
//! is searched too, in the hand, and from posture to posture it may move a little, with the digits. Least squares with priors.

use hand_model::load::{Torques, torques};
use hand_model::robot::{ArmState, ServoGoal};
use hand_model::{ArmVector, GRAVITY, RobotModel};
use least_squares::{Options, Problem, forward_differences};
use nalgebra::{DMatrix, DVector, Point3, Vector3};
use plant::RobotIndividual;
use plant::spread::Quantity;

use crate::arm_load::{bears, held_by_last, palm, weight as own_weight};
use crate::interval::TAUGHT;
use crate::kinematic_calibration::KinematicCalibration;
use crate::row::{Row, Weighed};
use crate::weight::Weight;

/// The arm stands in a posture whose joints its encoders show within this, rad, ...
const THERE: f64 = 0.01;
/// ... for this share of the script's time at least.
const LONG: f64 = 0.8;
/// Of the time in which it stands this part counts, as shares of it: it comes to rest before, and sets off after.
const RESTED: [f64; 2] = [0.5, 0.9];
/// Spread of where the weight acts about the palm's origin along each axis, m: it is somewhere in the hand.
const SOMEWHERE: f64 = 0.06;
/// How far that moves from posture to posture along each axis, m: the object in its grip, and the digits, which hang otherwise when they are empty.
const MOVES: f64 = 0.003;
/// What torques in one posture err by at least from one time to another, N m: joints come to rest a little otherwise.
const REST: f64 = 0.003;
/// Deviations are searched within this many spreads.
const RANGE: f64 = 5.0;
/// No residual counts as an outlier, whatever its standard deviations: there is one for each joint in each posture.
const NO_OUTLIER: f64 = 1e6;
/// Step of the differences, in spreads.
const STEP: f64 = 1e-3;

/// What weighing shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// Logarithm of each joint's gain.
    pub deviations: ArmVector,
    /// Of these.
    pub covariance: DMatrix<f64>,
    /// In so many postures the object was in the hand.
    pub postures: usize,
    /// What the weight's torques leave unexplained, root mean square, N m: as drawn, and with what was found.
    pub residuals: [f64; 2],
}

impl Gains {
    /// Of an arm with which nothing was weighed.
    pub fn unknown(prior: &RobotIndividual) -> Self {
        let spread = spreads(prior);
        let variances = DMatrix::from_diagonal(&DVector::from_iterator(
            spread.len(),
            spread.iter().map(|(_, sigma)| sigma * sigma),
        ));
        Self {
            deviations: spread.iter().map(|(mean, _)| *mean).collect(),
            covariance: variances,
            postures: 0,
            residuals: [0.0; 2],
        }
    }

    /// Whether the weight says more of a joint's gain than the drawing did.
    pub fn taught(&self, joint: usize, prior: &RobotIndividual) -> bool {
        self.covariance[(joint, joint)].sqrt() < TAUGHT * spreads(prior)[joint].1
    }
}

/// Mean and standard deviation of the gains' logarithms among robots.
fn spreads(prior: &RobotIndividual) -> ArmVector<(f64, f64)> {
    let gains = prior.parameters().iter().filter(|parameter| parameter.quantity == Quantity::ArmTorqueGain);
    gains.map(|parameter| (parameter.spread.mean, parameter.spread.sigma)).collect()
}

/// The arm at rest in one of the postures.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stand {
    /// Of the posture.
    posture: usize,
    /// Whether digits were pulled closed.
    closed: bool,
    /// What it showed, on average.
    shown: ArmState,
    /// Standard deviation of the torques, N m.
    scatter: ArmVector,
}

/// Which posture of `weight` the arm is in, if it is in one.
fn posture_of(row: &Row, weight: &Weight, ready: &ArmVector) -> Option<usize> {
    (0..weight.posture.len()).find(|n| {
        let at = weight.stand(*n, ready);
        row.arm.position.iter().zip(at).all(|(shown, at)| (shown - at).abs() < THERE)
    })
}

/// Pieces of a session in which the arm stands in one posture: first row, row behind the last, posture.
fn pieces(rows: &[Row], weight: &Weight, ready: &ArmVector, tick: f64) -> Vec<(usize, usize, usize)> {
    let least = (LONG * weight.hold / tick) as usize;
    let postures: Vec<Option<usize>> = rows.iter().map(|row| posture_of(row, weight, ready)).collect();
    let (mut found, mut at) = (Vec::new(), 0);
    for same in postures.chunk_by(|a, b| a == b) {
        let end = at + same.len();
        found.extend(same[0].filter(|_| same.len() >= least).map(|posture| (at, end, posture)));
        at = end;
    }
    found
}

/// The first row in which the arm stands in a posture of `weight`.
pub fn begin(rows: &[Row], weight: &Weight, ready: &ArmVector, tick: f64) -> Option<usize> {
    pieces(rows, weight, ready, tick).first().map(|(begin, ..)| *begin)
}

fn stands(weighed: &Weighed, tick: f64) -> Vec<Stand> {
    let Weighed { weight, ready, rows } = weighed;
    let of = |(begin, end, posture): (usize, usize, usize)| {
        let [from, to] = RESTED.map(|share| begin + (share * (end - begin) as f64) as usize);
        let rested = &rows[from..to];
        let count = rested.len().max(1) as f64;
        let mean = |value: fn(&ArmState) -> ArmVector| -> ArmVector {
            let mean = |joint: usize| rested.iter().map(|row| value(&row.arm)[joint]).sum::<f64>() / count;
            (0..ready.len()).map(mean).collect()
        };
        let torque = mean(|arm| arm.torque);
        let scatter = |joint: usize| {
            let squares: f64 = rested.iter().map(|row| (row.arm.torque[joint] - torque[joint]).powi(2)).sum();
            (squares / count).sqrt()
        };
        let pulled = |row: &Row| row.goals.iter().any(|goal| matches!(goal, ServoGoal::Current(_)));
        Stand {
            posture,
            closed: rested.iter().all(pulled),
            shown: ArmState { position: mean(|arm| arm.position), torque, ..ArmState::default() },
            scatter: (0..ready.len()).map(scatter).collect(),
        }
    };
    pieces(rows, weight, ready, tick).into_iter().map(of).collect()
}

/// A posture in which the arm stood with an empty hand and with the object in it.
#[derive(Debug, Clone, PartialEq)]
struct Pair {
    empty: ArmState,
    full: ArmState,
    /// Standard deviation of the difference of their torques, N m.
    sigma: ArmVector,
}

impl Pair {
    /// All of a session, by a robot believed to be `own`. The latest of each posture with an empty hand counts.
    fn of(own: &RobotModel, weighed: &Weighed, tick: f64) -> Vec<Self> {
        let stands = stands(weighed, tick);
        let pair = |full: &Stand| {
            let empty = stands.iter().rfind(|stand| !stand.closed && stand.posture == full.posture)?;
            let sigma =
                |joint: usize| (full.scatter[joint].powi(2) + empty.scatter[joint].powi(2) + REST * REST).sqrt();
            bears(own, [&empty.shown, &full.shown], weighed.weight.mass).then(|| Self {
                empty: empty.shown,
                full: full.shown,
                sigma: (0..full.scatter.len()).map(sigma).collect(),
            })
        };
        stands.iter().filter(|stand| stand.closed).filter_map(pair).collect()
    }

    /// By how much the joints bear more with the object in the hand, N m.
    fn more(&self) -> Torques {
        torques(&self.full.torque) - torques(&self.empty.torque)
    }
}

/// A posture as a robot believed to be one has it.
struct Posture {
    /// What holds a unit of force down at the palm's origin, N m over N, and for each metre along the palm's axes from there.
    levers: [Torques; 4],
    /// By how much the robot's own weight differs between the two times, N m.
    own: Torques,
}

impl Posture {
    fn of(robot: &RobotModel, pair: &Pair) -> Self {
        let arm = &robot.arm;
        let poses = arm.tree.forward(&pair.full.position);
        let palm = palm(robot, &pair.full.position);
        let at = |offset: Vector3<f64>| held_by_last(arm, &poses, &(palm * Point3::from(offset)), &-Vector3::z());
        let origin = at(Vector3::zeros());
        let along = |axis| at(Vector3::ith(axis, 1.0)) - origin;
        Self {
            levers: [origin, along(0), along(1), along(2)],
            own: own_weight(robot, &pair.full.position) - own_weight(robot, &pair.empty.position),
        }
    }

    /// What the joints bear more under a mass (kg) whose weight acts at `middle` (m, palm frame), N m.
    fn bears(&self, mass: f64, middle: &Vector3<f64>) -> Torques {
        let [origin, x, y, z] = &self.levers;
        self.own + (origin + x * middle.x + y * middle.y + z * middle.z) * (GRAVITY * mass)
    }
}

/// A search over, in this order: gains, the mass, the middle, and where that moves to in each posture.
struct Search<'a> {
    weight: &'a Weight,
    /// Of the gains.
    spread: ArmVector<(f64, f64)>,
    pairs: &'a [Pair],
    postures: Vec<Posture>,
}

impl<'a> Search<'a> {
    fn new(own: &RobotModel, weight: &'a Weight, prior: &RobotIndividual, pairs: &'a [Pair]) -> Self {
        let postures = pairs.iter().map(|pair| Posture::of(own, pair)).collect();
        Self { weight, spread: spreads(prior), pairs, postures }
    }

    fn len(&self) -> usize {
        self.moved(self.pairs.len())
    }

    /// Place of the mass.
    fn mass(&self) -> usize {
        self.spread.len()
    }

    /// Place of where the middle moves to in posture `n`.
    fn moved(&self, n: usize) -> usize {
        self.mass() + 4 + 3 * n
    }

    /// What is left of each pair, N m.
    fn left(&self, p: &[f64]) -> Vec<Torques> {
        let vector = |at: usize, sigma: f64| Vector3::new(p[at], p[at + 1], p[at + 2]) * sigma;
        let mass = self.weight.mass + p[self.mass()] * self.weight.mass_uncertain;
        let left = |(n, (pair, posture)): (usize, (&Pair, &Posture))| {
            let middle = vector(self.mass() + 1, SOMEWHERE) + vector(self.moved(n), MOVES);
            let bears = posture.bears(mass, &middle);
            let gain = |joint: usize| (self.spread[joint].0 + p[joint] * self.spread[joint].1).exp();
            let shown: ArmVector = (0..self.spread.len()).map(|joint| gain(joint) * bears[joint]).collect();
            pair.more() - torques(&shown)
        };
        self.pairs.iter().zip(&self.postures).enumerate().map(left).collect()
    }

    /// In standard deviations times `scale`, and the priors'.
    fn residuals(&self, p: &[f64], scale: f64) -> Vec<f64> {
        let white = |(left, pair): (Torques, &Pair)| {
            (0..self.spread.len()).map(|joint| left[joint] / (scale * pair.sigma[joint])).collect::<Vec<_>>()
        };
        self.left(p).into_iter().zip(self.pairs).flat_map(white).chain(p.iter().copied()).collect()
    }

    fn jacobian(&self, p: &[f64], at: &[f64], scale: f64) -> DMatrix<f64> {
        let bounds = vec![(-RANGE, RANGE); p.len()];
        forward_differences(p, at, &bounds, STEP / (2.0 * RANGE), |q, _| self.residuals(q, scale))
    }

    fn minimum(&self, scale: f64) -> Vec<f64> {
        let bounds = vec![(-RANGE, RANGE); self.len()];
        let jacobian = |p: &[f64], at: &[f64]| self.jacobian(p, at, scale);
        let problem = Problem { residuals: |p: &[f64]| self.residuals(p, scale), jacobian, bounds, groups: Vec::new() };
        let start = vec![0.0; self.len()];
        problem.minimise(&start, &Options { steps: 30, scale: NO_OUTLIER, tolerance: 1e-9 }).parameters
    }

    fn deviations(&self, p: &[f64]) -> ArmVector {
        self.spread.iter().zip(p).map(|((mean, sigma), p)| mean + p * sigma).collect()
    }

    fn rms(&self, p: &[f64]) -> f64 {
        let left = self.left(p);
        let sum: f64 = left.iter().map(Torques::norm_squared).sum();
        (sum / (self.spread.len() * left.len().max(1)) as f64).sqrt()
    }
}

/// The gains of the arm of a robot built from `hand` and `arm` whose kinematics are known as far as `kinematics` says. None where no
/// object was in the hand.
pub fn weigh(robot: &RobotModel, kinematics: &KinematicCalibration, (weighed, tick): (&Weighed, f64)) -> Option<Gains> {
    let prior = &kinematics.individual;
    let own = prior.robot(robot);
    let pairs = Pair::of(&own, weighed, tick);
    if pairs.is_empty() {
        return None;
    }
    let search = Search::new(&own, &weighed.weight, prior, &pairs);
    let mut p = search.minimum(1.0);
    // Torques that scatter more than was thought are known less surely: their own square sums, and those of the priors, over what is measured.
    let squares: f64 = search.residuals(&p, 1.0).iter().map(|value| value * value).sum();
    let scale = (squares / (search.spread.len() * pairs.len()) as f64).sqrt().max(1.0);
    if scale > 1.0 {
        p = search.minimum(scale);
    }
    let n = search.len();
    let slopes = search.jacobian(&p, &search.residuals(&p, scale), scale);
    let scaled = slopes.tr_mul(&slopes).cholesky().map_or_else(|| DMatrix::identity(n, n), |root| root.inverse());
    let spread = search.spread;
    let joints = spread.len();
    let mut covariance = DMatrix::from_fn(joints, joints, |i, j| scaled[(i, j)] * spread[i].1 * spread[j].1);
    let deviations = search.deviations(&p);
    // Levers are known as surely as arm and mount: what that moves counts as well.
    let moved = |place: usize, by: f64| {
        let mut other = prior.clone();
        other.set(place, prior.deviations()[place] + by);
        let own = other.robot(robot);
        let search = Search::new(&own, &weighed.weight, prior, &pairs);
        let found = search.deviations(&search.minimum(scale));
        DVector::from_fn(joints, |joint, _| (found[joint] - deviations[joint]) / by)
    };
    let known: Vec<(usize, DVector<f64>)> = (0..kinematics.places.len())
        .filter(|n| {
            let quantity = prior.parameters()[kinematics.places[*n]].quantity;
            matches!(quantity, Quantity::ArmEncoder | Quantity::MountPosition | Quantity::MountTurn)
        })
        .map(|n| (n, moved(kinematics.places[n], kinematics.covariance[(n, n)].sqrt())))
        .collect();
    for (a, slope) in &known {
        for (b, other) in &known {
            covariance += slope * other.transpose() * kinematics.covariance[(*a, *b)];
        }
    }
    let drawn = {
        let mut at = p.clone();
        at[..joints].fill(0.0);
        search.rms(&at)
    };
    Some(Gains { deviations, covariance, postures: pairs.len(), residuals: [drawn, search.rms(&p)] })
}

#[cfg(test)]
mod tests {
    use hand_model::robot::ServoState;

    use hand_model::Arm;

    use super::*;
    use crate::Script;

    const TICK: f64 = 1.0 / 120.0;

    /// A session in which an arm of these gains (logarithms) stands in every posture of the standard script, with an empty hand and then with a
    /// weight at `middle` (m, palm frame).
    fn session(deviations: &[f64], mass: f64, middle: &Vector3<f64>) -> Weighed {
        let robot = RobotModel::ftac_gen3();
        let RobotModel { hand, arm, .. } = &robot;
        let (weight, ready) =
            (Script::standard(&RobotModel::ftac_gen3()).expect("valid").weight.expect("a weight"), Arm::gen3().home);
        let mut rows = Vec::new();
        for full in [false, true] {
            for n in 0..weight.posture.len() {
                let position = weight.stand(n, &ready);
                let poses = arm.tree.forward(&position);
                let at = arm.tool_pose(&position) * hand.palm_from_flange.inverse() * Point3::from(*middle);
                let down = Vector3::z() * (-GRAVITY * mass);
                let load = if full { held_by_last(arm, &poses, &at, &down) } else { Torques::zeros() };
                let bears = own_weight(&robot, &position) + load;
                let torque = std::array::from_fn(|joint| deviations[joint].exp() * bears[joint]);
                let goal = ServoGoal::Position { angle: 0.0, current_limit: 0.1 };
                let goal = if full { ServoGoal::Current(0.2) } else { goal };
                for _ in 0..(weight.hold / TICK) as usize {
                    rows.push(Row {
                        time: rows.len() as f64 * TICK,
                        servos: [ServoState::default(); 6].into(),
                        arm: ArmState { position, torque: torque.into(), ..ArmState::default() },
                        goals: [goal; 6].into(),
                    });
                }
            }
        }
        Weighed { weight, ready, rows }
    }

    fn found(weighed: &Weighed) -> Option<Gains> {
        let robot = RobotModel::ftac_gen3();
        let known = KinematicCalibration::unknown(&RobotIndividual::designed(&robot));
        weigh(&robot, &known, (weighed, TICK))
    }

    /// Gains are found again wherever in the hand the weight acts; that of joint 1, whose axis is upright, stays as drawn and is said to.
    #[test]
    fn gains_are_found_again() {
        let deviations = [0.04, -0.03, 0.05, 0.03, -0.04, 0.06, 0.01];
        let weighed = session(&deviations, 0.18, &Vector3::new(-0.02, 0.03, -0.04));
        let gains = found(&weighed).expect("gains");
        let prior = RobotIndividual::designed(&RobotModel::ftac_gen3());
        assert_eq!(gains.postures, weighed.weight.posture.len());
        assert!(gains.residuals[1] < 0.2 * gains.residuals[0] && gains.residuals[1] < 1e-3, "{:?}", gains.residuals);
        for (joint, (found, truth)) in gains.deviations.iter().zip(deviations).enumerate().skip(1) {
            let sigma = gains.covariance[(joint, joint)].sqrt();
            assert!((found - truth).abs() < 2.0 * sigma, "{joint}: {gains:?}");
        }
        assert!([1, 3].iter().all(|joint| gains.taught(*joint, &prior)), "{gains:?}");
        assert!(!gains.taught(0, &prior) && gains.deviations[0].abs() < 1e-6, "{gains:?}");
    }

    /// A scale that is wrong by so much makes every gain that it shows wrong by as much: the unit of torque is the scale's.
    #[test]
    fn the_unit_is_the_scales() {
        let mut weighed = session(&[0.0; 7], 0.18 * 0.03_f64.exp(), &Vector3::new(-0.02, 0.03, -0.04));
        let gains = found(&weighed).expect("gains");
        assert!((gains.deviations[1] - 0.03).abs() < 0.008, "{gains:?}");
        weighed.weight.mass_uncertain = 0.03 * weighed.weight.mass;
        let unsure = found(&weighed).expect("gains");
        assert!(unsure.covariance[(1, 1)] > 2.0 * gains.covariance[(1, 1)], "{unsure:?} {gains:?}");
    }

    /// Nothing in the hand shows nothing.
    #[test]
    fn an_empty_hand_shows_nothing() {
        assert_eq!(found(&session(&[0.02; 7], 0.0, &Vector3::zeros())), None);
    }
}
