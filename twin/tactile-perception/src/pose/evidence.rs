//! Evidence of the pads in the frames of the links that carry them, with its standard deviations and weights.

use hand_model::transmission::Crossing;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

use hand_model::Hand;
use nalgebra::{Isometry3, Point3, Vector3};

use super::inputs::PoseOptions;
use super::system::evenly_spaced;
use crate::contacts::{ContactPatch, SurfacePoint};
use crate::pad_touch::PadTouch;
use crate::posture::Posture;

/// Largest number of points of a patch.
const MAX_POINTS: usize = 14;
/// Largest number of normals of a patch.
const MAX_NORMALS: usize = 4;
/// A patch with less than this force (N) has a lower weight.
const FULL_WEIGHT_FORCE: f64 = 0.5;
/// Least weight of a patch.
const MIN_WEIGHT: f64 = 0.05;
/// Tilt of a normal at which a point's trust is halved, rad: photometric stereo is inaccurate on steep flanks, and at a
/// pad's rounded edges part of the contact is out of the cameras' view.
const HALF_TRUST_TILT: f64 = 0.7;
/// Side of the squares of a pad whose free points are tested together, m.
const SPOT_SIDE: f64 = 8e-3;
/// A digit is obstructed if its cable's tension exceeds that of a free digit at the same excursion by this much (N) plus
/// this share.
const OBSTRUCTION_TENSION: (f64, f64) = (0.8, 0.35);

/// Product of the standard deviation of a patch's heights and the radius of the ball that would press as deep and as
/// wide, m2: narrow patches have steep flanks, on which photometric stereo is inaccurate.
const SIGMA_TIMES_RADIUS: f64 = 3e-7;
/// Largest standard deviation of a patch's heights, m.
const MAX_HEIGHT_SIGMA: f64 = 1.5e-3;

/// A felt point with its normal (palm frame) and weight.
pub(super) type ContactPoint = (Point3<f64>, Vector3<f64>, f64);

/// A patch in the frame of the link that carries it (palm: the palm frame).
pub(super) struct LinkPatch {
    pub link: Option<usize>,
    /// Index among the pressed pads.
    pub pressed: usize,
    /// Points with their trust: 1 where the surface is level, less on flanks.
    pub points: Vec<(Point3<f64>, f64)>,
    pub normals: Vec<(Point3<f64>, Vector3<f64>, f64)>,
    /// Weight, 1 for a patch with full force.
    pub weight: f64,
    /// Standard deviation of the common error of its heights, m.
    pub sigma: f64,
    pub centroid: Point3<f64>,
    /// Force on the pad, N.
    pub force: Vector3<f64>,
}

impl LinkPatch {
    /// A patch of a pad at `place` on its link; `sigma` (m) is the least standard deviation of its heights.
    pub(crate) fn new(
        link: Option<usize>,
        pressed: usize,
        place: &Isometry3<f64>,
        patch: &ContactPatch,
        sigma: f64,
    ) -> Self {
        let point = |p: &SurfacePoint| place * p.point;
        let points = evenly_spaced(&patch.points, MAX_POINTS);
        let normals = evenly_spaced(&patch.points, MAX_NORMALS);
        Self {
            link,
            pressed,
            points: points.iter().map(|p| (point(p), point_trust(&p.normal))).collect(),
            normals: normals.iter().map(|p| (point(p), place * p.normal, point_trust(&p.normal))).collect(),
            weight: (patch.force / FULL_WEIGHT_FORCE).clamp(MIN_WEIGHT, 1.0),
            sigma: height_sigma(patch, sigma),
            centroid: place * patch.centroid,
            force: place * (patch.normal * patch.force),
        }
    }
}

/// Self-contact of the hand, in the frame of the link that carries the pad. It loads joints and gives no evidence of an
/// object.
pub(super) struct SelfContact {
    pub link: Option<usize>,
    pub centroid: Point3<f64>,
    /// Force on the pad, N.
    pub force: Vector3<f64>,
}

impl SelfContact {
    /// A patch of a pad at `place` on its link.
    pub(crate) fn new(link: Option<usize>, place: &Isometry3<f64>, patch: &ContactPatch) -> Self {
        Self { link, centroid: place * patch.centroid, force: place * (patch.normal * patch.force) }
    }
}

