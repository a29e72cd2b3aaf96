//! Kinematic calibration: the arm's encoders, the hand's mount and the links' stops, from touches of one fixed ball by pads.
//!
//! If a pad feels the ball's centre, forward kinematics give the position of that centre in the frame of the arm's
//! base. For the true robot, all touches give the same position. This is calibration by a single endpoint constraint
//! (Meggiolaro, Scriffignano and Dubowsky 2000), here with a sensor that measures where the end touches. The estimate
//! is by least squares over encoders, mount, stops and the ball's position, each with its prior.

use crate::script::OPPOSITION;
use control::inverse_kinematics::Joints;
use ftac_least_squares::{Options, Problem, forward_differences};
use hand_model::{Hand, RobotModel};
use nalgebra::{DMatrix, Isometry3, Matrix3, Point3, Vector3};
use plant::RobotIndividual;
use plant::spread::Quantity;
use tactile_optics::Foundation;

use crate::ball::Ball;
use crate::interval::TAUGHT;

/// Standard deviation of the unmodelled error of a touch, m: along the pad, and along its normal.
const UNEXPLAINED: [f64; 2] = [2e-4, 1e-4];
/// Standard deviation of the error common to all touches of a pad, m along each axis: its camera is displaced, its gel
/// differs in thickness.
const OF_PAD: [f64; 3] = [2e-4, 2.5e-4, 1.5e-4];
/// Standard deviation of the error common to all touches, m along each axis: the gel of all pads is of one batch.
const OF_HAND: [f64; 3] = [1e-4, 1e-4, 2e-4];
/// Standard deviation of the error common to all touches by links, m along each axis: a link swings onto its stop while
/// its cover already sticks to the ball, which shears the cover.
const OF_LINKS: [f64; 3] = [2e-4, 6e-4, 2e-4];
/// Greatest closing angle at which a joint's spring is at rest, rad: three standard deviations of the rest angle, and a
/// margin for the spring rate.
const CLOSED: f64 = 0.18;
/// Torque that the weight of the links adds, N m.
const WEIGHT: f64 = 0.004;
/// Outlier threshold of the residuals, in standard deviations.
const OUTLIER: f64 = 3.0;
/// Bounds of the search for deviations, in prior standard deviations.
const RANGE: f64 = 5.0;
/// Step of the finite differences, in prior standard deviations.
const STEP: f64 = 1e-3;

/// One touch of the ball by a pad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Index of the camera that saw it.
    pub camera: usize,
    /// Joint angles that the arm's encoders showed, rad.
    pub arm: Joints,
    /// Angle of the opposition servo, rad.
    pub opposition: f64,
    /// Centre of the ball in the pad frame, m.
    pub center: Point3<f64>,
    /// Covariance of `center`, m2.
    pub covariance: Matrix3<f64>,
}

impl Touch {
    /// Returns the penetration of the ball into the pad, m.
    pub fn depth(&self, hand: &Hand, ball: &Ball) -> f64 {
        let pad = &hand.pads[hand.cameras[self.camera].pad];
        let [x, y, z] = self.center.coords.data.0[0];
        pad.surface_height(x, y) + ball.radius - z
    }

    /// True if the touch pushes every link between palm and pad onto its stop. The contact force, from the gel's force
    /// law, must have a greater opening torque about each of their joints than the closing torque of any spring and the
    /// links' own weight.
    fn is_on_stops(&self, hand: &Hand, ball: &Ball) -> bool {
        let pad = &hand.pads[hand.cameras[self.camera].pad];
        let Some(link) = pad.link else { return true };
        let force = Foundation::winkler(&hand.gel()).ball_force(ball.radius, self.depth(hand, ball));
        let links = hand.tree.forward(&hand.open());
        let place = links[link] * pad.link_from_pad;
        let (point, push) = (place * self.center, place * Vector3::z() * -force);
        hand.tree.chain(link).into_iter().filter(|joint| Some(*joint) != hand.transmission.opposition).all(|joint| {
            let axis = links[joint].rotation * hand.tree.joints[joint].axis.into_inner();
            let opening = -axis.dot(&(point - links[joint] * Point3::origin()).cross(&push));
            opening > hand.transmission.springs[joint] * CLOSED + WEIGHT
        })
    }
}

/// Result of the kinematic calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicCalibration {
    /// Calibrated robot; parameters that were not searched are as in the individual from which the search began.
    pub individual: RobotIndividual,
    /// Places of the searched parameters in the individual.
    pub places: Vec<usize>,
    /// Covariance of their deviations.
    pub covariance: DMatrix<f64>,
    /// Centre of the ball in the frame of the arm's base, m.
    pub ball: Point3<f64>,
    /// All estimated values, as offsets from the prior means in prior standard deviations.
    found: Vec<f64>,
    /// Covariance of `found`.
    scaled: DMatrix<f64>,
    /// Root mean square distance between the ball's centre and the positions that the touches give, m: for the prior
    /// model with the ball at its best-fitting position, and for the calibrated robot.
    pub residuals: [f64; 2],
    pub touches: usize,
}

