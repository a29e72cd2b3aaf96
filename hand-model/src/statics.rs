//! Static equilibrium of the cable-driven digits: from tensions to joint angles, free or against an obstacle.
//!
//! At rest the hand sits in a minimum of its potential energy U(q) = sum of K q^2 / 2 - sum of T e(q) + sum over the
//! skin of k A d^2 / 2 with springs K, tensions T, cable excursions e, and a skin of many small elements of area A,
//! each of which penetrates the obstacle by a depth d under a foundation stiffness k (Pa/m). The gradient is the joint
//! torque balance. The tension is raised from zero in steps, and each step is solved by a damped Newton method, so that
//! the digits come to rest where closing leads them and not behind the obstacle. The obstacle does not move and has no
//! friction. The opposition joint stays at its given angle.
//!
//! With friction in the guides every span has its own tension ([`crate::transmission::friction`]). The span tensions
//! are frozen at the posture from which a load step starts, and updated until they no longer change.
//!
//! ```
//! use hand_model::nalgebra::Vector3;
//! use hand_model::statics::{GuideFriction, contact_equilibrium, free_equilibrium};
//! use hand_model::{Digit, Hand};
//!
//! let hand = Hand::ftac();
//! let (tensions, opposition) = ([0.0, 6.0, 6.0, 6.0, 6.0], 0.0);
//! let free = free_equilibrium(&hand, &tensions, opposition);
//!
//! // The same tensions, with a wall 40 mm in front of the palm frame's origin; its outward direction is +z.
//! let wall = |point: &hand_model::nalgebra::Point3<f64>| (point.z + 0.040, Vector3::z());
//! let stiffness = hand.gel().stiffness;
//! let blocked = contact_equilibrium(&hand, &tensions, opposition, &GuideFriction::NONE, stiffness, wall)?;
//! let knuckle = hand.links(Digit::Index)[0];
//! assert!(blocked.angles[knuckle] < free[knuckle] && !blocked.contact_forces.is_empty());
//! # Ok::<(), hand_model::statics::NoEquilibrium>(())
//! ```

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use crate::hand::{Hand, SkinElement};
use crate::transmission::friction::CableFriction;
use crate::transmission::{Crossing, MAX_SPANS};
use crate::{Digit, HandVector};

/// Side length of a skin element, m; coarser for a digit of which only the closure is needed.
const ELEMENT_SIZE: f64 = 0.002;
const COARSE_ELEMENT_SIZE: f64 = 0.005;
/// Number of load steps from zero to full tension.
const LOAD_STEPS: usize = 24;
/// Largest number of Newton iterations of a load step.
const MAX_NEWTON_ITERATIONS: usize = 200;
/// Residual torque below which a joint is at rest, N m.
const TORQUE_TOLERANCE: f64 = 1e-7;
/// Residual torque above which no equilibrium was found, N m; where only a digit's closure is needed, a hundredth of
/// the torque that bends it.
const MAX_RESIDUAL_TORQUE: f64 = 1e-4;
const COARSE_MAX_RESIDUAL: f64 = 2e-3;
/// Largest number of rounds of updates of the spans' tensions, and the change of an angle below which they have
/// converged, rad.
const MAX_TENSION_UPDATES: usize = 30;
const ANGLE_TOLERANCE: f64 = 1e-6;
/// Largest change of a joint in one iteration, rad.
const MAX_JOINT_STEP: f64 = 0.05;

/// Cable friction with all guides in the same state: 1 after the digits have closed, -1 after they have opened.
#[derive(Debug, Clone, Copy)]
pub struct GuideFriction {
    /// Friction in the guides.
    pub friction: CableFriction,
    /// State of all guides, -1 to 1.
    pub state: f64,
}

impl GuideFriction {
    /// Frictionless guides.
    pub const NONE: Self = Self { friction: CableFriction::NONE, state: 0.0 };
}

/// A contact force on a link.
#[derive(Debug, Clone, Copy)]
pub struct LinkForce {
    /// Loaded link.
    pub link: usize,
    /// Centre of pressure, palm frame, m.
    pub point: Point3<f64>,
    /// Force of the obstacle on the link, palm frame, N.
    pub force: Vector3<f64>,
}

