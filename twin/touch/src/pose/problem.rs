//! The residuals of the pose estimate and their derivatives.
//!
//! A state is moved by a vector (rho, phi, dq): pose <- pose * exp(rho, phi) in the object's own axes, joints by addition.
//! Felt points and normals are pulled into the object frame, so that p <- p - rho - phi x p and n <- n - phi x n.

use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, HAND_JOINTS, Hand};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

use super::evidence::{ClearPad, LinkPatch, held_up};
use super::screen::FeltPoint;
use super::system::{Cost, Kinematics, Normal, Sink, evenly};
use super::{KnownShape, PoseOptions, PosePrior};
use crate::pipeline::PadTouch;
use crate::posture::{Posture, digit_of, excursion_residual, free_posture, spring_residuals};

/// Points of a patch err together (posture, calibration): a patch counts as no more than so many independent points ...
const INDEPENDENT_POINTS: f64 = 4.0;
/// ... and normals.
const INDEPENDENT_NORMALS: f64 = 2.0;
/// Torque that a contact on a blind pad may have about a joint, N m.
const UNFELT_TORQUE: f64 = 0.2;
/// Step for the curvature of the shape, m.
const CURVATURE_STEP: f64 = 4e-4;

/// Which evidence takes part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Evidence {
    /// Servos, springs and limits alone.
    Joints,
    /// Everything, but the object does not turn.
    Translation,
    /// Everything, felt points and normals trusted less and without Huber: a smoother landscape to start in.
    Soft,
    /// Everything.
    All,
}

/// Pose and posture.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    pub pose: Isometry3<f64>,
    pub q: [f64; HAND_JOINTS],
}

pub(super) struct Problem<'a> {
    hand: &'a Hand,
    shape: &'a dyn KnownShape,
    prior: &'a PosePrior,
    options: &'a PoseOptions,
    pub posture: Posture,
    patches: Vec<LinkPatch>,
    clear: Vec<ClearPad>,
    /// Cables of digits that touch.
    cables: Vec<usize>,
    /// Links with a pad that may be pressed without being felt.
    blind: Vec<usize>,
    /// Column of every joint; `None` where the joint is not estimated.
    column: [Option<usize>; HAND_JOINTS],
    columns: usize,
    /// Joints from the palm to each link.
    chains: Vec<Vec<usize>>,
    /// Columns that a point on each link depends on, ascending; the palm's last.
    reach: Vec<Vec<usize>>,
    torque_sigma: [f64; HAND_JOINTS],
}

impl<'a> Problem<'a> {
    pub fn new(
        hand: &'a Hand,
        touches: &[PadTouch],
        servos: &[ServoState; ACTUATORS],
        prior: &'a PosePrior,
        shape: &'a dyn KnownShape,
        options: &'a PoseOptions,
    ) -> Self {
        let (mut patches, mut clear, mut cables, mut blind) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for touch in touches {
            let pad = &hand.pads[touch.pad];
            let place = pad.link_from_pad;
            let peak = touch.patches.iter().map(|patch| patch.peak).fold(0.0, f64::max);
            let lift = Vector3::z() * (1.0 - options.sinking) * peak;
            for patch in &touch.patches {
                patches.push(LinkPatch::new(pad.link, &place, patch, &lift));
            }
            if touch.touched() || touch.blind {
                cables.extend(digit_of(pad.link).map(|digit| digit.index()));
            }
            blind.extend(pad.link.filter(|_| touch.blind));
            if options.use_clear && !touch.clear.is_empty() {
                let points: Vec<Point3<f64>> = touch.clear.iter().map(|point| place * point).collect();
                clear.push(ClearPad::new(pad.link, points));
            }
        }
        let posture = free_posture(hand, servos);
        cables.sort_unstable();
        cables.dedup();
        let mut column = [None; HAND_JOINTS];
        let mut columns = 6;
        for &cable in &cables {
            for (joint, _) in &hand.transmission.cables[cable].joints {
                column[*joint] = Some(columns);
                columns += 1;
            }
        }
        // A digit that is held up by what no pad feels is not where a free one would be: what it does not feel is not told.
        clear.retain(|pad| {
            let digit = digit_of(pad.link).map(|digit| digit.index());
            digit.is_none_or(|digit| cables.contains(&digit) || !held_up(hand, &posture, digit))
        });
        let chains: Vec<Vec<usize>> = (0..hand.tree.len()).map(|link| hand.tree.chain(link)).collect();
        let reach = chains.iter().map(Vec::as_slice).chain([&[][..]]).map(|chain| {
            let mut reach: Vec<usize> = (0..6).chain(chain.iter().filter_map(|&joint| column[joint])).collect();
            reach.sort_unstable();
            reach
        });
        let (reach, torque_sigma) = (reach.collect(), [options.sigma_torque; HAND_JOINTS]);
        let mut problem = Self {
            hand,
            shape,
            prior,
            options,
            posture,
            patches,
            clear,
            cables,
            blind,
            column,
            columns,
            chains,
            reach,
            torque_sigma,
        };
        problem.settle_torque_sigmas(&posture.q);
        problem
    }

