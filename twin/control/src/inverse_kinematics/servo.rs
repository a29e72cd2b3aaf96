//! Arm servo: the reference posture of the arm and its step.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};

use super::{ArmKinematics, IkError, IkSettings, Jacobian, JointVector, Joints, QpMethod, bounds, program, wrap};
use crate::Twist;
use crate::trajectory::{PosePath, displacement};

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkStep {
    /// Set-points after the step, rad.
    pub q: Joints,
    /// Joint speeds after the step, rad/s.
    pub qd: Joints,
    /// Distance of the reference palm from the target after the step, m.
    pub position_error: f64,
    /// Angle between the reference palm and the target after the step, rad.
    pub rotation_error: f64,
    /// Share of the desired twist that is carried out, 0 to 1.
    pub speed_scale: f64,
    /// True if limits or a singularity keep the arm from the desired twist: it lags, or the target is out of reach.
    pub saturated: bool,
    /// Method by which the program was solved; with [`QpMethod::Failed`] the arm brakes.
    pub method: QpMethod,
}

/// Tracking errors over a whole path, from a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathRollout {
    /// Largest distance from the path, m.
    pub worst_position_error: f64,
    /// Largest angle from the path, rad.
    pub worst_rotation_error: f64,
    /// Final distance from the path's end, m.
    pub position_error: f64,
    /// Final angle from the path's end, rad.
    pub rotation_error: f64,
    /// Number of ticks, out of `ticks`, in which limits or a singularity held the arm back.
    pub saturated_ticks: usize,
    pub ticks: usize,
    /// Final posture, rad.
    pub q: Joints,
}

/// The arm's reference, moved tick by tick towards palm poses; see the documentation of the parent module. A clone is a
/// full snapshot.
#[derive(Debug, Clone)]
pub struct ArmServo {
    kinematics: ArmKinematics,
    settings: IkSettings,
    /// Comfortable posture, rad.
    comfort: Joints,
    q_ref: Joints,
    qd_ref: Joints,
}

impl ArmServo {
    /// A servo at rest at `q` (rad), which must be within the joint limits and becomes its comfortable posture.
    pub fn new(kinematics: ArmKinematics, settings: IkSettings, q: Joints) -> Result<Self, IkError> {
        kinematics.within_limits(&q, 0.0)?;
        let qd_ref = kinematics.arm().each(|_| 0.0);
        Ok(Self { kinematics, settings, comfort: q, q_ref: q, qd_ref })
    }

    /// Reference posture, rad.
    pub fn q(&self) -> &Joints {
        &self.q_ref
    }

    /// Reference joint speeds, rad/s.
    pub fn qd(&self) -> &Joints {
        &self.qd_ref
    }

    /// `world_from_palm` of the reference.
    pub fn palm_pose(&self) -> Isometry3<f64> {
        self.kinematics.palm_pose(&self.q_ref)
    }

    pub fn kinematics(&self) -> &ArmKinematics {
        &self.kinematics
    }

    pub fn settings(&self) -> &IkSettings {
        &self.settings
    }

    /// Changes the comfortable posture (rad), for instance to a posture planned by [`ArmKinematics::solve`].
    pub fn set_comfort(&mut self, comfort: Joints) {
        self.comfort = comfort;
    }

