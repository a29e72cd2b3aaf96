//! Registration: the pose of the arm's base relative to the table, from known points that the hand has touched.
//!
//! Every point is known in the world frame of the table and felt in the frame of the arm's base. The transform between
//! the two is the least-squares rigid one (Arun, Huang and Blostein 1987; Kabsch 1976). Its covariance follows from the
//! covariances of the touches and from the residuals.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Tolerance of collinearity, m: points that deviate less from a line leave a rotation undetermined.
const COLLINEARITY_TOLERANCE: f64 = 0.02;

/// A touched point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchedPoint {
    /// Known position on the table, m, world.
    pub known: Point3<f64>,
    /// Felt position, m, in the frame of the arm's base.
    pub felt: Point3<f64>,
    /// Covariance of the felt position, m2.
    pub covariance: Matrix3<f64>,
}

/// Estimated pose of the arm's base.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    pub world_from_base: Isometry3<f64>,
    /// Covariance of the position of the points' centre (m) and of the rotation (rad, rotation vector), world axes.
    pub covariance: Matrix6<f64>,
    /// Centre of the known points, m, world.
    pub centroid: Point3<f64>,
    /// Residual of each point: its distance from the known position, m.
    pub residuals: Vec<f64>,
}

/// Registration failure.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegistrationError {
    #[error("points: found {0}, expected at least 3")]
    TooFew(usize),
    #[error("points: found them within {:.0} mm of one line, expected a triangle", 1e3 * .0)]
    Collinear(f64),
    /// A value is not finite, or a covariance is not positive definite.
    #[error(
        "point {0}: found an invalid position or covariance, expected finite numbers and a positive definite covariance"
    )]
    NotFinite(usize),
    /// A residual is too large: the points do not fit together.
    #[error(
        "point {point}: residual: found {:.1} mm, expected at most {:.1} mm: check its position",
        1e3 * residual,
        1e3 * most
    )]
    Residual {
        /// Number of the point, from 1.
        point: usize,
        /// Residual of the point, m.
        residual: f64,
        /// Largest permitted residual, m.
        most: f64,
    },
}

/// Computes the rigid transform from the felt points to the known ones. No residual may exceed `most` (m).
pub fn register(points: &[TouchedPoint], most: f64) -> Result<Registration, RegistrationError> {
    if points.len() < 3 {
        return Err(RegistrationError::TooFew(points.len()));
    }
    let mut information = Vec::new();
    for (n, point) in points.iter().enumerate() {
        let finite = point.known.coords.iter().chain(&point.felt.coords).all(|value| value.is_finite());
        let inverse = point.covariance.cholesky().filter(|_| finite).map(|root| root.inverse());
        information.push(inverse.ok_or(RegistrationError::NotFinite(n + 1))?);
    }
    let weights: Vec<f64> = points.iter().map(|point| 3.0 / point.covariance.trace()).collect();
    let middle = |place: fn(&TouchedPoint) -> Point3<f64>| {
        let sum: Vector3<f64> = points.iter().zip(&weights).map(|(point, weight)| *weight * place(point).coords).sum();
        Point3::from(sum / weights.iter().sum::<f64>())
    };
    let (known, felt) = (middle(|point| point.known), middle(|point| point.felt));
    let (mut cross, mut spread) = (Matrix3::zeros(), Matrix3::zeros());
    for (point, weight) in points.iter().zip(&weights) {
        cross += *weight * (point.known - known) * (point.felt - felt).transpose();
        spread += (point.known - known) * (point.known - known).transpose() / points.len() as f64;
    }
    let mut variances: Vec<f64> = spread.symmetric_eigenvalues().iter().copied().collect();
    variances.sort_by(f64::total_cmp);
    let across = variances[1].max(0.0).sqrt();
    if across < COLLINEARITY_TOLERANCE {
        return Err(RegistrationError::Collinear(across));
    }
    let svd = cross.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(RegistrationError::NotFinite(1)) };
    // Excludes reflections.
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * handed * v_t));
    let world_from_base = Isometry3::from_parts(Translation3::from(known.coords - turn * felt.coords), turn);
    let off = points.iter().map(|point| world_from_base * point.felt - point.known).collect::<Vec<_>>();
    let (worst, residual) =
        off.iter().map(Vector3::norm).enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
    if residual > most {
        return Err(RegistrationError::Residual { point: worst + 1, residual, most });
    }
    let covariance = covariance(points, (&information, &off), turn, known)?;
    let residuals = off.iter().map(Vector3::norm).collect();
    Ok(Registration { world_from_base, covariance, centroid: known, residuals })
}

