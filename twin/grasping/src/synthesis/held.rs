//! A synthesized grasp as it was held in physics.
//!
//! Unlike [`crate::Grasp`], which is a recipe for picking up in the two-object benchmark, this is a *state*: the pose of
//! the object, all joint angles, tensions and contacts. It also has what a plan for several objects needs: the digits it
//! uses, the approach direction, the clearance of the free digits, and the wrench margin.
//! In files lengths are rounded to 0.01 mm, angles to 1e-4 rad, forces to 1 mN. [`UrdfGrasp`] is the same for a hand from a URDF.

use hand_model::{Digit, DigitVector, HandVector};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// A contact of a held grasp, palm frame. In the file it is a list of its four fields.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "ContactRow", into = "ContactRow")]
pub struct HeldContact {
    /// Link in joint order, `None` for the palm.
    pub link: Option<usize>,
    /// m.
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

/// What a grasp was verified for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Proof {
    /// Mass of the object, kg.
    pub mass: f64,
    /// Coulomb coefficient between hand and object.
    pub friction: f64,
    /// Largest mass that it was found to hold in six directions, kg.
    pub payload: f64,
}

/// A grasp held in physics. Lengths in m, angles in rad, tensions and forces in N.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeldGrasp {
    pub object: String,
    /// Number of the chain that found it, which with the header's seed reproduces it.
    pub chain: u64,
    /// `palm_from_object` when closed: x, y, z, then the quaternion's i, j, k, w.
    pub palm_from_object: [f64; 7],
    /// Joint angles when closed.
    #[schemars(with = "Vec<f64>")]
    pub joints: HandVector,
    /// `palm_from_object` and joint angles with the hand open, before it closes.
    pub start: [f64; 7],
    /// See `start`.
    #[schemars(with = "Vec<f64>")]
    pub open_joints: HandVector,
    /// Tension of each digit's cable when closed.
    #[schemars(with = "Vec<f64>")]
    pub tensions: DigitVector,
    /// Angle of the thumb's opposition.
    pub opposition: f64,
    pub contacts: Vec<HeldContact>,
    /// Digits in contact.
    #[schemars(with = "Vec<String>")]
    pub digits: Vec<Digit>,
    /// Whether the palm is in contact.
    pub palm: bool,
    /// Direction in which the palm faces and the hand approaches, object frame.
    pub approach: [f64; 3],
    /// Clearance: least distance of the free digits from the object; `None` if all are in contact.
    pub room: Option<f64>,
    /// Wrench margin, N (see [`crate::force_closure::wrench_margin`]).
    pub margin: f64,
    /// Deepest penetration.
    pub penetration: f64,
    /// Distance and angle by which closing moved the object.
    pub moved: [f64; 2],
    /// Energy of the sample it came from.
    pub energy: f64,
    /// What it was verified for; `None` in files without it, whose grasps hold 0.1 kg at friction 0.6.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<Proof>,
}

/// A verified grasp of a hand from a URDF. m, rad, N, frame of the URDF's root link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UrdfGrasp {
    pub object: String,
    /// Number of the chain that found it, which with the header's seed reproduces it.
    pub chain: u64,
    /// `root_from_object` when closed: x, y, z, then i, j, k, w.
    pub root_from_object: [f64; 7],
    /// Joint angles when closed, by name.
    pub joints: Vec<(String, f64)>,
    /// `root_from_object` with the hand open, before it closes.
    pub start: [f64; 7],
    /// Joint angles then.
    pub open_joints: Vec<(String, f64)>,
    /// Tensions of the actuators that hold the open posture, by name.
    pub open_tensions: Vec<(String, f64)>,
    /// Tensions when closed.
    pub tensions: Vec<(String, f64)>,
    pub contacts: Vec<HeldContact>,
    /// Wrench margin, N.
    pub margin: f64,
    /// Deepest overlap, of hand and object or of two links that collide.
    pub penetration: f64,
    /// Whether it still held when nothing pulled.
    pub held_without_tension: bool,
    /// What it was verified for.
    pub proof: Proof,
}

/// A verified grasp as files have it.
pub trait VerifiedGrasp: Clone + Send + Sync + Serialize + DeserializeOwned {
    /// Number of the chain that found it.
    fn chain(&self) -> u64;

    /// Wrench margin, N.
    fn margin(&self) -> f64;