    /// Moves the reference by one tick of `dt` (s) towards `target` (`world_from_palm` at the end of the tick), which
    /// itself moves with the twist `feedforward` (world axes, at the palm's origin).
    pub fn step(&mut self, target: &Isometry3<f64>, feedforward: &Twist, dt: f64) -> Result<IkStep, IkError> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(IkError::TimeStep(dt));
        }
        if !(target.to_homogeneous().iter().all(|v| v.is_finite()) && feedforward.iter().all(|v| v.is_finite())) {
            return Err(IkError::Target);
        }
        let (palm, jacobian) = self.kinematics.jacobian(&self.q_ref);
        let wanted = self.desired_twist(&palm, target, feedforward, dt);
        let bounds = bounds::speed_bounds(self.kinematics.arm(), &self.settings, &self.q_ref, &self.qd_ref, dt);
        let task = self.weighted_objective(&jacobian, &wanted);
        let solution = program::solve(&task, &bounds);
        let residual = (task.jacobian * solution.qd - task.twist).norm();
        for i in 0..self.q_ref.len() {
            self.qd_ref[i] = solution.qd[i];
            self.q_ref[i] += solution.qd[i] * dt;
        }
        let (shift, turn) = displacement(&self.palm_pose(), target);
        Ok(IkStep {
            q: self.q_ref,
            qd: self.qd_ref,
            position_error: shift.norm(),
            rotation_error: turn.norm(),
            speed_scale: solution.speed_scale,
            saturated: residual > 0.2 * task.twist.norm() + 1e-3 || solution.method == QpMethod::Failed,
            method: solution.method,
        })
    }

    /// Follows `path` with a copy of this servo, in ticks of `dt` (s) and for `settle` (s) beyond its end, to predict
    /// the tracking errors of a motion before it is made. Takes about 4 us per tick.
    pub fn roll_out(&self, path: &PosePath, settle: f64, dt: f64) -> Result<PathRollout, IkError> {
        let mut servo = self.clone();
        let mut out = PathRollout { q: servo.q_ref, ..PathRollout::default() };
        let mut time = 0.0;
        while time < path.duration() + settle {
            time += dt;
            let (target, twist) = path.sample(time);
            let step = servo.step(&target, &twist, dt)?;
            out.worst_position_error = out.worst_position_error.max(step.position_error);
            out.worst_rotation_error = out.worst_rotation_error.max(step.rotation_error);
            out.saturated_ticks += usize::from(step.saturated);
            out.ticks += 1;
            (out.position_error, out.rotation_error, out.q) = (step.position_error, step.rotation_error, step.q);
        }
        Ok(out)
    }

    /// Brakes all joints to rest within their acceleration limits. To be called until `qd` is zero.
    pub fn brake(&mut self, dt: f64) -> Result<Joints, IkError> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(IkError::TimeStep(dt));
        }
        let bounds = bounds::speed_bounds(self.kinematics.arm(), &self.settings, &self.q_ref, &self.qd_ref, dt);
        for i in 0..self.q_ref.len() {
            self.qd_ref[i] = 0f64.clamp(bounds.lower[i], bounds.upper[i]);
            self.q_ref[i] += self.qd_ref[i] * dt;
        }
        Ok(self.q_ref)
    }

    /// Desired twist: feed-forward plus feedback. The feedback slows down in time to stop at the target.
    fn desired_twist(&self, palm: &Isometry3<f64>, target: &Isometry3<f64>, feedforward: &Twist, dt: f64) -> Twist {
        let s = &self.settings;
        let gain = s.gain.min(0.5 / dt);
        let (shift, turn) = displacement(palm, target);
        // Error relative to the target's present pose; `target` is its pose one tick later.
        let shift = shift - feedforward.fixed_rows::<3>(0) * dt;
        let turn = turn - feedforward.fixed_rows::<3>(3) * dt;
        let toward = |error: Vector3<f64>, deceleration: f64| {
            let length = error.norm();
            if length < 1e-15 {
                Vector3::zeros()
            } else {
                error * (gain * length).min((2.0 * deceleration * length).sqrt()) / length
            }
        };
        let cap = |v: Vector3<f64>, limit: f64| v * (limit / v.norm().max(limit));
        let v = cap(toward(shift, s.deceleration) + feedforward.fixed_rows::<3>(0), s.speed);
        let w = cap(toward(turn, s.turn_deceleration) + feedforward.fixed_rows::<3>(3), s.turn_speed);
        Twist::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    fn weighted_objective(&self, jacobian: &Jacobian, wanted: &Twist) -> program::MotionObjective {
        let s = &self.settings;
        let mut weighted = *jacobian;
        weighted.fixed_rows_mut::<3>(3).scale_mut(s.turn_weight);
        let w = s.turn_weight;
        let twist = wanted.component_mul(&Vector6::new(1.0, 1.0, 1.0, w, w, w));
        let square: Matrix6<f64> = weighted * weighted.transpose();
        let smallest = square.symmetric_eigenvalues().min().max(0.0).sqrt();
        let closeness = (1.0 - smallest / s.singular_value).max(0.0);
        let damping = s.damping * s.damping + (s.singular_damping * closeness).powi(2);
        // Comfort motion without the part that moves the palm.
        let arm = self.kinematics.arm();
        let pull = JointVector::from_fn(|i, _| {
            if i >= arm.joints() {
                return 0.0;
            }
            let mut error = self.comfort[i] - self.q_ref[i];
            if !arm.tree.joints[i].lower.is_finite() {
                error = wrap(error);
            }
            (s.comfort_gain * error).clamp(-s.comfort_speed, s.comfort_speed)
        });
        let comfort = (square + Matrix6::identity() * damping)
            .cholesky()
            .map_or_else(JointVector::zeros, |factor| pull - weighted.transpose() * factor.solve(&(weighted * pull)));
        program::MotionObjective { jacobian: weighted, twist, damping, comfort, slowdown: s.slowdown }
    }
}
