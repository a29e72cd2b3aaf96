//! Payload calibration: gains of the arm's torque sensors, from a known weight.
//!
//! The difference of a joint's torque between a full and an empty hand, in the same posture, is its gain times the
//! torque of the weight. One scale gives all gains a common unit (drive gains by a known payload: Gautier and Briot
//! 2011). The weight's point of action is unknown. Its position in the hand is estimated too, and it may move slightly
//! from posture to posture, with the digits. The estimate is by least squares with priors.

use ftac_least_squares::{FitProblem, SolverOptions, forward_differences};
use hand_model::gravity::{ArmTorques, pack_torques};
use hand_model::robot::{ArmState, ServoGoal};
use hand_model::{ArmVector, GRAVITY, RobotModel};
use nalgebra::{DMatrix, DVector, Point3, Vector3};
use plant::RobotInstance;
use plant::prior::Quantity;

use crate::arm_load::{bears_load, gravity_torques as own_weight, holding_torques, palm_pose};
use crate::interval::IDENTIFIED_RATIO;
use crate::kinematic_calibration::KinematicCalibration;
use crate::payload::Payload;
use crate::tick_record::{PayloadRow, TickRecord};

/// Tolerance of the encoder angles for an arm at rest in a posture, rad.
const POSTURE_TOLERANCE: f64 = 0.01;
/// Minimum duration of a stand, as a share of the script's time.
const MIN_STAND_SHARE: f64 = 0.8;
/// Part of a stand that is evaluated, as shares of its duration: the arm settles before it, and starts moving after it.
const EVALUATED_SHARES: [f64; 2] = [0.5, 0.9];
/// Prior standard deviation of the weight's point of action about the palm's origin along each axis, m.
const ACTION_POINT_SIGMA: f64 = 0.06;
/// Standard deviation of that point's motion between postures along each axis, m: the object moves in its grip, and
/// empty digits hang differently.
const ACTION_POINT_MOTION_SIGMA: f64 = 0.003;
/// Minimum standard deviation of torques in one posture between repetitions, N m: joints settle slightly differently.
const MIN_TORQUE_SIGMA: f64 = 0.003;
/// Bounds of the search for deviations, in prior standard deviations.
const SEARCH_RANGE: f64 = 5.0;
/// Outlier threshold of the residuals, in standard deviations; so high that none is an outlier, because there is just
/// one residual per joint and posture.
const OUTLIER_THRESHOLD: f64 = 1e6;
/// Step of the finite differences, in prior standard deviations.
const FINITE_DIFFERENCE_STEP: f64 = 1e-3;

/// Torque sensor gains from payload calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueGains {
    /// Logarithm of each joint's gain.
    pub deviations: ArmVector,
    /// Covariance of `deviations`.
    pub covariance: DMatrix<f64>,
    /// Number of postures with the object in the hand.
    pub postures: usize,
    /// Root mean square residual of the weight's torques, N m: with the prior gains, and with those identified.
    pub residuals: [f64; 2],
}

impl TorqueGains {
    /// Returns the prior gains of an arm without payload calibration.
    pub fn from_prior(prior: &RobotInstance) -> Self {
        let spread = gain_priors(prior);
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

    /// True if the weight determines a joint's gain better than the prior.
    pub fn is_identified(&self, joint: usize, prior: &RobotInstance) -> bool {
        self.covariance[(joint, joint)].sqrt() < IDENTIFIED_RATIO * gain_priors(prior)[joint].1
    }
}

/// Returns mean and standard deviation of the logarithms of the gains among instances.
fn gain_priors(prior: &RobotInstance) -> ArmVector<(f64, f64)> {
    let gains = prior.parameters().iter().filter(|parameter| parameter.quantity == Quantity::ArmTorqueGain);
    gains.map(|parameter| (parameter.prior.mean, parameter.prior.sigma)).collect()
}

/// The arm at rest in one of the postures.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RestPosture {
    /// Index of the posture.
    posture: usize,
    /// True if digits were pulled closed.
    closed: bool,
    /// Mean measured state of the arm.
    shown: ArmState,
    /// Standard deviation of the torques, N m.
    scatter: ArmVector,
}

