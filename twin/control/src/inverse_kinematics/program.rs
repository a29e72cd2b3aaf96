//! Quadratic program of a tick. Its variables are the joint speeds and the speed scale. Joints that an arm lacks stay
//! at 0.
//!
//! If the unconstrained minimum lies within the bounds, it is the answer, and a Cholesky factorisation gives it.
//! Otherwise the projected Newton method (Bertsekas 1982) finds the minimum: the program is strictly convex and every
//! bound is on one variable. An interior-point solver, the reference of the tests, takes ten times as long.

use hand_model::arm::MAX_ARM_JOINTS;
use nalgebra::{SMatrix, SVector, Vector6};

use super::bounds::SpeedBounds;
use super::{Jacobian, JointVector};

const VARIABLE_COUNT: usize = MAX_ARM_JOINTS + 1;
type Variables = SVector<f64, VARIABLE_COUNT>;
type Hessian = SMatrix<f64, VARIABLE_COUNT, VARIABLE_COUNT>;
/// Largest number of Newton steps, and the step (rad/s) below which the minimum counts as found.
const MAX_NEWTON_STEPS: usize = 50;
const STEP_TOLERANCE: f64 = 1e-12;
/// Share of the predicted decrease that a step must achieve, and the smallest fraction of a step that is tried; below
/// it only rounding errors are left.
const MIN_DECREASE_SHARE: f64 = 1e-4;
const MIN_STEP_FRACTION: f64 = 1e-9;

/// Method by which the program of a tick was solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QpMethod {
    /// No bound is active: solved in closed form.
    Unconstrained,
    /// At least one bound is active.
    Bounded,
    /// The solver gave up, and the joints brake.
    Failed,
}

/// Terms of the cost; see the documentation of the parent module.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MotionObjective {
    /// Weighted Jacobian and twist.
    pub jacobian: Jacobian,
    pub twist: Vector6<f64>,
    pub damping: f64,
    pub comfort: JointVector,
    pub slowdown: f64,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Solution {
    pub qd: JointVector,
    pub speed_scale: f64,
    pub method: QpMethod,
}

pub(crate) fn solve(task: &MotionObjective, bounds: &SpeedBounds) -> Solution {
    let (hessian, gradient) = cost(task);
    let clamped = |x: &Variables, path| Solution {
        qd: JointVector::from_fn(|i, _| x[i].clamp(bounds.lower[i], bounds.upper[i])),
        speed_scale: x[VARIABLE_COUNT - 1].clamp(0.0, 1.0),
        method: path,
    };
    let Some(factor) = hessian.cholesky() else { return clamped(&Variables::zeros(), QpMethod::Failed) };
    let free = -factor.solve(&gradient);
    let inside = (0..VARIABLE_COUNT - 1).all(|i| bounds.lower[i] <= free[i] && free[i] <= bounds.upper[i]);
    if inside && (-1e-9..=1.0 + 1e-9).contains(&free[VARIABLE_COUNT - 1]) {
        return clamped(&free, QpMethod::Unconstrained);
    }
    minimise_bounded(&hessian, &gradient, bounds, &free)
        .map_or_else(|| clamped(&Variables::zeros(), QpMethod::Failed), |x| clamped(&x, QpMethod::Bounded))
}

/// Hessian and gradient of the cost.
fn cost(task: &MotionObjective) -> (Hessian, Variables) {
    let mut rows = SMatrix::<f64, 6, VARIABLE_COUNT>::zeros();
    rows.fixed_columns_mut::<MAX_ARM_JOINTS>(0).copy_from(&task.jacobian);
    rows.set_column(VARIABLE_COUNT - 1, &-task.twist);
    let mut hessian = rows.transpose() * rows;
    let mut gradient = Variables::zeros();
    for i in 0..VARIABLE_COUNT - 1 {
        hessian[(i, i)] += task.damping;
        gradient[i] = -task.damping * task.comfort[i];
    }
    let slow = task.slowdown * task.twist.norm_squared() + 1e-6;
    hessian[(VARIABLE_COUNT - 1, VARIABLE_COUNT - 1)] += slow;
    gradient[VARIABLE_COUNT - 1] = -slow;
    (hessian, gradient)
}

