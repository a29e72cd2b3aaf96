//! Odds of a try: success and contact probabilities from rehearsals under sampled errors, for an aim with an unknown
//! error.
//!
//! A grasp was rehearsed in physics under errors of its aim, and each rehearsal held, missed or made an unwanted
//! contact. In a trial the error of the aim is b + n: b persists through the trial (the error of the arm and the
//! persistent part of vision's error), n is new at each look. A [`Belief`] is a set of weighted samples of b. The odds
//! at one b come from the rehearsals near it, weighted by a Gaussian kernel as wide as n (the Nadaraya-Watson
//! estimator). The odds of the try are their mean over the belief. A failed try makes those b more likely at which it
//! had to fail.
//!
//! Two dozen rehearsals alone are too few to tell grasps apart: the best of many such estimates is mostly the luckiest.
//! Rehearsals of the other grasps of the same object therefore count too, each with a reduced weight.
//!
//! Rehearsals after various holds of the first object are weighted by the similarity of their hold to the felt one
//! ([`Rehearsed::beside`]).

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};

use crate::extent::Extent;
use crate::uncertainty::Uncertainty;

/// Number of samples of the persistent error in a belief.
const VALUES: usize = 96;
/// Smallest kernel width, m: at about this width, left-out rehearsals are predicted best by the others.
const NARROWEST: f64 = 0.004;
/// Kernel weight of a default outcome that dominates where no rehearsal is near: no hold, and a contact in half of the
/// cases.
const UNKNOWN: f64 = 0.2;
/// Weight of a rehearsal of any grasp of the same object; those of the grasp itself count with the rest of 1 in
/// addition.
const OTHERS: f64 = 0.2;
/// Smallest weight of a rehearsal after another hold: with few sampled holds, none is similar to the felt one in all
/// components.
const ANY_HOLD: f64 = 0.1;
/// Number of aims along each axis of the grid of [`Belief::odds_around`]; odd.
pub const AIMS: usize = 5;
/// Spacing of the aims, m.
const AIM_STEP: f64 = 0.004;
/// Largest logarithm of the factor between neighbours in that grid; no kernel reaches beyond it.
const MOST_APART: f64 = 300.0;

/// Outcome of a try at the second object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TryOutcome {
    /// The object is lifted, and the first one is still held.
    Held,
    /// The object is not lifted, and there was no unwanted contact.
    Missed,
    /// The first object, the digits that hold it, or the palm touched the second object.
    Contact,
}

/// One rehearsal of a grasp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rehearsed {
    /// Error of the aim, m, in axes that turn with the grasp's heading.
    pub error: Vector3<f64>,
    /// Extent of the first object as it was held; `None` if all rehearsals have the planned hold.
    pub hold: Option<Extent>,
    pub outcome: TryOutcome,
    /// Weight for the felt hold; 1 for its own hold.
    pub weight: f64,
}

impl Rehearsed {
    /// A rehearsal after the planned hold.
    pub fn new(error: Vector3<f64>, outcome: TryOutcome) -> Self {
        Self { error, hold: None, outcome, weight: 1.0 }
    }

    /// Weights the rehearsal by the similarity of its hold to the felt one.
    #[must_use]
    pub fn beside(&self, felt: &Extent) -> Self {
        let weight = |hold: Extent| ANY_HOLD + (1.0 - ANY_HOLD) * hold.likeness(felt);
        Self { weight: self.hold.map_or(1.0, weight), ..*self }
    }
}

/// Probabilities of a try's outcomes; the rest is the probability of a miss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odds {
    pub held: f64,
    pub contact: f64,
}

/// Properties of a try that determine its odds.
#[derive(Debug, Clone)]
pub struct Aimed {
    /// Rehearsals of the grasp.
    pub rehearsed: Arc<[Rehearsed]>,
    /// Rehearsals of all grasps of the object, including this one.
    pub all: Arc<[Rehearsed]>,
    /// Yaw of the grasp in the world, rad.
    pub heading: f64,
    /// Offset of the aim from the seen position, m, world.
    pub aim: Vector3<f64>,
}

/// Belief about the persistent error of the aim: weighted samples (a particle set).
#[derive(Debug, Clone)]
pub struct Belief {
    /// Samples of the error, m, world.
    values: Vec<Vector3<f64>>,
    /// Weights of the samples; they add up to 1.
    weights: Vec<f64>,
    /// Standard deviation of the part of vision's error that is new at each look, m.
    fresh: f64,
}