/// A posture at rest.
#[derive(Debug, Clone)]
pub struct Equilibrium {
    /// Joint angles, rad.
    pub angles: HandVector,
    /// Contact forces on the links.
    pub contact_forces: Vec<LinkForce>,
}

/// Error: no posture at rest was found.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "{digit}: no equilibrium at tension {tension} N: torque off balance by {residual} N m, expected below {max_residual} N m"
)]
pub struct NoEquilibrium {
    /// The digit that does not come to rest.
    pub digit: &'static str,
    /// Tension of its cable, N.
    pub tension: f64,
    /// Residual torque, N m.
    pub residual: f64,
    /// Largest permitted residual torque, N m.
    pub max_residual: f64,
}

/// Computes the equilibrium without contact at cable `tensions` (N), with the opposition joint at `opposition` (rad).
pub fn free_equilibrium(hand: &Hand, tensions: &[f64], opposition: f64) -> HandVector {
    free_equilibrium_with_friction(hand, tensions, opposition, &GuideFriction::NONE)
}

/// Like [`free_equilibrium`], for cables with friction in their guides.
pub fn free_equilibrium_with_friction(
    hand: &Hand,
    tensions: &[f64],
    opposition: f64,
    slid: &GuideFriction,
) -> HandVector {
    let mut angles = hand.open_angles();
    if let Some(joint) = hand.transmission.opposition {
        angles[joint] = opposition;
    }
    for (cable, tension) in tensions.iter().enumerate() {
        let friction = hand.cable_guide_friction(cable, &slid.friction);
        let found = hand.transmission.free_angles_with_friction(cable, *tension, &friction, slid.state);
        for (joint, angle) in found {
            angles[joint] = angle.clamp(hand.tree.joints[joint].lower, hand.tree.joints[joint].upper);
        }
    }
    angles
}

/// Computes the equilibrium against an obstacle. `obstacle` returns the signed distance (m, negative inside) of a point
/// in the palm frame and the outward direction there. `foundation` is the skin's stiffness, Pa/m.
///
/// # Errors
/// [`NoEquilibrium`] with the first digit that does not come to rest.
pub fn contact_equilibrium(
    hand: &Hand,
    tensions: &[f64],
    opposition: f64,
    slid: &GuideFriction,
    foundation: f64,
    obstacle: impl Fn(&Point3<f64>) -> (f64, Vector3<f64>),
) -> Result<Equilibrium, NoEquilibrium> {
    let mut angles = hand.open_angles();
    if let Some(joint) = hand.transmission.opposition {
        angles[joint] = opposition;
    }
    let mut pushes = Vec::new();
    for &digit in hand.digits() {
        let skin = build_skin(hand, digit, ELEMENT_SIZE);
        let problem = Problem { hand, digit, skin, foundation, obstacle: &|_, point: &Point3<f64>| obstacle(point) };
        problem.close(&mut angles, tensions[digit.index()], slid, MAX_RESIDUAL_TORQUE)?;
        pushes.extend(problem.contact_forces(&angles));
    }
    Ok(Equilibrium { angles, contact_forces: pushes })
}

/// Computes the joint angles (rad) after one `digit` has continued closing at its `tension` (N) from the hand's angles
/// `q` (rad) until it rests against an obstacle. The obstacle may differ from link to link: signed distance and outward
/// direction as in [`contact_equilibrium`].
///
/// # Errors
/// [`NoEquilibrium`] if the digit does not come to rest.
pub fn close_digit(
    hand: &Hand,
    (digit, tension): (Digit, f64),
    q: &[f64],
    foundation: f64,
    obstacle: impl Fn(usize, &Point3<f64>) -> (f64, Vector3<f64>),
) -> Result<HandVector, NoEquilibrium> {
    let mut angles: HandVector = q.iter().copied().collect();
    let problem =
        Problem { hand, digit, skin: build_skin(hand, digit, COARSE_ELEMENT_SIZE), foundation, obstacle: &obstacle };
    problem.settle(&mut angles, tension, &GuideFriction::NONE, COARSE_MAX_RESIDUAL)?;
    Ok(angles)
}

