//! Cost of a state: the residuals of each kind of evidence with their derivatives.
//!
//! Measured points and normals are transformed to the object frame, where a step changes them by p <- p - rho - phi x p
//! and n <- n - phi x n. The heights of a patch have a common error (the pad's calibration, the level of its surface)
//! that is larger than their individual ones. A patch therefore gives one residual for the mean of its points and one for
//! each point's deviation from it.

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector3};

use super::evidence::ContactFreeSpot;
use super::problem::{EvidenceStage, PoseProblem, PoseState};
use super::system::{Cost, Kinematics, Loss, NormalEquations, ResidualSink};
use crate::posture::{excursion_residual, spring_residuals};

/// Individual error of the points of a patch: a share of their common error, and a floor (m).
const POINT_SIGMA_TERMS: (f64, f64) = (0.5, 5e-5);
/// Largest weight of a patch's points, as a number of independent points.
const MAX_INDEPENDENT_POINTS: f64 = 6.0;
/// Largest weight of a patch's normals, as a number of independent normals.
const MAX_INDEPENDENT_NORMALS: f64 = 2.0;
/// Finite-difference step for the curvature of the shape, m.
const CURVATURE_STEP: f64 = 4e-4;
/// Least standard deviations of heights in the first and the second stage of the search: common to a patch, and of each
/// point, m.
const SOFT_SIGMAS: (f64, f64) = (1.6e-3, 4e-3);
const MIDDLE_SIGMAS: (f64, f64) = (4e-4, 6e-4);
/// Huber threshold of the prior's rotation, in standard deviations: objects roll as the hand closes, so the planned
/// orientation is at times far off.
const ROTATION_HUBER: f64 = 2.0;
/// Stride of the points of a patch and of contact-free surface in the first stage.
const SOFT_STRIDE: usize = 3;
/// Indentation below which a contact may remain undetected, m.
const UNDETECTED_DEPTH: f64 = 1.5e-4;

/// A state with the link poses that follow from it.
#[derive(Clone, Copy)]
struct Posed<'a> {
    state: &'a PoseState,
    kinematics: &'a Kinematics<'a>,
}

/// The robust cost of a state to second order.
pub(crate) struct LinearisedCost {
    /// Cost as of [`PoseProblem::cost`], to the bit.
    pub cost: f64,
    /// Gauss-Newton matrix, lower triangle.
    pub hessian: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

fn infinite_if_nan(cost: f64) -> f64 {
    if cost.is_nan() { f64::INFINITY } else { cost }
}

impl PoseProblem<'_> {
    /// Robust cost of a state.
    pub(crate) fn cost(&self, state: &PoseState, evidence: EvidenceStage) -> f64 {
        let mut sink = Cost(0.0);
        self.residuals(state, evidence, &mut sink);
        infinite_if_nan(sink.0)
    }

    /// Cost of a state, with its gradient and its Gauss-Newton matrix.
    pub(crate) fn linearise(&self, state: &PoseState, evidence: EvidenceStage) -> LinearisedCost {
        let n = self.columns;
        let held = match evidence {
            EvidenceStage::Joints | EvidenceStage::Posture => 0..6,
            EvidenceStage::Translation => 3..6,
            EvidenceStage::Soft | EvidenceStage::Middle | EvidenceStage::All => 0..0,
        };
        let mut sink = NormalEquations::new(n, held.clone());
        self.residuals(state, evidence, &mut sink);
        for k in held {
            sink.hessian[(k, k)] = 1.0;
        }
        LinearisedCost { cost: infinite_if_nan(sink.cost), hessian: sink.hessian, gradient: sink.gradient }
    }

    /// Adds all residuals of `evidence` to `sink`.
    fn residuals(&self, state: &PoseState, evidence: EvidenceStage, sink: &mut dyn ResidualSink) {
        let kinematics = Kinematics::new(self.hand, &self.chains, &state.q);
        let posed = Posed { state, kinematics: &kinematics };
        self.joint_residuals(posed, sink);
        if evidence != EvidenceStage::Joints {
            self.prior_residuals(state, sink);
            self.contact_residuals(posed, evidence, sink);
            self.contact_free_residuals(posed, evidence, sink);
        }
    }