/// Returns the index of the posture of `weight` that the arm is in, if any.
fn posture_of(row: &TickRecord, weight: &Payload, ready: &ArmVector) -> Option<usize> {
    (0..weight.posture.len()).find(|n| {
        let at = weight.posture_joints(*n, ready);
        row.arm.position.iter().zip(at).all(|(shown, at)| (shown - at).abs() < POSTURE_TOLERANCE)
    })
}

/// Returns the pieces of a session in which the arm stands in one posture: first row, end row (exclusive), posture.
fn posture_segments(rows: &[TickRecord], weight: &Payload, ready: &ArmVector, tick: f64) -> Vec<(usize, usize, usize)> {
    let least = (MIN_STAND_SHARE * weight.hold / tick) as usize;
    let postures: Vec<Option<usize>> = rows.iter().map(|row| posture_of(row, weight, ready)).collect();
    let (mut found, mut at) = (Vec::new(), 0);
    for same in postures.chunk_by(|a, b| a == b) {
        let end = at + same.len();
        found.extend(same[0].filter(|_| same.len() >= least).map(|posture| (at, end, posture)));
        at = end;
    }
    found
}

/// Returns the first row in which the arm stands in a posture of `weight`.
pub fn first_stand_row(rows: &[TickRecord], weight: &Payload, ready: &ArmVector, tick: f64) -> Option<usize> {
    posture_segments(rows, weight, ready, tick).first().map(|(begin, ..)| *begin)
}

fn rest_postures(weighed: &PayloadRow, tick: f64) -> Vec<RestPosture> {
    let PayloadRow { payload: weight, ready, rows } = weighed;
    let of = |(begin, end, posture): (usize, usize, usize)| {
        let [from, to] = EVALUATED_SHARES.map(|share| begin + (share * (end - begin) as f64) as usize);
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
        let pulled = |row: &TickRecord| row.goals.iter().any(|goal| matches!(goal, ServoGoal::Current(_)));
        RestPosture {
            posture,
            closed: rested.iter().all(pulled),
            shown: ArmState { position: mean(|arm| arm.position), torque, ..ArmState::default() },
            scatter: (0..ready.len()).map(scatter).collect(),
        }
    };
    posture_segments(rows, weight, ready, tick).into_iter().map(of).collect()
}

/// A posture in which the arm stood with an empty hand and with the object in it.
#[derive(Debug, Clone, PartialEq)]
struct PosturePair {
    empty: ArmState,
    full: ArmState,
    /// Standard deviation of the torque difference, N m.
    sigma: ArmVector,
}

impl PosturePair {
    /// Returns all pairs of a session, according to the robot `own`. Of several stands in a posture with an empty hand,
    /// the last one is used.
    fn all_pairs(own: &RobotModel, weighed: &PayloadRow, tick: f64) -> Vec<Self> {
        let stands = rest_postures(weighed, tick);
        let pair = |full: &RestPosture| {
            let empty = stands.iter().rfind(|stand| !stand.closed && stand.posture == full.posture)?;
            let sigma = |joint: usize| {
                (full.scatter[joint].powi(2) + empty.scatter[joint].powi(2) + MIN_TORQUE_SIGMA * MIN_TORQUE_SIGMA)
                    .sqrt()
            };
            bears_load(own, [&empty.shown, &full.shown], weighed.payload.mass).then(|| Self {
                empty: empty.shown,
                full: full.shown,
                sigma: (0..full.scatter.len()).map(sigma).collect(),
            })
        };
        stands.iter().filter(|stand| stand.closed).filter_map(pair).collect()
    }

    /// Returns the increase of the joint torques with the object in the hand, N m.
    fn torque_increase(&self) -> ArmTorques {
        pack_torques(&self.full.torque) - pack_torques(&self.empty.torque)
    }
}

/// Joint torques of a posture, according to a robot model.
struct PostureTorques {
    /// Joint torques that hold a unit downward force, N m per N: at the palm's origin, and their change for each metre
    /// along the palm's axes.
    levers: [ArmTorques; 4],
    /// Difference of the torques of the robot's own weight between the two stands, N m.
    robot_torques: ArmTorques,
}

