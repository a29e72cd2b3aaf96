//! The quadratic program of a tick, in eight variables: seven joint speeds and the speed scale.
//!
//! Where the minimum without bounds lies inside them it is the answer, and a Cholesky factor gives it; otherwise clarabel
//! solves the program, built anew so that nothing but the reference is state.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{SMatrix, SVector, Vector6};

use super::bounds::SpeedBounds;
use super::{Jacobian, Vector7};

const N: usize = 8;
/// Width (rad/s) that a bound pair is widened by, so that the interior is not empty.
const WIDEN: f64 = 1e-7;
/// Costs are scaled by this, so that the smallest weights stand well clear of the tolerances.
const SCALE: f64 = 100.0;

/// How a tick's program was solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QpPath {
    /// No bound is active: in closed form.
    Interior,
    /// By the interior-point solver.
    Bounded,
    /// The solver gave up; the joints brake.
    Failed,
}

/// What to minimise; see the module page above.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Task {
    /// Weighted Jacobian and twist.
    pub jacobian: Jacobian,
    pub twist: Vector6<f64>,
    pub damping: f64,
    pub comfort: Vector7,
    pub slowdown: f64,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Solution {
    pub qd: Vector7,
    pub speed_scale: f64,
    pub path: QpPath,
}

pub(crate) fn solve(task: &Task, bounds: &SpeedBounds) -> Solution {
    let (hessian, gradient) = cost(task);
    let clamped = |x: &[f64], path| Solution {
        qd: Vector7::from_fn(|i, _| x[i].clamp(bounds.lower[i], bounds.upper[i])),
        speed_scale: x[N - 1].clamp(0.0, 1.0),
        path,
    };
    if let Some(factor) = hessian.cholesky() {
        let x = -factor.solve(&gradient);
        let inside = (0..N - 1).all(|i| bounds.lower[i] <= x[i] && x[i] <= bounds.upper[i]);
        if inside && (-1e-9..=1.0 + 1e-9).contains(&x[N - 1]) {
            return clamped(x.as_slice(), QpPath::Interior);
        }
    }
    bounded(&hessian, &gradient, bounds)
        .map_or_else(|| clamped(&[0.0; N], QpPath::Failed), |x| clamped(&x, QpPath::Bounded))
}

/// Hessian and gradient of the cost.
fn cost(task: &Task) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let mut rows = SMatrix::<f64, 6, N>::zeros();
    rows.fixed_columns_mut::<7>(0).copy_from(&task.jacobian);
    rows.set_column(N - 1, &-task.twist);
    let mut hessian = rows.transpose() * rows;
    let mut gradient = SVector::<f64, N>::zeros();
    for i in 0..N - 1 {
        hessian[(i, i)] += task.damping;
        gradient[i] = -task.damping * task.comfort[i];
    }
    let slow = task.slowdown * task.twist.norm_squared() + 1e-6;
    hessian[(N - 1, N - 1)] += slow;
    gradient[N - 1] = -slow;
    (hessian * SCALE, gradient * SCALE)
}

fn bounded(hessian: &SMatrix<f64, N, N>, gradient: &SVector<f64, N>, bounds: &SpeedBounds) -> Option<Vec<f64>> {
    // Upper triangle by columns.
    let mut starts = vec![0];
    let (mut rows, mut values) = (Vec::with_capacity(36), Vec::with_capacity(36));
    for column in 0..N {
        for row in 0..=column {
            rows.push(row);
            values.push(hessian[(row, column)]);
        }
        starts.push(rows.len());
    }
    let p = CscMatrix::new(N, N, starts, rows, values);
    // x <= upper and -x <= -lower, both rows of a variable in one column.
    let a = CscMatrix::new(
        2 * N,
        N,
        (0..=N).map(|i| 2 * i).collect(),
        (0..N).flat_map(|i| [i, N + i]).collect(),
        (0..N).flat_map(|_| [1.0, -1.0]).collect(),
    );
    let upper = |i: usize| if i < N - 1 { bounds.upper[i] + WIDEN } else { 1.0 };
    let lower = |i: usize| if i < N - 1 { bounds.lower[i] - WIDEN } else { 0.0 };
    let b: Vec<f64> = (0..N).map(upper).chain((0..N).map(|i| -lower(i))).collect();
    let settings = DefaultSettings {
        verbose: false,
        max_iter: 40,
        presolve_enable: false,
        equilibrate_enable: false,
        max_threads: 1,
        direct_solve_method: "qdldl".into(),
        tol_gap_abs: 1e-7,
        tol_gap_rel: 1e-7,
        tol_feas: 1e-8,
        ..DefaultSettings::default()
    };
    let cones = [SupportedConeT::NonnegativeConeT(2 * N)];
    let mut solver = DefaultSolver::new(&p, gradient.as_slice(), &a, &b, &cones, settings).ok()?;
    solver.solve();
    let fine = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    (fine && solver.solution.x.iter().all(|v| v.is_finite())).then(|| solver.solution.x.clone())
}
