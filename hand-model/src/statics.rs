//! Static equilibrium of the cable-driven digits: from tensions to joint angles, free or against an obstacle.
//!
//! At rest the hand sits in a minimum of its potential energy
//! U(q) = sum of K q^2 / 2 - sum of T e(q) + sum over the skin of k A d^2 / 2
//! with springs K, tensions T, cable excursions e, and a skin of many small elements of area A, each pressed by its depth d
//! in the obstacle under a foundation stiffness k (Pa/m). The gradient is the joint torque balance. Tension is raised from zero
//! in steps and each step solved by a damped Newton method, so that the digits come to rest where closing leads them and not
//! behind the obstacle. The obstacle does not move and has no friction. The opposition joint stands where it is told to.
//!
//! With friction in the guides every span has its own tension ([`crate::transmission::friction`]), which is frozen at the
//! posture a load step starts from and found anew until it no longer changes.

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use crate::hand::{Hand, SkinElement};
use crate::transmission::friction::CableFriction;
use crate::transmission::{Crossing, SPANS};
use crate::{Digit, HandVector};

/// Size of a skin element's side, m; that of a digit of which only the closure is asked for.
const ELEMENT: f64 = 0.002;
const COARSE_ELEMENT: f64 = 0.005;
/// Load steps from zero to full tension.
const LOAD_STEPS: usize = 24;
/// Newton iterations of a load step at most.
const ITERATIONS: usize = 200;
/// Torque balance at which a joint is at rest, N m.
const TOLERANCE: f64 = 1e-7;
/// Torques farther from balance than this are no equilibrium, N m; where only a digit's closure is asked for, a hundredth of what bends it.
const FAILURE: f64 = 1e-4;
const COARSE_FAILURE: f64 = 2e-3;
/// Rounds in which the spans' tensions are found anew at most, and the change of an angle at which they stand, rad.
const ROUNDS: usize = 30;
const STANDS: f64 = 1e-6;
/// Largest change of a joint in one iteration, rad.
const LARGEST_STEP: f64 = 0.05;

/// The cables' friction with all guides in the same state: 1 when the digits have closed, -1 when they have opened.
#[derive(Debug, Clone, Copy)]
pub struct Slid {
    /// Friction in the guides.
    pub friction: CableFriction,
    /// State of all guides, -1 to 1.
    pub state: f64,
}

impl Slid {
    /// Guides that take nothing.
    pub const NOTHING: Self = Self { friction: CableFriction::NONE, state: 0.0 };
}

/// What is pushed where.
#[derive(Debug, Clone, Copy)]
pub struct Push {
    /// The link that is pushed.
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
    /// What presses on the links.
    pub pushes: Vec<Push>,
}

/// No posture at rest was found.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("{digit}: no equilibrium at tension {tension} N: torque off balance by {found} N m, expected below {most} N m")]
pub struct NoEquilibrium {
    /// The digit that does not come to rest.
    pub digit: &'static str,
    /// Its cable tension, N.
    pub tension: f64,
    /// What remains, N m.
    pub found: f64,
    /// What may remain, N m.
    pub most: f64,
}

/// Equilibrium without contact at cable `tensions` (N), the opposition joint at `opposition` (rad).
pub fn free(hand: &Hand, tensions: &[f64], opposition: f64) -> HandVector {
    free_sliding(hand, tensions, opposition, &Slid::NOTHING)
}

/// As [`free`], for cables that rub in their guides.
pub fn free_sliding(hand: &Hand, tensions: &[f64], opposition: f64, slid: &Slid) -> HandVector {
    let mut angles = hand.open();
    if let Some(joint) = hand.transmission.opposition {
        angles[joint] = opposition;
    }
    for (cable, tension) in tensions.iter().enumerate() {
        let friction = hand.guides(cable, &slid.friction);
        let found = hand.transmission.free_angles_sliding(cable, *tension, &friction, slid.state);
        for (joint, angle) in found {
            angles[joint] = angle.clamp(hand.tree.joints[joint].lower, hand.tree.joints[joint].upper);
        }
    }
    angles
}

