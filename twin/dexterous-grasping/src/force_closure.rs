//! Force closure: the disturbance that a set of frictional point contacts resists.
//!
//! Contact i presses with f_i inside its friction cone (Coulomb: |tangential| <= mu * normal, pushing only). All forces
//! together exert the wrench G f, with the torque taken about `center` and divided by a length so that both halves are
//! in N. [`wrench_margin`] solves for the largest t such that G f = t d has a solution with a total normal force within
//! the limit. It does so for d along each of the 12 directions +-x, y, z of force and torque, and returns the least t.
//! Each is a second-order-cone program. Since f = 0 solves it for t = 0, the result is never negative.
//!
//! Twelve directions decide closure exactly: without closure the resisted wrenches lie in a half space a . w >= 0, and
//! the direction against any non-zero component of a lies outside it. As a magnitude, the margin is an upper bound of
//! the radius of the resisted ball. The resisted set also contains the cross-polytope of the 12 points, so the ball's
//! radius is at least margin / sqrt 6.
//!
//! [`dfc_residual`] is the paper's cheap estimator for its search (supplement, "Differentiable force closure estimator"):
//! friction is ignored and all normal forces are equal.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus, SupportedConeT,
    ZeroConeT,
};
use nalgebra::{Point3, UnitVector3, Vector3, Vector6};

/// Threshold below which a resisted wrench is solver rounding and counts as 0, as a share of the force limit.
const ZERO_THRESHOLD: f64 = 1e-6;

/// One frictional point contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionContact {
    /// Contact point on the object, m.
    pub point: Point3<f64>,
    /// Direction in which the hand pushes: the surface normal *into* the object.
    pub normal: UnitVector3<f64>,
    /// Coulomb friction coefficient; 0 for a frictionless contact.
    pub friction: f64,
}

/// Errors of computing a margin.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ForceClosureError {
    /// Invalid argument.
    #[error("{field}: found {found}, expected {expected}")]
    Argument {
        /// Name of the argument, such as `contacts[2].friction`.
        field: String,
        /// Value of the argument.
        found: f64,
        /// Valid values.
        expected: &'static str,
    },
    /// The cone program ended without a solution.
    #[error("the friction-cone program for direction {direction} ended with {status}")]
    Solver {
        /// Index of the direction: +x, -x, +y, ... of force, then of torque.
        direction: usize,
        /// The solver's status.
        status: String,
    },
}

/// Computes the wrench margin: the largest wrench resisted in the worst of the 12 axis directions, N (torques divided
/// by `length_scale`, m, taken about `center`), when the normal forces of all contacts add up to at most
/// `max_normal_force`, N. It is 0 without force closure.
///
/// # Errors
/// [`ForceClosureError::Argument`] for a length or a force that is not positive, a negative friction coefficient, or
/// coordinates that are not finite; [`ForceClosureError::Solver`] if a cone program ends without a solution.
///
/// ```
/// use dexterous_grasping::force_closure::{FrictionContact, wrench_margin};
/// use nalgebra::{Point3, UnitVector3, Vector3};
///
/// // Three fingers around a ball of 3 cm radius.
/// let contacts = [0.0_f64, 120.0, 240.0].map(|angle| {
///     let (sin, cos) = angle.to_radians().sin_cos();
///     let outward = UnitVector3::new_normalize(Vector3::new(cos, sin, 0.0));
///     FrictionContact { point: Point3::from(outward.scale(0.03)), normal: -outward, friction: 0.8 }
/// });
/// let margin = wrench_margin(&contacts, &Point3::origin(), 0.03, 10.0)?;
/// assert!(margin > 1.0, "resists more than 1 N in every direction: {margin}");
/// # Ok::<(), dexterous_grasping::force_closure::ForceClosureError>(())
/// ```
pub fn wrench_margin(
    contacts: &[FrictionContact],
    center: &Point3<f64>,
    length_scale: f64,
    max_normal_force: f64,
) -> Result<f64, ForceClosureError> {
    soft_wrench_margin(contacts, 0.0, center, length_scale, max_normal_force)
}

