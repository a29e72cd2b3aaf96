//! Kinematic calibration: the arm's encoders, the hand's mount and the links' stops, from touches of one fixed ball by
//! pads.
//!
//! A pad measures the ball's centre, and forward kinematics give the position of that centre in the frame of the arm's
//! base. For the true robot, all touches give the same position. This is calibration by a single endpoint constraint
//! (Meggiolaro, Scriffignano and Dubowsky 2000), here with a sensor that measures the position of the contact. The
//! estimate is by least squares over encoders, mount, stops and the ball's position, each with its prior.

use crate::script::OPPOSITION_ACTUATOR;
use control::inverse_kinematics::Joints;
use ftac_least_squares::{FitProblem, SolverOptions, forward_differences};
use hand_model::{Hand, RobotModel};
use nalgebra::{DMatrix, Isometry3, Matrix3, Point3, Vector3};
use plant::RobotInstance;
use plant::prior::Quantity;
use tactile_optics::GelFoundation;

use crate::ball::CalibrationBall;
use crate::interval::IDENTIFIED_RATIO;

/// Standard deviation of the unmodelled error of a touch, m: along the pad, and along its normal.
const UNMODELLED_SIGMA: [f64; 2] = [2e-4, 1e-4];
/// Standard deviation of the error common to all touches of a pad, m along each axis: displacement of its camera,
/// thickness of its gel.
const PAD_SIGMA: [f64; 3] = [2e-4, 2.5e-4, 1.5e-4];
/// Standard deviation of the error common to all touches, m along each axis: the gel of all pads is of one batch.
const COMMON_SIGMA: [f64; 3] = [1e-4, 1e-4, 2e-4];
/// Standard deviation of the error common to all touches by links, m along each axis: a link swings onto its stop while
/// its cover already sticks to the ball, which shears the cover.
const LINK_SIGMA: [f64; 3] = [2e-4, 6e-4, 2e-4];
/// Maximum closing angle at which a joint's spring is at rest, rad: three standard deviations of the rest angle, and a
/// margin for the spring rate.
const MAX_REST_ANGLE: f64 = 0.18;
/// Additional torque from the weight of the links, N m.
const LINK_WEIGHT_TORQUE: f64 = 0.004;
/// Outlier threshold of the residuals, in standard deviations.
const OUTLIER_THRESHOLD: f64 = 3.0;
/// Bounds of the search for deviations, in prior standard deviations.
const SEARCH_RANGE: f64 = 5.0;
/// Step of the finite differences, in prior standard deviations.
const FINITE_DIFFERENCE_STEP: f64 = 1e-3;

/// One touch of the ball by a pad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallTouch {
    /// Index of the camera that took it.
    pub camera: usize,
    /// Joint angles measured by the arm's encoders, rad.
    pub arm: Joints,
    /// Angle of the opposition servo, rad.
    pub opposition: f64,
    /// Centre of the ball in the pad frame, m.
    pub center: Point3<f64>,
    /// Covariance of `center`, m2.
    pub covariance: Matrix3<f64>,
}

impl BallTouch {
    /// Returns the penetration of the ball into the pad, m.
    pub fn depth(&self, hand: &Hand, ball: &CalibrationBall) -> f64 {
        let pad = &hand.pads[hand.cameras[self.camera].pad];
        let [x, y, z] = self.center.coords.data.0[0];
        pad.surface_height(x, y) + ball.radius - z
    }

    /// True if the touch pushes every link between palm and pad onto its stop. The contact force, from the gel's force
    /// law, must have a greater opening torque about each of their joints than the closing torque of any spring and the
    /// links' own weight.
    fn is_on_stops(&self, hand: &Hand, ball: &CalibrationBall) -> bool {
        let pad = &hand.pads[hand.cameras[self.camera].pad];
        let Some(link) = pad.link else { return true };
        let force = GelFoundation::winkler(&hand.gel()).ball_force(ball.radius, self.depth(hand, ball));
        let links = hand.tree.forward(&hand.open_angles());
        let place = links[link] * pad.link_from_pad;
        let (point, push) = (place * self.center, place * Vector3::z() * -force);
        hand.tree.chain(link).into_iter().filter(|joint| Some(*joint) != hand.transmission.opposition).all(|joint| {
            let axis = links[joint].rotation * hand.tree.joints[joint].axis.into_inner();
            let opening = -axis.dot(&(point - links[joint] * Point3::origin()).cross(&push));
            opening > hand.transmission.springs[joint] * MAX_REST_ANGLE + LINK_WEIGHT_TORQUE
        })
    }
}