/// Builds the skin of each link of a digit, with elements of side length `element` (m).
fn build_skin(hand: &Hand, digit: Digit, element: f64) -> Vec<Vec<SkinElement>> {
    hand.links(digit).iter().map(|link| hand.covers[*link].skin_elements(element)).collect()
}

struct Problem<'a, F> {
    hand: &'a Hand,
    digit: Digit,
    /// Skin elements of each of the digit's links.
    skin: Vec<Vec<SkinElement>>,
    foundation: f64,
    obstacle: &'a F,
}

impl<F: Fn(usize, &Point3<f64>) -> (f64, Vector3<f64>)> Problem<'_, F> {
    /// Raises the digit's tension from zero to `full` (N) and moves the joints from `angles` along. The residual
    /// torques are at most `most` (N m).
    fn close(&self, angles: &mut HandVector, full: f64, slid: &GuideFriction, most: f64) -> Result<(), NoEquilibrium> {
        (1..=LOAD_STEPS).try_for_each(|step| self.settle(angles, full * step as f64 / LOAD_STEPS as f64, slid, most))
    }

    /// Moves the joints from `angles` to rest at this `tension` (N), with residual torques of at most `most` (N m).
    fn settle(
        &self,
        angles: &mut HandVector,
        tension: f64,
        slid: &GuideFriction,
        most: f64,
    ) -> Result<(), NoEquilibrium> {
        let (hand, digit) = (self.hand, self.digit);
        for _ in 0..MAX_TENSION_UPDATES {
            let before = *angles;
            let path = &hand.transmission.cables[digit.index()];
            let friction = hand.cable_guide_friction(digit.index(), &slid.friction);
            let spans = path.span_tensions(angles, tension, &friction, &[slid.state; MAX_SPANS]);
            let rest = self.relax(angles, &spans);
            if rest > most {
                return Err(NoEquilibrium { digit: digit.name(), tension, residual: rest, max_residual: most });
            }
            let changed = angles.iter().zip(&before).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            if slid.friction.coefficient == 0.0 || changed < ANGLE_TOLERANCE {
                break;
            }
        }
        Ok(())
    }

    fn joints(&self) -> Vec<usize> {
        self.hand.transmission.cables[self.digit.index()].joints.iter().map(|crossing| crossing.joint).collect()
    }

    /// Computes the energy (J), its gradient (N m) and a positive approximation of its Hessian (N m/rad) over the
    /// cable's joints.
    fn energy(&self, angles: &[f64], spans: &[f64; MAX_SPANS]) -> (f64, DVector<f64>, DMatrix<f64>) {
        let path = &self.hand.transmission.cables[self.digit.index()];
        let n = path.joints.len();
        let (mut energy, mut gradient, mut hessian) = (0.0, DVector::zeros(n), DMatrix::zeros(n, n));
        for (row, Crossing { joint, lever, .. }) in path.joints.iter().enumerate() {
            let (q, k) = (angles[*joint], self.hand.transmission.springs[*joint]);
            let (tension, turn) = (spans[row], q - self.hand.transmission.spring_rests[*joint]);
            energy += 0.5 * k * turn * turn - tension * lever.excursion(q);
            gradient[row] = k * turn - tension * lever.moment_arm(q);
            let h = 1e-5;
            let slope = (lever.moment_arm(q + h) - lever.moment_arm(q - h)) / (2.0 * h);
            hessian[(row, row)] = (k - tension * slope).max(0.1 * k);
        }
        self.for_each_penetrating(angles, |link, at, outward, depth, stiffness, poses| {
            energy += 0.5 * stiffness * depth * depth;
            let jacobian = self.hand.tree.jacobian(poses, link, &poses[link].inverse_transform_point(&at));
            let lever: DVector<f64> = DVector::from_iterator(
                n,
                path.joints.iter().map(|own| outward.dot(&jacobian.fixed_view::<3, 1>(0, own.joint))),
            );
            gradient -= &lever * (stiffness * depth);
            hessian += &lever * lever.transpose() * stiffness;
        });
        (energy, gradient, hessian)
    }

    /// Calls `found` for each skin element that penetrates the obstacle: link, position, outward direction, depth (m),
    /// stiffness (N/m), poses.
    fn for_each_penetrating(
        &self,
        angles: &[f64],
        mut found: impl FnMut(usize, Point3<f64>, Vector3<f64>, f64, f64, &[nalgebra::Isometry3<f64>]),
    ) {
        let poses = self.hand.tree.forward(angles);
        for (&link, skin) in self.hand.links(self.digit).iter().zip(&self.skin) {
            let center = poses[link] * self.hand.covers[link].link_from_cover * Point3::origin();
            if (self.obstacle)(link, &center).0 > self.hand.covers[link].half.norm() {
                continue;
            }
            for element in skin {
                let at = poses[link] * element.point;
                let (distance, outward) = (self.obstacle)(link, &at);
                if distance < 0.0 {
                    found(link, at, outward, -distance, self.foundation * element.area, &poses);
                }
            }
        }
    }

    /// Moves the digit to rest at its spans' tensions; returns the largest residual torque, N m.
    fn relax(&self, angles: &mut HandVector, spans: &[f64; MAX_SPANS]) -> f64 {
        let joints = self.joints();
        let limits: Vec<(f64, f64)> =
            joints.iter().map(|j| (self.hand.tree.joints[*j].lower, self.hand.tree.joints[*j].upper)).collect();
        let mut damping = 0.0;
        let (mut energy, mut gradient, mut hessian) = self.energy(angles, spans);
        for _ in 0..MAX_NEWTON_ITERATIONS {
            // A joint pressed against its stop is left out.
            let stopped = |row: usize, angles: &[f64], gradient: &DVector<f64>| {
                let (q, (low, high)) = (angles[joints[row]], limits[row]);
                (q <= low && gradient[row] > 0.0) || (q >= high && gradient[row] < 0.0)
            };
            let rest = (0..joints.len())
                .filter(|row| !stopped(*row, angles, &gradient))
                .fold(0.0, |most: f64, row| most.max(gradient[row].abs()));
            if rest < TORQUE_TOLERANCE {
                return rest;
            }
            let (mut system, mut right) = (hessian.clone(), -&gradient);
            for row in 0..joints.len() {
                system[(row, row)] += damping;
                if stopped(row, angles, &gradient) {
                    system.row_mut(row).fill(0.0);
                    system.column_mut(row).fill(0.0);
                    system[(row, row)] = 1.0;
                    right[row] = 0.0;
                }
            }
            let Some(factor) = system.cholesky() else { return rest };
            let mut step = factor.solve(&right);
            let longest = step.amax();
            if longest > MAX_JOINT_STEP {
                step *= MAX_JOINT_STEP / longest;
            }
            let mut trial = *angles;
            for (row, joint) in joints.iter().enumerate() {
                trial[*joint] = (trial[*joint] + step[row]).clamp(limits[row].0, limits[row].1);
            }
            let next = self.energy(&trial, spans);
            if next.0 <= energy + 1e-15 {
                *angles = trial;
                (energy, gradient, hessian) = next;
                damping *= 0.3;
            } else {
                damping = (4.0 * damping).max(1e-3);
            }
        }
        (0..joints.len())
            .filter(|row| {
                let (q, (low, high)) = (angles[joints[*row]], limits[*row]);
                q > low && q < high
            })
            .fold(0.0, |most: f64, row| most.max(gradient[row].abs()))
    }

    fn contact_forces(&self, angles: &[f64]) -> Vec<LinkForce> {
        let mut sums = vec![(0.0, Vector3::zeros(), Vector3::zeros()); angles.len()];
        self.for_each_penetrating(angles, |link, at, outward, depth, stiffness, _| {
            let force = stiffness * depth;
            sums[link].0 += force;
            sums[link].1 += at.coords * force;
            sums[link].2 += outward * force;
        });
        let loaded = sums.iter().enumerate().filter(|(_, sum)| sum.0 > 0.0);
        loaded.map(|(link, sum)| LinkForce { link, point: (sum.1 / sum.0).into(), force: sum.2 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NO_OBSTACLE: fn(&Point3<f64>) -> (f64, Vector3<f64>) = |_| (1.0, Vector3::z());

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Without an obstacle, the minimum of the energy equals the closed form.
        #[test]
        fn free_is_the_limit_of_against(t in proptest::collection::vec(0.0f64..15.0, 5), opposition in 0.0f64..1.5) {
            let hand = Hand::ftac();
            let tensions = [t[0], t[1], t[2], t[3], t[4]];
            let found = contact_equilibrium(&hand, &tensions, opposition, &GuideFriction::NONE, 1e9, NO_OBSTACLE).expect("at rest");
            let expected = free_equilibrium(&hand, &tensions, opposition);
            for (ours, closed) in found.angles.iter().zip(&expected) {
                prop_assert!((ours - closed).abs() < 1e-4, "{ours} {closed}");
            }
        }

        /// The same with friction in the guides, after closing and after opening: at the same tension, the digit is
        /// less flexed after closing.
        #[test]
        fn free_is_the_limit_of_against_with_friction(tension in 0.5f64..10.0, opposition in 0.0f64..1.5) {
            let hand = Hand::ftac();
            let (tensions, friction) = ([tension; 5], hand.parameters.cable.friction);
            let [closed, opened] = [1.0, -1.0].map(|state| {
                let slid = GuideFriction { friction, state };
                let found = contact_equilibrium(&hand, &tensions, opposition, &slid, 1e9, NO_OBSTACLE).expect("at rest");
                (found.angles, free_equilibrium_with_friction(&hand, &tensions, opposition, &slid))
            });
            for (found, expected) in [&closed, &opened] {
                for (ours, exact) in found.iter().zip(expected) {
                    prop_assert!((ours - exact).abs() < 1e-4, "{ours} {exact}");
                }
            }
            prop_assert!(closed.1[3] < opened.1[3] && closed.1[5] < opened.1[5]);
        }

        /// The gradient is the energy's derivative, contact included.
        #[test]
        fn gradient_is_finite_difference(q in proptest::collection::vec(0.1f64..1.4, 3), tension in 0.0f64..30.0) {
            let hand = Hand::ftac();
            let digit = Digit::Middle;
            let wall = |_: usize, p: &Point3<f64>| (p.z + 0.01, Vector3::z());
            let skin = build_skin(&hand, digit, ELEMENT_SIZE);
            let problem = Problem { hand: &hand, digit, skin, foundation: 1e8, obstacle: &wall };
            let mut angles = hand.open_angles();
            angles[6..9].copy_from_slice(&q);
            let (_, gradient, _) = problem.energy(&angles, &[tension, 0.9 * tension, 0.7 * tension]);
            for row in 0..3 {
                let h = 1e-7;
                let at = |shift: f64| { let mut a = angles; a[6 + row] += shift; problem.energy(&a, &[tension, 0.9 * tension, 0.7 * tension]).0 };
                let difference = (at(h) - at(-h)) / (2.0 * h);
                prop_assert!((difference - gradient[row]).abs() < 1e-4 * (1.0 + gradient[row].abs()), "{row}: {difference} {}", gradient[row]);
            }
        }
    }

    /// A wall stops one finger: the torques of cable, springs and wall balance at every joint, and the wall holds no
    /// other digit.
    #[test]
    fn balance_at_a_wall() {
        let hand = Hand::ftac();
        let wall = |p: &Point3<f64>| (p.z, Vector3::z());
        let rest = contact_equilibrium(&hand, &[0.0, 12.0, 0.0, 0.0, 0.0], 0.0, &GuideFriction::NONE, 1e9, wall)
            .expect("at rest");
        let torques = hand.transmission.torques(&rest.angles, &[0.0, 12.0, 0.0, 0.0, 0.0]);
        let poses = hand.tree.forward(&rest.angles);
        assert!(!rest.contact_forces.is_empty());
        for (joint, torque) in torques.iter().enumerate().take(6).skip(3) {
            let push: f64 = rest
                .contact_forces
                .iter()
                .map(|push| {
                    let local = poses[push.link].inverse_transform_point(&push.point);
                    push.force.dot(&hand.tree.jacobian(&poses, push.link, &local).fixed_view::<3, 1>(0, joint))
                })
                .sum();
            let (q, limits) = (rest.angles[joint], &hand.tree.joints[joint]);
            let stop = q <= limits.lower || q >= limits.upper;
            assert!(stop || (torque + push).abs() < 1e-4, "{joint}: {torque} {push}");
        }
    }
}