/// Returns the places of an individual's kinematic parameters.
pub fn searched(individual: &RobotIndividual) -> Vec<usize> {
    let kinematic = |quantity| {
        use Quantity::{ArmEncoder, JointZero, MountPosition, MountTurn};
        matches!(quantity, ArmEncoder | MountPosition | MountTurn | JointZero)
    };
    let parameters = individual.parameters();
    (0..parameters.len()).filter(|place| kinematic(parameters[*place].quantity)).collect()
}

/// Returns the centre of the ball that a pad feels, according to `robot`, in the frame of the arm's base, with the pose
/// of the pad.
fn felt_at(robot: &RobotModel, touch: &Touch) -> (Point3<f64>, Isometry3<f64>) {
    let RobotModel { hand, arm, .. } = robot;
    let pad = &hand.pads[hand.cameras[touch.camera].pad];
    let mut joints = hand.open();
    if let Some(joint) = hand.transmission.opposition {
        joints[joint] = (touch.opposition / hand.servos[OPPOSITION].gear_ratio_opposition).max(0.0);
    }
    let palm = arm.tool_pose(&touch.arm) * hand.palm_from_flange.inverse();
    let link = pad.link.map_or_else(Isometry3::identity, |link| hand.tree.forward(&joints)[link]);
    let pose = palm * link * pad.link_from_pad;
    (pose * touch.center, pose)
}

struct Search<'a> {
    robot: &'a RobotModel,
    ball: &'a Ball,
    from: &'a RobotIndividual,
    places: &'a [usize],
    touches: &'a [Touch],
}

impl Search<'_> {
    fn individual(&self, p: &[f64]) -> RobotIndividual {
        let mut individual = self.from.clone();
        for (place, z) in self.places.iter().zip(p) {
            let spread = &individual.parameters()[*place].spread;
            let deviation = spread.mean + z * spread.sigma;
            individual.set(*place, deviation);
        }
        individual
    }

    fn middle(&self, p: &[f64]) -> Point3<f64> {
        self.ball.middle() + self.ball.uncertain * self.vector(p, 0)
    }

    /// Returns the `n`-th vector after the individual's parameters: the ball's position, the error common to all
    /// touches, that of links, and that of each pad.
    fn vector(&self, p: &[f64], n: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| p[self.places.len() + 3 * n + axis])
    }

    /// Returns the number of searched values.
    fn len(&self) -> usize {
        self.places.len() + 3 * (3 + self.robot.hand.pads.len())
    }

    /// Returns the vector from the ball's centre to the centre that each touch gives, m, with its covariance, m2.
    fn distances(&self, p: &[f64]) -> Vec<(Vector3<f64>, Matrix3<f64>)> {
        let individual = self.individual(p);
        let (robot, middle) = (individual.robot(self.robot), self.middle(p));
        let of = |touch: &Touch| {
            let pad = self.robot.hand.cameras[touch.camera].pad;
            let alike = |n: usize, sigma: [f64; 3]| self.vector(p, n).component_mul(&Vector3::from(sigma));
            let of_links = self.robot.hand.pads[pad].link.map_or_else(Vector3::zeros, |_| alike(2, OF_LINKS));
            let alike = alike(1, OF_HAND) + of_links + alike(3 + pad, OF_PAD);
            let center = touch.center - alike;
            let (at, pose) = felt_at(&robot, &Touch { center, ..*touch });
            let turn = pose.rotation.to_rotation_matrix().into_inner();
            let [along, across] = UNEXPLAINED;
            let model = Matrix3::from_diagonal(&Vector3::new(along, along, across).map(|sigma| sigma * sigma));
            (at - middle, turn * (touch.covariance + model) * turn.transpose())
        };
        self.touches.iter().map(of).collect()
    }

    /// Returns the residuals, in standard deviations times `scale`, followed by those of the prior.
    fn residuals(&self, p: &[f64], scale: f64) -> Vec<f64> {
        let whitened = |(off, covariance): (Vector3<f64>, Matrix3<f64>)| {
            let white = covariance.cholesky().and_then(|root| root.l().solve_lower_triangular(&off));
            (white.unwrap_or(off / UNEXPLAINED[0]) / scale).data.0[0]
        };
        self.distances(p).into_iter().flat_map(whitened).chain(p.iter().copied()).collect()
    }

    fn jacobian(&self, p: &[f64], at: &[f64], scale: f64) -> DMatrix<f64> {
        let bounds = vec![(-RANGE, RANGE); p.len()];
        forward_differences(p, at, &bounds, STEP / (2.0 * RANGE), |q, _| self.residuals(q, scale))
    }
}

