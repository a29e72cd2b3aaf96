//! One grasp: approach, digits, tensions, and the position of the object in the hand when the digits close.

use hand_model::{Digit, DigitVector, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A grasp. Angles in rad, lengths in m, tensions in N.
///
/// ```
/// use dexterous_grasping::Grasp;
/// use nalgebra::Point3;
///
/// // Ring and little finger of a five-fingered hand. Without `digits`, those that are pulled close.
/// let text = r#"{"id": 0, "object": "ball", "yaw": 0.3, "pitch": 0.2, "roll": -0.9, "center": [-0.03, -0.04, -0.02],
///     "pre_tension": [0, 0, 0, 1.5, 1.5], "close_tension": [0, 0, 0, 18, 18], "opposition": 0.0, "raise": 0.0,
///     "thumb_delay": 0.0, "held": null, "held_joints": null, "score": 0.0}"#;
/// let grasp: Grasp = serde_json::from_str(text)?;
/// assert_eq!(grasp.digits.len(), 2);
///
/// // `world_from_palm` for a ball on the table.
/// let ball = Point3::new(0.5, 0.1, 0.02);
/// let palm = grasp.palm_pose(&ball, 0.0);
/// assert!((palm.inverse_transform_point(&ball) - Point3::from(grasp.center)).norm() < 1e-12);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "GraspFields")]
pub struct Grasp {
    /// Number within the repertoire.
    pub id: u32,
    /// Name of the object.
    pub object: String,
    /// Digits that close, in the order of [`Digit::ALL`].
    pub digits: Vec<Digit>,
    /// Rotation of the hand about the vertical, relative to the object's yaw.
    pub yaw: f64,
    /// Pitch, positive with the fingers down.
    pub pitch: f64,
    /// Roll about the finger axis. Negative values turn the ulnar edge down.
    pub roll: f64,
    /// Centre of the object in the palm frame when the digits start to close.
    pub center: [f64; 3],
    /// Tension of each digit's cable while approaching.
    pub pre_tension: DigitVector,
    /// Tension of each digit's cable when closed.
    pub close_tension: DigitVector,
    /// Angle of the thumb's opposition.
    pub opposition: f64,
    /// Distance by which the hand rises while the digits close.
    pub raise: f64,
    /// Delay of the thumb's closing after the fingers', s; negative if it closes first.
    pub thumb_delay: f64,
    /// `palm_from_object` at the end of a successful closing in physics.
    pub held: Option<Isometry3<f64>>,
    /// Finger joint angles at the same time.
    pub held_joints: Option<Vec<f64>>,
    /// Standard deviations of the object's position (m) and rotation (rad) about [`Self::held`], per axis, over the
    /// circumstances in which it was held. `None` if it was held in a single one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "held_spread")]
    pub held_sigmas: Option<[f64; 2]>,
    /// Success rate over the verification runs, which have placement errors.
    pub score: f64,
}

/// Fields of a grasp in a file. If a file does not name the digits, they are those whose cables are pulled when closed.
#[derive(Deserialize)]
struct GraspFields {
    id: u32,
    object: String,
    digits: Option<Vec<Digit>>,
    yaw: f64,
    pitch: f64,
    roll: f64,
    center: [f64; 3],
    pre_tension: DigitVector,
    close_tension: DigitVector,
    opposition: f64,
    raise: f64,
    thumb_delay: f64,
    held: Option<Isometry3<f64>>,
    held_joints: Option<Vec<f64>>,
    #[serde(alias = "held_spread")]
    held_sigmas: Option<[f64; 2]>,
    score: f64,
}

impl From<GraspFields> for Grasp {
    fn from(fields: GraspFields) -> Self {
        let GraspFields { id, object, digits, yaw, pitch, roll, center, pre_tension, close_tension, .. } = fields;
        let GraspFields { opposition, raise, thumb_delay, held, held_joints, held_sigmas: held_spread, score, .. } =
            fields;
        let digits = digits.unwrap_or_else(|| pulled_digits(&close_tension));
        Self {
            id,
            object,
            digits,
            yaw,
            pitch,
            roll,
            center,
            pre_tension,
            close_tension,
            opposition,
            raise,
            thumb_delay,
            held,
            held_joints,
            held_sigmas: held_spread,
            score,
        }
    }
}

/// Returns the digits whose cables are pulled.
pub fn pulled_digits(tensions: &[f64]) -> Vec<Digit> {
    Digit::ALL.into_iter().zip(tensions).filter(|(_, tension)| **tension > 0.0).map(|(digit, _)| digit).collect()
}

impl Grasp {
    /// Returns the rotation `world_from_palm` for an object whose yaw is `object_yaw`.
    pub fn palm_rotation(&self, object_yaw: f64) -> UnitQuaternion<f64> {
        palm_rotation(self.yaw + object_yaw, self.pitch, self.roll)
    }

    /// Returns `world_from_palm` for which an object at `object` with `object_yaw` has its centre at [`Self::center`].
    pub fn palm_pose(&self, object: &Point3<f64>, object_yaw: f64) -> Isometry3<f64> {
        let rotation = self.palm_rotation(object_yaw);
        let center = rotation * Vector3::from(self.center);
        Isometry3::from_parts(Translation3::from(object.coords - center), rotation)
    }
}

/// Returns a grasp pose of `hand` moved back by `distance` (m): along the jaws for a gripper, away from the object and
/// up for any other hand.
pub fn pregrasp_pose(hand: &Hand, grasp: &Isometry3<f64>, distance: f64) -> Isometry3<f64> {
    let away = if hand.jaws().is_some() { grasp * -Vector3::y() } else { grasp * Vector3::z() + Vector3::z() * 0.5 };
    Isometry3::from_parts(Translation3::from(grasp.translation.vector + away.normalize() * distance), grasp.rotation)
}

/// Returns the rotation `world_from_palm` of a hand with this heading about the vertical, pitch and roll (rad), as
/// defined by [`Grasp`].
pub fn palm_rotation(heading: f64, pitch: f64, roll: f64) -> UnitQuaternion<f64> {
    let z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
    let y = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch);
    let x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll);
    z * y * x * level_rotation()
}

