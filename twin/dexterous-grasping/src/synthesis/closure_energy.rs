//! The differentiable force-closure estimator (supplement, "Differentiable force closure estimator"), with an effective
//! rank term.
//!
//! For contacts at x_i (from the centre of mass, over the object's length) with unit forces c_i, the grasp map is G
//! with blocks `[I; [x_i]x]`. *Balance* is |G c| / n, the deviation of equal forces from equilibrium. *Rank* is -log
//! det(G G' / n + delta I). It grows without bound as the contacts approach a line and is flat where they span space.
//! The published term lambda_0(G G' - eps I) is numerically ineffective at its eps.
//!
//! The determinant needs no 6 x 6 matrix: eliminating the force block leaves 3 ln(1 + delta) + ln det C with C = delta
//! I + J(Q) - J(m m') / (1 + delta), where m and Q are the first two moments of the x_i and J(A) = tr(A) I - A turns a
//! second moment into an inertia. The cost is two moments and a 3 x 3 determinant.

use nalgebra::{Matrix3, Vector3, Vector6};

/// Delta of the rank term.
pub const RANK_DELTA: f64 = 0.01;

/// Balance and rank of one set of contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// |G c| / n, 0 is best, at most about 1.
    pub balance: f64,
    /// -log det(G G' / n + delta I), small is good.
    pub rank: f64,
}

struct Moments {
    wrench: Vector6<f64>,
    mean: Vector3<f64>,
    second: Matrix3<f64>,
}

fn moments(points: &[Vector3<f64>], pushes: &[Vector3<f64>]) -> Moments {
    let (mut force, mut torque, mut mean) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    let (mut xx, mut yy, mut zz, mut xy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (x, c) in points.iter().zip(pushes) {
        force += c;
        torque += x.cross(c);
        mean += x;
        xx += x.x * x.x;
        yy += x.y * x.y;
        zz += x.z * x.z;
        xy += x.x * x.y;
        xz += x.x * x.z;
        yz += x.y * x.z;
    }
    let scale = 1.0 / points.len() as f64;
    Moments {
        wrench: Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z) * scale,
        mean: mean * scale,
        second: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * scale,
    }
}

fn inertia(second: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * second.trace() - second
}

fn reduced(moments: &Moments) -> Matrix3<f64> {
    Matrix3::identity() * RANK_DELTA + inertia(&moments.second)
        - inertia(&(moments.mean * moments.mean.transpose())) / (1.0 + RANK_DELTA)
}

fn rank(determinant: f64) -> f64 {
    -(3.0 * (1.0 + RANK_DELTA).ln() + determinant.max(f64::MIN_POSITIVE).ln())
}

/// Computes balance and rank of contacts at `points` (dimensionless) pushing along the unit vectors `pushes`.
pub fn closure(points: &[Vector3<f64>], pushes: &[Vector3<f64>]) -> Closure {
    let moments = moments(points, pushes);
    Closure { balance: moments.wrench.norm(), rank: rank(reduced(&moments).determinant()) }
}

/// Computes the same as [`closure`], and adds the derivatives of `weights.0` * balance + `weights.1` * rank to
/// `by_points` and `by_pushes`.
pub fn closure_with_gradient(
    points: &[Vector3<f64>],
    pushes: &[Vector3<f64>],
    weights: (f64, f64),
    by_points: &mut [Vector3<f64>],
    by_pushes: &mut [Vector3<f64>],
) -> Closure {
    let moments = moments(points, pushes);
    let balance = moments.wrench.norm();
    let scale = 1.0 / points.len() as f64;
    let along = moments.wrench * (weights.0 * scale / balance.max(1e-12));
    let (force, torque) = (Vector3::new(along[0], along[1], along[2]), Vector3::new(along[3], along[4], along[5]));
    let matrix = reduced(&moments);
    // Positive definite by construction: at least delta.
    let inverse = matrix.try_inverse().unwrap_or_else(Matrix3::zeros);
    let spread = (Matrix3::identity() * inverse.trace() - inverse) * (-2.0 * weights.1 * scale);
    let shift = moments.mean / (1.0 + RANK_DELTA);
    for n in 0..points.len() {
        by_points[n] += pushes[n].cross(&torque) + spread * (points[n] - shift);
        by_pushes[n] += force + torque.cross(&points[n]);
    }
    Closure { balance, rank: rank(matrix.determinant()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix6, SMatrix};
    use proptest::prelude::*;

    fn vectors(n: usize) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        prop::collection::vec([-1.0..1.0_f64, -1.0..1.0, -1.0..1.0].prop_map(Vector3::from), n)
    }

    /// Computes G G' / n + delta I explicitly.
    fn full(points: &[Vector3<f64>]) -> Matrix6<f64> {
        let mut sum = Matrix6::identity() * RANK_DELTA;
        for x in points {
            let mut block = SMatrix::<f64, 6, 3>::zeros();
            block.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            block.fixed_view_mut::<3, 3>(3, 0).copy_from(&x.cross_matrix());
            sum += block * block.transpose() / points.len() as f64;
        }
        sum
    }

    proptest! {
        #[test]
        fn reduced_determinant_is_the_full_one(points in vectors(5)) {
            let found = closure(&points, &points).rank;
            let expected = -full(&points).determinant().ln();
            prop_assert!((found - expected).abs() < 1e-9, "{} {}", found, expected);
        }

        #[test]
        fn gradients_are_finite_differences(points in vectors(4), pushes in vectors(4)) {
            let weights = (1.3, 0.7);
            let value = |points: &[Vector3<f64>], pushes: &[Vector3<f64>]| {
                let c = closure(points, pushes);
                weights.0 * c.balance + weights.1 * c.rank
            };
            prop_assume!(closure(&points, &pushes).balance > 1e-3);
            let (mut by_points, mut by_pushes) = (vec![Vector3::zeros(); 4], vec![Vector3::zeros(); 4]);
            closure_with_gradient(&points, &pushes, weights, &mut by_points, &mut by_pushes);
            let h = 1e-6;
            for n in 0..4 {
                for axis in 0..3 {
                    let mut moved = points.clone();
                    moved[n][axis] += h;
                    let mut back = points.clone();
                    back[n][axis] -= h;
                    let slope = (value(&moved, &pushes) - value(&back, &pushes)) / (2.0 * h);
                    prop_assert!((slope - by_points[n][axis]).abs() < 1e-5 * (1.0 + slope.abs()));
                    let mut moved = pushes.clone();
                    moved[n][axis] += h;
                    let mut back = pushes.clone();
                    back[n][axis] -= h;
                    let slope = (value(&points, &moved) - value(&points, &back)) / (2.0 * h);
                    prop_assert!((slope - by_pushes[n][axis]).abs() < 1e-5 * (1.0 + slope.abs()));
                }
            }
        }
    }

    /// Contacts on a line lose rank and have a high cost; spread ones do not.
    #[test]
    fn a_line_costs_more_than_a_triangle() {
        let line = [Vector3::x(), -Vector3::x(), Vector3::x() * 0.3];
        let triangle = [Vector3::x(), Vector3::new(-0.5, 0.8, 0.0), Vector3::new(-0.5, -0.8, 0.0)];
        assert!(closure(&line, &line).rank > closure(&triangle, &triangle).rank + 3.0);
    }

    #[test]
    fn opposed_pushes_balance() {
        let points = [Vector3::x(), -Vector3::x()];
        let pushes = [-Vector3::x(), Vector3::x()];
        assert!(closure(&points, &pushes).balance < 1e-12);
        assert!((closure(&points, &[-Vector3::x(), -Vector3::x()]).balance - 1.0).abs() < 1e-12);
    }
}