/// Computes the margin as [`wrench_margin`] does, for soft fingertips. A contact that presses with f on an area also
/// bears a torque of mu f `torsion_arm` (m) about its normal, less as it bears more friction along the surface (the
/// ellipsoid of Howe and Cutkosky 1996). A pair of opposed contacts then resists the torque about the line through
/// them, which point contacts do not.
///
/// For a circular contact of radius a under the pressure of Hertz, the arm is 3 pi / 16 a.
///
/// # Errors
/// As those of [`wrench_margin`], and [`ForceClosureError::Argument`] for a negative `torsion_arm`.
///
/// ```
/// use dexterous_grasping::force_closure::{FrictionContact, soft_wrench_margin, wrench_margin};
/// use nalgebra::{Point3, Vector3};
///
/// // A parallel gripper holds a box of 50 mm with gel pads whose contacts have a radius of 5 mm.
/// let contacts = [1.0, -1.0].map(|side| FrictionContact {
///     point: Point3::new(0.025 * side, 0.0, 0.0),
///     normal: if side > 0.0 { -Vector3::x_axis() } else { Vector3::x_axis() },
///     friction: 0.9,
/// });
/// let torsion_arm = 3.0 * std::f64::consts::PI / 16.0 * 0.005;
/// assert_eq!(wrench_margin(&contacts, &Point3::origin(), 0.025, 20.0)?, 0.0);
/// assert!(soft_wrench_margin(&contacts, torsion_arm, &Point3::origin(), 0.025, 20.0)? > 1.0);
/// # Ok::<(), dexterous_grasping::force_closure::ForceClosureError>(())
/// ```
pub fn soft_wrench_margin(
    contacts: &[FrictionContact],
    torsion_arm: f64,
    center: &Point3<f64>,
    length_scale: f64,
    max_normal_force: f64,
) -> Result<f64, ForceClosureError> {
    check(contacts, length_scale, max_normal_force)?;
    if !(torsion_arm.is_finite() && torsion_arm >= 0.0) {
        let expected = "a length in m, 0 or more";
        return Err(ForceClosureError::Argument { field: "torsion_arm".into(), found: torsion_arm, expected });
    }
    let mut worst = f64::INFINITY;
    for direction in 0..12 {
        worst = worst.min(max_resisted(contacts, torsion_arm, center, length_scale, direction)?);
        if worst == 0.0 {
            break;
        }
    }
    Ok(worst * max_normal_force)
}

/// Computes the paper's ||G c||: the imbalance of unit forces along all normals, with torques about the origin of the
/// points' frame. 0 is best. Force (dimensionless) and torque (m) enter one norm, as published.
pub fn dfc_residual(contacts: &[FrictionContact]) -> f64 {
    let sum: Vector6<f64> = contacts.iter().map(|c| wrench(&c.point.coords, &c.normal)).sum();
    sum.norm()
}

