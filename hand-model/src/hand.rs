//! A hand built from its parameter file: kinematic tree, covers, pads, cameras, transmission.
//!
//! Each digit is closed by one actuator through one cable; a thumb may have a second actuator for its opposition. Hands
//! with motors in the joints are described by the same model: a constant moment arm and a spring for each joint, as in
//! `data/robots/allegro.toml`. Parallel grippers have two digits with a sliding joint each, as in
//! `data/robots/franka_hand.toml`.

mod cover;
mod jaws;

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use tinyvec::ArrayVec;

use crate::digit::Digit;
use crate::kinematics::{Joint, JointKind, Tree, pose_from_xyz_rpy};
use crate::pads::{Pad, PadCamera};
use crate::parameters::{
    Cable, Cover, Follows, Gel, HandParameters, Handedness, JointParameters, PadParameters, Servo,
};
use crate::robot::ServoGoal;
use crate::transmission::friction::CableFriction;
use crate::transmission::{CablePath, Crossing, Follower, GuidePair, Lever, Transmission};
use ftac_platform::data::DataError;

pub use cover::{CoverShape, SkinElement};
pub use jaws::Jaws;

/// Largest number of joints of a hand.
pub const MAX_HAND_JOINTS: usize = 24;
/// Largest number of digits of a hand; each is closed by one actuator.
pub const MAX_DIGITS: usize = 5;
/// Largest number of actuators of a hand: one for each digit, and the thumb's opposition.
pub const MAX_ACTUATORS: usize = MAX_DIGITS + 1;
/// A value for each joint of a hand, in the order of its tree.
pub type HandVector<T = f64> = ArrayVec<[T; MAX_HAND_JOINTS]>;
/// A value for each digit of a hand.
pub type DigitVector<T = f64> = ArrayVec<[T; MAX_DIGITS]>;
/// A value for each actuator of a hand: the digits' actuators, then the opposition.
pub type ActuatorVector<T = f64> = ArrayVec<[T; MAX_ACTUATORS]>;

/// Mass, centre of mass and inertia of a link.
#[derive(Debug, Clone, Copy)]
pub struct MassProperties {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the link frame, m.
    pub com: Point3<f64>,
    /// Inertia about the centre of mass, link axes, kg m2.
    pub inertia: Matrix3<f64>,
}

/// A hand from a parameter file.
///
/// ```
/// use std::path::Path;
///
/// use hand_model::{Digit, Hand};
///
/// // An Allegro Hand with camera fingertips; for your own hand, read the text from your file.
/// # const TEXT: &str = include_str!("../data/robots/allegro.toml");
/// let hand = Hand::parse(TEXT, Path::new("allegro.toml"))?;
/// println!("{} joints, {} digits, {} pads", hand.tree.len(), hand.digits().len(), hand.pads.len());
///
/// // Poses in the palm frame, m.
/// let palm_from_link = hand.tree.forward(&hand.open_angles());
/// let palm_from_pad = hand.pad_poses(&palm_from_link);
/// let index = hand.find_pad("index_distal").expect("a pad of this name");
/// println!("pad of the index finger at {:.3?}", palm_from_pad[index].translation.vector.as_slice());
/// # Ok::<(), hand_model::DataError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Hand {
    /// The parameters from which the hand was built.
    pub parameters: HandParameters,
    /// Joints digit by digit, proximal first. The root is the palm.
    pub tree: Tree,
    /// Links of each digit.
    chains: Vec<Vec<usize>>,
    /// The palm's cover.
    pub palm_cover: CoverShape,
    /// The cover of each link.
    pub covers: Vec<CoverShape>,
    /// Mass of the palm with the servo pack.
    pub palm_mass: MassProperties,
    /// Mass of each link.
    pub masses: Vec<MassProperties>,
    /// The arm's tool frame in the palm frame.
    pub palm_from_flange: Isometry3<f64>,
    /// Pads, in the order of the parameter file.
    pub pads: Vec<Pad>,
    /// Cameras, pad by pad.
    pub cameras: Vec<PadCamera>,
    /// Cables, springs and opposition drive.
    pub transmission: Transmission,
    /// Servos of the actuators: identical in the nominal hand, each with its own deviations in a plant instance.
    pub servos: Vec<Servo>,
    /// The digits' cables with their spools.
    pub cables: Vec<Cable>,
}

