//! The estimation problem: the evidence, and the state to be estimated. [`super::residuals`] gives the cost of a state.
//!
//! A step (rho, phi, dq, ds) moves a state by pose <- pose * exp(rho, phi) in the object's own axes, and joints and lifts of
//! pressed pads by addition.

use hand_model::transmission::CablePath;
use hand_model::{Hand, HandVector};
use nalgebra::{DVector, Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::evidence::{ContactFreeSpot, ContactPoint, LinkPatch, PressedPad, SelfContact, obstructed};
use super::inputs::{PoseInputs, PoseOptions, PosePrior};
use super::shape::KnownShape;
use super::system::{Kinematics, evenly_spaced};
use crate::posture::{Posture, excursion_sigma, free_posture, friction_sigmas};

/// Standard deviation of the torque about a joint from a contact on a blind pad, N m.
const BLIND_PAD_TORQUE: f64 = 0.2;

/// Subsets and weightings of the evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EvidenceStage {
    /// Servos, springs and limits only.
    Joints,
    /// Everything, with the object's pose fixed.
    Posture,
    /// Everything, with the object's rotation fixed.
    Translation,
    /// Everything, with larger standard deviations of points and normals and a quadratic loss: a smoother cost to start with.
    Soft,
    /// Everything, with larger standard deviations of points.
    Middle,
    /// Everything.
    All,
}

/// Pose and posture.
#[derive(Debug, Clone)]
pub(super) struct PoseState {
    pub pose: Isometry3<f64>,
    pub q: HandVector,
    /// Offset of the object outwards from the measured heights of each pressed pad, m.
    pub lift: Vec<f64>,
}

pub(super) struct PoseProblem<'a> {
    pub(super) hand: &'a Hand,
    pub(super) shape: &'a dyn KnownShape,
    pub(super) prior: &'a PosePrior,
    pub(super) options: &'a PoseOptions,
    pub(super) posture: Posture,
    pub(super) patches: Vec<LinkPatch>,
    /// Self-contacts of the hand.
    pub(super) self_contacts: Vec<SelfContact>,
    pub(super) pressed: Vec<PressedPad>,
    pub(super) contact_free: Vec<ContactFreeSpot>,
    /// Cables of digits in contact.
    pub(super) cables: Vec<usize>,
    /// Links with a blind pad.
    pub(super) blind: Vec<usize>,
    /// Column of every joint; `None` where the joint is not estimated.
    pub(super) column: HandVector<Option<usize>>,
    pub(super) columns: usize,
    /// Joints from the palm to each link.
    pub(super) chains: Vec<Vec<usize>>,
    /// Columns that a point on each link depends on, ascending; the palm's last.
    pub(super) reach: Vec<Vec<usize>>,
    /// Columns that a point of each pressed pad depends on; the column of its lift comes last.
    pub(super) pressed_reach: Vec<Vec<usize>>,
    /// Gravity in the palm's frame, m/s2.
    pub(super) gravity: Vector3<f64>,
    /// Torque of the digit's own weight about each joint, N m.
    pub(super) gravity_torques: HandVector,
    pub(super) torque_sigma: HandVector,
    /// Standard deviation of a cable's excursion, m.
    pub(super) excursion_sigma: f64,
}

