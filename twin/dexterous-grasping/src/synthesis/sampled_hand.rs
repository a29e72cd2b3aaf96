//! A hand as a chain samples it: kinematic tree, mechanism and surface in one frame, the palm frame.
//!
//! The object comes along -z of the palm frame, and the hand turns about [`PIVOT`](super::frames::PIVOT), 35 mm along
//! -z, where the fingers close. A hand from a parameter file is laid out like that. For a hand from a URDF the caller
//! gives the pose of its root in this frame.

use hand_model::Hand;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::Tree;
use nalgebra::{Isometry3, Point3, UnitVector3};

use super::chain::GraspSample;
use super::energy::{EnergyWeights, GraspEnergy, TablePlane};
use super::field::DistanceField;
use super::frames::LinkFrames;
use super::mechanism::Mechanism;
use super::surface::{ContactCandidate, HandSurface};
use crate::force_closure::FrictionContact;

/// Length below which a normal counts as undefined.
const MIN_NORMAL: f64 = 1e-6;

/// A hand as it is sampled, in the palm frame.
///
/// ```
/// use dexterous_grasping::synthesis::sampled_hand::SampledHand;
/// use hand_model::Hand;
///
/// let hand = SampledHand::from_hand(&Hand::ftac(), 500);
/// assert_eq!(hand.tree.len(), 15);
/// assert!(hand.surface.len() >= 500 && !hand.surface.candidates.is_empty());
/// ```
#[derive(Debug, Clone)]
pub struct SampledHand {
    /// Kinematic tree. Joints without a parent are placed in the palm frame.
    pub tree: Tree,
    /// Joint limits and actuator lines.
    pub mechanism: Mechanism,
    /// Surface points, contact candidates, and pairs of links that may collide.
    pub surface: HandSurface,
}

impl SampledHand {
    /// Builds it from a hand that touches with its pads, with at least `points` points on its covers.
    pub fn from_hand(hand: &Hand, points: usize) -> Self {
        let (tree, mechanism) = (hand.tree.clone(), Mechanism::from_hand(hand));
        Self { tree, mechanism, surface: HandSurface::new(hand, points) }
    }

    /// Builds it from a hand of a URDF, with at least `points` points on its collision shapes, as
    /// [`HandSurface::from_mechanism`] does. `palm_from_root` places the root link. The points for which `may_touch` is
    /// true are the contact candidates: on link 0, the root, in the palm frame; on link i + 1 in the frame of the link
    /// that joint i moves.
    pub fn from_urdf(
        hand: &HandMechanism,
        palm_from_root: &Isometry3<f64>,
        points: usize,
        may_touch: impl FnMut(&ContactCandidate) -> bool,
    ) -> Self {
        let mut placed = hand.clone();
        for joint in placed.tree.joints.iter_mut().filter(|joint| joint.parent.is_none()) {
            joint.origin = palm_from_root * joint.origin;
        }
        for solid in placed.solids.iter_mut().filter(|solid| solid.link.is_none()) {
            solid.link_from_solid = palm_from_root * solid.link_from_solid;
        }
        let surface = HandSurface::from_mechanism(&placed, points, may_touch);
        Self { mechanism: Mechanism::from_urdf(hand), tree: placed.tree, surface }
    }

