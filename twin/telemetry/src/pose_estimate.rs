//! Drawing of pose estimates: a ghost at each one with the ellipsoid of its position covariance, both fading to grey
//! with age, and the trajectories of the held object that a decision compared.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rerun::components::FillMode;
use rerun::{Ellipsoids3D, LineStrips3D, Mesh3D, Points3D};

use crate::mesh::DrawnObject;
use crate::scene::colored_mesh;

/// Thickness of the ghost's shell, m: offset of its surface from the object's.
const SHELL_THICKNESS: f32 = 5.0e-4;
/// Opacity (alpha, of 255) of a ghost, and its colour when new and when old.
const GHOST_OPACITY: u8 = 110;
const FRESH_COLOR: [f64; 3] = [60.0, 220.0, 255.0];
const STALE_COLOR: [f64; 3] = [130.0, 134.0, 140.0];
/// Ageing of an estimate: time of one step, s, and number of steps until it is grey.
const AGE_STEPS: (f64, u32) = (2.0, 5);
/// Half-axis length of an ellipsoid, standard deviations.
const ELLIPSOID_SIGMAS: f64 = 2.0;
/// Smallest half axis that is drawn, m.
const MIN_HALF_AXIS: f64 = 2.0e-4;
/// Colours of trajectories.
pub const REJECTED_COLOR: [u8; 3] = [255, 70, 60];
pub const CHOSEN_COLOR: [u8; 3] = [80, 220, 110];

/// A trajectory of a held object.
#[derive(Debug, Clone, Default)]
pub struct ObjectPath {
    /// `world_from_object` along the trajectory. Empty: no trajectory is shown.
    pub poses: Vec<Isometry3<f64>>,
    /// Pose of closest approach to the target object, and the distance there, m. A negative distance is a collision.
    pub nearest: Option<(Isometry3<f64>, f64)>,
}

/// Time of the last touch of an object, with the covariance of its position.
#[derive(Debug, Clone)]
pub struct LastContact {
    time: f64,
    /// Standard deviations along the axes, m, largest first.
    axes: [f64; 3],
    rotation: UnitQuaternion<f64>,
    step: u32,
}

impl LastContact {
    /// Creates the record from the time of the touch, `time` (s), and the position covariance (m2).
    pub fn new(time: f64, covariance: &Matrix3<f64>) -> Self {
        let eigen = covariance.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let axes = order.map(|n| eigen.eigenvalues[n].max(0.0).sqrt());
        let [x, y] = [0, 1].map(|n| eigen.eigenvectors.column(order[n]).into_owned());
        let basis = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Self { time, axes, rotation: UnitQuaternion::from_rotation_matrix(&basis), step: 0 }
    }

    /// Returns the age step at `time` (s) if it has changed since the last call.
    pub fn update_age(&mut self, time: f64) -> Option<u32> {
        let step = (((time - self.time) / AGE_STEPS.0).max(0.0) as u32).min(AGE_STEPS.1);
        (std::mem::replace(&mut self.step, step) != step).then_some(step)
    }

    /// Describes age and standard deviations in words.
    fn description(&self, name: &str, time: f64) -> String {
        let [long, _, short] = self.axes.map(|axis| axis * 1e3);
        let age = time - self.time;
        let when = if age < 0.5 * AGE_STEPS.0 { "touched now".to_owned() } else { format!("touched {age:.0} s ago") };
        format!("{name} {when}: s.d. {short:.1} to {long:.1} mm")
    }
}

fn age_color(step: u32) -> [f64; 3] {
    let share = f64::from(step.min(AGE_STEPS.1)) / f64::from(AGE_STEPS.1);
    std::array::from_fn(|i| FRESH_COLOR[i] + (STALE_COLOR[i] - FRESH_COLOR[i]) * share)
}

fn ghost_color(object: &DrawnObject, step: u32) -> [u8; 3] {
    let tint = age_color(step);
    std::array::from_fn(|i| ((f64::from(object.color[i]) + 3.0 * tint[i]) / 4.0) as u8)
}

/// Returns the ghost of a pose estimate that is `step` steps old: a slightly enlarged shell, so that it is visible
/// around the true object.
pub fn ghost(object: &DrawnObject, step: u32) -> Mesh3D {
    colored_mesh(&object.mesh().grown(SHELL_THICKNESS), ghost_color(object, step), GHOST_OPACITY)
}