/// Minimises `x H x / 2 + g x` within bounds, starting at `start`. In each step the variables that their bounds hold
/// back stay there. The others take a Newton step, clipped to the bounds and halved until the cost falls. `None` if no
/// minimum is found.
fn minimise_bounded(
    hessian: &Hessian,
    gradient: &Variables,
    bounds: &SpeedBounds,
    start: &Variables,
) -> Option<Variables> {
    let lower = Variables::from_fn(|i, _| if i < VARIABLE_COUNT - 1 { bounds.lower[i] } else { 0.0 });
    let upper = Variables::from_fn(|i, _| if i < VARIABLE_COUNT - 1 { bounds.upper[i] } else { 1.0 });
    let within = |x: Variables| x.zip_zip_map(&lower, &upper, f64::clamp);
    let cost = |x: &Variables| x.dot(&(0.5 * (hessian * x) + gradient));
    let mut x = within(*start);
    for _ in 0..MAX_NEWTON_STEPS {
        let slope = hessian * x + gradient;
        let (mut reduced, mut right) = (*hessian, -slope);
        for i in 0..VARIABLE_COUNT {
            if x[i] <= lower[i] && slope[i] > 0.0 || x[i] >= upper[i] && slope[i] < 0.0 {
                reduced.row_mut(i).fill(0.0);
                reduced.column_mut(i).fill(0.0);
                (reduced[(i, i)], right[i]) = (1.0, 0.0);
            }
        }
        let newton = reduced.cholesky()?.solve(&right);
        let (before, mut share) = (cost(&x), 1.0);
        let next = loop {
            let next = within(x + newton * share);
            if cost(&next) <= before + MIN_DECREASE_SHARE * slope.dot(&(next - x)) {
                break next;
            }
            share *= 0.5;
            if share < MIN_STEP_FRACTION {
                return Some(x);
            }
        };
        let moved = (next - x).amax();
        x = next;
        if moved < STEP_TOLERANCE {
            return Some(x);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};
    use proptest::prelude::*;

    use super::*;

    /// Finds the same minimum by an interior-point solver.
    fn by_interior_points(hessian: &Hessian, gradient: &Variables, bounds: &SpeedBounds) -> Variables {
        // Upper triangle by columns.
        let upper_triangle = || (0..VARIABLE_COUNT).flat_map(|column| (0..=column).map(move |row| (row, column)));
        let starts = (0..=VARIABLE_COUNT).map(|column| column * (column + 1) / 2).collect();
        let values = upper_triangle().map(|at| hessian[at]).collect();
        let p = CscMatrix::new(
            VARIABLE_COUNT,
            VARIABLE_COUNT,
            starts,
            upper_triangle().map(|(row, _)| row).collect(),
            values,
        );
        // x <= upper and -x <= -lower, both rows of a variable in one column.
        let both = (0..VARIABLE_COUNT).flat_map(|i| [i, VARIABLE_COUNT + i]).collect();
        let a = CscMatrix::new(
            2 * VARIABLE_COUNT,
            VARIABLE_COUNT,
            (0..=VARIABLE_COUNT).map(|i| 2 * i).collect(),
            both,
            [1.0, -1.0].repeat(VARIABLE_COUNT),
        );
        let upper = (0..VARIABLE_COUNT).map(|i| if i < VARIABLE_COUNT - 1 { bounds.upper[i] } else { 1.0 });
        let lower = (0..VARIABLE_COUNT).map(|i| if i < VARIABLE_COUNT - 1 { -bounds.lower[i] } else { 0.0 });
        let b: Vec<f64> = upper.chain(lower).collect();
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: 1e-11,
            tol_gap_rel: 1e-11,
            tol_feas: 1e-11,
            ..DefaultSettings::default()
        };
        let cones = [SupportedConeT::NonnegativeConeT(2 * VARIABLE_COUNT)];
        let mut solver = DefaultSolver::new(&p, gradient.as_slice(), &a, &b, &cones, settings).expect("a program");
        solver.solve();
        Variables::from_column_slice(&solver.solution.x)
    }

    proptest! {
        /// Bounds hold, and the cost is no higher than that of the interior-point solution.
        #[test]
        fn the_minimum_is_that_of_an_interior_point_solver(
            raw in proptest::collection::vec(-1.0f64..1.0, 42 + 6 + 7 + 14), damping in 1e-5f64..0.02, slowdown in 0.01f64..2.0,
        ) {
            let task = MotionObjective {
                jacobian: Jacobian::from_column_slice(&raw[..42]),
                twist: Vector6::from_column_slice(&raw[42..48]),
                damping,
                comfort: 0.3 * JointVector::from_column_slice(&raw[48..55]),
                slowdown,
            };
            let bounds = SpeedBounds {
                lower: JointVector::from_fn(|i, _| raw[55 + i].min(raw[62 + i])),
                upper: JointVector::from_fn(|i, _| raw[55 + i].max(raw[62 + i])),
            };
            let (hessian, gradient) = cost(&task);
            let free = -hessian.cholesky().expect("positive definite").solve(&gradient);
            let found = minimise_bounded(&hessian, &gradient, &bounds, &free).expect("found");
            let exact = by_interior_points(&hessian, &gradient, &bounds);
            let value = |x: &Variables| x.dot(&(0.5 * (hessian * x) + gradient));
            prop_assert!(value(&found) < value(&exact) + 1e-9, "{found} {exact}");
            prop_assert!((0..VARIABLE_COUNT - 1).all(|i| bounds.lower[i] <= found[i] && found[i] <= bounds.upper[i]));
            prop_assert!((0.0..=1.0).contains(&found[VARIABLE_COUNT - 1]));
        }
    }
}