/// Equilibrium against an obstacle: `obstacle` gives the signed distance (m, negative inside) of a point in the palm frame and
/// the outward direction there; `foundation` is the skin's stiffness, Pa/m.
pub fn against(
    hand: &Hand,
    tensions: &[f64],
    opposition: f64,
    slid: &Slid,
    foundation: f64,
    obstacle: impl Fn(&Point3<f64>) -> (f64, Vector3<f64>),
) -> Result<Equilibrium, NoEquilibrium> {
    let mut angles = hand.open();
    if let Some(joint) = hand.transmission.opposition {
        angles[joint] = opposition;
    }
    let mut pushes = Vec::new();
    for &digit in hand.digits() {
        let skin = skin_of(hand, digit, ELEMENT);
        let problem = Problem { hand, digit, skin, foundation, obstacle: &|_, point: &Point3<f64>| obstacle(point) };
        problem.close(&mut angles, tensions[digit.index()], slid, FAILURE)?;
        pushes.extend(problem.pushes(&angles));
    }
    Ok(Equilibrium { angles, pushes })
}

/// Joint angles (rad) of a hand whose joints are at `q` (rad) after one `digit` has gone on from there at its `tension` (N) until it rests
/// against an obstacle, which may be another one for each link: signed distance and outward direction as in [`against`].
pub fn closed(
    hand: &Hand,
    (digit, tension): (Digit, f64),
    q: &[f64],
    foundation: f64,
    obstacle: impl Fn(usize, &Point3<f64>) -> (f64, Vector3<f64>),
) -> Result<HandVector, NoEquilibrium> {
    let mut angles: HandVector = q.iter().copied().collect();
    let problem = Problem { hand, digit, skin: skin_of(hand, digit, COARSE_ELEMENT), foundation, obstacle: &obstacle };
    problem.settle(&mut angles, tension, &Slid::NOTHING, COARSE_FAILURE)?;
    Ok(angles)
}

/// The skin of each link of a digit, in elements with sides of this length, m.
fn skin_of(hand: &Hand, digit: Digit, element: f64) -> Vec<Vec<SkinElement>> {
    hand.links(digit).iter().map(|link| hand.covers[*link].skin(element)).collect()
}

struct Problem<'a, F> {
    hand: &'a Hand,
    digit: Digit,
    /// Of each of the digit's links.
    skin: Vec<Vec<SkinElement>>,
    foundation: f64,
    obstacle: &'a F,
}

