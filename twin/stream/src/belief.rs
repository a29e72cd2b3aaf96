//! What the robot believes and weighs, drawn: the ghost of an object with the ellipsoid of its place, which grey with age, and the
//! ways of what it holds.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rerun::components::FillMode;
use rerun::{Ellipsoids3D, LineStrips3D, Mesh3D, Points3D};

use crate::mesh::DrawnObject;
use crate::scene::drawn;

/// How far a ghost stands out, m.
const SHELL: f32 = 5.0e-4;
/// How transparent a ghost is drawn, the colour it tends to, and the one it has when it is old.
const GHOST: u8 = 110;
const FRESH: [f64; 3] = [60.0, 220.0, 255.0];
const STALE: [f64; 3] = [130.0, 134.0, 140.0];
/// A belief ages in steps of this time, s, and is grey after this many.
const AGE: (f64, u32) = (2.0, 5);
/// Standard deviations that an ellipsoid reaches.
const REACH: f64 = 2.0;
/// Smallest half axis that is drawn, m.
const SMALLEST: f64 = 2.0e-4;
/// Colour of ways.
pub const REJECTED: [u8; 3] = [255, 70, 60];
pub const CHOSEN: [u8; 3] = [80, 220, 110];

/// A way of an object in the hand.
#[derive(Debug, Clone, Default)]
pub struct Way {
    /// `world_from_object` along it; none: no way is shown.
    pub poses: Vec<Isometry3<f64>>,
    /// Where it comes nearest to what is to be taken, and the distance there, m; negative is a collision.
    pub nearest: Option<(Isometry3<f64>, f64)>,
}

/// When an object was felt, and how well its place is known.
#[derive(Debug, Clone)]
pub struct Felt {
    time: f64,
    /// Standard deviations along the axes, m, largest first.
    axes: [f64; 3],
    rotation: UnitQuaternion<f64>,
    step: u32,
}

impl Felt {
    /// Felt at `time` (s) with this covariance (m2).
    pub fn new(time: f64, covariance: &Matrix3<f64>) -> Self {
        let eigen = covariance.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let axes = order.map(|n| eigen.eigenvalues[n].max(0.0).sqrt());
        let [x, y] = [0, 1].map(|n| eigen.eigenvectors.column(order[n]).into_owned());
        let basis = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Self { time, axes, rotation: UnitQuaternion::from_rotation_matrix(&basis), step: 0 }
    }

    /// The step of its age at `time` (s), if it has changed.
    pub fn ages(&mut self, time: f64) -> Option<u32> {
        let step = (((time - self.time) / AGE.0).max(0.0) as u32).min(AGE.1);
        (std::mem::replace(&mut self.step, step) != step).then_some(step)
    }

    /// In words.
    fn words(&self, name: &str, time: f64) -> String {
        let [long, _, short] = self.axes.map(|axis| axis * 1e3);
        let age = time - self.time;
        let when = if age < 0.5 * AGE.0 { "felt now".to_owned() } else { format!("felt {age:.0} s ago") };
        format!("{name} {when}: s.d. {short:.1} to {long:.1} mm")
    }
}

fn faded(step: u32) -> [f64; 3] {
    let share = f64::from(step.min(AGE.1)) / f64::from(AGE.1);
    std::array::from_fn(|i| FRESH[i] + (STALE[i] - FRESH[i]) * share)
}

fn ghost_color(object: &DrawnObject, step: u32) -> [u8; 3] {
    let tint = faded(step);
    std::array::from_fn(|i| ((f64::from(object.color[i]) + 3.0 * tint[i]) / 4.0) as u8)
}

/// The ghost that stands for an estimated pose, `step` steps old: a shell a little larger, so that it is seen around the true object.
pub fn ghost(object: &DrawnObject, step: u32) -> Mesh3D {
    drawn(&object.mesh().grown(SHELL), ghost_color(object, step), GHOST)
}

/// The colour of a ghost that is there already.
pub fn tint(object: &DrawnObject, step: u32) -> Mesh3D {
    let [r, g, b] = ghost_color(object, step);
    Mesh3D::update_fields().with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, GHOST))
}

/// The ellipsoid of an object's place, in its frame.
pub fn ellipsoid(object: &DrawnObject, felt: &Felt, time: f64) -> Ellipsoids3D {
    let half = felt.axes.map(|axis| (REACH * axis).max(SMALLEST) as f32);
    let q = felt.rotation.coords.cast::<f32>();
    Ellipsoids3D::from_half_sizes([half])
        .with_quaternions([rerun::Quaternion::from_xyzw([q.x, q.y, q.z, q.w])])
        .with_fill_mode(FillMode::MajorWireframe)
        .with_line_radii([0.0004f32])
        .with_colors([faded(0).map(|part| part as u8)])
        .with_labels([felt.words(&object.name, time)])
        .with_show_labels(true)
}

/// Label and colour of an ellipsoid that is there already.
pub fn label(felt: &Felt, step: u32, time: f64) -> Ellipsoids3D {
    Ellipsoids3D::update_fields()
        .with_labels([felt.words("", time).trim_start().to_owned()])
        .with_colors([faded(step).map(|part| part as u8)])
}

/// The way of an object's origin.
pub fn way(poses: &[Isometry3<f64>], color: [u8; 3]) -> LineStrips3D {
    let points: Vec<[f32; 3]> = poses.iter().map(|pose| pose.translation.vector.cast::<f32>().into()).collect();
    LineStrips3D::new([points]).with_radii([0.0012f32]).with_colors([color])
}

/// An object where a way that was not taken comes nearest to its target.
pub fn collision(object: &DrawnObject) -> Mesh3D {
    drawn(&object.mesh(), REJECTED, GHOST)
}

/// How near that is, m.
pub fn distance(distance: f64) -> Points3D {
    let text = match distance < 0.0 {
        true => format!("not taken: would collide by {:.1} mm", -distance * 1e3),
        false => format!("not taken: passes at {:.1} mm", distance * 1e3),
    };
    Points3D::new([<[f32; 3]>::from(Vector3::<f32>::zeros())])
        .with_radii([0.001f32])
        .with_colors([REJECTED])
        .with_labels([text])
        .with_show_labels(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turned standard deviations of 3, 2 and 1 mm come out again, and the longest lies where it was put.
    #[test]
    fn an_ellipsoid_has_the_axes_of_its_covariance() {
        let turn = Rotation3::from_euler_angles(0.3, -0.5, 1.1);
        let squares = Vector3::new(1.0, 9.0, 4.0) * 1e-6;
        let covariance = turn.matrix() * Matrix3::from_diagonal(&squares) * turn.matrix().transpose();
        let felt = Felt::new(1.0, &covariance);
        for (axis, expected) in felt.axes.iter().zip([3e-3, 2e-3, 1e-3]) {
            assert!((axis - expected).abs() < 1e-9, "{:?}", felt.axes);
        }
        let longest = felt.rotation * Vector3::x();
        assert!(longest.dot(&(turn * Vector3::y())).abs() > 0.999);
    }

    #[test]
    fn beliefs_grey_with_age() {
        let mut felt = Felt::new(1.0, &Matrix3::identity());
        assert_eq!(felt.ages(1.5), None);
        assert_eq!(felt.ages(3.5), Some(1));
        assert_eq!((felt.ages(3.6), felt.ages(60.0), felt.ages(90.0)), (None, Some(5), None));
        assert_eq!(faded(0), FRESH);
        assert_eq!(faded(5), STALE);
    }
}