    /// Pose of the object before the hand closes.
    fn start(&self) -> Isometry3<f64>;

    /// None in files without it.
    fn proof(&self) -> Option<Proof>;

    /// Whether it still held when nothing pulled; none where that was not tried.
    fn held_without_tension(&self) -> Option<bool> {
        None
    }

    /// The same grasp with the object's frame moved by `shift` (m, along the object's own axes).
    #[must_use]
    fn with_frame_moved(self, shift: &Vector3<f64>) -> Self;

    /// The grasp with its numbers rounded to the file's precision.
    #[must_use]
    fn rounded(self) -> Self {
        self
    }

    /// True if two grasps are the same for practical purposes. `turn` gives the angle between two orientations of the object,
    /// reduced by its symmetry.
    fn nearly_equals(&self, _other: &Self, _turn: impl Fn(&UnitQuaternion<f64>, &UnitQuaternion<f64>) -> f64) -> bool {
        false
    }
}

impl VerifiedGrasp for UrdfGrasp {
    fn chain(&self) -> u64 {
        self.chain
    }

    fn margin(&self) -> f64 {
        self.margin
    }

    fn start(&self) -> Isometry3<f64> {
        pose_from_array(&self.start)
    }

    fn proof(&self) -> Option<Proof> {
        Some(self.proof)
    }

    fn held_without_tension(&self) -> Option<bool> {
        Some(self.held_without_tension)
    }

    fn with_frame_moved(mut self, shift: &Vector3<f64>) -> Self {
        for pose in [&mut self.root_from_object, &mut self.start] {
            *pose = moved(pose, shift);
        }
        self
    }
}

/// The numbers of a list by name.
pub fn values(named: &[(String, f64)]) -> Vec<f64> {
    named.iter().map(|(_, value)| *value).collect()
}

/// A pose of an object whose frame moves by `shift` along the object's own axes.
fn moved(pose: &[f64; 7], shift: &Vector3<f64>) -> [f64; 7] {
    pose_to_array(&(pose_from_array(pose) * Translation3::from(*shift)))
}

/// A pose as position and quaternion (i, j, k, w).
pub fn pose_to_array(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.quaternion());
    [t.x, t.y, t.z, q.i, q.j, q.k, q.w]
}

/// The inverse of [`pose_to_array`].
pub fn pose_from_array(a: &[f64; 7]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(a[6], a[3], a[4], a[5]));
    Isometry3::from_parts(Translation3::new(a[0], a[1], a[2]), rotation)
}

impl VerifiedGrasp for HeldGrasp {
    fn chain(&self) -> u64 {
        self.chain
    }

    fn margin(&self) -> f64 {
        self.margin
    }

    fn start(&self) -> Isometry3<f64> {
        pose_from_array(&self.start)
    }

    fn proof(&self) -> Option<Proof> {
        self.proof
    }

    fn rounded(mut self) -> Self {
        // A quotient by a whole number prints short.
        let to =
            |values: &mut [f64], per_unit: f64| values.iter_mut().for_each(|x| *x = (*x * per_unit).round() / per_unit);
        for pose in [&mut self.palm_from_object, &mut self.start] {
            to(pose, per_unit::POSE);
        }
        to(&mut self.joints, per_unit::ANGLE);
        to(&mut self.open_joints, per_unit::ANGLE);
        to(&mut self.tensions, per_unit::FORCE);
        to(std::slice::from_mut(&mut self.opposition), per_unit::ANGLE);
        for contact in &mut self.contacts {
            to(&mut contact.point, per_unit::POSE);
            to(&mut contact.normal, per_unit::DIRECTION);
            to(std::slice::from_mut(&mut contact.force), per_unit::FORCE);
        }
        to(&mut self.approach, per_unit::DIRECTION);
        to(self.room.as_mut_slice(), per_unit::POSE);
        to(std::slice::from_mut(&mut self.margin), per_unit::FORCE);
        to(std::slice::from_mut(&mut self.penetration), per_unit::DEPTH);
        to(&mut self.moved, per_unit::MOTION);
        to(std::slice::from_mut(&mut self.energy), per_unit::ENERGY);
        if let Some(proof) = &mut self.proof {
            to(std::slice::from_mut(&mut proof.payload), per_unit::MASS);
        }
        self
    }

    fn with_frame_moved(mut self, shift: &Vector3<f64>) -> Self {
        for pose in [&mut self.palm_from_object, &mut self.start] {
            *pose = moved(pose, shift);
        }
        self
    }