impl<F: Fn(usize, &Point3<f64>) -> (f64, Vector3<f64>)> Problem<'_, F> {
    /// Raises the digit's tension from zero to `full` (N), with the joints at `angles`, which it moves, and leaves torques off balance
    /// by no more than `most` (N m).
    fn close(&self, angles: &mut HandVector, full: f64, slid: &Slid, most: f64) -> Result<(), NoEquilibrium> {
        (1..=LOAD_STEPS).try_for_each(|step| self.settle(angles, full * step as f64 / LOAD_STEPS as f64, slid, most))
    }

    /// Moves the joints from `angles` to rest at this `tension` (N), torques off balance by no more than `most` (N m).
    fn settle(&self, angles: &mut HandVector, tension: f64, slid: &Slid, most: f64) -> Result<(), NoEquilibrium> {
        let (hand, digit) = (self.hand, self.digit);
        for _ in 0..ROUNDS {
            let before = *angles;
            let path = &hand.transmission.cables[digit.index()];
            let friction = hand.guides(digit.index(), &slid.friction);
            let spans = path.span_tensions(angles, tension, &friction, &[slid.state; SPANS]);
            let rest = self.relax(angles, &spans);
            if rest > most {
                return Err(NoEquilibrium { digit: digit.name(), tension, found: rest, most });
            }
            let changed = angles.iter().zip(&before).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            if slid.friction.coefficient == 0.0 || changed < STANDS {
                break;
            }
        }
        Ok(())
    }

    fn joints(&self) -> Vec<usize> {
        self.hand.transmission.cables[self.digit.index()].joints.iter().map(|crossing| crossing.joint).collect()
    }

    /// Energy (J), its gradient (N m) and a positive approximation of its Hessian (N m/rad) over the cable's joints.
    fn energy(&self, angles: &[f64], spans: &[f64; SPANS]) -> (f64, DVector<f64>, DMatrix<f64>) {
        let path = &self.hand.transmission.cables[self.digit.index()];
        let n = path.joints.len();
        let (mut energy, mut gradient, mut hessian) = (0.0, DVector::zeros(n), DMatrix::zeros(n, n));
        for (row, Crossing { joint, lever, .. }) in path.joints.iter().enumerate() {
            let (q, k) = (angles[*joint], self.hand.transmission.springs[*joint]);
            let (tension, turn) = (spans[row], q - self.hand.transmission.rests[*joint]);
            energy += 0.5 * k * turn * turn - tension * lever.excursion(q);
            gradient[row] = k * turn - tension * lever.moment_arm(q);
            let h = 1e-5;
            let slope = (lever.moment_arm(q + h) - lever.moment_arm(q - h)) / (2.0 * h);
            hessian[(row, row)] = (k - tension * slope).max(0.1 * k);
        }
        self.each_pressed(angles, |link, at, outward, depth, stiffness, poses| {
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

    /// Calls `found` for each skin element in the obstacle: link, place, outward direction, depth (m), stiffness (N/m), poses.
    fn each_pressed(
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

    /// Moves the digit to rest at its spans' tensions; returns the largest torque left, N m.
    fn relax(&self, angles: &mut HandVector, spans: &[f64; SPANS]) -> f64 {
        let joints = self.joints();
        let limits: Vec<(f64, f64)> =
            joints.iter().map(|j| (self.hand.tree.joints[*j].lower, self.hand.tree.joints[*j].upper)).collect();
        let mut damping = 0.0;
        let (mut energy, mut gradient, mut hessian) = self.energy(angles, spans);
        for _ in 0..ITERATIONS {
            // A joint at its stop that is pushed against it takes no part.
            let stopped = |row: usize, angles: &[f64], gradient: &DVector<f64>| {
                let (q, (low, high)) = (angles[joints[row]], limits[row]);
                (q <= low && gradient[row] > 0.0) || (q >= high && gradient[row] < 0.0)
            };
            let rest = (0..joints.len())
                .filter(|row| !stopped(*row, angles, &gradient))
                .fold(0.0, |most: f64, row| most.max(gradient[row].abs()));
            if rest < TOLERANCE {
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
            if longest > LARGEST_STEP {
                step *= LARGEST_STEP / longest;
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

    fn pushes(&self, angles: &[f64]) -> Vec<Push> {
        let mut sums = vec![(0.0, Vector3::zeros(), Vector3::zeros()); angles.len()];
        self.each_pressed(angles, |link, at, outward, depth, stiffness, _| {
            let force = stiffness * depth;
            sums[link].0 += force;
            sums[link].1 += at.coords * force;
            sums[link].2 += outward * force;
        });
        let loaded = sums.iter().enumerate().filter(|(_, sum)| sum.0 > 0.0);
        loaded.map(|(link, sum)| Push { link, point: (sum.1 / sum.0).into(), force: sum.2 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NOTHING: fn(&Point3<f64>) -> (f64, Vector3<f64>) = |_| (1.0, Vector3::z());

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// With nothing in the way, the energy's minimum is the closed form's.
        #[test]
        fn free_is_the_limit_of_against(t in proptest::collection::vec(0.0f64..15.0, 5), opposition in 0.0f64..1.5) {
            let hand = Hand::ftac();
            let tensions = [t[0], t[1], t[2], t[3], t[4]];
            let found = against(&hand, &tensions, opposition, &Slid::NOTHING, 1e9, NOTHING).expect("at rest");
            let expected = free(&hand, &tensions, opposition);
            for (ours, closed) in found.angles.iter().zip(&expected) {
                prop_assert!((ours - closed).abs() < 1e-4, "{ours} {closed}");
            }
        }

        /// The same with rubbing cables, closed and opened; closing less far than opening.
        #[test]
        fn free_is_the_limit_of_against_with_friction(tension in 0.5f64..10.0, opposition in 0.0f64..1.5) {
            let hand = Hand::ftac();
            let (tensions, friction) = ([tension; 5], hand.parameters.cable.friction);
            let [closed, opened] = [1.0, -1.0].map(|state| {
                let slid = Slid { friction, state };
                let found = against(&hand, &tensions, opposition, &slid, 1e9, NOTHING).expect("at rest");
                (found.angles, free_sliding(&hand, &tensions, opposition, &slid))
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
            let skin = skin_of(&hand, digit, ELEMENT);
            let problem = Problem { hand: &hand, digit, skin, foundation: 1e8, obstacle: &wall };
            let mut angles = hand.open();
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

    /// A wall that stops one finger: the torques of cable, springs and wall balance at every joint, the wall holds no other.
    #[test]
    fn balance_at_a_wall() {
        let hand = Hand::ftac();
        let wall = |p: &Point3<f64>| (p.z, Vector3::z());
        let rest = against(&hand, &[0.0, 12.0, 0.0, 0.0, 0.0], 0.0, &Slid::NOTHING, 1e9, wall).expect("at rest");
        let torques = hand.transmission.torques(&rest.angles, &[0.0, 12.0, 0.0, 0.0, 0.0]);
        let poses = hand.tree.forward(&rest.angles);
        assert!(!rest.pushes.is_empty());
        for (joint, torque) in torques.iter().enumerate().take(6).skip(3) {
            let push: f64 = rest
                .pushes
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