impl PostureTorques {
    fn for_pair(robot: &RobotModel, pair: &PosturePair) -> Self {
        let arm = &robot.arm;
        let poses = arm.tree.forward(&pair.full.position);
        let palm = palm_pose(robot, &pair.full.position);
        let at = |offset: Vector3<f64>| holding_torques(arm, &poses, &(palm * Point3::from(offset)), &-Vector3::z());
        let origin = at(Vector3::zeros());
        let along = |axis| at(Vector3::ith(axis, 1.0)) - origin;
        Self {
            levers: [origin, along(0), along(1), along(2)],
            robot_torques: own_weight(robot, &pair.full.position) - own_weight(robot, &pair.empty.position),
        }
    }

    /// Returns the increase of the joint torques under a mass (kg) whose weight acts at `middle` (m, palm frame), N m.
    fn load_torques(&self, mass: f64, middle: &Vector3<f64>) -> ArmTorques {
        let [origin, x, y, z] = &self.levers;
        self.robot_torques + (origin + x * middle.x + y * middle.y + z * middle.z) * (GRAVITY * mass)
    }
}

/// Search over, in this order: gains, mass, point of action of the weight, and its motion in each posture.
struct GainSearch<'a> {
    payload: &'a Payload,
    /// Mean and standard deviation of each gain's prior.
    priors: ArmVector<(f64, f64)>,
    pairs: &'a [PosturePair],
    postures: Vec<PostureTorques>,
}

impl<'a> GainSearch<'a> {
    fn new(own: &RobotModel, weight: &'a Payload, prior: &RobotInstance, pairs: &'a [PosturePair]) -> Self {
        let postures = pairs.iter().map(|pair| PostureTorques::for_pair(own, pair)).collect();
        Self { payload: weight, priors: gain_priors(prior), pairs, postures }
    }

    fn len(&self) -> usize {
        self.point_index(self.pairs.len())
    }

    /// Index of the mass in the parameters.
    fn mass_index(&self) -> usize {
        self.priors.len()
    }

    /// Index of the point's motion in posture `n` in the parameters.
    fn point_index(&self, n: usize) -> usize {
        self.mass_index() + 4 + 3 * n
    }

    /// Returns the residual torques of each pair, N m.
    fn torque_residuals(&self, p: &[f64]) -> Vec<ArmTorques> {
        let vector = |at: usize, sigma: f64| Vector3::new(p[at], p[at + 1], p[at + 2]) * sigma;
        let mass = self.payload.mass + p[self.mass_index()] * self.payload.mass_uncertain;
        let left = |(n, (pair, posture)): (usize, (&PosturePair, &PostureTorques))| {
            let middle = vector(self.mass_index() + 1, ACTION_POINT_SIGMA)
                + vector(self.point_index(n), ACTION_POINT_MOTION_SIGMA);
            let bears = posture.load_torques(mass, &middle);
            let gain = |joint: usize| (self.priors[joint].0 + p[joint] * self.priors[joint].1).exp();
            let shown: ArmVector = (0..self.priors.len()).map(|joint| gain(joint) * bears[joint]).collect();
            pair.torque_increase() - pack_torques(&shown)
        };
        self.pairs.iter().zip(&self.postures).enumerate().map(left).collect()
    }

    /// Returns the residuals, in standard deviations times `scale`, followed by those of the priors.
    fn residuals(&self, p: &[f64], scale: f64) -> Vec<f64> {
        let white = |(left, pair): (ArmTorques, &PosturePair)| {
            (0..self.priors.len()).map(|joint| left[joint] / (scale * pair.sigma[joint])).collect::<Vec<_>>()
        };
        self.torque_residuals(p).into_iter().zip(self.pairs).flat_map(white).chain(p.iter().copied()).collect()
    }

    fn jacobian(&self, p: &[f64], at: &[f64], scale: f64) -> DMatrix<f64> {
        let bounds = vec![(-SEARCH_RANGE, SEARCH_RANGE); p.len()];
        forward_differences(p, at, &bounds, FINITE_DIFFERENCE_STEP / (2.0 * SEARCH_RANGE), |q, _| {
            self.residuals(q, scale)
        })
    }

