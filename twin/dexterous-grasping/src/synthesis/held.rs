//! A synthesized grasp as it was held in physics.
//!
//! Unlike [`crate::Grasp`], which is a recipe for picking up in the two-object benchmark, this is a *state*: the pose
//! of the object, all joint angles, tensions and contacts. It also has the data that a plan for several objects needs:
//! the digits in use, the approach direction, the clearance of the free digits, and the wrench margin.
//!
//! In files of the built-in hand, lengths are rounded to 0.01 mm, angles to 1e-4 rad and forces to 1 mN. Files of a
//! hand from a URDF name joints and actuators.

use std::ops::{Deref, DerefMut};

use hand_model::Digit;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A contact of a held grasp, palm frame. In a file it is a list of its four fields.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(from = "ContactRow", into = "ContactRow")]
pub struct HeldContact {
    /// Link in joint order, `None` for the palm.
    pub link: Option<usize>,
    /// Contact point, m.
    pub point: [f64; 3],
    /// Unit normal into the object.
    pub normal: [f64; 3],
    /// Normal force, N.
    pub force: f64,
}

type ContactRow = (Option<usize>, [f64; 3], [f64; 3], f64);

impl From<ContactRow> for HeldContact {
    fn from((link, point, normal, force): ContactRow) -> Self {
        Self { link, point, normal, force }
    }
}

impl From<HeldContact> for ContactRow {
    fn from(contact: HeldContact) -> Self {
        (contact.link, contact.point, contact.normal, contact.force)
    }
}

/// Load for which a grasp was verified.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct VerifiedLoad {
    /// Mass of the object, kg.
    pub mass: f64,
    /// Coulomb friction coefficient between hand and object.
    pub friction: f64,
    /// Payload: largest mass that the grasp was found to hold in six directions, kg.
    pub payload: f64,
}

/// Values of a hand's joints or actuators, in the hand's order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(from = "ValuesRow", into = "ValuesRow")]
pub struct NamedValues {
    /// One name per value. Empty for the built-in hand, whose files have the values alone.
    pub names: Vec<String>,
    /// Values: angles in rad, slides in m, tensions in N.
    pub values: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(untagged)]
enum ValuesRow {
    Plain(Vec<f64>),
    Named(Vec<(String, f64)>),
}

impl From<ValuesRow> for NamedValues {
    fn from(row: ValuesRow) -> Self {
        match row {
            ValuesRow::Plain(values) => values.into_iter().collect(),
            ValuesRow::Named(named) => {
                let (names, values) = named.into_iter().unzip();
                Self { names, values }
            }
        }
    }
}

impl From<NamedValues> for ValuesRow {
    fn from(NamedValues { names, values }: NamedValues) -> Self {
        if names.is_empty() { Self::Plain(values) } else { Self::Named(names.into_iter().zip(values).collect()) }
    }
}

impl FromIterator<f64> for NamedValues {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        Self { names: Vec::new(), values: values.into_iter().collect() }
    }
}

impl Deref for NamedValues {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.values
    }
}

impl DerefMut for NamedValues {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }
}

/// Pose of the object in the closed hand: x, y, z, then the quaternion's i, j, k, w. The variant is the field's name in
/// a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClosedPose {
    /// Pose in the palm frame of the built-in hand, whose palm is its root.
    PalmFromObject([f64; 7]),
    /// Pose in the root link of the URDF.
    RootFromObject([f64; 7]),
}

impl Deref for ClosedPose {
    type Target = [f64; 7];

    fn deref(&self) -> &[f64; 7] {
        match self {
            Self::PalmFromObject(pose) | Self::RootFromObject(pose) => pose,
        }
    }
}

impl DerefMut for ClosedPose {
    fn deref_mut(&mut self) -> &mut [f64; 7] {
        match self {
            Self::PalmFromObject(pose) | Self::RootFromObject(pose) => pose,
        }
    }
}