/// Returns the root mean square of the distances, m.
fn rms(distances: &[(Vector3<f64>, Matrix3<f64>)]) -> f64 {
    let sum: f64 = distances.iter().map(|(off, _)| off.norm_squared()).sum();
    (sum / distances.len().max(1) as f64).sqrt()
}

/// Calibrates the individual `from` of `robot` by its touches of a ball. Only touches that push the links onto their
/// stops are used. Without touches, the result is the prior.
pub fn calibrate(robot: &RobotModel, ball: &Ball, from: &RobotIndividual, touches: &[Touch]) -> KinematicCalibration {
    let hand = &robot.hand;
    let places = searched(from);
    let sure: Vec<Touch> = touches.iter().filter(|touch| touch.is_on_stops(hand, ball)).copied().collect();
    let touches = &sure[..];
    let search = Search { robot, ball, from, places: &places, touches };
    let n = search.len();
    let (mut p, mut scale) = (vec![0.0; n], 1.0);
    let prior = search.distances(&p);
    let center = prior.iter().fold(Vector3::zeros(), |sum, (off, _)| sum + off) / prior.len().max(1) as f64;
    let designed = rms(&prior.iter().map(|(off, covariance)| (off - center, *covariance)).collect::<Vec<_>>());
    for _ in 0..3 {
        let bounds = vec![(-RANGE, RANGE); n];
        let jacobian = |p: &[f64], at: &[f64]| search.jacobian(p, at, scale);
        let problem =
            Problem { residuals: |p: &[f64]| search.residuals(p, scale), jacobian, bounds, groups: Vec::new() };
        p = problem.minimise(&p, &Options { steps: 20, scale: OUTLIER, tolerance: 1e-6 }).parameters;
        let white = search.residuals(&p, 1.0);
        let mut squares: Vec<f64> = white[..3 * touches.len()].iter().map(|value| value * value).collect();
        squares.sort_by(f64::total_cmp);
        // For a normal distribution, the median square is 0.455 variances. No touch is trusted more than its covariance
        // allows.
        scale = squares.get(squares.len() / 2).map_or(1.0, |median| (median / 0.455).sqrt().max(1.0));
    }
    let slopes = search.jacobian(&p, &search.residuals(&p, scale), scale);
    let scaled = slopes.tr_mul(&slopes).cholesky().map_or_else(|| DMatrix::identity(n, n), |root| root.inverse());
    let spread: Vec<f64> = places.iter().map(|place| from.parameters()[*place].spread.sigma).collect();
    KinematicCalibration {
        individual: search.individual(&p),
        covariance: DMatrix::from_fn(places.len(), places.len(), |i, j| scaled[(i, j)] * spread[i] * spread[j]),
        ball: search.middle(&p),
        residuals: [designed, rms(&search.distances(&p))],
        touches: touches.len(),
        places,
        found: p,
        scaled,
    }
}

impl KinematicCalibration {
    /// Returns the calibration of a robot without touches: the prior.
    pub fn unknown(prior: &RobotIndividual) -> Self {
        let places = searched(prior);
        let n = places.len();
        let spread: Vec<f64> = places.iter().map(|place| prior.parameters()[*place].spread.sigma).collect();
        Self {
            individual: prior.clone(),
            covariance: DMatrix::from_fn(n, n, |i, j| if i == j { spread[i] * spread[j] } else { 0.0 }),
            ball: Point3::origin(),
            residuals: [f64::NAN; 2],
            touches: 0,
            found: vec![0.0; n],
            scaled: DMatrix::identity(n, n),
            places,
        }
    }

    /// Returns the standard deviation of where a pad will feel the ball along its normal, m, when the arm's encoders
    /// show `shown`. `robot` is the nominal model.
    pub fn along_normal(&self, robot: &RobotModel, ball: &Ball, camera: usize, shown: &Joints) -> f64 {
        let own = self.individual.robot(robot);
        let touch =
            Touch { camera, arm: *shown, opposition: 0.0, center: Point3::origin(), covariance: Matrix3::zeros() };
        let (_, pose) = felt_at(&own, &touch);
        let touches = [Touch { center: pose.inverse() * self.ball, ..touch }];
        let search = Search { robot, ball, from: &self.individual, places: &self.places, touches: &touches };
        let normal = pose * Vector3::z();
        let along = |p: &[f64]| search.distances(p)[0].0.dot(&normal);
        let at = along(&self.found);
        let slopes = DMatrix::from_fn(self.found.len(), 1, |i, _| {
            let mut moved = self.found.clone();
            moved[i] += STEP;
            (along(&moved) - at) / STEP
        });
        (slopes.tr_mul(&self.scaled) * &slopes)[(0, 0)].max(0.0).sqrt()
    }