/// Covariance of the weighted least-squares solution. It is enlarged if the residuals exceed what the covariances of
/// the touches predict.
fn covariance(
    points: &[TouchedPoint],
    (information, off): (&[Matrix3<f64>], &[Vector3<f64>]),
    turn: UnitQuaternion<f64>,
    middle: Point3<f64>,
) -> Result<Matrix6<f64>, RegistrationError> {
    let turn = turn.to_rotation_matrix().into_inner();
    let (mut normal, mut chi) = (Matrix6::zeros(), 0.0);
    for ((point, information), off) in points.iter().zip(information).zip(off) {
        let information = turn * information * turn.transpose();
        let mut jacobian = nalgebra::Matrix3x6::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(point.known - middle).cross_matrix());
        normal += jacobian.transpose() * information * jacobian;
        chi += (off.transpose() * information * off).x;
    }
    let freedom = 3.0 * points.len() as f64 - 6.0;
    let inverse = normal.cholesky().ok_or(RegistrationError::NotFinite(1))?.inverse();
    Ok(inverse * (chi / freedom).max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MARKS: [[f64; 2]; 3] = [[0.45, -0.15], [0.45, 0.15], [0.65, 0.0]];

    fn truth() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(0.012, -0.007, 0.004), Vector3::new(0.004, -0.007, 0.02))
    }

    fn touched(off: [Vector3<f64>; 3]) -> Vec<TouchedPoint> {
        let point = |([x, y], off): (&[f64; 2], Vector3<f64>)| {
            let known = Point3::new(*x, *y, 0.03);
            TouchedPoint {
                known,
                felt: truth().inverse_transform_point(&known) + off,
                covariance: Matrix3::from_diagonal_element(1e-6),
            }
        };
        MARKS.iter().zip(off).map(point).collect()
    }

    #[test]
    fn exact_points_give_the_exact_place() {
        let found = register(&touched([Vector3::zeros(); 3]), 1e-6).expect("registers");
        assert!((found.world_from_base.translation.vector - truth().translation.vector).norm() < 1e-12);
        assert!(found.world_from_base.rotation.angle_to(&truth().rotation) < 1e-12);
        assert!(found.residuals.iter().all(|residual| *residual < 1e-12));
        // Three points known to 1 mm: their centre is known to 1 mm / sqrt(3), rotations by the points' lever arms.
        let sigma = |n: usize| found.covariance[(n, n)].sqrt();
        assert!((sigma(0) - 1e-3 / 3.0_f64.sqrt()).abs() < 1e-9, "{}", sigma(0));
        let lever = MARKS.iter().map(|[_, y]| y * y).sum::<f64>().sqrt();
        assert!((sigma(3) - 1e-3 / lever).abs() < 1e-9, "{}", sigma(3));
    }

    /// Over sampled errors, the stated covariance agrees with the scatter of the results.
    #[test]
    fn the_covariance_is_what_comes_of_drawn_errors() {
        use rand_chacha::rand_core::SeedableRng;
        use rand_distr::Distribution;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let normal = rand_distr::Normal::new(0.0, 1e-3).expect("a distribution");
        let (mut squares, mut turns, count) = (0.0, 0.0, 400);
        for _ in 0..count {
            let off = [(); 3].map(|()| Vector3::from_fn(|_, _| normal.sample(&mut rng)));
            let found = register(&touched(off), 1.0).expect("registers");
            let error = found.world_from_base * truth().inverse();
            squares += (error * found.centroid - found.centroid).z.powi(2);
            turns += error.rotation.scaled_axis().z.powi(2);
        }
        let exact = register(&touched([Vector3::zeros(); 3]), 1.0).expect("registers").covariance;
        for (found, stated) in [(squares, exact[(2, 2)]), (turns, exact[(5, 5)])] {
            let ratio = (found / f64::from(count) / stated).sqrt();
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn what_cannot_be_registered_is_refused() {
        let good = touched([Vector3::zeros(); 3]);
        assert_eq!(register(&good[..2], 0.01), Err(RegistrationError::TooFew(2)));
        let line = good.iter().map(|point| TouchedPoint { known: Point3::new(0.5, point.known.y, 0.03), ..*point });
        assert!(matches!(register(&line.collect::<Vec<_>>(), 0.01), Err(RegistrationError::Collinear(_))));
        let mut numbers = good.clone();
        numbers[1].felt.x = f64::NAN;
        assert_eq!(register(&numbers, 0.01), Err(RegistrationError::NotFinite(2)));
        // One ball is off its mark.
        let moved = touched([Vector3::zeros(), Vector3::zeros(), Vector3::new(0.03, 0.0, 0.0)]);
        let error = register(&moved, 0.005).expect_err("refused").to_string();
        assert!(error.contains("expected at most 5.0 mm"), "{error}");
    }
}