impl Hand {
    /// Returns the F-TAC Hand as shipped.
    ///
    /// # Panics
    /// Never in a tested build: the parameter file is compiled in and a test reads it.
    pub fn ftac() -> Self {
        Self::build(HandParameters::ftac())
    }

    /// Builds a hand from the text of a parameter file; `path` is used in errors.
    ///
    /// # Errors
    /// [`DataError`] with the field at fault.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        Ok(Self::build(HandParameters::parse(text, path)?))
    }

    /// Returns the hand's digits.
    pub fn digits(&self) -> &'static [Digit] {
        &Digit::ALL[..self.cables.len()]
    }

    /// Returns the links of a digit from the palm outwards, which are also its joints; empty for a digit that the hand
    /// lacks.
    pub fn links(&self, digit: Digit) -> &[usize] {
        self.chains.get(digit.index()).map_or(&[], Vec::as_slice)
    }

    /// Returns the digit to which `link` belongs; `None` is the palm.
    pub fn digit_of(&self, link: Option<usize>) -> Option<Digit> {
        let chain = self.chains.iter().position(|chain| link.is_some_and(|link| chain.contains(&link)))?;
        Digit::ALL.get(chain).copied()
    }

    /// Collects `value(joint)` over the joint indices.
    pub fn each_joint<T: Default>(&self, value: impl FnMut(usize) -> T) -> HandVector<T> {
        (0..self.tree.len()).map(value).collect()
    }

    /// Collects `value(digit)` over the digit indices.
    pub fn each_digit<T: Default>(&self, value: impl FnMut(usize) -> T) -> DigitVector<T> {
        (0..self.cables.len()).map(value).collect()
    }

    /// Collects `value(actuator)` over the actuator indices.
    pub fn each_actuator<T: Default>(&self, value: impl FnMut(usize) -> T) -> ActuatorVector<T> {
        (0..self.servos.len()).map(value).collect()
    }

    /// Returns the joint angles of the open hand, rad.
    pub fn open_angles(&self) -> HandVector {
        self.each_joint(|_| 0.0)
    }

    /// Returns zero tensions, those of slack cables, N.
    pub fn slack_tensions(&self) -> DigitVector {
        self.each_digit(|_| 0.0)
    }

    /// Computes the servo goals for cable `tensions` (N, held by current control) and an angle of the opposition joint
    /// (rad), which draws at most `current_limit` (A).
    pub fn servo_goals(&self, tensions: &[f64], opposition: f64, current_limit: f64) -> ActuatorVector<ServoGoal> {
        self.each_actuator(|n| match tensions.get(n) {
            Some(tension) => {
                let to_current = self.cables[n].spool_radius / self.servos[n].torque_constant;
                ServoGoal::Current(tension * to_current)
            }
            None => {
                let most = self.transmission.opposition.map_or(0.0, |joint| self.tree.joints[joint].upper);
                let angle = opposition.min(most) * self.servos[n].gear_ratio_opposition;
                ServoGoal::Position { angle, current_limit }
            }
        })
    }

    /// Scales guide friction to cable `n`: returns its friction where the guides of the nominal hand have friction
    /// `drawn`.
    pub fn cable_guide_friction(&self, n: usize, drawn: &CableFriction) -> CableFriction {
        let (own, design) = (&self.cables[n].friction, &self.parameters.cable.friction);
        if own == design {
            return *drawn;
        }
        CableFriction {
            coefficient: drawn.coefficient * own.coefficient / design.coefficient,
            presliding: drawn.presliding * own.presliding / design.presliding,
            routing: drawn.routing * own.routing / design.routing,
        }
    }

    pub(crate) fn build(mut parameters: HandParameters) -> Self {
        if parameters.handedness == Handedness::Right {
            mirror_in_x(&mut parameters);
        }
        let index = |name: &str| parameters.joint.iter().position(|joint| joint.name == name);
        let joints: Vec<Joint> = parameters
            .joint
            .iter()
            .map(|joint| Joint {
                name: joint.name.clone(),
                parent: index(&joint.parent),
                kind: if joint.slide { JointKind::Slide } else { JointKind::Turn },
                origin: pose_from_xyz_rpy(joint.xyz, joint.rpy),
                axis: Vector3::z_axis(),
                lower: joint.lower,
                upper: joint.upper,
            })
            .collect();
        let lever = |joint: &JointParameters| match (joint.guide_before, joint.guide_after) {
            (Some(before), Some(after)) => Lever::Guides(GuidePair { before, after }),
            _ => Lever::Constant(joint.arm.unwrap_or_default()),
        };
        let crossing = |joint: usize| {
            let own = &parameters.joint[joint];
            Crossing { joint, lever: lever(own), range: [own.lower, own.upper] }
        };
        let pulling = parameters.actuator.iter().filter(|actuator| actuator.drives.is_none());
        let cables: Vec<CablePath> = pulling
            .map(|own| CablePath { joints: own.cable.iter().filter_map(|name| index(name)).map(crossing).collect() })
            .collect();
        let opposition = parameters.actuator.iter().find_map(|actuator| actuator.drives.as_deref()).and_then(index);
        let followers = parameters.joint.iter().enumerate().filter_map(|(joint, own)| {
            let Follows { joint: leader, multiplier } = own.follows.as_ref()?;
            Some(Follower { joint, leader: index(leader)?, multiplier: *multiplier, offset: 0.0 })
        });
        let followers = followers.collect();
        let (pads, cameras) = build_pads(&parameters);
        let palm_body = box_mass(parameters.palm.mass, &parameters.palm.cover, Some(parameters.palm.com));
        Self {
            chains: chains(&joints),
            tree: Tree { joints },
            palm_cover: CoverShape::from_parameters(&parameters.palm.cover),
            covers: parameters.joint.iter().map(|joint| CoverShape::from_parameters(&joint.cover)).collect(),
            palm_mass: with_point_mass(palm_body, parameters.palm.servo_pack_mass, parameters.palm.servo_pack_com),
            masses: parameters.joint.iter().map(|joint| box_mass(joint.mass, &joint.cover, None)).collect(),
            // The tool axis (z) runs along the fingers (y); the tool's y points out of the back of the hand.
            palm_from_flange: Isometry3::from_parts(
                Translation3::from(Vector3::from(parameters.palm.flange_xyz)),
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[
                    -Vector3::x(),
                    Vector3::z(),
                    Vector3::y(),
                ])),
            ),
            pads,
            cameras,
            cables: vec![parameters.cable; cables.len()],
            transmission: Transmission {
                cables,
                opposition,
                followers,
                springs: parameters.joint.iter().map(|joint| joint.spring).collect(),
                spring_rests: parameters.joint.iter().map(|_| 0.0).collect(),
            },
            servos: vec![parameters.servo; parameters.actuator.len()],
            parameters,
        }
    }

    /// Returns the damping of a joint, N m s/rad or N s/m.
    pub fn joint_damping(&self, joint: usize) -> f64 {
        self.parameters.joint[joint].damping.unwrap_or(self.parameters.joint_defaults.damping)
    }

    /// Returns the armature of a joint (reflected inertia of its drive), kg m2 or kg.
    pub fn joint_armature(&self, joint: usize) -> f64 {
        self.parameters.joint[joint].armature.unwrap_or(self.parameters.joint_defaults.armature)
    }

    /// Returns the elastomer of the pads.
    pub fn gel(&self) -> Gel {
        self.parameters.gel
    }

    /// Computes `palm_from_pad` of all pads from the link poses of [`Tree::forward`].
    pub fn pad_poses(&self, links: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        self.pads.iter().map(|pad| pad.link.map_or(pad.link_from_pad, |link| links[link] * pad.link_from_pad)).collect()
    }

    /// Returns the index of the pad called `name`.
    pub fn find_pad(&self, name: &str) -> Option<usize> {
        self.pads.iter().position(|pad| pad.name == name)
    }
}

