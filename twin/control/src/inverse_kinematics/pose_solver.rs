//! Pose solver: joint angles for a palm pose, by damped least squares from several seeds. Deterministic.

use std::f64::consts::{PI, TAU};

use hand_model::arm::MAX_ARM_JOINTS;
use nalgebra::{Isometry3, Matrix6, Vector6};

use super::{ArmKinematics, Joints, wrap};
use crate::trajectory::displacement;

/// Tolerances within which a pose counts as reached (m, rad).
const POSITION_TOLERANCE: f64 = 1e-6;
const ROTATION_TOLERANCE: f64 = 1e-5;
/// Distance kept from position limits, rad.
const LIMIT_MARGIN: f64 = 0.01;
const MAX_ITERATIONS: usize = 80;
/// Stopping rule: a descent ends if the error has not fallen below this share of its value this many steps earlier. All
/// of 566 reachable palm poses over the table are still found, some from other seeds. Unreachable poses take a third of
/// the steps.
const STALL_CRITERION: (f64, usize) = (0.9, 10);
/// Number of evenly distributed seeds that are tried after the given ones.
const EXTRA_SEED_COUNT: u32 = 40;
/// Weight of a radian relative to a metre.
const ROTATION_WEIGHT: f64 = 0.25;

impl ArmKinematics {
    /// Finds joint angles (rad) within limits that put the palm at `world_from_palm`; `None` if no seed leads there.
    /// The solution reached from `seed` is preferred. Continuous joints are turned to within half a turn of `seed`.
    pub fn solve(&self, world_from_palm: &Isometry3<f64>, seed: &Joints) -> Option<Joints> {
        self.seeds(seed).find_map(|start| self.descend(world_from_palm, start)).map(|q| self.wrapped_near(q, seed))
    }

    /// Finds all distinct postures (more than 0.05 rad apart) that the seeds lead to, that of `seed` first.
    pub fn solutions(&self, world_from_palm: &Isometry3<f64>, seed: &Joints) -> Vec<Joints> {
        let mut found: Vec<Joints> = Vec::new();
        for q in self.seeds(seed).filter_map(|start| self.descend(world_from_palm, start)) {
            let q = self.wrapped_near(q, seed);
            if found.iter().all(|other| (0..q.len()).any(|i| wrap(q[i] - other[i]).abs() > 0.05)) {
                found.push(q);
            }
        }
        found
    }

    fn seeds(&self, seed: &Joints) -> impl Iterator<Item = Joints> + '_ {
        const PRIMES: [u32; MAX_ARM_JOINTS] = [2, 3, 5, 7, 11, 13, 17];
        let home = self.arm.home;
        // The three wrist joints turned to their other solution.
        let mirrored = home.iter().enumerate().map(|(i, &angle)| match home.len() - i {
            1 | 3 => angle + PI,
            2 => -angle,
            _ => angle,
        });
        let spread = (1..=EXTRA_SEED_COUNT).map(|n| {
            self.arm.each(|i| {
                let joint = &self.arm.tree.joints[i];
                let (lower, upper) = if joint.lower.is_finite() { (joint.lower, joint.upper) } else { (-PI, PI) };
                lower + (upper - lower) * (0.05 + 0.9 * halton(n, PRIMES[i]))
            })
        });
        [*seed, home, mirrored.collect()].into_iter().chain(spread)
    }

    /// Damped least squares with projection onto the limits.
    fn descend(&self, target: &Isometry3<f64>, mut q: Joints) -> Option<Joints> {
        let mut damping = 1e-3;
        let mut last = f64::INFINITY;
        // Smallest error up to each step.
        let mut least = [f64::INFINITY; MAX_ITERATIONS];
        for n in 0..MAX_ITERATIONS {
            let (palm, mut jacobian) = self.jacobian(&q);
            let (shift, turn) = displacement(&palm, target);
            if shift.norm() < POSITION_TOLERANCE && turn.norm() < ROTATION_TOLERANCE {
                return self.within_limits(&q, 0.0).is_ok().then_some(q);
            }
            let error = Vector6::new(
                shift.x,
                shift.y,
                shift.z,
                turn.x * ROTATION_WEIGHT,
                turn.y * ROTATION_WEIGHT,
                turn.z * ROTATION_WEIGHT,
            );
            jacobian.fixed_rows_mut::<3>(3).scale_mut(ROTATION_WEIGHT);
            damping = if error.norm() < last { (damping * 0.4f64).max(1e-9) } else { (damping * 4.0).min(1e-1) };
            last = error.norm();
            least[n] = n.checked_sub(1).map_or(last, |before| last.min(least[before]));
            if n.checked_sub(STALL_CRITERION.1).is_some_and(|before| least[n] > STALL_CRITERION.0 * least[before]) {
                return None;
            }
            let square: Matrix6<f64> = jacobian * jacobian.transpose() + Matrix6::identity() * damping;
            let step = jacobian.transpose() * square.cholesky()?.solve(&error);
            let scale = 0.5 / step.amax().max(0.5);
            for i in 0..q.len() {
                let joint = &self.arm.tree.joints[i];
                q[i] = (q[i] + step[i] * scale).clamp(joint.lower + LIMIT_MARGIN, joint.upper - LIMIT_MARGIN);
            }
        }
        None
    }

    /// Turns continuous joints to within half a turn of `seed`.
    fn wrapped_near(&self, mut q: Joints, seed: &Joints) -> Joints {
        for i in 0..q.len() {
            if !self.arm.tree.joints[i].lower.is_finite() {
                q[i] -= TAU * ((q[i] - seed[i]) / TAU).round();
            }
        }
        q
    }
}

/// Element `n` of the van der Corput sequence in `base`.
fn halton(mut n: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while n > 0 {
        digit /= f64::from(base);
        value += digit * f64::from(n % base);
        n /= base;
    }
    value
}