    /// Returns the energy of this hand on an object, with or without a table under it.
    pub fn energy<'a>(
        &'a self,
        field: &'a DistanceField,
        weights: EnergyWeights,
        table: Option<TablePlane>,
    ) -> GraspEnergy<'a> {
        GraspEnergy::from_mechanism(self.mechanism.clone(), &self.surface, field, weights, table)
    }

    /// Returns working space for the poses of this hand's links.
    pub fn frames(&self) -> LinkFrames {
        LinkFrames::new(&self.tree)
    }

    /// Returns the contacts of a sample for [`crate::force_closure`], object frame. The points are those of the hand,
    /// up to a few millimetres off the object, and the normals those of the object beside them. `None` if the object
    /// has no unique normal there, as in the middle of a slab.
    pub fn friction_contacts(
        &self,
        sample: &GraspSample,
        field: &DistanceField,
        friction: f64,
    ) -> Option<Vec<FrictionContact>> {
        let mut frames = self.frames();
        frames.set_state(&sample.state);
        let contact = |&index: &usize| {
            let candidate = &self.surface.candidates[index];
            let point = frames.point(candidate.link, &candidate.point);
            let normal = UnitVector3::try_new(-field.sample_at(&point).normal, MIN_NORMAL)?;
            Some(FrictionContact { point: Point3::from(point), normal, friction })
        };
        sample.contacts.iter().map(contact).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use hand_model::hand_mechanism::Triangles;
    use hand_model::urdf_hand::{ConvexDecomposition, MeshTools};
    use nalgebra::{Translation3, Vector3};

    use super::super::chain::{self, AnnealingSchedule};
    use super::super::field::tests::ball;
    use super::*;
    use crate::force_closure::wrench_margin;

    /// Two jaws of 60 mm, 80 mm apart, on hinges at the ends of a bar; the root's x points to the object.
    fn clamp() -> HandMechanism {
        let link = |name: &str| {
            format!(
                r#"<link name="{name}"><inertial><mass value="0.1"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5"
                iyz="0" izz="1e-5"/></inertial><collision><origin xyz="0.03 0 0"/><geometry>
                <box size="0.06 0.01 0.02"/></geometry></collision></link>"#
            )
        };
        let joint = |name: &str, child: &str, y: f64, low: f64, high: f64| {
            format!(
                r#"<joint name="{name}" type="revolute"><parent link="base"/><child link="{child}"/>
                <origin xyz="0.02 {y} 0"/><axis xyz="0 0 1"/>
                <limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>"#
            )
        };
        let urdf = format!(
            r#"<robot name="clamp"><link name="base"><collision><geometry><box size="0.03 0.1 0.02"/></geometry>
            </collision></link>{}{}{}{}</robot>"#,
            link("left"),
            link("right"),
            joint("a", "left", 0.04, -1.0, 0.5),
            joint("b", "right", -0.04, -0.5, 1.0),
        );
        let pulls = "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n\
            [[actuator]]\nname = \"close\"\narms = { a = -0.01, b = 0.01 }\n";
        let no_meshes = MeshTools {
            read: |path| panic!("{}: no mesh is expected", path.display()),
            decompose: |_: &Triangles| ConvexDecomposition::default(),
        };
        HandMechanism::parse(&urdf, Path::new("clamp.urdf"), pulls, Path::new("clamp.toml"), no_meshes).expect("valid")
    }

    fn sampled() -> SampledHand {
        // The root's x is -z of the palm frame, and the pivot is 50 mm before the root.
        let turn = nalgebra::UnitQuaternion::rotation_between(&Vector3::x(), &-Vector3::z()).expect("not opposite");
        let palm_from_root = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.015), turn);
        SampledHand::from_urdf(&clamp(), &palm_from_root, 600, |at| match at.link {
            0 => false,
            1 => at.normal.y < -0.9,
            _ => at.normal.y > 0.9,
        })
    }

    /// Candidates are on the inner faces that were chosen, and points on the shapes, in the palm frame.
    #[test]
    fn shapes_of_a_urdf_become_a_surface() {
        let hand = sampled();
        assert!((600..900).contains(&hand.surface.len()), "{}", hand.surface.len());
        assert!(hand.surface.candidates.iter().all(|at| at.link > 0 && at.normal.y.abs() > 0.9));
        for link in [1, 2] {
            assert!(hand.surface.candidates.iter().filter(|at| at.link == link).count() > 10, "link {link}");
        }
        let base = &hand.surface.links[0];
        assert!(base.points.iter().all(|p| p.z > -1e-9 && p.z < 0.03 + 1e-9), "the base is behind the palm plane");
        assert_eq!(hand.surface.pairs, [(1, 2)], "the base carries both jaws");
    }

    /// A clamp takes a ball between its jaws: its contacts are on both, opposed, and resist sideways forces.
    #[test]
    fn a_clamp_takes_a_ball() {
        let (hand, field) = (sampled(), ball(0.03));
        let energy = hand.energy(&field, EnergyWeights::default(), None);
        let schedule = AnnealingSchedule { burn_in: 1500, steady: 100, ..AnnealingSchedule::default() };
        let mut frames = hand.frames();
        let margins = (0..8).map(|number| {
            let best = chain::run(&energy, &mut frames, 4, &schedule, &mut chain::chain_rng(1, number)).best;
            let contacts = hand.friction_contacts(&best, &field, 0.8).expect("a ball has normals");
            wrench_margin(&contacts, &field.center, field.length, 10.0).expect("solved")
        });
        let margins: Vec<f64> = margins.collect();
        assert!(margins.iter().filter(|margin| **margin > 0.1).count() >= 2, "{margins:?}");
    }
}