/// Groups joints into connected chains, ordered by the first joint of each.
fn chains(joints: &[Joint]) -> Vec<Vec<usize>> {
    let mut chains: Vec<Vec<usize>> = Vec::new();
    for (n, joint) in joints.iter().enumerate() {
        match chains.iter_mut().find(|chain| joint.parent.is_some_and(|parent| chain.contains(&parent))) {
            Some(chain) => chain.push(n),
            None => chains.push(vec![n]),
        }
    }
    chains
}

/// Computes the mass properties of a uniform box of the cover's size.
fn box_mass(mass: f64, cover: &Cover, com: Option<[f64; 3]>) -> MassProperties {
    let square: Vec<f64> = cover.half.iter().map(|half| half * half).collect();
    let local =
        Matrix3::from_diagonal(&Vector3::new(square[1] + square[2], square[0] + square[2], square[0] + square[1]))
            * (mass / 3.0);
    let rotation = pose_from_xyz_rpy(cover.center, cover.rpy).rotation.to_rotation_matrix();
    MassProperties {
        mass,
        com: Point3::from(Vector3::from(com.unwrap_or(cover.center))),
        inertia: rotation * local * rotation.transpose(),
    }
}

/// Adds a point mass at `at` (m) (parallel-axis theorem).
fn with_point_mass(body: MassProperties, mass: f64, at: [f64; 3]) -> MassProperties {
    let at = Vector3::from(at);
    let total = body.mass + mass;
    let com = (body.com.coords * body.mass + at * mass) / total;
    let shifted = |m: f64, d: Vector3<f64>| (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * m;
    MassProperties {
        mass: total,
        com: Point3::from(com),
        inertia: body.inertia + shifted(body.mass, body.com.coords - com) + shifted(mass, at - com),
    }
}

fn build_pads(parameters: &HandParameters) -> (Vec<Pad>, Vec<PadCamera>) {
    let mut pads = Vec::new();
    let mut cameras = Vec::new();
    for (index, pad) in parameters.pad.iter().enumerate() {
        let configuration = parameters.configuration[&pad.configuration];
        let link = parameters.joint.iter().position(|joint| joint.name == pad.link);
        let cover = link.map_or(parameters.palm.cover, |link| parameters.joint[link].cover);
        let first = cameras.len();
        let h = configuration.h / configuration.cameras as f64;
        for n in 0..configuration.cameras {
            cameras.push(PadCamera {
                name: if configuration.cameras == 1 { pad.name.clone() } else { format!("{}_{n}", pad.name) },
                pad: index,
                center_y: (n as f64 + 0.5) * h - 0.5 * configuration.h,
                h,
                w: configuration.w,
            });
        }
        pads.push(Pad {
            name: pad.name.clone(),
            link,
            configuration: pad.configuration.chars().next().unwrap_or('?'),
            link_from_pad: pad_frame(pad),
            h: configuration.h,
            w: configuration.w,
            edge_radius: cover.radius,
            cameras: (first..cameras.len()).collect(),
        });
    }
    (pads, cameras)
}

fn pad_frame(pad: &PadParameters) -> Isometry3<f64> {
    let y = Vector3::from(pad.y).normalize();
    let z = Vector3::from(pad.z);
    let z = (z - y * z.dot(&y)).normalize();
    Isometry3::from_parts(
        Translation3::from(Vector3::from(pad.center)),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[y.cross(&z), y, z])),
    )
}