/// Schema of a [`ClosedPose`]: exactly one of its fields is present.
#[cfg(feature = "schemars")]
#[derive(Serialize, schemars::JsonSchema)]
struct ClosedPoseFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    palm_from_object: Option<[f64; 7]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    root_from_object: Option<[f64; 7]>,
}

/// Parts of a hand with named digits that hold an object, and the clearance of the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct DigitUse {
    /// Digits in contact.
    #[cfg_attr(feature = "schemars", schemars(with = "Vec<String>"))]
    pub digits: Vec<Digit>,
    /// True if the palm is in contact.
    pub palm: bool,
    /// Direction in which the palm faces and the hand approaches, object frame.
    pub approach: [f64; 3],
    /// Clearance: least distance of the free digits from the object, m; `None` if all are in contact.
    pub room: Option<f64>,
}

/// A grasp held in physics. Lengths in m, angles in rad, tensions and forces in N; frame of the hand's root.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct HeldGrasp {
    /// Name of the object.
    pub object: String,
    /// Number of the chain that found it, which with the header's seed reproduces it.
    pub chain: u64,
    /// `root_from_object` when closed.
    #[serde(flatten)]
    #[cfg_attr(feature = "schemars", schemars(with = "ClosedPoseFields"))]
    pub closed: ClosedPose,
    /// Joint coordinates when closed.
    pub joints: NamedValues,
    /// `root_from_object` with the hand open, before it closes.
    pub start: [f64; 7],
    /// Joint coordinates with the hand open.
    pub open_joints: NamedValues,
    /// Tensions that hold the open posture. `None` if they follow from it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open_tensions: Option<NamedValues>,
    /// Tensions of the actuators when closed.
    pub tensions: NamedValues,
    /// Opposition angle of the thumb. `None` for a hand without an opposition drive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opposition: Option<f64>,
    /// Contacts of hand and object.
    pub contacts: Vec<HeldContact>,
    /// Parts of the hand in use. `None` for a hand whose digits have no names.
    #[serde(flatten)]
    pub digit_use: Option<DigitUse>,
    /// Wrench margin, N (see [`crate::force_closure`]).
    pub margin: f64,
    /// Deepest penetration of hand and object, or of two colliding links.
    pub penetration: f64,
    /// True if it still held without tension. `None` if that was not tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_without_tension: Option<bool>,
    /// Distance and angle by which the closing moved the object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<[f64; 2]>,
    /// Energy of the sample it came from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy: Option<f64>,
    /// Load for which it was verified. `None` in files without it, whose grasps hold 0.1 kg at friction 0.6.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "proof")]
    pub verified_load: Option<VerifiedLoad>,
}

impl HeldGrasp {
    /// Returns the digits in contact. Empty for a hand whose digits have no names.
    pub fn digits(&self) -> &[Digit] {
        self.digit_use.as_ref().map_or(&[], |used| &used.digits)
    }

    /// True if the root, which is the palm, is in contact.
    pub fn palm(&self) -> bool {
        self.contacts.iter().any(|contact| contact.link.is_none())
    }

    /// Returns the same grasp with the object's frame moved by `shift` (m, along the object's own axes).
    #[must_use]
    pub fn with_frame_moved(mut self, shift: &Vector3<f64>) -> Self {
        for pose in [&mut *self.closed, &mut self.start] {
            *pose = pose_to_array(&(pose_from_array(pose) * Translation3::from(*shift)));
        }
        self
    }