    fn joint_residuals(&self, Posed { state, kinematics }: Posed, sink: &mut dyn ResidualSink) {
        let (options, column) = (self.options, &self.column);
        for &cable in &self.cables {
            // A cable's joints are all estimated: their columns are those of the outermost joint's link.
            let outermost = self.hand.transmission.cables[cable].joints.last().map(|crossing| crossing.joint);
            let columns = self.reach(outermost);
            let (residual, derivative) = excursion_residual(self.hand, cable, &state.q, self.posture.excursions[cable]);
            let scale = 1.0 / self.excursion_sigma;
            sink.add(residual * scale, Loss::Square, columns, &|row| {
                for (joint, arm) in derivative {
                    if let Some(&Some(column)) = column.get(joint) {
                        row[column] += arm * scale;
                    }
                }
            });
            for (joint, residual, slope) in spring_residuals(self.hand, cable, &state.q, self.posture.tensions[cable]) {
                let torque = self.contact_torque(kinematics, joint) + self.gravity_torques[joint];
                let scale = 1.0 / self.torque_sigma[joint];
                sink.add((residual - torque) * scale, Loss::Huber(options.huber), columns, &|row| {
                    self.contact_torque_row(kinematics, joint, -scale, row);
                    if let Some(column) = column[joint] {
                        row[column] += slope * scale;
                    }
                });
                let limits = &self.hand.tree.joints[joint];
                let beyond = state.q[joint] - state.q[joint].clamp(limits.lower, limits.upper);
                if let (true, Some(column)) = (beyond != 0.0, column[joint]) {
                    sink.add(beyond / options.sigma_limit, Loss::Square, &[column], &|row| {
                        row[column] = 1.0 / options.sigma_limit;
                    });
                }
            }
        }
    }

    fn prior_residuals(&self, state: &PoseState, sink: &mut dyn ResidualSink) {
        let deviation = self.prior.palm_from_object.inverse() * state.pose;
        let turn = deviation.rotation.scaled_axis();
        let rotation = deviation.rotation.to_rotation_matrix();
        // d log(R exp phi) = (1 + [log R]/2 + ...) phi.
        let jacobian = Matrix3::identity() + 0.5 * turn.cross_matrix();
        for axis in 0..3 {
            let scale = 1.0 / self.prior.sigma_translation;
            sink.add(deviation.translation.vector[axis] * scale, Loss::Square, self.reach(None), &|row| {
                (0..3).for_each(|k| row[k] = rotation[(axis, k)] * scale);
            });
            let scale = 1.0 / self.prior.sigma_rotation;
            sink.add(turn[axis] * scale, Loss::Huber(ROTATION_HUBER), self.reach(None), &|row| {
                (0..3).for_each(|k| row[3 + k] = jacobian[(axis, k)] * scale);
            });
        }
    }

    /// Adds the derivative of a residual with the sensitivity `pull`, times `scale`, to a row.
    fn sensitivity_row(&self, posed: Posed, link: Option<usize>, pull: &PointSensitivity, scale: f64, row: &mut [f64]) {
        let Posed { state, kinematics } = posed;
        for k in 0..3 {
            row[k] -= pull.gradient[k] * scale;
            row[3 + k] -= pull.moment[k] * scale;
        }
        let gradient = state.pose * pull.gradient;
        let moment = state.pose * pull.moment + state.pose.translation.vector.cross(&gradient);
        for &joint in kinematics.chain(link) {
            if let Some(column) = self.column[joint] {
                let turning = moment - kinematics.origin(joint).cross(&gradient);
                row[column] += kinematics.axes[joint].dot(&turning) * scale;
            }
        }
    }