/// Mirrors the hand in x of the palm frame. Link frames keep x along the phalanx and y palmar, so that only z (the
/// axis) changes side: a rotation R becomes M R S with M = diag(-1, 1, 1) on the palm side and S = diag(1, 1, -1) on
/// the link side.
fn mirror_in_x(parameters: &mut HandParameters) {
    let palm_side = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
    let link_side = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let side = |name: &str| if name == "palm" { palm_side } else { link_side };
    let flip = |m: &Matrix3<f64>, v: &mut [f64; 3]| *v = (m * Vector3::from(*v)).into();
    flip(&palm_side, &mut parameters.palm.com);
    flip(&palm_side, &mut parameters.palm.flange_xyz);
    flip(&palm_side, &mut parameters.palm.servo_pack_com);
    flip(&palm_side, &mut parameters.palm.cover.center);
    for joint in &mut parameters.joint {
        let parent = side(&joint.parent);
        flip(&parent, &mut joint.xyz);
        let rotation = Rotation3::from_euler_angles(joint.rpy[0], joint.rpy[1], joint.rpy[2]);
        // A joint turning the other way about a mirrored axis is the same flexion, and link z is mirrored with it.
        let mirrored = Rotation3::from_matrix_unchecked(parent * rotation.matrix() * link_side);
        // The axis stays +z: mirror flips both the axis vector and the sense of rotation about it.
        let (r, p, y) = mirrored.euler_angles();
        joint.rpy = [r, p, y];
        flip(&link_side, &mut joint.cover.center);
        let cover = Rotation3::from_euler_angles(joint.cover.rpy[0], joint.cover.rpy[1], joint.cover.rpy[2]);
        let (r, p, y) = Rotation3::from_matrix_unchecked(link_side * cover.matrix() * link_side).euler_angles();
        joint.cover.rpy = [r, p, y];
    }
    for pad in &mut parameters.pad {
        let m = side(&pad.link);
        flip(&m, &mut pad.center);
        flip(&m, &mut pad.y);
        flip(&m, &mut pad.z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_the_paper() {
        let hand = Hand::ftac();
        assert_eq!((hand.tree.len(), hand.pads.len(), hand.cameras.len()), (15, 17, 18));
        let area: f64 = hand.pads.iter().map(|pad| pad.h * pad.w).sum();
        assert!((area * 1e4 - 155.0).abs() < 10.0, "155 cm2 of pads, found {} cm2", area * 1e4);
    }

    /// Every pad lies on its cover: the surface centre is on the cover's face to within 0.2 mm, normal outwards.
    #[test]
    fn pads_lie_on_covers() {
        let hand = Hand::ftac();
        for pad in &hand.pads {
            let cover = pad.link.map_or(hand.palm_cover, |link| hand.covers[link]);
            let center = cover.link_from_cover.inverse() * pad.link_from_pad * Point3::origin();
            let normal = cover.link_from_cover.inverse() * pad.link_from_pad * Vector3::z();
            let axis = normal.iamax();
            assert!((center[axis] * normal[axis].signum() - cover.half[axis]).abs() < 2e-4, "{}: {center}", pad.name);
        }
    }

    /// A right hand is the mirror image of the left one, at any posture.
    #[test]
    fn right_hand_mirrors_left() {
        let text = include_str!("../data/ftac_hand.toml").replace("handedness = \"left\"", "handedness = \"right\"");
        let right = Hand::parse(&text, Path::new("right.toml")).expect("valid");
        let left = Hand::ftac();
        let q: Vec<f64> = (0..15).map(|j| 0.1 + 0.07 * j as f64).collect();
        let (l, r) = (left.tree.forward(&q), right.tree.forward(&q));
        for (pad_left, pad_right) in left.pad_poses(&l).iter().zip(right.pad_poses(&r)) {
            let (a, b) = (pad_left.translation.vector, pad_right.translation.vector);
            assert!((Vector3::new(-a.x, a.y, a.z) - b).norm() < 1e-9, "{a} {b}");
        }
    }

    #[test]
    fn errors_name_file_element_and_field() {
        let text = include_str!("../data/ftac_hand.toml").replacen("mass = 0.030207", "mass = 0.0", 1);
        let error = Hand::parse(&text, Path::new("bad.toml")).expect_err("zero mass").to_string();
        assert_eq!(error, "bad.toml: joint[thumb_1].mass: found 0, expected a positive mass in kg");
    }
}