/// Returns a force and its torque as one vector.
fn wrench(arm: &Vector3<f64>, force: &Vector3<f64>) -> Vector6<f64> {
    let torque = arm.cross(force);
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

fn check(contacts: &[FrictionContact], length_scale: f64, max_normal_force: f64) -> Result<(), ForceClosureError> {
    let expect = |good: bool, field: &str, found: f64, expected| {
        if good { Ok(()) } else { Err(ForceClosureError::Argument { field: field.to_owned(), found, expected }) }
    };
    let positive = |x: f64| x.is_finite() && x > 0.0;
    expect(positive(length_scale), "length_scale", length_scale, "a positive length in m")?;
    expect(positive(max_normal_force), "max_normal_force", max_normal_force, "a positive force in N")?;
    for (n, contact) in contacts.iter().enumerate() {
        let friction = contact.friction;
        expect(friction.is_finite() && friction >= 0.0, &format!("contacts[{n}].friction"), friction, "a number >= 0")?;
        for x in contact.point.iter().chain(contact.normal.iter()) {
            expect(x.is_finite(), &format!("contacts[{n}]"), *x, "finite coordinates")?;
        }
    }
    Ok(())
}

/// Returns the largest t with G f = t d for one direction, under a total normal force of 1.
///
/// The unknowns are, for each contact, its normal force and, with friction, two tangential forces, plus the torque
/// about its normal over `torsion_arm` if that is not 0. The last unknown is t. In the solver's form A x + s = b with s
/// in cones, there are 6 rows of balance and one for the total normal force, then one cone per contact.
fn max_resisted(
    contacts: &[FrictionContact],
    torsion_arm: f64,
    center: &Point3<f64>,
    length_scale: f64,
    direction: usize,
) -> Result<f64, ForceClosureError> {
    let rubbing = if torsion_arm > 0.0 { 4 } else { 3 };
    let unknowns: usize = 1 + contacts.iter().map(|c| if c.friction > 0.0 { rubbing } else { 1 }).sum::<usize>();
    let t = unknowns - 1;
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut put = |row: usize, column: usize, value: f64| {
        if value != 0.0 {
            rows.push(row);
            columns.push(column);
            values.push(value);
        }
    };
    let mut cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(6), NonnegativeConeT(1)];
    let (mut row, mut column) = (7, 0);
    for contact in contacts {
        let arm = (contact.point - center) / length_scale;
        let balance = |column: usize, force: &Vector3<f64>, put: &mut dyn FnMut(usize, usize, f64)| {
            for (axis, value) in wrench(&arm, force).iter().enumerate() {
                put(axis, column, *value);
            }
        };
        balance(column, &contact.normal, &mut put);
        put(6, column, 1.0);
        put(row, column, if contact.friction > 0.0 { -contact.friction } else { -1.0 });
        if contact.friction > 0.0 {
            for (n, tangent) in tangents(&contact.normal).iter().enumerate() {
                balance(column + 1 + n, tangent, &mut put);
                put(row + 1 + n, column + 1 + n, -1.0);
            }
            if torsion_arm > 0.0 {
                let torque = contact.normal.scale(torsion_arm / length_scale);
                for (axis, value) in torque.iter().enumerate() {
                    put(3 + axis, column + 3, *value);
                }
                put(row + 3, column + 3, -1.0);
            }
            cones.push(SecondOrderConeT(rubbing));
            row += rubbing;
            column += rubbing;
        } else {
            cones.push(NonnegativeConeT(1));
            row += 1;
            column += 1;
        }
    }
    put(direction / 2, t, if direction.is_multiple_of(2) { -1.0 } else { 1.0 });

    let a = CscMatrix::new_from_triplets(row, unknowns, rows, columns, values);
    let mut b = vec![0.0; row];
    b[6] = 1.0;
    let mut cost = vec![0.0; unknowns];
    cost[t] = -1.0;
    let failed = |status: String| ForceClosureError::Solver { direction, status };
    let settings =
        DefaultSettingsBuilder::default().verbose(false).build().map_err(|error| failed(error.to_string()))?;
    let no_quadratic_cost = CscMatrix::zeros((unknowns, unknowns));
    let mut solver = DefaultSolver::new(&no_quadratic_cost, &cost, &a, &b, &cones, settings)
        .map_err(|error| failed(error.to_string()))?;
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => {
            let found = solver.solution.x[t];
            Ok(if found > ZERO_THRESHOLD { found } else { 0.0 })
        }
        status => Err(failed(status.to_string())),
    }
}