/// Result of the kinematic calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicCalibration {
    /// Calibrated robot; parameters that were not searched are as in the instance at the start of the search.
    pub robot_instance: RobotInstance,
    /// Indices of the searched parameters in the instance.
    pub parameter_indices: Vec<usize>,
    /// Covariance of their deviations.
    pub covariance: DMatrix<f64>,
    /// Centre of the ball in the frame of the arm's base, m.
    pub ball: Point3<f64>,
    /// All estimated values, as offsets from the prior means in prior standard deviations.
    estimates: Vec<f64>,
    /// Covariance of `estimates`.
    estimate_covariance: DMatrix<f64>,
    /// Root mean square distance between the ball's centre and the positions from the touches, m: for the prior model
    /// with the ball at its best-fitting position, and for the calibrated robot.
    pub residuals: [f64; 2],
    pub touches: usize,
}

/// Returns the indices of an instance's kinematic parameters.
pub fn kinematic_parameters(instance: &RobotInstance) -> Vec<usize> {
    let kinematic = |quantity| {
        use Quantity::{ArmEncoder, JointZero, MountPosition, MountTurn};
        matches!(quantity, ArmEncoder | MountPosition | MountTurn | JointZero)
    };
    let parameters = instance.parameters();
    (0..parameters.len()).filter(|place| kinematic(parameters[*place].quantity)).collect()
}

/// Returns the centre of the ball that a pad measures, according to `robot`, in the frame of the arm's base, with the
/// pose of the pad.
fn felt_center(robot: &RobotModel, touch: &BallTouch) -> (Point3<f64>, Isometry3<f64>) {
    let RobotModel { hand, arm, .. } = robot;
    let pad = &hand.pads[hand.cameras[touch.camera].pad];
    let mut joints = hand.open_angles();
    if let Some(joint) = hand.transmission.opposition {
        joints[joint] = (touch.opposition / hand.servos[OPPOSITION_ACTUATOR].gear_ratio_opposition).max(0.0);
    }
    let palm = arm.tool_pose(&touch.arm) * hand.palm_from_flange.inverse();
    let link = pad.link.map_or_else(Isometry3::identity, |link| hand.tree.forward(&joints)[link]);
    let pose = palm * link * pad.link_from_pad;
    (pose * touch.center, pose)
}

struct CalibrationSearch<'a> {
    robot: &'a RobotModel,
    ball: &'a CalibrationBall,
    from: &'a RobotInstance,
    places: &'a [usize],
    touches: &'a [BallTouch],
}