    fn minimum(&self, scale: f64) -> Vec<f64> {
        let bounds = vec![(-SEARCH_RANGE, SEARCH_RANGE); self.len()];
        let jacobian = |p: &[f64], at: &[f64]| self.jacobian(p, at, scale);
        let problem =
            FitProblem { residuals: |p: &[f64]| self.residuals(p, scale), jacobian, bounds, groups: Vec::new() };
        let start = vec![0.0; self.len()];
        problem.minimise(&start, &SolverOptions { max_steps: 30, scale: OUTLIER_THRESHOLD, tolerance: 1e-9 }).parameters
    }

    fn deviations(&self, p: &[f64]) -> ArmVector {
        self.priors.iter().zip(p).map(|((mean, sigma), p)| mean + p * sigma).collect()
    }

    fn rms(&self, p: &[f64]) -> f64 {
        let left = self.torque_residuals(p);
        let sum: f64 = left.iter().map(ArmTorques::norm_squared).sum();
        (sum / (self.priors.len() * left.len().max(1)) as f64).sqrt()
    }
}

/// Identifies the torque gains of the arm of `robot`, whose kinematics are known up to the covariance of `kinematics`.
/// Returns none if no object was in the hand.
pub fn identify_gains(
    robot: &RobotModel,
    kinematics: &KinematicCalibration,
    (weighed, tick): (&PayloadRow, f64),
) -> Option<TorqueGains> {
    let prior = &kinematics.robot_instance;
    let own = prior.apply_to_robot(robot);
    let pairs = PosturePair::all_pairs(&own, weighed, tick);
    if pairs.is_empty() {
        return None;
    }
    let search = GainSearch::new(&own, &weighed.payload, prior, &pairs);
    let mut p = search.minimum(1.0);
    // If the torques scatter more than assumed, their standard deviations are scaled: sum of squares, including the
    // priors', over the number of measurements.
    let squares: f64 = search.residuals(&p, 1.0).iter().map(|value| value * value).sum();
    let scale = (squares / (search.priors.len() * pairs.len()) as f64).sqrt().max(1.0);
    if scale > 1.0 {
        p = search.minimum(scale);
    }
    let n = search.len();
    let slopes = search.jacobian(&p, &search.residuals(&p, scale), scale);
    let scaled = slopes.tr_mul(&slopes).cholesky().map_or_else(|| DMatrix::identity(n, n), |root| root.inverse());
    let spread = search.priors;
    let joints = spread.len();
    let mut covariance = DMatrix::from_fn(joints, joints, |i, j| scaled[(i, j)] * spread[i].1 * spread[j].1);
    let deviations = search.deviations(&p);
    // Levers are only as certain as arm and mount, whose uncertainty is propagated.
    let moved = |place: usize, by: f64| {
        let mut other = prior.clone();
        other.set(place, prior.deviations()[place] + by);
        let own = other.apply_to_robot(robot);
        let search = GainSearch::new(&own, &weighed.payload, prior, &pairs);
        let found = search.deviations(&search.minimum(scale));
        DVector::from_fn(joints, |joint, _| (found[joint] - deviations[joint]) / by)
    };
    let known: Vec<(usize, DVector<f64>)> = (0..kinematics.parameter_indices.len())
        .filter(|n| {
            let quantity = prior.parameters()[kinematics.parameter_indices[*n]].quantity;
            matches!(quantity, Quantity::ArmEncoder | Quantity::MountPosition | Quantity::MountTurn)
        })
        .map(|n| (n, moved(kinematics.parameter_indices[n], kinematics.covariance[(n, n)].sqrt())))
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
    Some(TorqueGains { deviations, covariance, postures: pairs.len(), residuals: [drawn, search.rms(&p)] })
}

#[cfg(test)]
mod tests {
    use hand_model::robot::ServoState;

    use hand_model::Arm;

    use super::*;
    use crate::ExcitationScript;

    const TICK: f64 = 1.0 / 120.0;