    fn contact_residuals(&self, posed: Posed, evidence: EvidenceStage, sink: &mut dyn ResidualSink) {
        let Posed { state, kinematics } = posed;
        // Least standard deviations of a patch's common error and of a point; weight of normals.
        let (least, least_relief, normal_soft) = match evidence {
            EvidenceStage::Soft => (SOFT_SIGMAS.0, SOFT_SIGMAS.1, 0.5),
            EvidenceStage::Middle => (MIDDLE_SIGMAS.0, MIDDLE_SIGMAS.1, 1.0),
            _ => (0.0, 0.0, 1.0),
        };
        let huber = (Loss::Huber(self.options.huber), 1);
        let (loss, every) = if evidence == EvidenceStage::Soft { (Loss::Square, SOFT_STRIDE) } else { huber };
        for (n, pad) in self.pressed.iter().enumerate() {
            let column = self.columns - self.pressed.len() + n;
            sink.add((state.lift[n] - pad.lift) / pad.sigma, loss, &[column], &|row| row[column] = 1.0 / pad.sigma);
        }
        let object_from_palm = state.pose.inverse();
        let mut pulls: Vec<(f64, f64, PointSensitivity)> = Vec::with_capacity(16);
        for patch in &self.patches {
            let object_from_link = object_from_palm * kinematics.pose(patch.link);
            let columns: &[usize] = &self.pressed_reach[patch.pressed];
            let lift_column = columns[columns.len() - 1];
            let out = object_from_link * self.pressed[patch.pressed].normal;
            let lift = self.lift(state, patch.pressed);
            pulls.clear();
            let (mut whole, mut mean, mut common) = (0.0, 0.0, PointSensitivity::ZERO);
            for (point, trust) in patch.points.iter().step_by(every) {
                let p = object_from_link * (point + lift);
                let (distance, gradient) = self.shape.signed_distance(&p);
                let pull = PointSensitivity { gradient, moment: p.coords.cross(&gradient) };
                let weight = trust * trust;
                whole += weight;
                mean += weight * distance;
                common.add(&pull, weight);
                pulls.push((distance, *trust, pull));
            }
            mean /= whole;
            let common = common.scaled(1.0 / whole);
            let scale = patch.weight.sqrt() / patch.sigma.max(least);
            sink.add(mean * scale, loss, columns, &|row| {
                self.sensitivity_row(posed, patch.link, &common, scale, row);
                row[lift_column] += common.gradient.dot(&out) * scale;
            });
            let share = |independent: f64, count: usize| (patch.weight * independent / count as f64).min(1.0).sqrt();
            let relief = POINT_SIGMA_TERMS.1.hypot(POINT_SIGMA_TERMS.0 * patch.sigma).max(least_relief);
            let each = share(MAX_INDEPENDENT_POINTS, pulls.len()) / relief;
            for (distance, trust, pull) in &pulls {
                let scale = each * trust;
                sink.add((distance - mean) * scale, loss, columns, &|row| {
                    let mut own = pull.clone();
                    own.add(&common, -1.0);
                    self.sensitivity_row(posed, patch.link, &own, scale, row);
                    row[lift_column] += own.gradient.dot(&out) * scale;
                });
            }
            let each = share(MAX_INDEPENDENT_NORMALS, patch.normals.len()) * normal_soft / self.options.sigma_normal;
            for (point, normal, trust) in &patch.normals {
                let scale = each * trust;
                let (p, n) = (object_from_link * (point + lift), object_from_link * normal);
                let gradient = self.shape.signed_distance(&p).1;
                let curvature = if sink.wants_rows() { self.curvature(&p, &gradient) } else { Matrix3::zeros() };
                let palm_normal = state.pose * n;
                for axis in 0..3 {
                    sink.add((n[axis] - gradient[axis]) * scale, loss, columns, &|row| {
                        let bend: Vector3<f64> = -curvature.row(axis).transpose();
                        let pull = PointSensitivity { gradient: bend, moment: p.coords.cross(&bend) };
                        self.sensitivity_row(posed, patch.link, &pull, scale, row);
                        // n <- n - phi x n; component `axis` of phi x n is phi . (n x e). Evaluated at the shape's
                        // normal, so that noise in n does not appear as information on the rotation of a ball.
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

    /// Derivative of the shape's normal with respect to the point, 1/m.
    fn curvature(&self, p: &Point3<f64>, gradient: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::from_columns(&[0, 1, 2].map(|axis| {
            let beside = p + Vector3::ith(axis, CURVATURE_STEP);
            (self.shape.signed_distance(&beside).1 - gradient) / CURVATURE_STEP
        }))
    }

    fn contact_free_residuals(&self, posed: Posed, evidence: EvidenceStage, sink: &mut dyn ResidualSink) {
        let Posed { state, kinematics } = posed;
        let every = if evidence == EvidenceStage::Soft { SOFT_STRIDE } else { 1 };
        let object_from_palm = state.pose.inverse();
        let scale = 1.0 / self.options.sigma_contact_free;
        for ContactFreeSpot { link, pressed, points, middle, radius } in &self.contact_free {
            let object_from_link = object_from_palm * kinematics.pose(*link);
            let lift = pressed
                .map_or(Vector3::zeros(), |n| self.pressed[n].normal * (state.lift[n] - UNDETECTED_DEPTH).max(0.0));
            if self.shape.distance(&(object_from_link * (middle + lift))) > radius + 5e-4 {
                continue;
            }
            let columns = pressed.map_or_else(|| self.reach(*link), |n| &self.pressed_reach[n]);
            for point in points.iter().step_by(every) {
                let p = object_from_link * (point + lift);
                let distance = self.shape.distance(&p);
                if distance < 0.0 {
                    sink.add(distance * scale, Loss::Huber(self.options.huber), columns, &|row| {
                        let gradient = self.shape.signed_distance(&p).1;
                        let pull = PointSensitivity { gradient, moment: p.coords.cross(&gradient) };
                        self.sensitivity_row(posed, *link, &pull, scale, row);
                        if let Some(n) = pressed {
                            let out = object_from_link * self.pressed[*n].normal;
                            row[columns[columns.len() - 1]] += gradient.dot(&out) * scale;
                        }
                    });
                }
            }
        }
    }
}

/// Sensitivity of a residual to the motion of a point: its gradient, and the gradient's moment about the object's origin,
/// object frame. From p <- p - rho - phi x p and g . (phi x p) = phi . (p x g).
#[derive(Clone)]
struct PointSensitivity {
    gradient: Vector3<f64>,
    moment: Vector3<f64>,
}

impl PointSensitivity {
    const ZERO: Self = Self { gradient: Vector3::new(0.0, 0.0, 0.0), moment: Vector3::new(0.0, 0.0, 0.0) };

    fn add(&mut self, other: &Self, weight: f64) {
        self.gradient += other.gradient * weight;
        self.moment += other.moment * weight;
    }

    fn scaled(&self, factor: f64) -> Self {
        Self { gradient: self.gradient * factor, moment: self.moment * factor }
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;
    use hand_model::robot::ServoState;
    use nalgebra::{DVector, Isometry3, UnitQuaternion, Vector2};
    use proptest::prelude::*;

    use super::super::inputs::{PoseInputs, PoseOptions, PosePrior};
    use super::super::shape::KnownShape;
    use super::*;
    use crate::contacts::{ContactPatch, SurfacePoint};
    use crate::pad_touch::PadTouch;
    use crate::posture::Readings;

    struct Ellipsoid(Vector3<f64>);
    impl KnownShape for Ellipsoid {
        /// A function with the ellipsoid as its zero set, and its true gradient; derivatives need no more.
        fn signed_distance(&self, p: &Point3<f64>) -> (f64, Vector3<f64>) {
            let inner = p.coords.component_div(&self.0);
            let (norm, least) = (inner.norm(), self.0.min());
            (least * (norm - 1.0), least * inner.component_div(&self.0) / norm)
        }
    }

    /// A touch in the middle of pad `name` with free surface around.
    fn touch(hand: &Hand, name: &str, peak: f64) -> PadTouch {
        let pad = hand.find_pad(name).expect("a pad");
        let surface = |x: f64, y: f64, z: f64| SurfacePoint {
            point: Point3::new(x * 1e-3, y * 1e-3, -z * peak),
            normal: Vector3::new(0.1 * x, 0.1 * y, -1.0).normalize(),
        };
        let points = vec![
            surface(0.0, 0.0, 1.0),
            surface(1.0, 0.3, 0.8),
            surface(-1.0, 0.6, 0.7),
            surface(0.4, 1.1, 0.9),
            surface(-0.2, -1.3, 0.6),
        ];
        let patch = ContactPatch {
            camera: hand.pads[pad].cameras[0],
            area: 2e-5,
            centroid: points[0].point,
            axes: [Vector2::x(), Vector2::y()],
            extent: [1e-3, 1e-3],
            normal: -Vector3::z(),
            force: 1.2,
            peak,
            points,
            self_contact: false,
        };
        let clear = (-3..=3).flat_map(|x| (-4..=4).map(move |y| Point3::new(2e-3 * x as f64, 2e-3 * y as f64, 0.0)));
        PadTouch { pad, patches: vec![patch], force: 1.2, contact_free: clear.collect(), ..PadTouch::default() }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// The gradient of the cost agrees with finite differences, for the pose, the joints and the lifts, at states
        /// in which every kind of evidence takes part. (Normals are left out, because their derivative is taken at the
        /// shape's normal on purpose.)
        #[test]
        fn the_gradient_is_that_of_the_cost(
            shift in prop::array::uniform3(-2e-3..2e-3f64), turn in prop::array::uniform3(-0.1..0.1f64),
            bend in 0.2..0.9f64, lift in 0.2e-3..1.5e-3f64, sinking in 0.0..1.0f64,
        ) {
            let hand = Hand::ftac();
            let touches = [touch(&hand, "palm_ulnar", 8e-4), touch(&hand, "ring_distal", 6e-4)];
            let shape = Ellipsoid(Vector3::new(0.03, 0.024, 0.026));
            let options = PoseOptions { penetration_share: sinking, sigma_normal: f64::INFINITY, ..PoseOptions::default() };
            let servos = [ServoState { position: 1.0, current: 0.1, ..ServoState::default() }; 6];
            let palm = hand.pad_poses(&hand.tree.forward(&[bend; 15]));
            // Slightly inside the palm pad: contact points are off the surface, and contact-free points are inside.
            let middle = palm[hand.find_pad("palm_ulnar").expect("a pad")] * Point3::new(0.0, 0.0, 0.024);
            let pose = Isometry3::from_parts((middle.coords + Vector3::from(shift)).into(), UnitQuaternion::identity());
            let prior = PosePrior::weak(pose * Isometry3::new(Vector3::new(4e-3, -6e-3, 2e-3), Vector3::from(turn) * 0.3));
            let problem = PoseProblem::new(&PoseInputs {
                hand: &hand,
                touches: &touches,
                readings: Readings::without_gravity(&servos),
                prior: &prior,
                shape: &shape,
                options: &options,
            });
            let mut state = PoseState { q: hand.each_joint(|_| bend), ..problem.start(pose) };
            state.lift[..2].fill(lift);
            for evidence in [EvidenceStage::Soft, EvidenceStage::Middle, EvidenceStage::All] {
                let LinearisedCost { cost, gradient, .. } = problem.linearise(&state, evidence);
                prop_assert_eq!(cost.to_bits(), problem.cost(&state, evidence).to_bits());
                for k in 0..gradient.len() {
                    let step = if (3..gradient.len() - 2).contains(&k) { 1e-7 } else { 1e-9 };
                    let cost = |sign: f64| {
                        let mut by = DVector::zeros(gradient.len());
                        by[k] = sign * step;
                        problem.cost(&problem.moved(&state, &by), evidence)
                    };
                    let slope = (cost(1.0) - cost(-1.0)) / (2.0 * step);
                    let size = gradient.amax().max(1.0);
                    prop_assert!((slope - gradient[k]).abs() < 5e-3 * gradient[k].abs() + 1e-3 * size, "{k}: {slope} {}", gradient[k]);
                }
            }
        }
    }
}