/// Returns the level orientation: palm facing down, fingers along world x, so that palm y is world x and palm z is
/// world z.
fn level_rotation() -> UnitQuaternion<f64> {
    let columns = Matrix3::from_columns(&[-Vector3::y(), Vector3::x(), Vector3::z()]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grasp() -> Grasp {
        Grasp {
            id: 0,
            object: "ball".into(),
            digits: vec![Digit::Ring, Digit::Little],
            yaw: 0.3,
            pitch: 0.2,
            roll: -0.9,
            center: [-0.03, -0.04, -0.02],
            pre_tension: [0.0; 5].into(),
            close_tension: [0.0; 5].into(),
            opposition: 0.0,
            raise: 0.0,
            thumb_delay: 0.0,
            held: None,
            held_joints: None,
            held_sigmas: None,
            score: 0.0,
        }
    }

    /// If a file does not name the digits of a grasp, they are those that it pulls.
    #[test]
    fn digits_are_named_or_pulled() {
        let mut pulling = grasp();
        pulling.close_tension[Digit::Little.index()] = 12.0;
        let named = serde_json::to_value(&pulling).expect("JSON");
        assert_eq!(serde_json::from_value::<Grasp>(named.clone()).expect("a grasp"), pulling);
        let mut unnamed = named;
        unnamed.as_object_mut().expect("fields").remove("digits");
        assert_eq!(serde_json::from_value::<Grasp>(unnamed).expect("a grasp").digits, [Digit::Little]);
    }

    #[test]
    fn palm_pose_places_the_objects_center() {
        let object = Point3::new(0.5, 0.1, 0.02);
        let pose = grasp().palm_pose(&object, 0.7);
        assert!((pose.inverse_transform_point(&object).coords - Vector3::from(grasp().center)).norm() < 1e-12);
    }

    /// At level, the fingers point forward and the palm faces down. Negative roll puts the ulnar edge (palm -x) down,
    /// positive pitch the fingers.
    #[test]
    fn signs_of_the_angles() {
        let mut g = Grasp { yaw: 0.0, pitch: 0.0, roll: 0.0, ..grasp() };
        assert!((g.palm_rotation(0.0) * Vector3::y() - Vector3::x()).norm() < 1e-12);
        assert!((g.palm_rotation(0.0) * -Vector3::z() + Vector3::z()).norm() < 1e-12);
        g.roll = -1.0;
        assert!((g.palm_rotation(0.0) * -Vector3::x()).z < -0.5);
        g.roll = 0.0;
        g.pitch = 0.5;
        assert!((g.palm_rotation(0.0) * Vector3::y()).z < -0.3);
    }
}