    /// Returns a session in which an arm with these gains (logarithms) stands in every posture of the standard script,
    /// with an empty hand and then with a weight at `middle` (m, palm frame).
    fn session(deviations: &[f64], mass: f64, middle: &Vector3<f64>) -> PayloadRow {
        let robot = RobotModel::ftac_gen3();
        let RobotModel { hand, arm, .. } = &robot;
        let (weight, ready) = (
            ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid").payload.expect("a weight"),
            Arm::gen3().home,
        );
        let mut rows = Vec::new();
        for full in [false, true] {
            for n in 0..weight.posture.len() {
                let position = weight.posture_joints(n, &ready);
                let poses = arm.tree.forward(&position);
                let at = arm.tool_pose(&position) * hand.palm_from_flange.inverse() * Point3::from(*middle);
                let down = Vector3::z() * (-GRAVITY * mass);
                let load = if full { holding_torques(arm, &poses, &at, &down) } else { ArmTorques::zeros() };
                let bears = own_weight(&robot, &position) + load;
                let torque = std::array::from_fn(|joint| deviations[joint].exp() * bears[joint]);
                let goal = ServoGoal::Position { angle: 0.0, current_limit: 0.1 };
                let goal = if full { ServoGoal::Current(0.2) } else { goal };
                for _ in 0..(weight.hold / TICK) as usize {
                    rows.push(TickRecord {
                        time: rows.len() as f64 * TICK,
                        servos: [ServoState::default(); 6].into(),
                        arm: ArmState { position, torque: torque.into(), ..ArmState::default() },
                        goals: [goal; 6].into(),
                    });
                }
            }
        }
        PayloadRow { payload: weight, ready, rows }
    }

    fn found(weighed: &PayloadRow) -> Option<TorqueGains> {
        let robot = RobotModel::ftac_gen3();
        let known = KinematicCalibration::from_prior(&RobotInstance::nominal(&robot));
        identify_gains(&robot, &known, (weighed, TICK))
    }

    /// Gains are recovered for any point of action of the weight. The gain of joint 1, whose axis is vertical, keeps
    /// its prior value and is reported accordingly.
    #[test]
    fn gains_are_found_again() {
        let deviations = [0.04, -0.03, 0.05, 0.03, -0.04, 0.06, 0.01];
        let weighed = session(&deviations, 0.18, &Vector3::new(-0.02, 0.03, -0.04));
        let gains = found(&weighed).expect("gains");
        let prior = RobotInstance::nominal(&RobotModel::ftac_gen3());
        assert_eq!(gains.postures, weighed.payload.posture.len());
        assert!(gains.residuals[1] < 0.2 * gains.residuals[0] && gains.residuals[1] < 1e-3, "{:?}", gains.residuals);
        for (joint, (found, truth)) in gains.deviations.iter().zip(deviations).enumerate().skip(1) {
            let sigma = gains.covariance[(joint, joint)].sqrt();
            assert!((found - truth).abs() < 2.0 * sigma, "{joint}: {gains:?}");
        }
        assert!([1, 3].iter().all(|joint| gains.is_identified(*joint, &prior)), "{gains:?}");
        assert!(!gains.is_identified(0, &prior) && gains.deviations[0].abs() < 1e-6, "{gains:?}");
    }

    /// A relative error of the scale becomes the same relative error of every gain: the scale defines the unit of
    /// torque.
    #[test]
    fn the_unit_is_the_scales() {
        let mut weighed = session(&[0.0; 7], 0.18 * 0.03_f64.exp(), &Vector3::new(-0.02, 0.03, -0.04));
        let gains = found(&weighed).expect("gains");
        assert!((gains.deviations[1] - 0.03).abs() < 0.008, "{gains:?}");
        weighed.payload.mass_uncertain = 0.03 * weighed.payload.mass;
        let unsure = found(&weighed).expect("gains");
        assert!(unsure.covariance[(1, 1)] > 2.0 * gains.covariance[(1, 1)], "{unsure:?} {gains:?}");
    }

    /// An empty hand gives no result.
    #[test]
    fn an_empty_hand_shows_nothing() {
        assert_eq!(found(&session(&[0.02; 7], 0.0, &Vector3::zeros())), None);
    }
}
