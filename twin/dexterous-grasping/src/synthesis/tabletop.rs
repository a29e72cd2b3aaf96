//! Proposals for an object that rests on a table: the chain samples postures above the table, and each posture it finds
//! becomes a [`Grasp`].
//!
//! In addition to the terms of the energy, the task constrains the hand. Only the palm and the digits that take the
//! object may touch it, and the other digits stay as they are. An object that is already held is treated as part of the
//! palm, so that it keeps clear of the table and of the object to be taken.

use hand_model::{Digit, Hand};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};

use super::chain::{self, AnnealingSchedule};
use super::energy::{EnergyWeights, GraspEnergy, TablePlane};
use super::field::DistanceField;
use super::frames::LinkFrames;
use super::hand_use::HandUse;
use super::mechanism::Mechanism;
use super::posture::open_clear;
use super::surface::HandSurface;
use crate::grasp::{Grasp, palm_rotation};
use crate::sampler::{self, HandForm, ObjectExtent};

/// Number of points on the hand's surface.
const SURFACE_POINTS: usize = 600;
/// Short schedule: a chain has to find a posture fast, because many postures are tried in physics.
const SCHEDULE: AnnealingSchedule = AnnealingSchedule {
    burn_in: 1000,
    steady: 150,
    initial_temperature: 2.0,
    final_temperature: 0.02,
    contact_share: 0.3,
};
/// Maximum number of chains until one ends in a posture that an arm above the table can take.
const MAX_CHAINS: usize = 4;
/// Fewest and most contact points of a chain.
const CONTACT_COUNT_RANGE: (usize, usize) = (3, 5);
/// Largest heading relative to the object, rad.
const MAX_HEADING: f64 = 0.6;
/// Ranges of pitch and roll at which chains begin, rad.
const START_PITCH_RANGE: [f64; 2] = [-0.3, 0.9];
const START_ROLL_RANGE: [f64; 2] = [-1.4, 1.4];
/// Range of the pitch of a proposed posture, rad.
const PITCH_RANGE: [f64; 2] = [-0.5, 1.3];
/// Thresholds that reject a sample, m: depth of a point of the hand in the object, and distance of a contact from it.
const MAX_DEPTH: f64 = 6e-3;
const MAX_CONTACT_DISTANCE: f64 = 0.02;

/// An object at rest on the table.
pub struct RestingObject<'a> {
    /// Size of the object.
    pub extent: &'a ObjectExtent,
    /// Distance field of the object.
    pub field: &'a DistanceField,
    /// Table, object frame.
    pub table: TablePlane,
    /// `world_from_object` at yaw 0.
    pub rest: UnitQuaternion<f64>,
}

/// An object that the hand already holds.
pub struct CarriedObject {
    /// Points on its surface, palm frame, m.
    pub points: Vec<Vector3<f64>>,
    /// Joint angles of the hand that holds it, rad.
    pub joints: Vec<f64>,
}

/// Proposer of grasps with some digits of a hand.
pub struct TabletopProposer<'a> {
    hand: &'a Hand,
    digits: Vec<Digit>,
    form: HandForm,
    surface: HandSurface,
    mechanism: Mechanism,
}

impl<'a> TabletopProposer<'a> {
    /// Creates a proposer for `digits` of a hand that is empty or holds the `carried` object. Returns `None` for a hand
    /// with jaws.
    pub fn new(hand: &'a Hand, digits: Vec<Digit>, carried: Option<&CarriedObject>) -> Option<Self> {
        if hand.jaws().is_some() {
            return None;
        }
        let mut surface = HandSurface::new(hand, SURFACE_POINTS);
        if let Some(carried) = carried {
            surface.extend_palm(&carried.points);
        }
        let mut mechanism = Mechanism::from_hand(hand);
        let still = carried.map_or_else(|| hand.open_angles().to_vec(), |carried| carried.joints.clone());
        HandUse::with_digits(digits.clone(), true).limit(hand, &still, &mut surface, &mut mechanism);
        Some(Self { hand, digits, form: HandForm::from_hand(hand), surface, mechanism })
    }

    /// Proposes a posture that one of a few chains finds, with tensions, delays and rise from the ranges of the hand's
    /// file for these digits. Returns `None` if no chain ends in a posture of balanced contacts that faces the table,
    /// or if the file has no ranges for such digits.
    pub fn propose(&self, object: &RestingObject, id: u32, rng: &mut impl Rng) -> Option<Grasp> {
        let drawn = sampler::propose(&self.form, object.extent, &self.digits, id, rng)?;
        let (mechanism, weights) = (self.mechanism.clone(), EnergyWeights::default());
        let energy = GraspEnergy::from_mechanism(mechanism, &self.surface, object.field, weights, Some(object.table));
        let mut frames = LinkFrames::new(&self.hand.tree);
        (0..MAX_CHAINS).find_map(|_| self.posture(&energy, &mut frames, object, &drawn, rng))
    }