    /// Returns a square root of the covariance of the parameters at these places of the individual, in prior standard
    /// deviations. Its columns are independent errors.
    pub fn root(&self, places: &[usize]) -> DMatrix<f64> {
        let own: Vec<Option<usize>> =
            places.iter().map(|place| self.places.iter().position(|known| known == place)).collect();
        let entry = |i: usize, j: usize| match (own[i], own[j]) {
            (Some(a), Some(b)) => self.scaled[(a, b)],
            _ => f64::from(u8::from(i == j)),
        };
        let covariance = DMatrix::from_fn(places.len(), places.len(), entry);
        covariance.cholesky().map_or_else(|| DMatrix::identity(places.len(), places.len()), |root| root.l())
    }

    /// True if the touches tell more about the parameter at `n` of [`Self::places`] than the prior.
    pub fn taught(&self, n: usize) -> bool {
        self.scaled[(n, n)].sqrt() < TAUGHT
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use hand_model::{Arm, ArmVector};

    use super::*;
    use crate::evaluation::{median, reach};
    use crate::script::Script;

    const DEPTH: f64 = 0.0015;

    /// Returns exact touches of a ball by `truth`, five for each camera, with the arm at random postures around its
    /// home posture.
    fn touched(truth: &RobotIndividual, ball: &Ball) -> (RobotModel, Vec<Touch>) {
        let robot = RobotModel::ftac_gen3();
        let (hand, own) = (&robot.hand, truth.robot(&robot));
        let middle = ball.middle() + Vector3::new(0.002, -0.001, 0.003);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let touches = (0..5 * hand.cameras.len()).map(|n| {
            let shown: ArmVector = Arm::gen3().home.iter().map(|angle| angle + rng.random_range(-0.6..0.6)).collect();
            let bare = Touch {
                camera: n % hand.cameras.len(),
                arm: shown,
                opposition: 0.0,
                center: Point3::new(0.0, 0.0, ball.radius - DEPTH),
                covariance: Matrix3::from_diagonal_element(1e-10),
            };
            // The ball stays in place wherever the arm carries the pad: a touch at a distance.
            let (_, pose) = felt_at(&own, &bare);
            Touch { center: pose.inverse() * middle, ..bare }
        });
        (robot.clone(), touches.collect())
    }

    /// Exact touches identify a robot to a fraction of a millimetre, and the position of the ball.
    #[test]
    fn exact_touches_show_the_robot() {
        let ball = Script::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball");
        let designed = RobotIndividual::designed(&RobotModel::ftac_gen3());
        let truth = RobotIndividual::draw(&RobotModel::ftac_gen3(), 9);
        let (robot, mut touches) = touched(&truth, &ball);
        let hand = &robot.hand;
        // A link that a touch does not push onto its stop tells nothing, so only the palm's touches are used.
        touches.retain(|touch| hand.pads[hand.cameras[touch.camera].pad].link.is_none());
        let found = calibrate(&robot, &ball, &designed, &touches);
        assert_eq!(found.touches, touches.len());
        assert!(found.residuals[1] < 0.1 * found.residuals[0], "{:?}", found.residuals);
        let error = |own| median(&reach(&truth, own, &robot, &Arm::gen3().home, 0.0));
        assert!(error(&found.individual) < 0.4 * error(&designed), "{} {}", error(&found.individual), error(&designed));
        for joint in 1..6 {
            let place = truth.place(Quantity::ArmEncoder, joint).expect("an encoder");
            let n = found.places.iter().position(|own| *own == place).expect("searched");
            assert!(found.taught(n), "{joint}");
            let off = found.individual.deviations()[place] - truth.deviations()[place];
            assert!(off.abs() < 4.0 * found.covariance[(n, n)].sqrt(), "{joint}: {off}");
        }
    }

    /// Without touches, everything keeps its prior value and spread.
    #[test]
    fn no_touches_say_nothing() {
        let ball = Script::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball");
        let designed = RobotIndividual::designed(&RobotModel::ftac_gen3());
        let found = calibrate(&RobotModel::ftac_gen3(), &ball, &designed, &[]);
        assert!((0..found.places.len()).all(|n| !found.taught(n)));
        assert!((found.ball - ball.middle()).norm() < 1e-12);
    }

    /// A pad pressed close to its link's joint does not open that joint: the link hangs on its spring.
    #[test]
    fn a_touch_near_a_joint_says_nothing_of_its_stop() {
        let (hand, ball) =
            (Hand::ftac(), Script::standard(&RobotModel::ftac_gen3()).expect("valid").ball.expect("a ball"));
        let camera = hand.cameras.iter().position(|camera| camera.name == "index_middle").expect("a camera");
        let touch = |y: f64, depth: f64| Touch {
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