    pub fn options(&self) -> &PoseOptions {
        self.options
    }

    pub fn has_contact(&self) -> bool {
        !self.patches.is_empty()
    }

    pub fn shape(&self) -> &dyn KnownShape {
        self.shape
    }

    /// At most `most` felt points of each patch with normals (palm frame) and weights, at a posture.
    pub fn felt(&self, state: &State, most: usize) -> Vec<FeltPoint> {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        let mut felt = Vec::new();
        for patch in &self.patches {
            let pose = kinematics.pose(patch.link);
            let chosen = evenly(&patch.normals, most);
            let share = patch.weight / chosen.len().max(1) as f64;
            felt.extend(
                chosen.iter().map(|(point, normal, trust)| (pose * point, pose * normal, share * trust * trust)),
            );
        }
        felt
    }

    pub fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// Sets how far each joint's torque balance is trusted, from the contact torques at `q`.
    pub fn settle_torque_sigmas(&mut self, q: &[f64; HAND_JOINTS]) {
        let kinematics = Kinematics::new(self.hand, &self.chains, q);
        for joint in 0..HAND_JOINTS {
            let torque = self.contact_torque(&kinematics, joint).abs();
            // What presses on a blind pad turns all joints below it.
            let unfelt = self.blind.iter().any(|&link| kinematics.chain(Some(link)).contains(&joint));
            let felt = self.options.sigma_torque.hypot(self.options.contact_torque_fraction * torque);
            self.torque_sigma[joint] = if unfelt { felt.hypot(UNFELT_TORQUE) } else { felt };
        }
    }

    /// Torque of the felt forces about `joint`, N m.
    fn contact_torque(&self, kinematics: &Kinematics, joint: usize) -> f64 {
        let (axis, origin) = (kinematics.axes[joint], kinematics.origin(joint));
        let about = |patch: &&LinkPatch| kinematics.chain(patch.link).contains(&joint);
        let torque = |patch: &LinkPatch| {
            let pose = kinematics.pose(patch.link);
            axis.dot(&((pose * patch.centroid).coords - origin).cross(&(pose * patch.force)))
        };
        self.patches.iter().filter(about).map(torque).sum()
    }

    /// Adds the derivatives of [`Self::contact_torque`] by the joints further out, times `scale`, to a row.
    fn contact_torque_row(&self, kinematics: &Kinematics, joint: usize, scale: f64, row: &mut [f64]) {
        let (axis, origin) = (kinematics.axes[joint], kinematics.origin(joint));
        for patch in &self.patches {
            let chain = kinematics.chain(patch.link);
            let Some(at) = chain.iter().position(|&other| other == joint) else { continue };
            let pose = kinematics.pose(patch.link);
            let (centroid, force) = ((pose * patch.centroid).coords, pose * patch.force);
            for &outer in &chain[at + 1..] {
                let Some(column) = self.column[outer] else { continue };
                let turn = kinematics.axes[outer];
                let moved = turn.cross(&(centroid - kinematics.origin(outer)));
                let change = moved.cross(&force) + (centroid - origin).cross(&turn.cross(&force));
                row[column] += axis.dot(&change) * scale;
            }
        }
    }

    /// Columns that a point on `link` depends on.
    fn reach(&self, link: Option<usize>) -> &[usize] {
        &self.reach[link.unwrap_or(self.chains.len())]
    }

    /// `state` moved by a step.
    pub fn moved(&self, state: &State, step: &DVector<f64>) -> State {
        let rho = Vector3::new(step[0], step[1], step[2]);
        let phi = Vector3::new(step[3], step[4], step[5]);
        let mut q = state.q;
        for (angle, column) in q.iter_mut().zip(&self.column) {
            if let Some(column) = column {
                *angle += step[*column];
            }
        }
        State { pose: state.pose * Isometry3::from_parts(Translation3::from(rho), UnitQuaternion::new(phi)), q }
    }