    /// Same object and digits, the object's position in the hand within 5 mm, its orientation within 0.15 rad, every joint within
    /// 0.2 rad.
    fn nearly_equals(&self, other: &Self, turn: impl Fn(&UnitQuaternion<f64>, &UnitQuaternion<f64>) -> f64) -> bool {
        let (a, b) = (pose_from_array(&self.palm_from_object), pose_from_array(&other.palm_from_object));
        self.object == other.object
            && self.digits == other.digits
            && (a.translation.vector - b.translation.vector).norm() < 5e-3
            && self.joints.iter().zip(&other.joints).all(|(p, q)| (p - q).abs() < 0.2)
            && turn(&a.rotation, &b.rotation) < 0.15
    }
}

/// Precision of the file: steps per unit.
pub(super) mod per_unit {
    /// Lengths (m) and quaternions.
    pub const POSE: f64 = 1e5;
    /// rad.
    pub const ANGLE: f64 = 1e4;
    /// N.
    pub const FORCE: f64 = 1e3;
    /// Unit vectors.
    pub const DIRECTION: f64 = 1e4;
    /// Penetration, m.
    pub const DEPTH: f64 = 1e6;
    /// Motion of the object, m and rad.
    pub const MOTION: f64 = 1e4;
    pub const ENERGY: f64 = 1e3;
    /// kg.
    pub const MASS: f64 = 1e4;
    /// Friction coefficients.
    pub const FRICTION: f64 = 1e4;
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn grasp() -> HeldGrasp {
        HeldGrasp {
            object: "ball".into(),
            chain: 3,
            palm_from_object: pose_to_array(&Isometry3::from_parts(
                Translation3::new(0.012_345_678, 0.0, -0.04),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
            )),
            joints: HandVector::from_iter([0.123_456_789; 15]),
            start: pose_to_array(&Isometry3::identity()),
            open_joints: HandVector::from_iter([0.1; 15]),
            tensions: [10.0, 20.0, 0.0, 0.0, 0.0].into(),
            opposition: 1.2,
            contacts: vec![HeldContact { link: Some(2), point: [0.01; 3], normal: [0.0, 0.0, 1.0], force: 1.5 }],
            digits: vec![Digit::Thumb],
            palm: false,
            approach: [0.0, 0.0, -1.0],
            room: Some(0.012),
            margin: 1.234_567,
            penetration: 1e-4,
            moved: [1e-3, 0.02],
            energy: 0.9,
            proof: Some(Proof { mass: 0.1, friction: 0.6, payload: 0.253 }),
        }
    }

    /// Moving the object's frame moves no point of the object: a point's place in the hand stays.
    #[test]
    fn a_moved_frame_moves_no_point() {
        let (shift, grasp) = (Vector3::new(0.01, -0.02, 0.03), grasp());
        let moved = grasp.clone().with_frame_moved(&shift);
        let point = nalgebra::Point3::new(0.004, 0.005, 0.006);
        for (before, after) in [(grasp.palm_from_object, moved.palm_from_object), (grasp.start, moved.start)] {
            let apart = pose_from_array(&before) * point - pose_from_array(&after) * (point - shift);
            assert!(apart.norm() < 1e-12, "{apart}");
        }
    }

    #[test]
    fn near_duplicates_are_known() {
        let angle = |p: &UnitQuaternion<f64>, q: &UnitQuaternion<f64>| p.angle_to(q);
        let (a, mut b) = (grasp(), grasp());
        b.palm_from_object[0] += 0.004;
        assert!(a.nearly_equals(&b, angle));
        b.palm_from_object[0] += 0.004;
        assert!(!a.nearly_equals(&b, angle));
        let c = HeldGrasp { digits: vec![Digit::Index], ..grasp() };
        assert!(!a.nearly_equals(&c, angle));
        let mut bent = grasp();
        bent.joints[7] += 0.3;
        assert!(!a.nearly_equals(&bent, angle));
        let mut turned = grasp();
        let pose = pose_from_array(&turned.palm_from_object);
        turned.palm_from_object = pose_to_array(&(pose * UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0)));
        assert!(!a.nearly_equals(&turned, angle));
        assert!(a.nearly_equals(&turned, |_, _| 0.0), "a ball's turn is no difference");
    }
}