    /// Returns the grasp as files record it: rounded for the built-in hand, exact for any other.
    #[must_use]
    pub fn at_file_precision(mut self) -> Self {
        if matches!(self.closed, ClosedPose::RootFromObject(_)) {
            return self;
        }
        // Division by a whole number gives short decimals.
        let to =
            |values: &mut [f64], per_unit: f64| values.iter_mut().for_each(|x| *x = (*x * per_unit).round() / per_unit);
        for pose in [&mut *self.closed, &mut self.start] {
            to(pose, per_unit::POSE);
        }
        to(&mut self.joints, per_unit::ANGLE);
        to(&mut self.open_joints, per_unit::ANGLE);
        to(&mut self.tensions, per_unit::FORCE);
        to(self.opposition.as_mut_slice(), per_unit::ANGLE);
        for contact in &mut self.contacts {
            to(&mut contact.point, per_unit::POSE);
            to(&mut contact.normal, per_unit::DIRECTION);
            to(std::slice::from_mut(&mut contact.force), per_unit::FORCE);
        }
        if let Some(used) = &mut self.digit_use {
            to(&mut used.approach, per_unit::DIRECTION);
            to(used.room.as_mut_slice(), per_unit::POSE);
        }
        to(std::slice::from_mut(&mut self.margin), per_unit::FORCE);
        to(std::slice::from_mut(&mut self.penetration), per_unit::DEPTH);
        to(self.moved.as_mut_slice().as_flattened_mut(), per_unit::MOTION);
        to(self.energy.as_mut_slice(), per_unit::ENERGY);
        if let Some(verification) = &mut self.verified_load {
            to(std::slice::from_mut(&mut verification.payload), per_unit::MASS);
        }
        self
    }

    /// True if two grasps are the same for practical purposes: same object and digits, the object's position in the
    /// hand within 5 mm, its orientation within 0.15 rad, and every joint within 0.2 rad. `turn` gives the angle
    /// between two orientations of the object, reduced by its symmetry. Always false for a hand whose digits have no
    /// names.
    pub fn nearly_equals(
        &self,
        other: &Self,
        turn: impl Fn(&UnitQuaternion<f64>, &UnitQuaternion<f64>) -> f64,
    ) -> bool {
        let (a, b) = (pose_from_array(&self.closed), pose_from_array(&other.closed));
        self.object == other.object
            && self.digit_use.is_some()
            && self.digits() == other.digits()
            && (a.translation.vector - b.translation.vector).norm() < 5e-3
            && self.joints.iter().zip(&*other.joints).all(|(p, q)| (p - q).abs() < 0.2)
            && turn(&a.rotation, &b.rotation) < 0.15
    }
}

/// Converts a pose to position and quaternion (i, j, k, w).
pub fn pose_to_array(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.quaternion());
    [t.x, t.y, t.z, q.i, q.j, q.k, q.w]
}

/// Inverts [`pose_to_array`].
pub fn pose_from_array(a: &[f64; 7]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(a[6], a[3], a[4], a[5]));
    Isometry3::from_parts(Translation3::new(a[0], a[1], a[2]), rotation)
}

/// Precision of the file: steps per unit.
pub(super) mod per_unit {
    /// Lengths (m) and quaternions.
    pub(in super::super) const POSE: f64 = 1e5;
    /// Joint angles, rad.
    pub(in super::super) const ANGLE: f64 = 1e4;
    /// Forces, N.
    pub(in super::super) const FORCE: f64 = 1e3;
    /// Unit vectors.
    pub(in super::super) const DIRECTION: f64 = 1e4;
    /// Penetration, m.
    pub(in super::super) const DEPTH: f64 = 1e6;
    /// Motion of the object, m and rad.
    pub(in super::super) const MOTION: f64 = 1e4;
    pub(in super::super) const ENERGY: f64 = 1e3;
    /// Masses, kg.
    pub(in super::super) const MASS: f64 = 1e4;
    /// Friction coefficients.
    pub(in super::super) const FRICTION: f64 = 1e4;
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(in super::super) fn used(digits: &[Digit]) -> DigitUse {
        DigitUse { digits: digits.to_vec(), palm: false, approach: [0.0, 0.0, -1.0], room: Some(0.012) }
    }