impl Belief {
    /// Prior belief, before any try.
    pub fn new(uncertainty: &Uncertainty) -> Self {
        let level = uncertainty.lasting();
        let sigmas = Vector3::new(level, level, uncertainty.arm);
        let values = (1..=VALUES).map(|n| normals(n).component_mul(&sigmas)).collect();
        Self { values, weights: vec![1.0 / VALUES as f64; VALUES], fresh: uncertainty.fresh_look() }
    }

    /// Belief about an object that was located by touch, so that its position relative to the hand is known with this
    /// covariance (m2, world). `None` if the covariance is not positive definite.
    pub fn located(covariance: &Matrix3<f64>) -> Option<Self> {
        let root = covariance.cholesky()?.l();
        let values = (1..=VALUES).map(|n| root * normals(n)).collect();
        Some(Self { values, weights: vec![1.0 / VALUES as f64; VALUES], fresh: 0.0 })
    }

    /// Odds of a try at an object whose position is the mean of `looks` looks.
    pub fn odds(&self, aimed: &Aimed, looks: u32) -> Odds {
        let mut odds = Odds { held: 0.0, contact: 0.0 };
        for (value, weight) in self.values.iter().zip(&self.weights) {
            let there = self.at(aimed, value, looks);
            odds.held += weight * there.held;
            odds.contact += weight * there.contact;
        }
        odds
    }

    /// [`Self::odds`] for a square grid of aims, centred on that of `aimed`; [`aim_beside`] gives the offsets of the
    /// others.
    ///
    /// A kernel is a product over the world's axes. Along an axis, its values at evenly spaced aims form a power
    /// series: `exp(-(d - n s)^2 / 2 w^2) = exp(-d^2 / 2 w^2) exp(d s / w^2)^n exp(-s^2 / 2 w^2)^(n^2)`.
    pub fn odds_around(&self, aimed: &Aimed, looks: u32) -> [[Odds; AIMS]; AIMS] {
        let width = self.fresh(looks).max(NARROWEST);
        let inverse = 1.0 / (width * width);
        let fall = (-0.5 * AIM_STEP * AIM_STEP * inverse).exp();
        let turn = Rotation2::new(aimed.heading);
        let counted = |rehearsed: &Rehearsed, share| {
            let level = turn * rehearsed.error.xy();
            (Vector3::new(level.x, level.y, rehearsed.error.z) - aimed.aim, share * rehearsed.weight, rehearsed.outcome)
        };
        let own = aimed.rehearsed.iter().map(|rehearsed| counted(rehearsed, 1.0 - OTHERS));
        let all = aimed.all.iter().map(|rehearsed| counted(rehearsed, OTHERS));
        let rehearsals: Vec<_> = own.chain(all).collect();
        let mut odds = [[Odds { held: 0.0, contact: 0.0 }; AIMS]; AIMS];
        for (value, weight) in self.values.iter().zip(&self.weights) {
            // Sums over rehearsals that held, made a contact and missed.
            let mut sums = [[[0.0; AIMS]; AIMS]; 3];
            for (error, share, outcome) in &rehearsals {
                let off = error - value;
                let middle = share * (-0.5 * off.norm_squared() * inverse).exp();
                let [x, y] = [off.x, off.y].map(|off| beside(off * AIM_STEP * inverse, fall));
                let sum = &mut sums[match outcome {
                    TryOutcome::Held => 0,
                    TryOutcome::Contact => 1,
                    TryOutcome::Missed => 2,
                }];
                for (line, x) in sum.iter_mut().zip(x) {
                    line.iter_mut().zip(y).for_each(|(sum, y)| *sum += middle * x * y);
                }
            }
            for (x, line) in odds.iter_mut().enumerate() {
                for (y, odds) in line.iter_mut().enumerate() {
                    let [held, contact, missed] = sums.map(|sum| sum[x][y]);
                    let share = weight / (UNKNOWN + held + contact + missed);
                    odds.held += share * held;
                    odds.contact += share * (0.5 * UNKNOWN + contact);
                }
            }
        }
        odds
    }