impl CalibrationSearch<'_> {
    fn instance_at(&self, p: &[f64]) -> RobotInstance {
        let mut instance = self.from.clone();
        for (place, z) in self.places.iter().zip(p) {
            let spread = &instance.parameters()[*place].prior;
            let deviation = spread.mean + z * spread.sigma;
            instance.set(*place, deviation);
        }
        instance
    }

    fn ball_center(&self, p: &[f64]) -> Point3<f64> {
        self.ball.center() + self.ball.uncertain * self.vector(p, 0)
    }

    /// Returns the `n`-th vector after the instance's parameters: the ball's position, the error common to all touches,
    /// that of links, and that of each pad.
    fn vector(&self, p: &[f64], n: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| p[self.places.len() + 3 * n + axis])
    }

    /// Returns the number of searched values.
    fn len(&self) -> usize {
        self.places.len() + 3 * (3 + self.robot.hand.pads.len())
    }

    /// Returns the vector from the ball's centre to the centre from each touch, m, with its covariance, m2.
    fn distances(&self, p: &[f64]) -> Vec<(Vector3<f64>, Matrix3<f64>)> {
        let instance = self.instance_at(p);
        let (robot, middle) = (instance.apply_to_robot(self.robot), self.ball_center(p));
        let of = |touch: &BallTouch| {
            let pad = self.robot.hand.cameras[touch.camera].pad;
            let alike = |n: usize, sigma: [f64; 3]| self.vector(p, n).component_mul(&Vector3::from(sigma));
            let of_links = self.robot.hand.pads[pad].link.map_or_else(Vector3::zeros, |_| alike(2, LINK_SIGMA));
            let alike = alike(1, COMMON_SIGMA) + of_links + alike(3 + pad, PAD_SIGMA);
            let center = touch.center - alike;
            let (at, pose) = felt_center(&robot, &BallTouch { center, ..*touch });
            let turn = pose.rotation.to_rotation_matrix().into_inner();
            let [along, across] = UNMODELLED_SIGMA;
            let model = Matrix3::from_diagonal(&Vector3::new(along, along, across).map(|sigma| sigma * sigma));
            (at - middle, turn * (touch.covariance + model) * turn.transpose())
        };
        self.touches.iter().map(of).collect()
    }

    /// Returns the residuals, in standard deviations times `scale`, followed by those of the prior.
    fn residuals(&self, p: &[f64], scale: f64) -> Vec<f64> {
        let whitened = |(off, covariance): (Vector3<f64>, Matrix3<f64>)| {
            let white = covariance.cholesky().and_then(|root| root.l().solve_lower_triangular(&off));
            (white.unwrap_or(off / UNMODELLED_SIGMA[0]) / scale).data.0[0]
        };
        self.distances(p).into_iter().flat_map(whitened).chain(p.iter().copied()).collect()
    }

    fn jacobian(&self, p: &[f64], at: &[f64], scale: f64) -> DMatrix<f64> {
        let bounds = vec![(-SEARCH_RANGE, SEARCH_RANGE); p.len()];
        forward_differences(p, at, &bounds, FINITE_DIFFERENCE_STEP / (2.0 * SEARCH_RANGE), |q, _| {
            self.residuals(q, scale)
        })
    }
}

/// Returns the root mean square of the distances, m.
fn rms(distances: &[(Vector3<f64>, Matrix3<f64>)]) -> f64 {
    let sum: f64 = distances.iter().map(|(off, _)| off.norm_squared()).sum();
    (sum / distances.len().max(1) as f64).sqrt()
}

/// Calibrates the instance `from` of `robot` by its touches of a ball. Only touches that push the links onto their
/// stops are used. Without touches, the result is the prior.
pub fn calibrate(
    robot: &RobotModel,
    ball: &CalibrationBall,
    from: &RobotInstance,
    touches: &[BallTouch],
) -> KinematicCalibration {
    let hand = &robot.hand;
    let places = kinematic_parameters(from);
    let sure: Vec<BallTouch> = touches.iter().filter(|touch| touch.is_on_stops(hand, ball)).copied().collect();
    let touches = &sure[..];
    let search = CalibrationSearch { robot, ball, from, places: &places, touches };
    let n = search.len();
    let (mut p, mut scale) = (vec![0.0; n], 1.0);
    let prior = search.distances(&p);
    let center = prior.iter().fold(Vector3::zeros(), |sum, (off, _)| sum + off) / prior.len().max(1) as f64;
    let designed = rms(&prior.iter().map(|(off, covariance)| (off - center, *covariance)).collect::<Vec<_>>());
    for _ in 0..3 {
        let bounds = vec![(-SEARCH_RANGE, SEARCH_RANGE); n];
        let jacobian = |p: &[f64], at: &[f64]| search.jacobian(p, at, scale);
        let problem =
            FitProblem { residuals: |p: &[f64]| search.residuals(p, scale), jacobian, bounds, groups: Vec::new() };
        p = problem
            .minimise(&p, &SolverOptions { max_steps: 20, scale: OUTLIER_THRESHOLD, tolerance: 1e-6 })
            .parameters;
        let white = search.residuals(&p, 1.0);
        let mut squares: Vec<f64> = white[..3 * touches.len()].iter().map(|value| value * value).collect();
        squares.sort_by(f64::total_cmp);
        // For a normal distribution, the median square is 0.455 variances. No touch is trusted more than its covariance
        // allows.
        scale = squares.get(squares.len() / 2).map_or(1.0, |median| (median / 0.455).sqrt().max(1.0));
    }
    let slopes = search.jacobian(&p, &search.residuals(&p, scale), scale);
    let scaled = slopes.tr_mul(&slopes).cholesky().map_or_else(|| DMatrix::identity(n, n), |root| root.inverse());
    let spread: Vec<f64> = places.iter().map(|place| from.parameters()[*place].prior.sigma).collect();
    KinematicCalibration {
        robot_instance: search.instance_at(&p),
        covariance: DMatrix::from_fn(places.len(), places.len(), |i, j| scaled[(i, j)] * spread[i] * spread[j]),
        ball: search.ball_center(&p),
        residuals: [designed, rms(&search.distances(&p))],
        touches: touches.len(),
        parameter_indices: places,
        estimates: p,
        estimate_covariance: scaled,
    }
}