/// Standard deviation of a patch's heights, m.
fn height_sigma(patch: &ContactPatch, sigma: f64) -> f64 {
    let radius = patch.area / (TAU * patch.peak.max(1e-6));
    sigma.hypot(SIGMA_TIMES_RADIUS / radius.max(1e-6)).min(MAX_HEIGHT_SIGMA)
}

pub(super) struct PressedPad {
    /// Normal of the pad in the frame of the link that carries it.
    pub normal: Vector3<f64>,
    /// Expected offset of the object outwards from the measured heights, m: see [`super::PoseOptions::penetration_share`].
    pub lift: f64,
    /// Standard deviation of `lift`, m.
    pub sigma: f64,
}

impl PressedPad {
    /// The pad at `place` on its link. The deepest of its accurately measured patches is taken to lie on the pad.
    pub(crate) fn new(place: &Isometry3<f64>, touch: &PadTouch, options: &PoseOptions) -> Self {
        let sigma = |patch: &&ContactPatch| height_sigma(patch, options.sigma_height);
        let best = touch.object_patches().map(|patch| sigma(&patch)).fold(f64::INFINITY, f64::min);
        let deepest =
            touch.object_patches().filter(|patch| sigma(patch) < 2.0 * best).max_by(|a, b| a.peak.total_cmp(&b.peak));
        let (peak, height) = deepest.map_or((0.0, 0.0), |patch| (patch.peak, sigma(&patch)));
        let stiff = 1.0 - options.penetration_share;
        Self { normal: place * Vector3::z(), lift: stiff * peak, sigma: options.sigma_lift.hypot(stiff * height) }
    }
}

/// Neighbouring points of a pad without contact, in the frame of the link that carries it.
pub(super) struct ContactFreeSpot {
    pub link: Option<usize>,
    /// Index among the pressed pads if the pad is pressed elsewhere.
    pub pressed: Option<usize>,
    pub points: Vec<Point3<f64>>,
    /// Bounding ball, for a quick test against objects farther away.
    pub middle: Point3<f64>,
    pub radius: f64,
}

impl ContactFreeSpot {
    /// The spots of a pad at `place` on its link, from all of its free points (pad frame).
    pub(crate) fn of_pad(
        link: Option<usize>,
        pressed: Option<usize>,
        place: &Isometry3<f64>,
        points: &[Point3<f64>],
    ) -> impl Iterator<Item = Self> {
        let mut tiles: BTreeMap<[i64; 2], Vec<Point3<f64>>> = BTreeMap::new();
        for point in points {
            let tile = [point.x, point.y].map(|at| (at / SPOT_SIDE).floor() as i64);
            tiles.entry(tile).or_default().push(place * point);
        }
        tiles.into_values().map(move |points| {
            let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
            let middle = Point3::from(sum / points.len() as f64);
            let radius = points.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
            Self { link, pressed, points, middle, radius }
        })
    }
}

/// Trust of a point with this normal (pad frame), at most 1.
fn point_trust(normal: &Vector3<f64>) -> f64 {
    let tilt = (-normal.z).clamp(-1.0, 1.0).acos();
    1.0 / (1.0 + (tilt / HALF_TRUST_TILT).powi(2))
}

/// True if something keeps a digit from closing as far as its cable tension would.
pub(super) fn obstructed(hand: &Hand, posture: &Posture, cable: usize) -> bool {
    let path = &hand.transmission.cables[cable];
    let joints = path.joints.iter().map(|Crossing { joint, lever, .. }| {
        let arm = lever.moment_arm(posture.q[*joint]);
        (hand.transmission.spring_torque(*joint, posture.q[*joint]), arm)
    });
    // The tension that balances the springs of a free digit, weighted by the joints' moment arms.
    let (torque, arm) = joints.fold((0.0, 0.0), |(torque, arm), (t, a)| (torque + t * a, arm + a * a));
    let (needed, pull) = (torque / arm.max(1e-12), posture.tensions[cable]);
    pull > needed + OBSTRUCTION_TENSION.0 + OBSTRUCTION_TENSION.1 * needed
}
