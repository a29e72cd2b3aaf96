//! What the pads say, in the frames of the links that carry them, and how far each part of it is trusted.

use hand_model::Hand;
use nalgebra::{Isometry3, Point3, Vector3};

use super::system::evenly;
use crate::contacts::{Patch, SurfacePoint};
use crate::posture::Posture;

/// Points of a patch that are used.
const POINTS: usize = 14;
/// Normals of a patch that are used.
const NORMALS: usize = 4;
/// A patch that bears less than this force (N) has less say ...
const FULL_FORCE: f64 = 0.5;
/// ... but never less than this.
const LEAST_WEIGHT: f64 = 0.05;
/// Tilt of a felt normal at which a point is trusted half as much, rad: photometric stereo errs on steep flanks, and at the
/// rounded edges of a pad, part of the object presses where no camera looks.
const STEEP: f64 = 0.7;
/// A cable that pulls harder than a free digit at its excursion needs by this much (N) and this share is held up by something.
const HELD_UP: (f64, f64) = (0.8, 0.35);

/// A patch in the frame of the link that carries it (palm: the palm frame).
pub(super) struct LinkPatch {
    pub link: Option<usize>,
    /// Points, each with its trust: 1 where the gel is pressed squarely, less on flanks.
    pub points: Vec<(Point3<f64>, f64)>,
    pub normals: Vec<(Point3<f64>, Vector3<f64>, f64)>,
    /// Share of a full patch's say.
    pub weight: f64,
    pub centroid: Point3<f64>,
    /// Force on the pad, N.
    pub force: Vector3<f64>,
}

impl LinkPatch {
    /// A patch on a pad that sits at `place` on its link, its points moved by `lift` (m, pad frame).
    pub fn new(link: Option<usize>, place: &Isometry3<f64>, patch: &Patch, lift: &Vector3<f64>) -> Self {
        let point = |p: &SurfacePoint| place * (p.point + lift);
        let points = evenly(&patch.points, POINTS);
        let normals = evenly(&patch.points, NORMALS);
        Self {
            link,
            points: points.iter().map(|p| (point(p), trust(&p.normal))).collect(),
            normals: normals.iter().map(|p| (point(p), place * p.normal, trust(&p.normal))).collect(),
            weight: (patch.force / FULL_FORCE).clamp(LEAST_WEIGHT, 1.0),
            centroid: place * patch.centroid,
            force: place * (patch.normal * patch.force),
        }
    }
}

/// Points of a pad that feel nothing, in the frame of the link that carries it.
pub(super) struct ClearPad {
    pub link: Option<usize>,
    pub points: Vec<Point3<f64>>,
    /// A ball around them: an object farther away need not be asked point by point.
    pub middle: Point3<f64>,
    pub radius: f64,
}

impl ClearPad {
    pub fn new(link: Option<usize>, points: Vec<Point3<f64>>) -> Self {
        let middle = Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64);
        let radius = points.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
        Self { link, points, middle, radius }
    }
}

/// How far a point with this felt normal (pad frame) is trusted, at most 1.
fn trust(normal: &Vector3<f64>) -> f64 {
    let tilt = (-normal.z).clamp(-1.0, 1.0).acos();
    1.0 / (1.0 + (tilt / STEEP).powi(2))
}

/// Whether something keeps a digit from closing as far as its cable pulls.
pub(super) fn held_up(hand: &Hand, posture: &Posture, cable: usize) -> bool {
    let path = &hand.transmission.cables[cable];
    let joints = path.joints.iter().map(|(joint, guides)| {
        let arm = guides.moment_arm(posture.q[*joint]);
        (hand.transmission.springs[*joint] * posture.q[*joint], arm)
    });
    // The pull that balances the springs of a free digit, by the joints' moment arms.
    let (torque, arm) = joints.fold((0.0, 0.0), |(torque, arm), (t, a)| (torque + t * a, arm + a * a));
    let (needed, pull) = (torque / arm.max(1e-12), posture.tensions[cable]);
    pull > needed + HELD_UP.0 + HELD_UP.1 * needed
}