impl KinematicCalibration {
    /// Returns the calibration of a robot without touches: the prior.
    pub fn from_prior(prior: &RobotInstance) -> Self {
        let places = kinematic_parameters(prior);
        let n = places.len();
        let spread: Vec<f64> = places.iter().map(|place| prior.parameters()[*place].prior.sigma).collect();
        Self {
            robot_instance: prior.clone(),
            covariance: DMatrix::from_fn(n, n, |i, j| if i == j { spread[i] * spread[j] } else { 0.0 }),
            ball: Point3::origin(),
            residuals: [f64::NAN; 2],
            touches: 0,
            estimates: vec![0.0; n],
            estimate_covariance: DMatrix::identity(n, n),
            parameter_indices: places,
        }
    }

    /// Returns the standard deviation of the expected contact of a pad with the ball along its normal, m, at encoder
    /// angles `shown`. `robot` is the nominal model.
    pub fn normal_sigma(&self, robot: &RobotModel, ball: &CalibrationBall, camera: usize, shown: &Joints) -> f64 {
        let own = self.robot_instance.apply_to_robot(robot);
        let touch =
            BallTouch { camera, arm: *shown, opposition: 0.0, center: Point3::origin(), covariance: Matrix3::zeros() };
        let (_, pose) = felt_center(&own, &touch);
        let touches = [BallTouch { center: pose.inverse() * self.ball, ..touch }];
        let search = CalibrationSearch {
            robot,
            ball,
            from: &self.robot_instance,
            places: &self.parameter_indices,
            touches: &touches,
        };
        let normal = pose * Vector3::z();
        let along = |p: &[f64]| search.distances(p)[0].0.dot(&normal);
        let at = along(&self.estimates);
        let slopes = DMatrix::from_fn(self.estimates.len(), 1, |i, _| {
            let mut moved = self.estimates.clone();
            moved[i] += FINITE_DIFFERENCE_STEP;
            (along(&moved) - at) / FINITE_DIFFERENCE_STEP
        });
        (slopes.tr_mul(&self.estimate_covariance) * &slopes)[(0, 0)].max(0.0).sqrt()
    }

    /// Returns a square root of the covariance of the parameters at these indices of the instance, in prior standard
    /// deviations. Its columns are independent errors.
    pub fn covariance_root(&self, places: &[usize]) -> DMatrix<f64> {
        let own: Vec<Option<usize>> =
            places.iter().map(|place| self.parameter_indices.iter().position(|known| known == place)).collect();
        let entry = |i: usize, j: usize| match (own[i], own[j]) {
            (Some(a), Some(b)) => self.estimate_covariance[(a, b)],
            _ => f64::from(u8::from(i == j)),
        };
        let covariance = DMatrix::from_fn(places.len(), places.len(), entry);
        covariance.cholesky().map_or_else(|| DMatrix::identity(places.len(), places.len()), |root| root.l())
    }