    /// Updates the belief after a try that did not hold the object.
    pub fn failed(&mut self, aimed: &Aimed, looks: u32) {
        let likely: Vec<f64> = self.values.iter().map(|value| 1.0 - self.at(aimed, value, looks).held).collect();
        let sum: f64 = self.weights.iter().zip(&likely).map(|(weight, likely)| weight * likely).sum();
        if sum > 0.0 {
            self.weights.iter_mut().zip(&likely).for_each(|(weight, likely)| *weight *= likely / sum);
        }
    }

    /// Mean of the persistent error, m, world.
    pub fn mean(&self) -> Vector3<f64> {
        self.values.iter().zip(&self.weights).map(|(value, weight)| value * *weight).sum()
    }

    /// The `n`-th of `of` equal-weight samples of the persistent error, m, world.
    pub(crate) fn value(&self, n: usize, of: usize) -> Vector3<f64> {
        let mut left = (n as f64 + 0.5) / of as f64;
        let reached = |weight: &f64| {
            left -= weight;
            left <= 0.0
        };
        let place = self.weights.iter().position(reached).unwrap_or(self.values.len() - 1);
        self.values[place]
    }

    /// Standard deviation of the non-persistent error in the mean of `looks` looks, for each of x and y, m.
    pub(crate) fn fresh(&self, looks: u32) -> f64 {
        self.fresh / f64::from(looks.max(1)).sqrt()
    }

    /// Standard deviation of the persistent error, m: root of the mean variance over the axes.
    pub fn sigma(&self) -> f64 {
        let mean = self.mean();
        let squares =
            self.values.iter().zip(&self.weights).map(|(value, weight)| weight * (value - mean).norm_squared());
        (squares.sum::<f64>() / 3.0).sqrt()
    }

    /// Odds under the assumption that the persistent error is `value`.
    fn at(&self, aimed: &Aimed, value: &Vector3<f64>, looks: u32) -> Odds {
        let width = self.fresh(looks).max(NARROWEST);
        let off = value + aimed.aim;
        let level = Rotation2::new(-aimed.heading) * Vector2::new(off.x, off.y);
        let off = Vector3::new(level.x, level.y, off.z);
        let (mut held, mut contact, mut sum) = (0.0, 0.5 * UNKNOWN, UNKNOWN);
        for (rehearsals, share) in [(&aimed.rehearsed, 1.0 - OTHERS), (&aimed.all, OTHERS)] {
            for Rehearsed { error, outcome, weight, .. } in rehearsals.iter() {
                let near = share * weight * (-0.5 * (error - off).norm_squared() / (width * width)).exp();
                sum += near;
                match outcome {
                    TryOutcome::Held => held += near,
                    TryOutcome::Contact => contact += near,
                    TryOutcome::Missed => {}
                }
            }
        }
        Odds { held: held / sum, contact: contact / sum }
    }
}

/// Offset of the `n`-th aim of [`Belief::odds_around`] from the middle one along an axis, m.
pub fn aim_beside(n: usize) -> f64 {
    (n as f64 - (AIMS / 2) as f64) * AIM_STEP
}

/// Kernel along an axis at the aims of [`aim_beside`], relative to its value at the middle one: `slope` is d s / w^2
/// and `fall` is exp(-s^2 / 2 w^2), in the notation of [`Belief::odds_around`].
fn beside(slope: f64, fall: f64) -> [f64; AIMS] {
    let step = slope.clamp(-MOST_APART, MOST_APART).exp();
    let (mut values, back) = ([1.0; AIMS], step.recip());
    // From n to n + 1 the last factor falls by its power 2 n + 1.
    let (mut up, mut down) = (step * fall, back * fall);
    for n in 1..=AIMS / 2 {
        values[AIMS / 2 + n] = values[AIMS / 2 + n - 1] * up;
        values[AIMS / 2 - n] = values[AIMS / 2 + 1 - n] * down;
        (up, down) = (up * fall * fall, down * fall * fall);
    }
    values
}

/// Point number `n` (from 1) of a low-discrepancy sequence of three standard normals: Halton's sequence through the
/// Box-Muller transform.
fn normals(n: usize) -> Vector3<f64> {
    let [a, b, c, d] = [2, 3, 5, 7].map(|base| halton(n, base));
    let [one, two] = [a, c].map(|uniform| (-2.0 * uniform.ln()).sqrt());
    Vector3::new(one * (TAU * b).cos(), one * (TAU * b).sin(), two * (TAU * d).cos())
}