/// Returns an update of the colour of a ghost that is already logged.
pub fn ghost_color_update(object: &DrawnObject, step: u32) -> Mesh3D {
    let [r, g, b] = ghost_color(object, step);
    Mesh3D::update_fields().with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, GHOST_OPACITY))
}

/// Returns the covariance ellipsoid of an object's position, in the object's frame.
pub fn ellipsoid(object: &DrawnObject, felt: &LastContact, time: f64) -> Ellipsoids3D {
    let half = felt.axes.map(|axis| (ELLIPSOID_SIGMAS * axis).max(MIN_HALF_AXIS) as f32);
    let q = felt.rotation.coords.cast::<f32>();
    Ellipsoids3D::from_half_sizes([half])
        .with_quaternions([rerun::Quaternion::from_xyzw([q.x, q.y, q.z, q.w])])
        .with_fill_mode(FillMode::MajorWireframe)
        .with_line_radii([0.0004f32])
        .with_colors([age_color(0).map(|part| part as u8)])
        .with_labels([felt.description(&object.name, time)])
        .with_show_labels(true)
}

/// Returns an update of label and colour of an ellipsoid that is already logged.
pub fn ellipsoid_update(felt: &LastContact, step: u32, time: f64) -> Ellipsoids3D {
    Ellipsoids3D::update_fields()
        .with_labels([felt.description("", time).trim_start().to_owned()])
        .with_colors([age_color(step).map(|part| part as u8)])
}

/// Returns the path of an object's origin.
pub fn path_lines(poses: &[Isometry3<f64>], color: [u8; 3]) -> LineStrips3D {
    let points: Vec<[f32; 3]> = poses.iter().map(|pose| pose.translation.vector.cast::<f32>().into()).collect();
    LineStrips3D::new([points]).with_radii([0.0012f32]).with_colors([color])
}

/// Returns the object as drawn at the closest approach of a rejected trajectory to its target.
pub fn collision_mesh(object: &DrawnObject) -> Mesh3D {
    colored_mesh(&object.mesh(), REJECTED_COLOR, GHOST_OPACITY)
}

/// Returns the label of the closest approach. `distance` is in m; negative is a collision.
pub fn distance_label(distance: f64) -> Points3D {
    let text = match distance < 0.0 {
        true => format!("rejected: would collide by {:.1} mm", -distance * 1e3),
        false => format!("rejected: passes at {:.1} mm", distance * 1e3),
    };
    Points3D::new([<[f32; 3]>::from(Vector3::<f32>::zeros())])
        .with_radii([0.001f32])
        .with_colors([REJECTED_COLOR])
        .with_labels([text])
        .with_show_labels(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotated standard deviations of 3, 2 and 1 mm are recovered, and the longest axis has its given direction.
    #[test]
    fn an_ellipsoid_has_the_axes_of_its_covariance() {
        let turn = Rotation3::from_euler_angles(0.3, -0.5, 1.1);
        let squares = Vector3::new(1.0, 9.0, 4.0) * 1e-6;
        let covariance = turn.matrix() * Matrix3::from_diagonal(&squares) * turn.matrix().transpose();
        let felt = LastContact::new(1.0, &covariance);
        for (axis, expected) in felt.axes.iter().zip([3e-3, 2e-3, 1e-3]) {
            assert!((axis - expected).abs() < 1e-9, "{:?}", felt.axes);
        }
        let longest = felt.rotation * Vector3::x();
        assert!(longest.dot(&(turn * Vector3::y())).abs() > 0.999);
    }

    #[test]
    fn estimates_grey_with_age() {
        let mut felt = LastContact::new(1.0, &Matrix3::identity());
        assert_eq!(felt.update_age(1.5), None);
        assert_eq!(felt.update_age(3.5), Some(1));
        assert_eq!((felt.update_age(3.6), felt.update_age(60.0), felt.update_age(90.0)), (None, Some(5), None));
        assert_eq!(age_color(0), FRESH_COLOR);
        assert_eq!(age_color(5), STALE_COLOR);
    }
}