    /// True if the touches determine the parameter at `n` of [`Self::parameter_indices`] better than the prior.
    pub fn is_identified(&self, n: usize) -> bool {
        self.estimate_covariance[(n, n)].sqrt() < IDENTIFIED_RATIO
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use hand_model::{Arm, ArmVector};

    use super::*;
    use crate::evaluation::{fingertip_distances, median};
    use crate::script::ExcitationScript;

    const DEPTH: f64 = 0.0015;

    /// Returns exact touches of a ball by `truth`, five for each camera, with the arm at random postures around its
    /// home posture.
    fn touched(truth: &RobotInstance, ball: &CalibrationBall) -> (RobotModel, Vec<BallTouch>) {
        let robot = RobotModel::ftac_gen3();
        let (hand, own) = (&robot.hand, truth.apply_to_robot(&robot));
        let middle = ball.center() + Vector3::new(0.002, -0.001, 0.003);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let touches = (0..5 * hand.cameras.len()).map(|n| {
            let shown: ArmVector = Arm::gen3().home.iter().map(|angle| angle + rng.random_range(-0.6..0.6)).collect();
            let bare = BallTouch {
                camera: n % hand.cameras.len(),
                arm: shown,
                opposition: 0.0,
                center: Point3::new(0.0, 0.0, ball.radius - DEPTH),
                covariance: Matrix3::from_diagonal_element(1e-10),
            };
            // The ball stays in place wherever the arm carries the pad: a touch at a distance.
            let (_, pose) = felt_center(&own, &bare);
            BallTouch { center: pose.inverse() * middle, ..bare }
        });
        (robot.clone(), touches.collect())
    }

    /// Exact touches identify a robot to a fraction of a millimetre, and the position of the ball.
    #[test]
    fn exact_touches_show_the_robot() {
        let ball = ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball");
        let designed = RobotInstance::nominal(&RobotModel::ftac_gen3());
        let truth = RobotInstance::sample(&RobotModel::ftac_gen3(), 9);
        let (robot, mut touches) = touched(&truth, &ball);
        let hand = &robot.hand;
        // A link that a touch does not push onto its stop is undetermined, so only the palm's touches are used.
        touches.retain(|touch| hand.pads[hand.cameras[touch.camera].pad].link.is_none());
        let found = calibrate(&robot, &ball, &designed, &touches);
        assert_eq!(found.touches, touches.len());
        assert!(found.residuals[1] < 0.1 * found.residuals[0], "{:?}", found.residuals);
        let error = |own| median(&fingertip_distances(&truth, own, &robot, &Arm::gen3().home, 0.0));
        assert!(
            error(&found.robot_instance) < 0.4 * error(&designed),
            "{} {}",
            error(&found.robot_instance),
            error(&designed)
        );
        for joint in 1..6 {
            let place = truth.parameter_index(Quantity::ArmEncoder, joint).expect("an encoder");
            let n = found.parameter_indices.iter().position(|own| *own == place).expect("searched");
            assert!(found.is_identified(n), "{joint}");
            let off = found.robot_instance.deviations()[place] - truth.deviations()[place];
            assert!(off.abs() < 4.0 * found.covariance[(n, n)].sqrt(), "{joint}: {off}");
        }
    }

    /// Without touches, everything keeps its prior mean and standard deviation.
    #[test]
    fn no_touches_say_nothing() {
        let ball = ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball");
        let designed = RobotInstance::nominal(&RobotModel::ftac_gen3());
        let found = calibrate(&RobotModel::ftac_gen3(), &ball, &designed, &[]);
        assert!((0..found.parameter_indices.len()).all(|n| !found.is_identified(n)));
        assert!((found.ball - ball.center()).norm() < 1e-12);
    }

    /// A pad pressed close to its link's joint does not open that joint: the link hangs on its spring.
    #[test]
    fn a_touch_near_a_joint_says_nothing_of_its_stop() {
        let (hand, ball) =
            (Hand::ftac(), ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball"));
        let camera = hand.cameras.iter().position(|camera| camera.name == "index_middle").expect("a camera");
        let touch = |y: f64, depth: f64| BallTouch {
            camera,
            arm: Arm::gen3().home,
            opposition: 0.0,
            center: Point3::new(0.0, y, ball.radius - depth),
            covariance: Matrix3::identity(),
        };
        assert!(touch(0.008, DEPTH).is_on_stops(&hand, &ball));
        assert!(!touch(0.008, 2e-4).is_on_stops(&hand, &ball), "hardly any force");
    }
}