    pub(crate) fn grasp() -> HeldGrasp {
        HeldGrasp {
            object: "ball".into(),
            chain: 3,
            closed: ClosedPose::PalmFromObject(pose_to_array(&Isometry3::from_parts(
                Translation3::new(0.012_345_678, 0.0, -0.04),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
            ))),
            joints: [0.123_456_789; 15].into_iter().collect(),
            start: pose_to_array(&Isometry3::identity()),
            open_joints: [0.1; 15].into_iter().collect(),
            open_tensions: None,
            tensions: [10.0, 20.0, 0.0, 0.0, 0.0].into_iter().collect(),
            opposition: Some(1.2),
            contacts: vec![HeldContact { link: Some(2), point: [0.01; 3], normal: [0.0, 0.0, 1.0], force: 1.5 }],
            digit_use: Some(used(&[Digit::Thumb])),
            margin: 1.234_567,
            penetration: 1e-4,
            held_without_tension: None,
            moved: Some([1e-3, 0.02]),
            energy: Some(0.9),
            verified_load: Some(VerifiedLoad { mass: 0.1, friction: 0.6, payload: 0.253 }),
        }
    }

    /// Moving the object's frame moves no point of the object: each point keeps its position in the hand.
    #[test]
    fn a_moved_frame_moves_no_point() {
        let (shift, grasp) = (Vector3::new(0.01, -0.02, 0.03), grasp());
        let moved = grasp.clone().with_frame_moved(&shift);
        let point = nalgebra::Point3::new(0.004, 0.005, 0.006);
        for (before, after) in [(*grasp.closed, *moved.closed), (grasp.start, moved.start)] {
            let apart = pose_from_array(&before) * point - pose_from_array(&after) * (point - shift);
            assert!(apart.norm() < 1e-12, "{apart}");
        }
    }

    #[test]
    fn near_duplicates_are_known() {
        let angle = |p: &UnitQuaternion<f64>, q: &UnitQuaternion<f64>| p.angle_to(q);
        let (a, mut b) = (grasp(), grasp());
        b.closed[0] += 0.004;
        assert!(a.nearly_equals(&b, angle));
        b.closed[0] += 0.004;
        assert!(!a.nearly_equals(&b, angle));
        let c = HeldGrasp { digit_use: Some(used(&[Digit::Index])), ..grasp() };
        assert!(!a.nearly_equals(&c, angle));
        let mut bent = grasp();
        bent.joints[7] += 0.3;
        assert!(!a.nearly_equals(&bent, angle));
        let mut turned = grasp();
        let pose = pose_from_array(&turned.closed);
        *turned.closed = pose_to_array(&(pose * UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0)));
        assert!(!a.nearly_equals(&turned, angle));
        assert!(a.nearly_equals(&turned, |_, _| 0.0), "a ball's turn is no difference");
    }

    /// A line of each kind of hand is written as it was read.
    #[test]
    fn lines_of_both_kinds_of_hand_are_read() {
        let ours = serde_json::to_string(&grasp()).expect("a line");
        assert!(ours.starts_with(r#"{"object":"ball","chain":3,"palm_from_object":[0.012"#), "{ours}");
        let other = r#"{"object":"ball","chain":7,"root_from_object":[0.0,0.0,-0.05,0.0,0.0,0.0,1.0],"joints":[["turn",0.5]],"start":[0.0,0.0,-0.05,0.0,0.0,0.0,1.0],"open_joints":[["turn",0.1]],"open_tensions":[["close",1.0]],"tensions":[["close",30.0]],"contacts":[[0,[0.0,0.0,0.0],[0.0,0.0,1.0],2.0]],"margin":2.0,"penetration":0.0,"held_without_tension":false,"verified_load":{"mass":0.1,"friction":0.6,"payload":0.3}}"#;
        for line in [&*ours, other] {
            let read: HeldGrasp = serde_json::from_str(line).expect("read");
            assert_eq!(serde_json::to_string(&read).expect("a line"), line);
        }
        let earlier = serde_json::from_str::<HeldGrasp>(&other.replace("verified_load", "proof"));
        let other: HeldGrasp = serde_json::from_str(other).expect("read");
        assert_eq!(earlier.expect("read under the field's earlier name"), other);
        assert_eq!((&*other.tensions.names, &*other.tensions), (&["close".to_owned()][..], &[30.0][..]));
        assert!(other.digit_use.is_none() && other.digits().is_empty() && !other.palm());
    }
}