impl<'a> PoseProblem<'a> {
    pub(crate) fn new(inputs: &PoseInputs<'a>) -> Self {
        let PoseInputs { hand, touches, readings, prior, shape, options } = *inputs;
        let (mut patches, mut clear, mut cables, mut blind) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut pressed, mut links, mut own) = (Vec::new(), Vec::new(), Vec::new());
        for touch in touches {
            let pad = &hand.pads[touch.pad];
            let place = pad.link_from_pad;
            own.extend(
                touch
                    .patches
                    .iter()
                    .filter(|patch| patch.self_contact)
                    .map(|patch| SelfContact::new(pad.link, &place, patch)),
            );
            for patch in touch.object_patches() {
                patches.push(LinkPatch::new(pad.link, pressed.len(), &place, patch, options.sigma_height));
            }
            let at = touch.is_touched().then_some(pressed.len());
            if touch.is_touched() {
                pressed.push(PressedPad::new(&place, touch, options));
                links.push(pad.link);
            }
            if !touch.patches.is_empty() || touch.blind {
                cables.extend(hand.digit_of(pad.link).map(|digit| digit.index()));
            }
            blind.extend(pad.link.filter(|_| touch.blind));
            if options.use_contact_free && !touch.contact_free.is_empty() {
                clear.extend(ContactFreeSpot::of_pad(pad.link, at, &place, &touch.contact_free));
            }
        }
        let posture = free_posture(hand, readings.servos);
        cables.sort_unstable();
        cables.dedup();
        let mut column = hand.each_joint(|_| None);
        let mut columns = 6;
        for &cable in &cables {
            for crossing in &hand.transmission.cables[cable].joints {
                column[crossing.joint] = Some(columns);
                columns += 1;
            }
        }
        // An obstructed digit without measured contact is not where a free one would be, so its contact-free points are
        // not used.
        clear.retain(|pad| {
            let digit = hand.digit_of(pad.link).map(|digit| digit.index());
            digit.is_none_or(|digit| cables.contains(&digit) || !obstructed(hand, &posture, digit))
        });
        let chains: Vec<Vec<usize>> = (0..hand.tree.len()).map(|link| hand.tree.chain(link)).collect();
        let reach = chains.iter().map(Vec::as_slice).chain([&[][..]]).map(|chain| {
            let mut reach: Vec<usize> = (0..6).chain(chain.iter().filter_map(|&joint| column[joint])).collect();
            reach.sort_unstable();
            reach
        });
        let (reach, torque_sigma): (Vec<Vec<usize>>, _) = (reach.collect(), hand.each_joint(|_| options.sigma_torque));
        let pressed_reach = links.iter().enumerate().map(|(n, link)| {
            let of_link = &reach[link.unwrap_or(chains.len())];
            of_link.iter().copied().chain([columns + n]).collect()
        });
        let pressed_reach = pressed_reach.collect();
        let mut problem = Self {
            hand,
            shape,
            prior,
            options,
            posture,
            patches,
            self_contacts: own,
            columns: columns + pressed.len(),
            pressed,
            contact_free: clear,
            cables,
            blind,
            column,
            chains,
            reach,
            pressed_reach,
            gravity: readings.gravity,
            gravity_torques: hand.each_joint(|_| 0.0),
            torque_sigma,
            excursion_sigma: excursion_sigma(hand, options.sigma_excursion, &options.cables),
        };
        problem.update_torques(&posture.q);
        problem
    }

    pub(crate) fn options(&self) -> &PoseOptions {
        self.options
    }

    /// The initial state: the posture from the servos with the object at `pose`.
    pub(crate) fn start(&self, pose: Isometry3<f64>) -> PoseState {
        let lift = self.pressed.iter().map(|pad| pad.lift).collect();
        PoseState { pose, q: self.posture.q, lift }
    }

    pub(crate) fn has_contact(&self) -> bool {
        !self.patches.is_empty()
    }

    pub(crate) fn shape(&self) -> &dyn KnownShape {
        self.shape
    }

    /// At most `most` points of each patch with normals and weights, at the state's posture.
    pub(crate) fn contact_points(&self, state: &PoseState, most: usize) -> Vec<ContactPoint> {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        let mut felt = Vec::new();
        for patch in &self.patches {
            let pose = kinematics.pose(patch.link);
            let lift = self.lift(state, patch.pressed);
            let chosen = evenly_spaced(&patch.normals, most);
            let share = patch.weight / chosen.len().max(1) as f64;
            felt.extend(
                chosen
                    .iter()
                    .map(|(point, normal, trust)| (pose * (point + lift), pose * normal, share * trust * trust)),
            );
        }
        felt
    }

    pub(crate) fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// Computes, from the torques at `q`, the torque of the digits' weight about each joint and the standard deviation
    /// of the torque balance.
    pub(crate) fn update_torques(&mut self, q: &[f64]) {
        let kinematics = Kinematics::new(self.hand, &self.chains, q);
        for (joint, rubbing) in self.friction_sigmas(q).into_iter().enumerate() {
            let torque = self.contact_torque(&kinematics, joint).abs();
            // An unmeasured contact on a blind pad loads all joints towards the palm.
            let unfelt = self.blind.iter().any(|&link| kinematics.chain(Some(link)).contains(&joint));
            let felt = self.options.sigma_torque.hypot(self.options.contact_torque_fraction * torque);
            let felt = felt.hypot(self.options.tension_torque_fraction * self.cable_torque(joint, q)).hypot(rubbing);
            self.torque_sigma[joint] = if unfelt { felt.hypot(BLIND_PAD_TORQUE) } else { felt };
            self.gravity_torques[joint] = self.gravity_torque(&kinematics, joint);
        }
    }

    /// Torque of a joint's cable at `q`, N m.
    fn cable_torque(&self, joint: usize, q: &[f64]) -> f64 {
        let cables = self.hand.transmission.cables.iter().zip(&self.posture.tensions);
        let of_cable = |(path, tension): (&CablePath, &f64)| {
            let crossing = path.joints.iter().find(|crossing| crossing.joint == joint);
            crossing.map_or(0.0, |crossing| crossing.lever.moment_arm(q[joint]) * tension)
        };
        cables.map(of_cable).sum()
    }

    /// Gravity torque about `joint` of the links that it carries, N m.
    fn gravity_torque(&self, kinematics: &Kinematics, joint: usize) -> f64 {
        let carried = (0..self.hand.masses.len()).filter(|link| kinematics.chain(Some(*link)).contains(&joint));
        let moment = carried.map(|link| {
            let body = &self.hand.masses[link];
            (kinematics.pose(Some(link)) * body.com - kinematics.origin(joint))
                .coords
                .cross(&(self.gravity * body.mass))
        });
        kinematics.axes[joint].dot(&moment.sum::<Vector3<f64>>())
    }

    /// Felt forces (N) with their points of application (m), in the frame of the link that carries the pad: from
    /// objects and self-contacts.
    fn forces(&self) -> impl Iterator<Item = (Option<usize>, (Point3<f64>, Vector3<f64>))> {
        let objects = self.patches.iter().map(|patch| (patch.link, (patch.centroid, patch.force)));
        objects.chain(self.self_contacts.iter().map(|own| (own.link, (own.centroid, own.force))))
    }

    /// Standard deviation of each joint's torque at `q` due to the friction in the guides, N m.
    fn friction_sigmas(&self, q: &[f64]) -> HandVector {
        let mut sigmas = self.hand.each_joint(|_| 0.0);
        for (cable, path) in self.hand.transmission.cables.iter().enumerate() {
            let of_cable = friction_sigmas(self.hand, cable, q, self.posture.tensions[cable], &self.options.cables);
            for (crossing, sigma) in path.joints.iter().zip(of_cable) {
                sigmas[crossing.joint] = sigma;
            }
        }
        sigmas
    }

    /// Torque of the contact forces about `joint`, N m.
    pub(super) fn contact_torque(&self, kinematics: &Kinematics, joint: usize) -> f64 {
        let (axis, origin) = (kinematics.axes[joint], kinematics.origin(joint));
        let about = |(link, _): &(Option<usize>, _)| kinematics.chain(*link).contains(&joint);
        let torque = |(link, (centroid, force)): (Option<usize>, (Point3<f64>, Vector3<f64>))| {
            let pose = kinematics.pose(link);
            axis.dot(&((pose * centroid).coords - origin).cross(&(pose * force)))
        };
        self.forces().filter(about).map(torque).sum()
    }

    /// Adds the derivatives of [`Self::contact_torque`] with respect to the joints further out, times `scale`, to a row.
    pub(super) fn contact_torque_row(&self, kinematics: &Kinematics, joint: usize, scale: f64, row: &mut [f64]) {
        let (axis, origin) = (kinematics.axes[joint], kinematics.origin(joint));
        for (link, (centroid, force)) in self.forces() {
            let chain = kinematics.chain(link);
            let Some(at) = chain.iter().position(|&other| other == joint) else { continue };
            let pose = kinematics.pose(link);
            let (centroid, force) = ((pose * centroid).coords, pose * force);
            for &outer in &chain[at + 1..] {
                let Some(column) = self.column[outer] else { continue };
                let turn = kinematics.axes[outer];
                let moved = turn.cross(&(centroid - kinematics.origin(outer)));
                let change = moved.cross(&force) + (centroid - origin).cross(&turn.cross(&force));
                row[column] += axis.dot(&change) * scale;
            }
        }
    }

    /// Displacement of a pressed pad's points by its lift, link frame, m.
    pub(super) fn lift(&self, state: &PoseState, pressed: usize) -> Vector3<f64> {
        self.pressed[pressed].normal * state.lift[pressed]
    }

    /// Columns that a point on `link` depends on.
    pub(super) fn reach(&self, link: Option<usize>) -> &[usize] {
        &self.reach[link.unwrap_or(self.chains.len())]
    }

    /// Applies a step to `state`.
    pub(crate) fn moved(&self, state: &PoseState, step: &DVector<f64>) -> PoseState {
        let rho = Vector3::new(step[0], step[1], step[2]);
        let phi = Vector3::new(step[3], step[4], step[5]);
        let (mut q, mut lift) = (state.q, state.lift.clone());
        let first = self.columns - self.pressed.len();
        lift.iter_mut().zip(step.iter().skip(first)).for_each(|(lift, step)| *lift += step);
        for (angle, column) in q.iter_mut().zip(&self.column) {
            if let Some(column) = column {
                *angle += step[*column];
            }
        }
        PoseState {
            pose: state.pose * Isometry3::from_parts(Translation3::from(rho), UnitQuaternion::new(phi)),
            q,
            lift,
        }
    }

    /// Root mean square distance of the felt points to the surface, m.
    pub(crate) fn point_rms(&self, state: &PoseState) -> f64 {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        let (mut sum, mut count) = (0.0, 0usize);
        for patch in &self.patches {
            let object_from_link = state.pose.inverse() * kinematics.pose(patch.link);
            let lift = self.lift(state, patch.pressed);
            for (point, _) in &patch.points {
                let point = point + lift;
                sum += self.shape.signed_distance(&(object_from_link * point)).0.powi(2);
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use hand_model::GRAVITY;
    use hand_model::robot::ServoState;

    use super::*;
    use crate::posture::Readings;

    struct Far;
    impl KnownShape for Far {
        fn signed_distance(&self, _: &Point3<f64>) -> (f64, Vector3<f64>) {
            (1.0, Vector3::z())
        }
    }

    /// The torque of the weight about a joint is the negative derivative of the potential energy.
    #[test]
    fn weight_does_the_work_that_the_links_lose() {
        let (hand, options) = (Hand::ftac(), PoseOptions::default());
        let servos = hand.each_actuator(|_| ServoState::default());
        let turned = UnitQuaternion::from_euler_angles(0.4, -0.7, 0.2);
        let prior = PosePrior::weak(Isometry3::identity());
        let readings = Readings::new(&servos, &turned);
        let (hand, prior, options) = (&hand, &prior, &options);
        let mut problem = PoseProblem::new(&PoseInputs { hand, touches: &[], readings, prior, shape: &Far, options });
        let q = hand.each_joint(|joint| 0.1 + 0.03 * joint as f64);
        problem.update_torques(&q);
        let energy = |q: &[f64]| -> f64 {
            let heights = hand.tree.forward(q).into_iter().zip(&hand.masses);
            heights.map(|(link, body)| body.mass * GRAVITY * (turned * (link * body.com)).z).sum()
        };
        for joint in 0..hand.tree.len() {
            let [above, below] = [1e-4, -1e-4].map(|by| {
                let mut q = q;
                q[joint] += by;
                energy(&q)
            });
            let expected = (below - above) / 2e-4;
            assert!(
                (problem.gravity_torques[joint] - expected).abs() < 1e-7,
                "{joint}: {} {expected}",
                problem.gravity_torques[joint]
            );
        }
        assert!(problem.gravity_torques.iter().any(|torque| torque.abs() > 1e-3), "{:?}", problem.gravity_torques);
    }
}