    fn posture(
        &self,
        energy: &GraspEnergy,
        frames: &mut LinkFrames,
        object: &RestingObject,
        drawn: &Grasp,
        rng: &mut impl Rng,
    ) -> Option<Grasp> {
        let heading = if object.extent.yaw_matters { rng.random_range(-MAX_HEADING..MAX_HEADING) } else { 0.0 };
        let (pitch, roll) = (
            rng.random_range(START_PITCH_RANGE[0]..START_PITCH_RANGE[1]),
            rng.random_range(START_ROLL_RANGE[0]..START_ROLL_RANGE[1]),
        );
        let rotation = object.rest.inverse() * palm_rotation(heading, pitch, roll);
        let begun = chain::start_from_side(energy, rotation, &(rotation * Vector3::z()), rng);
        let contacts = rng.random_range(CONTACT_COUNT_RANGE.0..=CONTACT_COUNT_RANGE.1);
        let end = chain::run_from(energy, frames, begun, contacts, &SCHEDULE, rng).best;
        if end.terms.max_depth > MAX_DEPTH || end.terms.max_contact_distance > MAX_CONTACT_DISTANCE {
            return None;
        }
        let opened = open_clear(self.hand, &self.surface, object.field, frames, &end.state)?;
        let palm = opened.state.object_from_palm;
        // Rz(heading) Ry(pitch) Rx(roll), as defined by a grasp.
        let level = palm_rotation(0.0, 0.0, 0.0);
        let (roll, pitch, heading) = (object.rest * palm.rotation * level.inverse()).euler_angles();
        let yaw = if object.extent.yaw_matters { heading } else { 0.0 };
        let faces_down = (palm_rotation(yaw, pitch, roll) * -Vector3::z()).z < 0.3;
        if yaw.abs() > MAX_HEADING || !(PITCH_RANGE[0]..PITCH_RANGE[1]).contains(&pitch) || !faces_down {
            return None;
        }
        let mut grasp = Grasp { yaw, pitch, roll, ..drawn.clone() };
        grasp.center = palm.inverse_transform_point(&Point3::origin()).coords.into();
        if self.digits.contains(&Digit::Thumb) {
            grasp.opposition = opened.projected.opposition;
        }
        for digit in &self.digits {
            let pre = &mut grasp.pre_tension[digit.index()];
            *pre = pre.min(opened.open.tensions[digit.index()]);
        }
        Some(grasp)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::field::tests::ball;
    use super::*;

    const RADIUS: f64 = 0.025;

    fn proposals(digits: &[Digit], carried: Option<&CarriedObject>) -> Vec<Grasp> {
        let hand = Hand::ftac();
        let extent = ObjectExtent { name: "ball".into(), half: Vector3::repeat(RADIUS), yaw_matters: false };
        let table = TablePlane { normal: Unit::new_unchecked(Vector3::z()), offset: -RADIUS };
        let object = RestingObject { extent: &extent, field: &ball(RADIUS), table, rest: UnitQuaternion::identity() };
        let tabletop = TabletopProposer::new(&hand, digits.to_vec(), carried).expect("no jaws");
        let of = |id| tabletop.propose(&object, id, &mut ChaCha8Rng::seed_from_u64(u64::from(id)));
        (0..8).filter_map(of).collect()
    }

    /// Only the requested digits pull, whichever they are. The ball is near the palm, and the palm is above the table.
    #[test]
    fn any_digits_propose() {
        for digits in [&[Digit::Ring, Digit::Little][..], &[Digit::Thumb, Digit::Index], &[Digit::Little]] {
            let found = proposals(digits, None);
            assert!(found.len() >= 4, "{digits:?}: {} of 8", found.len());
            for grasp in &found {
                assert_eq!(crate::grasp::pulled_digits(&grasp.close_tension), digits);
                let palm = grasp.palm_pose(&Point3::new(0.0, 0.0, RADIUS), 0.0).translation.vector;
                assert!(palm.norm() < 0.2 && palm.z > 0.0, "{digits:?}: {palm}");
            }
            assert_eq!(found, proposals(digits, None));
        }
    }

    /// A held object stays out of the table: a long object under the palm's edge raises that edge.
    #[test]
    fn what_is_held_stays_above_the_table() {
        let points: Vec<Vector3<f64>> = (0..20).map(|n| Vector3::new(-0.03, 0.0, -0.005 * f64::from(n))).collect();
        let carried = CarriedObject { points, joints: vec![0.0; 15] };
        let lowest = |carried: Option<&CarriedObject>| {
            let found = proposals(&[Digit::Thumb, Digit::Index, Digit::Middle], carried);
            let tip =
                |grasp: &Grasp| grasp.palm_pose(&Point3::new(0.0, 0.0, RADIUS), 0.0) * Point3::new(-0.03, 0.0, -0.095);
            found.iter().map(|grasp| tip(grasp).z).fold(f64::INFINITY, f64::min)
        };
        assert!(lowest(Some(&carried)) > -0.01, "{}", lowest(Some(&carried)));
        assert!(lowest(None) < lowest(Some(&carried)), "{}", lowest(None));
    }
}