    /// Robust cost of a state.
    pub fn cost(&self, state: &State, evidence: Evidence) -> f64 {
        let mut sink = Cost(0.0);
        self.residuals(state, evidence, &mut sink);
        if sink.0.is_nan() { f64::INFINITY } else { sink.0 }
    }

    /// Gauss-Newton matrix and gradient of the cost.
    pub fn linearise(&self, state: &State, evidence: Evidence) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.columns;
        let held = match evidence {
            Evidence::Joints => 0..6,
            Evidence::Translation => 3..6,
            Evidence::Soft | Evidence::All => 0..0,
        };
        let mut sink = Normal::new(n, held.clone());
        self.residuals(state, evidence, &mut sink);
        for k in held {
            sink.hessian[(k, k)] = 1.0;
        }
        (sink.hessian, sink.gradient)
    }

    /// Root mean square distance of the felt points to the surface, m.
    pub fn point_rms(&self, state: &State) -> f64 {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        let (mut sum, mut count) = (0.0, 0usize);
        for patch in &self.patches {
            let object_from_link = state.pose.inverse() * kinematics.pose(patch.link);
            for (point, _) in &patch.points {
                sum += self.shape.signed_distance(&(object_from_link * point)).0.powi(2);
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }

    fn residuals(&self, state: &State, evidence: Evidence, sink: &mut dyn Sink) {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        self.joint_residuals(state, &kinematics, sink);
        if evidence != Evidence::Joints {
            self.prior_residuals(state, sink);
            self.contact_residuals(state, &kinematics, evidence, sink);
            self.clear_residuals(state, &kinematics, sink);
        }
    }

    fn joint_residuals(&self, state: &State, kinematics: &Kinematics, sink: &mut dyn Sink) {
        let (options, column) = (self.options, &self.column);
        for &cable in &self.cables {
            // A cable's joints are estimated together: their columns are those of the outermost one's link.
            let outermost = self.hand.transmission.cables[cable].joints.last().map(|(joint, _)| *joint);
            let columns = self.reach(outermost);
            let (residual, derivative) = excursion_residual(self.hand, cable, &state.q, self.posture.excursions[cable]);
            let scale = 1.0 / options.sigma_excursion;
            sink.add(residual * scale, None, columns, &|row| {
                for (joint, arm) in derivative {
                    if let Some(&Some(column)) = column.get(joint) {
                        row[column] += arm * scale;
                    }
                }
            });
            for (joint, residual, slope) in spring_residuals(self.hand, cable, &state.q, self.posture.tensions[cable]) {
                let torque = self.contact_torque(kinematics, joint);
                let scale = 1.0 / self.torque_sigma[joint];
                sink.add((residual - torque) * scale, Some(options.huber), columns, &|row| {
                    self.contact_torque_row(kinematics, joint, -scale, row);
                    if let Some(column) = column[joint] {
                        row[column] += slope * scale;
                    }
                });
                let limits = &self.hand.tree.joints[joint];
                let beyond = state.q[joint] - state.q[joint].clamp(limits.lower, limits.upper);
                if let (true, Some(column)) = (beyond != 0.0, column[joint]) {
                    sink.add(beyond / options.sigma_limit, None, &[column], &|row| {
                        row[column] = 1.0 / options.sigma_limit;
                    });
                }
            }
        }
    }

    fn prior_residuals(&self, state: &State, sink: &mut dyn Sink) {
        let deviation = self.prior.palm_from_object.inverse() * state.pose;
        let turn = deviation.rotation.scaled_axis();
        let rotation = deviation.rotation.to_rotation_matrix();
        // d log(R exp phi) = (1 + [log R]/2 + ...) phi.
        let jacobian = Matrix3::identity() + 0.5 * turn.cross_matrix();
        for axis in 0..3 {
            let scale = 1.0 / self.prior.sigma_translation;
            sink.add(deviation.translation.vector[axis] * scale, None, self.reach(None), &|row| {
                (0..3).for_each(|k| row[k] = rotation[(axis, k)] * scale);
            });
            let scale = 1.0 / self.prior.sigma_rotation;
            sink.add(turn[axis] * scale, None, self.reach(None), &|row| {
                (0..3).for_each(|k| row[3 + k] = jacobian[(axis, k)] * scale);
            });
        }
    }

    #[allow(clippy::too_many_arguments)]
    /// Writes `gradient` of a residual by a point `p` (object frame) that a link carries, times `scale`, into a row.
    fn point_row(
        &self,
        state: &State,
        kinematics: &Kinematics,
        link: Option<usize>,
        p: &Point3<f64>,
        gradient: &Vector3<f64>,
        scale: f64,
        row: &mut [f64],
    ) {
        // p <- p - rho - phi x p, and g . (phi x p) = phi . (p x g).
        let turning = p.coords.cross(gradient);
        for k in 0..3 {
            row[k] -= gradient[k] * scale;
            row[3 + k] -= turning[k] * scale;
        }
        let (palm_point, palm_gradient) = ((state.pose * p).coords, state.pose * gradient);
        for &joint in kinematics.chain(link) {
            if let Some(column) = self.column[joint] {
                row[column] +=
                    kinematics.axes[joint].cross(&(palm_point - kinematics.origin(joint))).dot(&palm_gradient) * scale;
            }
        }
    }

    fn contact_residuals(&self, state: &State, kinematics: &Kinematics, evidence: Evidence, sink: &mut dyn Sink) {
        let soft = evidence == Evidence::Soft;
        let (point_soft, normal_soft) = if soft { (1.0 / 8.0, 1.0 / 2.0) } else { (1.0, 1.0) };
        let huber = (!soft).then_some(self.options.huber);
        let object_from_palm = state.pose.inverse();
        for patch in &self.patches {
            let object_from_link = object_from_palm * kinematics.pose(patch.link);
            let columns = self.reach(patch.link);
            let share = |independent: f64, count: usize| (patch.weight * independent / count as f64).min(1.0).sqrt();
            let each = share(INDEPENDENT_POINTS, patch.points.len()) * point_soft / self.options.sigma_point;
            for (point, trust) in &patch.points {
                let p = object_from_link * point;
                let (distance, gradient) = self.shape.signed_distance(&p);
                let scale = each * trust;
                sink.add(distance * scale, huber, columns, &|row| {
                    self.point_row(state, kinematics, patch.link, &p, &gradient, scale, row);
                });
            }
            let each = share(INDEPENDENT_NORMALS, patch.normals.len()) * normal_soft / self.options.sigma_normal;
            for (point, normal, trust) in &patch.normals {
                let scale = each * trust;
                let (p, n) = (object_from_link * point, object_from_link * normal);
                let gradient = self.shape.signed_distance(&p).1;
                let curvature = if sink.wants_rows() { self.curvature(&p, &gradient) } else { Matrix3::zeros() };
                let palm_normal = state.pose * n;
                for axis in 0..3 {
                    sink.add((n[axis] - gradient[axis]) * scale, huber, columns, &|row| {
                        let bend = -curvature.row(axis).transpose();
                        self.point_row(state, kinematics, patch.link, &p, &bend, scale, row);
                        // n <- n - phi x n; component `axis` of phi x n is phi . (n x e). Taken at the shape's normal, so that
                        // noise in n does not pose as knowledge of the rotation of a ball.
                        let turning = gradient.cross(&Vector3::ith(axis, 1.0));
                        (0..3).for_each(|k| row[3 + k] -= turning[k] * scale);
                        let palm_axis = state.pose * Vector3::ith(axis, 1.0);
                        for &joint in kinematics.chain(patch.link) {
                            if let Some(column) = self.column[joint] {
                                row[column] += kinematics.axes[joint].cross(&palm_normal).dot(&palm_axis) * scale;
                            }
                        }
                    });
                }
            }
        }
    }

    /// Derivative of the shape's normal by the point, 1/m.
    fn curvature(&self, p: &Point3<f64>, gradient: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::from_columns(&[0, 1, 2].map(|axis| {
            let beside = p + Vector3::ith(axis, CURVATURE_STEP);
            (self.shape.signed_distance(&beside).1 - gradient) / CURVATURE_STEP
        }))
    }

    fn clear_residuals(&self, state: &State, kinematics: &Kinematics, sink: &mut dyn Sink) {
        let object_from_palm = state.pose.inverse();
        let scale = 1.0 / self.options.sigma_clear;
        for ClearPad { link, points, middle, radius } in &self.clear {
            let object_from_link = object_from_palm * kinematics.pose(*link);
            if self.shape.signed_distance(&(object_from_link * middle)).0 > 1.1 * radius + 1e-3 {
                continue;
            }
            for point in points {
                let p = object_from_link * point;
                let (distance, gradient) = self.shape.signed_distance(&p);
                if distance < 0.0 {
                    sink.add(distance * scale, Some(self.options.huber), self.reach(*link), &|row| {
                        self.point_row(state, kinematics, *link, &p, &gradient, scale, row);
                    });
                }
            }
        }
    }
}