/// Returns two unit vectors that complete `normal` to a right-handed frame.
fn tangents(normal: &UnitVector3<f64>) -> [Vector3<f64>; 2] {
    let helper = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let first = normal.cross(&helper).normalize();
    [first, normal.cross(&first)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Contacts on a sphere about the origin, pressing towards its centre.
    fn on_sphere(directions: &[Vector3<f64>], radius: f64, friction: f64) -> Vec<FrictionContact> {
        directions
            .iter()
            .map(|d| {
                let outward = UnitVector3::new_normalize(*d);
                FrictionContact { point: Point3::from(outward.scale(radius)), normal: -outward, friction }
            })
            .collect()
    }

    fn triangle() -> Vec<Vector3<f64>> {
        (0..3)
            .map(|n| f64::from(n) * std::f64::consts::TAU / 3.0)
            .map(|a| Vector3::new(a.cos(), a.sin(), 0.0))
            .collect()
    }

    fn tetrahedron() -> Vec<Vector3<f64>> {
        vec![
            Vector3::new(1.0, 1.0, 1.0),
            Vector3::new(1.0, -1.0, -1.0),
            Vector3::new(-1.0, 1.0, -1.0),
            Vector3::new(-1.0, -1.0, 1.0),
        ]
    }

    fn margin(contacts: &[FrictionContact], force: f64) -> f64 {
        wrench_margin(contacts, &Point3::origin(), 0.03, force).expect("solved")
    }

    /// Two opposed contacts cannot exert a torque about the line through them, with friction or without.
    #[test]
    fn two_opposed_contacts_are_not_closure() {
        for friction in [0.0, 0.8] {
            let pair = on_sphere(&[Vector3::x(), -Vector3::x()], 0.03, friction);
            assert_eq!(margin(&pair, 10.0), 0.0, "friction {friction}");
        }
    }

    /// Two opposed soft contacts are closure: about the line through them they resist mu times the force times the
    /// torsion arm, and no more.
    #[test]
    fn two_opposed_soft_contacts_bear_torsion() {
        let pair = on_sphere(&[Vector3::x(), -Vector3::x()], 0.03, 0.6);
        let about_x = max_resisted(&pair, 0.003, &Point3::origin(), 0.01, 6).expect("solved");
        assert!((about_x - 0.6 * 0.003 / 0.01).abs() < 1e-6, "{about_x}");
        let soft = soft_wrench_margin(&pair, 0.003, &Point3::origin(), 0.01, 10.0).expect("solved");
        assert!((soft - 1.8).abs() < 1e-4, "{soft}");
        assert_eq!(soft_wrench_margin(&pair, 0.0, &Point3::origin(), 0.01, 10.0), Ok(0.0));
        assert!(soft_wrench_margin(&pair, -1.0, &Point3::origin(), 0.01, 10.0).is_err());
    }

    /// Frictionless contacts exert no torque on a sphere.
    #[test]
    fn frictionless_sphere_is_not_closure() {
        assert_eq!(margin(&on_sphere(&tetrahedron(), 0.03, 0.0), 10.0), 0.0);
    }

    #[test]
    fn no_contacts_resist_nothing() {
        assert_eq!(margin(&[], 10.0), 0.0);
        assert_eq!(margin(&on_sphere(&[Vector3::z()], 0.03, 1.0), 10.0), 0.0);
    }

    #[test]
    fn three_and_four_frictional_contacts_are_closure() {
        for directions in [triangle(), tetrahedron()] {
            assert!(margin(&on_sphere(&directions, 0.03, 0.6), 10.0) > 0.1);
        }
    }

    /// Across the plane of three contacts only friction holds, so the margin there is mu times the total normal force, and so
    /// is the torque about the plane's axis divided by the radius.
    #[test]
    fn known_values_of_a_triangle() {
        let contacts = on_sphere(&triangle(), 0.03, 0.2);
        let along_z = max_resisted(&contacts, 0.0, &Point3::origin(), 0.03, 4).expect("solved");
        let about_z = max_resisted(&contacts, 0.0, &Point3::origin(), 0.03, 10).expect("solved");
        assert!((along_z - 0.2).abs() < 1e-6, "{along_z}");
        assert!((about_z - 0.2).abs() < 1e-6, "{about_z}");
        // About x the longest arms are +-R sin 60, and all friction together is at most mu.
        let about_x = max_resisted(&contacts, 0.0, &Point3::origin(), 0.03, 6).expect("solved");
        assert!(about_x < 0.2 * 3.0_f64.sqrt() / 2.0 + 1e-6, "{about_x}");
    }

    #[test]
    fn grows_with_friction() {
        let margins: Vec<f64> =
            [0.1, 0.3, 0.6, 1.0].iter().map(|mu| margin(&on_sphere(&tetrahedron(), 0.03, *mu), 10.0)).collect();
        assert!(margins.windows(2).all(|pair| pair[1] > pair[0]), "{margins:?}");
    }

    #[test]
    fn proportional_to_the_force_limit() {
        let contacts = on_sphere(&triangle(), 0.03, 0.5);
        assert!((margin(&contacts, 20.0) - 2.0 * margin(&contacts, 10.0)).abs() < 1e-9);
    }

    #[test]
    fn same_for_any_size_when_the_length_scales_along() {
        let at = |scale: f64| {
            wrench_margin(&on_sphere(&triangle(), 0.03 * scale, 0.5), &Point3::origin(), 0.03 * scale, 10.0)
                .expect("solved")
        };
        assert!((at(1.0) - at(7.0)).abs() < 1e-6);
    }

    #[test]
    fn bad_arguments_are_named() {
        let mut contacts = on_sphere(&triangle(), 0.03, 0.5);
        contacts[1].friction = -0.1;
        let error = wrench_margin(&contacts, &Point3::origin(), 0.03, 10.0).expect_err("negative friction");
        assert_eq!(error.to_string(), "contacts[1].friction: found -0.1, expected a number >= 0");
        let error = wrench_margin(&[], &Point3::origin(), 0.0, 10.0).expect_err("no length");
        assert!(error.to_string().starts_with("length_scale: found 0"));
    }

    #[test]
    fn residual_is_zero_in_balance_and_counts_what_is_not() {
        assert!(dfc_residual(&on_sphere(&tetrahedron(), 0.03, 0.5)) < 1e-12);
        assert!((dfc_residual(&on_sphere(&[Vector3::x()], 0.03, 0.5)) - 1.0).abs() < 1e-12);
        // A couple: forces balance, torques add up to 2 * 0.1.
        let couple = [(0.1, 1.0), (-0.1, -1.0)].map(|(x, y)| FrictionContact {
            point: Point3::new(x, 0.0, 0.0),
            normal: UnitVector3::new_normalize(Vector3::new(0.0, y, 0.0)),
            friction: 0.0,
        });
        assert!((dfc_residual(&couple) - 0.2).abs() < 1e-12);
    }

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        [-1.0..1.0_f64, -1.0..1.0, -1.0..1.0].prop_map(Vector3::from).prop_filter("not zero", |v| v.norm() > 0.1)
    }

    proptest! {
        /// For any contacts, closed or not, the program ends, and adding a contact never reduces the resistance.
        #[test]
        fn another_contact_never_harms(
            contacts in prop::collection::vec((direction(), direction(), 0.0..1.2_f64), 1..7),
        ) {
            let contacts: Vec<FrictionContact> = contacts.iter().map(|(p, n, friction)| FrictionContact {
                point: Point3::from(p * 0.03),
                normal: UnitVector3::new_normalize(*n),
                friction: *friction,
            }).collect();
            let all = wrench_margin(&contacts, &Point3::origin(), 0.03, 10.0)?;
            let fewer = wrench_margin(&contacts[1..], &Point3::origin(), 0.03, 10.0)?;
            prop_assert!(all >= fewer - 1e-4, "{all} < {fewer}");
            prop_assert!(all <= 10.0 * 2.0);
        }
    }
}
