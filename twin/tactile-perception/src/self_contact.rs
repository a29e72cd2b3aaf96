//! Self-contact: identifies contacts of the hand with itself, such as a finger on another, the thumb on a finger, a
//! finger on the palm.
//!
//! A patch is a self-contact under two conditions. At the posture from servos and pad forces, the cover of another link
//! lies at the patch and faces it, and no expected object explains the patch better. Distance and angle of each surface
//! to the patch are modelled as normal with its own standard deviations, and the likelier one counts as the cause. The
//! three joints of a digit share one cable, so that the posture of a digit in contact is known only to some
//! millimetres: see [`SelfContactOptions`].

use hand_model::Hand;
use nalgebra::{Isometry3, Point3, Vector3};

use crate::contacts::ContactPatch;
use crate::error::TouchError;
use crate::pad_touch::PadTouch;
use crate::pose::{KnownShape, PoseOptions, PosePrior, loaded_posture};
use crate::posture::Readings;

/// Number of points of a patch that are examined.
const MAX_POINTS: usize = 8;

/// Tolerances between a cover and a patch that it presses, given the uncertainty of the posture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfContactOptions {
    /// Largest distance of the cover's surface from the patch, m.
    pub max_distance: f64,
    /// Largest angle between the cover's surface and the patch's, rad.
    pub max_angle: f64,
    /// Standard deviation of the distance, m.
    pub sigma_distance: f64,
    /// Standard deviation of the angle, rad.
    pub sigma_angle: f64,
}

impl Default for SelfContactOptions {
    /// From 226 patches that only the hand pressed, in 40 trials of the benchmark. The distance of the cover was 1.1 mm
    /// in the median, 2.5 mm at the 90th percentile and 6.3 mm at the 95th; the angle was 0.37, 0.63 and 0.94 rad. Of
    /// 685 patches pressed by objects, one in ten had a cover within 10 mm, and hardly any of these faced the patch.
    fn default() -> Self {
        Self { max_distance: 0.006, max_angle: 0.8, sigma_distance: 0.002, sigma_angle: 0.4 }
    }
}

/// An object that is expected in the hand.
#[derive(Clone, Copy)]
pub struct ExpectedObject<'a> {
    /// Shape of the object.
    pub shape: &'a dyn KnownShape,
    /// Prior of its pose, with standard deviations.
    pub prior: PosePrior,
}

/// Distance and angle between a surface and a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SurfaceFit {
    /// Mean distance of the patch's points from the surface, m, negative inside.
    distance: f64,
    /// Mean angle between the surface's normals and the patch's, rad.
    angle: f64,
}

impl SurfaceFit {
    /// Fit of a surface, given by its signed `distance` with gradient, to the `points` of a patch with their normals.
    fn from_points(
        points: &[(Point3<f64>, Vector3<f64>)],
        distance: impl Fn(&Point3<f64>) -> (f64, Vector3<f64>),
    ) -> Self {
        let (mut sum, mut turned) = (0.0, 0.0);
        for (point, normal) in points {
            let (distance, outward) = distance(point);
            sum += distance;
            turned += outward.dot(normal).clamp(-1.0, 1.0).acos();
        }
        let count = points.len().max(1) as f64;
        Self { distance: sum / count, angle: turned / count }
    }

    /// Negative log-likelihood (up to a constant) under these standard deviations: one distance, two components of the angle.
    fn misfit(&self, distance: f64, angle: f64) -> f64 {
        let squares = (self.distance / distance).powi(2) + (self.angle / angle).powi(2);
        0.5 * squares + (distance * angle * angle).ln()
    }
}

/// Marks the patches that are explained by other links' covers rather than by `objects`.
pub fn mark_self_contacts(
    hand: &Hand,
    touches: &mut [PadTouch],
    readings: Readings,
    objects: &[ExpectedObject],
    (options, pose): (&SelfContactOptions, &PoseOptions),
) -> Result<(), TouchError> {
    if touches.iter().all(|touch| touch.patches.is_empty()) {
        return Ok(());
    }
    let links = hand.tree.forward(&loaded_posture(hand, touches, readings, pose)?);
    for touch in touches {
        let pad = &hand.pads[touch.pad];
        let place = pad.link.map_or(Isometry3::identity(), |link| links[link]) * pad.link_from_pad;
        for patch in &mut touch.patches {
            let points = sampled_points(patch, &place);
            let own = nearest_cover(hand, &links, pad.link, &points, options);
            let object = objects.iter().map(|object| object_misfit(object, &points, options));
            let object = object.fold(f64::INFINITY, f64::min);
            patch.self_contact = own.is_some_and(|own| own < object);
        }
    }
    Ok(())
}

/// Subsample of a patch's points and normals, in the palm frame.
fn sampled_points(patch: &ContactPatch, place: &Isometry3<f64>) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let stride = patch.points.len().div_ceil(MAX_POINTS).max(1);
    patch.points.iter().step_by(stride).map(|felt| (place * felt.point, place * felt.normal)).collect()
}

/// True if a joint connects these two links (`None` is the palm), so that their covers never touch.
fn neighbours(hand: &Hand, a: Option<usize>, b: Option<usize>) -> bool {
    let parent = |link: Option<usize>| link.map(|link| hand.tree.joints[link].parent);
    a == b || parent(a) == Some(b) || parent(b) == Some(a)
}

/// Misfit of the best-fitting cover for a patch on `link`; `None` if no cover is within the tolerances.
fn nearest_cover(
    hand: &Hand,
    links: &[Isometry3<f64>],
    link: Option<usize>,
    points: &[(Point3<f64>, Vector3<f64>)],
    options: &SelfContactOptions,
) -> Option<f64> {
    let others = std::iter::once(None).chain((0..links.len()).map(Some));
    let fits = others.filter(|other| !neighbours(hand, link, *other)).map(|other| {
        let (cover, pose) = match other {
            None => (&hand.palm_cover, Isometry3::identity()),
            Some(other) => (&hand.covers[other], links[other]),
        };
        SurfaceFit::from_points(points, |point| {
            let (distance, outward) = cover.signed_distance(&pose.inverse_transform_point(point));
            (distance, pose * outward)
        })
    });
    let near = fits.filter(|fit| fit.distance.abs() < options.max_distance && fit.angle < options.max_angle);
    near.map(|fit| fit.misfit(options.sigma_distance, options.sigma_angle)).reduce(f64::min)
}

/// Misfit of an object for a patch, in the units of [`nearest_cover`].
fn object_misfit(object: &ExpectedObject, points: &[(Point3<f64>, Vector3<f64>)], options: &SelfContactOptions) -> f64 {
    let PosePrior { palm_from_object, sigma_translation, sigma_rotation } = object.prior;
    let fit = SurfaceFit::from_points(points, |point| {
        let (distance, outward) = object.shape.signed_distance(&palm_from_object.inverse_transform_point(point));
        (distance, palm_from_object * outward)
    });
    fit.misfit(sigma_translation.hypot(options.sigma_distance), sigma_rotation.hypot(options.sigma_angle))
}