/// Van der Corput sequence: the digits of `n` in `base`, mirrored at the point.
fn halton(mut n: usize, base: usize) -> f64 {
    let (mut value, mut place) = (0.0, 1.0);
    while n > 0 {
        place /= base as f64;
        value += place * (n % base) as f64;
        n /= base;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNCERTAINTY: Uncertainty = Uncertainty { arm: 0.005, eyes: 0.006, eyes_lasting: 0.5 };

    /// Rehearsals on a grid of 3 mm: contact where the error is below -4 mm along x, a miss above 8 mm, a hold in
    /// between.
    fn wall() -> Arc<[Rehearsed]> {
        let steps = || (-6..=6).map(|n| 0.003 * f64::from(n));
        let outcome = |x: f64| match x {
            x if x < -0.004 => TryOutcome::Contact,
            x if x > 0.008 => TryOutcome::Missed,
            _ => TryOutcome::Held,
        };
        steps()
            .flat_map(|x| steps().map(move |y| (x, y)))
            .flat_map(|(x, y)| [-0.005, 0.0, 0.005].map(|z| Vector3::new(x, y, z)))
            .map(|error| Rehearsed::new(error, outcome(error.x)))
            .collect()
    }

    fn aimed(x: f64) -> Aimed {
        Aimed { rehearsed: wall(), all: wall(), heading: 0.0, aim: Vector3::new(x, 0.0, 0.0) }
    }

    #[test]
    fn values_spread_as_expected() {
        let belief = Belief::new(&UNCERTAINTY);
        let level = UNCERTAINTY.lasting();
        for (axis, sigma) in [level, level, UNCERTAINTY.arm].into_iter().enumerate() {
            let variance = belief.values.iter().map(|value| value[axis].powi(2)).sum::<f64>() / VALUES as f64;
            assert!((variance.sqrt() / sigma - 1.0).abs() < 0.1, "axis {axis}: {}", variance.sqrt() / sigma);
        }
        assert!(belief.mean().norm() < 0.001);
    }

    /// The odds are integrals of the normal distribution: contact left of the wall, hold right of it.
    #[test]
    fn odds_are_integrals() {
        let belief = Belief::new(&UNCERTAINTY);
        let sigma = UNCERTAINTY.arm.hypot(UNCERTAINTY.eyes);
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * 2.0_f64.sqrt()));
        for x in [-0.003, 0.0, 0.004] {
            // Halfway between the points of the grid.
            let odds = belief.odds(&aimed(x), 1);
            assert!((odds.contact - below(-0.0045 - x)).abs() < 0.06, "{x}: {odds:?} {}", below(-0.0045 - x));
            assert!((odds.held - (below(0.0075 - x) - below(-0.0045 - x))).abs() < 0.08, "{x}: {odds:?}");
        }
        assert!(belief.odds(&aimed(0.006), 1).contact < belief.odds(&aimed(0.0), 1).contact);
    }

    /// The grid of aims has the same odds as each aim alone, near rehearsals and far from all of them.
    #[test]
    fn odds_around_are_those_of_each_aim() {
        let mut belief = Belief::new(&UNCERTAINTY);
        belief.failed(&aimed(0.002), 1);
        for (at, heading, looks) in [(0.0, 0.0, 1), (0.004, 0.7, 2), (-0.03, -2.0, 3), (0.5, 0.3, 1), (30.0, 0.0, 1)] {
            let middle = Aimed { heading, aim: Vector3::new(at, -0.001, 0.002), ..aimed(0.0) };
            let around = belief.odds_around(&middle, looks);
            for (x, line) in around.iter().enumerate() {
                for (y, found) in line.iter().enumerate() {
                    let beside = Vector3::new(aim_beside(x), aim_beside(y), 0.0);
                    let exact = belief.odds(&Aimed { aim: middle.aim + beside, ..middle.clone() }, looks);
                    let off = (found.held - exact.held).abs().max((found.contact - exact.contact).abs());
                    assert!(off < 1e-12, "({x}, {y}) at {at}: {found:?} {exact:?}");
                }
            }
        }
    }

    /// Far from all rehearsals, no hold is promised.
    #[test]
    fn far_from_all_rehearsals_nothing_is_promised() {
        let odds = Belief::new(&UNCERTAINTY).odds(&aimed(0.1), 1);
        assert!(odds.held < 1e-6 && (odds.contact - 0.5).abs() < 1e-6, "{odds:?}");
    }

    /// After a failure, errors at which the try fails are more likely, and aiming elsewhere pays.
    #[test]
    fn failures_teach() {
        let mut belief = Belief::new(&UNCERTAINTY);
        let before = belief.odds(&aimed(0.0), 1);
        for _ in 0..3 {
            belief.failed(&aimed(0.0), 1);
        }
        assert!((belief.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(belief.odds(&aimed(0.0), 1).held < before.held - 0.1);
        // A try that aims far to the right and fails indicates that the error is not far to the left.
        let mut right = Belief::new(&UNCERTAINTY);
        right.failed(&aimed(0.010), 1);
        assert!(right.mean().x > 0.0);
    }

    /// An object that was located by touch is predicted by the rehearsals close to its position.
    #[test]
    fn what_was_located_leaves_little_doubt() {
        let covariance = Matrix3::identity() * 0.001_f64.powi(2);
        let located = Belief::located(&covariance).expect("positive definite");
        let (here, seen) = (located.odds(&aimed(0.002), 1), Belief::new(&UNCERTAINTY).odds(&aimed(0.002), 1));
        assert!(here.contact < 0.6 * seen.contact && here.held > seen.held + 0.1, "{here:?} {seen:?}");
        assert!(Belief::located(&Matrix3::zeros()).is_none());
    }

    /// A contact is likely if the felt hold is similar to the holds after which the grasp made contact, and unlikely
    /// otherwise.
    #[test]
    fn odds_depend_on_the_felt_hold() {
        let (low, high) = (Extent([0.0; 6]), Extent([0.0, 0.0, 0.0, 0.0, 0.0, 0.02]));
        let after = |hold, outcome| [Rehearsed { hold: Some(hold), ..Rehearsed::new(Vector3::zeros(), outcome) }; 10];
        let tried = [after(low, TryOutcome::Contact), after(high, TryOutcome::Held)].concat();
        let odds = |felt: &Extent| {
            let rehearsed: Arc<[Rehearsed]> = tried.iter().map(|one| one.beside(felt)).collect();
            let aimed = Aimed { all: rehearsed.clone(), rehearsed, heading: 0.0, aim: Vector3::zeros() };
            Belief::located(&Matrix3::from_diagonal_element(1e-6)).expect("positive").odds(&aimed, 1)
        };
        assert!(odds(&low).contact > 0.7 && odds(&high).held > 0.7, "{:?} {:?}", odds(&low), odds(&high));
    }

    /// A grasp that was lucky in its few rehearsals is not believed to be much better than the others of its object.
    #[test]
    fn luck_counts_for_less() {
        let with = |outcome| [Rehearsed::new(Vector3::zeros(), outcome); 40];
        let (lucky, others) = (with(TryOutcome::Held), [with(TryOutcome::Missed); 5].concat());
        let all: Arc<[Rehearsed]> = [&lucky[..], &others].concat().into();
        let alone = Aimed { rehearsed: lucky.into(), all: lucky.into(), heading: 0.0, aim: Vector3::zeros() };
        let among = Aimed { all, ..alone.clone() };
        let belief = Belief::new(&UNCERTAINTY);
        let (alone, among) = (belief.odds(&alone, 1).held, belief.odds(&among, 1).held);
        assert!(alone > 0.75 && (0.4 * alone..0.6 * alone).contains(&among), "{alone} {among}");
    }

    /// The axes turn with the grasp: an error along the world's y is an error along x for a grasp turned by 90 degrees.
    #[test]
    fn errors_turn_with_the_grasp() {
        let belief = Belief::new(&UNCERTAINTY);
        let turned = Aimed { heading: std::f64::consts::FRAC_PI_2, aim: Vector3::new(0.0, 0.006, 0.0), ..aimed(0.0) };
        let (straight, turned) = (belief.odds(&aimed(0.006), 1), belief.odds(&turned, 1));
        assert!((straight.contact - turned.contact).abs() < 0.06, "{straight:?} {turned:?}");
    }
}
