//! Foresight: the best few grasps of the second object are played in a twin of the scene, from the state as felt, before one is chosen.
//!
//! Rehearsals ([`crate::odds`]) were played from the plan's hold of the first object, with both objects in their nominal places. A twin
//! plays a try from where everything is believed to be now. What is not known is drawn ([`draws`]): the held object's pose in the hand
//! from its covariance, the error of the aim from the [`Belief`], the target's turn. The same draws for all grasps, so that these
//! are compared under the same errors; those of the hold come in pairs that mirror each other, so that their mean is the estimate. The outcomes count
//! beside the odds ([`Foreseen::with`]).

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use world::objects::ObjectModel;

use crate::executor::Executor;
use crate::odds::{Belief, Odds, TryOutcome};
use crate::percept::Percept;

/// Draws of what is not known, twice this many: each comes with its mirror image.
pub(crate) const PAIRS: usize = 4;
/// How many are played at most beside the plan.
const OTHERS: usize = 10;
/// The odds by rehearsal count as this many plays. Set by hand on seed 1.
const PRIOR: f64 = 4.0;
/// Standard deviation of how the target is turned about the vertical, rad.
const TURNED: f64 = 0.08;
/// Seed of the standard normals behind the draws: the same ones for every decision.
const SEED: u64 = 0x7477_696e;

/// One possible state of what is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draw {
    /// `palm_from_object` of the held object.
    pub held: Isometry3<f64>,
    /// `world_from_object` of the target, in the world as the arm believes in it.
    pub target: Isometry3<f64>,
}

/// The scene as it is believed to be.
pub struct Scene<'a> {
    /// In a decision, with the first object in the hand.
    pub executor: &'a Executor,
    /// The held object and the target.
    pub objects: &'a [Arc<ObjectModel>],
    /// Angles of the finger joints as felt, rad.
    pub joints: &'a [f64],
    /// What is not known.
    pub draws: &'a [Draw],
}

/// Why the twin failed.
#[derive(Debug, thiserror::Error)]
#[error("the twin of the scene: {0}")]
pub struct TwinError(#[from] pub Box<dyn std::error::Error + Send + Sync>);

/// A model of robot and objects in which tries can be played.
pub trait Twin: Sync {
    /// Gets ready to play tries in a scene.
    fn imagine(&self, scene: &Scene) -> Result<Box<dyn Imagined>, TwinError>;
}

/// A scene in the twin, under each of its draws.
pub trait Imagined {
    /// How `going`, which is about to approach the second object, ends under each of these draws; `None` where the draw's hold of the
    /// first object is none in the twin.
    fn play(&self, going: &Executor, draws: Range<usize>) -> Result<Vec<Option<TryOutcome>>, TwinError>;
}

/// How a policy plays second grasps before it chooses one.
#[derive(Clone, Copy)]
pub struct Foresees<'a> {
    pub twin: &'a dyn Twin,
    /// How many are played at most beside the plan.
    pub others: usize,
}

impl<'a> Foresees<'a> {
    /// The plan and the best others.
    pub fn best(twin: &'a dyn Twin) -> Self {
        Self { twin, others: OTHERS }
    }

    /// The plan alone.
    pub fn plan(twin: &'a dyn Twin) -> Self {
        Self { twin, others: 0 }
    }
}

/// What is not known when the second object is to be taken.
pub(crate) struct Unknown<'a> {
    /// `palm_from_object` of the held object and its covariance (m and rad, palm axes).
    pub held: (Isometry3<f64>, &'a Matrix6<f64>),
    /// The target as it is seen, or was felt.
    pub target: Percept,
    /// What is known about the error of the aim.
    pub belief: &'a Belief,
    /// How many looks the target's place is the mean of.
    pub looks: u32,
}

/// Draws of `unknown`.
pub(crate) fn draws(unknown: &Unknown) -> Vec<Draw> {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let root = unknown.held.1.symmetric_eigen();
    let scales = root.eigenvalues.map(|value| value.max(0.0).sqrt());
    let mut draws = Vec::with_capacity(2 * PAIRS);
    for pair in 0..PAIRS {
        let mut normal = || StandardNormal.sample(&mut rng);
        let held = Vector6::from_fn(|_, _| normal());
        let (fresh, turned): (Vector3<f64>, f64) = (Vector3::new(normal(), normal(), 0.0), normal());
        for (n, sign) in [1.0, -1.0].into_iter().enumerate() {
            let off = root.eigenvectors * scales.component_mul(&(sign * held));
            let aim =
                unknown.belief.value(2 * pair + n, 2 * PAIRS) + unknown.belief.fresh(unknown.looks) * sign * fresh;
            draws.push(Draw {
                held: moved(&unknown.held.0, &off),
                target: beside(&unknown.target, &-aim, sign * turned * TURNED),
            });
        }
    }
    draws
}

/// `pose` moved by a translation (m) and turned by a rotation vector (rad) about its own origin, both along the axes that it is given in.
fn moved(pose: &Isometry3<f64>, off: &Vector6<f64>) -> Isometry3<f64> {
    let (shift, turn) = (off.fixed_rows::<3>(0).into_owned(), off.fixed_rows::<3>(3).into_owned());
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + shift),
        UnitQuaternion::from_scaled_axis(turn) * pose.rotation,
    )
}

/// `world_from_object` of what is seen at `percept`, `off` (m) beside it and turned about the vertical by `turn` (rad).
fn beside(percept: &Percept, off: &Vector3<f64>, turn: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    Isometry3::from_parts(Translation3::from(percept.position.coords + off), turn * percept.rotation)
}

/// What came of a grasp in the twin.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Foreseen {
    /// How often it was played.
    pub played: u32,
    /// How often it held the object without a contact.
    pub held: u32,
    /// How often it made a contact.
    pub contact: u32,
}

impl Foreseen {
    /// Counts `outcomes` too.
    pub(crate) fn count(&mut self, outcomes: &[Option<TryOutcome>]) {
        for outcome in outcomes.iter().flatten() {
            self.played += 1;
            self.held += u32::from(*outcome == TryOutcome::Held);
            self.contact += u32::from(*outcome == TryOutcome::Contact);
        }
    }

    /// The same if `more` plays held the object.
    pub(crate) fn at_best(self, more: u32) -> Self {
        Self { played: self.played + more, held: self.held + more, ..self }
    }

    /// The `odds` with these outcomes: the mean of the Dirichlet distribution that they leave of a prior with that mean, worth
    /// [`PRIOR`] plays.
    pub(crate) fn with(&self, odds: &Odds) -> Odds {
        let share = |prior: f64, count: u32| (PRIOR * prior + f64::from(count)) / (PRIOR + f64::from(self.played));
        Odds { held: share(odds.held, self.held), contact: share(odds.contact, self.contact) }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::odds::{Aimed, Rehearsed};

    fn percept() -> Percept {
        Percept { position: Point3::new(0.6, 0.1, 0.03), rotation: UnitQuaternion::identity(), yaw: 0.0 }
    }

    fn some_draws(held: &Matrix6<f64>, aim: &Matrix3<f64>) -> Vec<Draw> {
        let belief = Belief::located(aim).expect("positive definite");
        draws(&Unknown {
            held: (Isometry3::translation(0.01, 0.05, -0.03), held),
            target: percept(),
            belief: &belief,
            looks: 1,
        })
    }

    /// Nothing unknown: all draws are what is believed, but for the target's turn.
    #[test]
    fn without_doubt_all_draws_are_the_estimate() {
        for draw in some_draws(&Matrix6::zeros(), &(Matrix3::identity() * 1e-16)) {
            assert!((draw.held.translation.vector - Vector3::new(0.01, 0.05, -0.03)).norm() < 1e-12);
            assert!((draw.target.translation.vector - percept().position.coords).norm() < 1e-6);
        }
    }

    /// The hold's draws come in pairs that mirror each other, spread only along what is not known, and are the same every time.
    #[test]
    fn draws_mirror_each_other_about_the_estimate() {
        let mut held = Matrix6::zeros();
        (held[(0, 0)], held[(5, 5)]) = (0.004_f64.powi(2), 0.2_f64.powi(2));
        let aim = Matrix3::identity() * 1e-16;
        let all = some_draws(&held, &aim);
        assert_eq!(all, some_draws(&held, &aim));
        let mut spread = 0.0;
        for pair in all.chunks(2) {
            let [off, mirrored] =
                [pair[0], pair[1]].map(|draw| draw.held.translation.vector - Vector3::new(0.01, 0.05, -0.03));
            assert!((off + mirrored).norm() < 1e-12 && off.y.abs() < 1e-12 && off.z.abs() < 1e-12, "{off}");
            let [turn, back] = [pair[0], pair[1]].map(|draw| draw.held.rotation.scaled_axis());
            assert!((turn + back).norm() < 1e-12 && turn.x.abs() < 1e-12 && turn.z.abs() > 0.0, "{turn}");
            spread += off.x.powi(2) / PAIRS as f64;
        }
        assert!((0.3..3.0).contains(&(spread.sqrt() / 0.004)), "{spread}");
    }

    /// By how much the draws put the target beside where it is seen, m.
    fn offs(belief: &Belief) -> Vec<Vector3<f64>> {
        let held = (Isometry3::identity(), &Matrix6::zeros());
        let all = draws(&Unknown { held, target: percept(), belief, looks: 1 });
        all.iter().map(|draw| draw.target.translation.vector - percept().position.coords).collect()
    }

    /// The hand that goes too far along x finds the target too far back.
    #[test]
    fn an_error_of_the_aim_is_a_target_on_the_other_side() {
        let mut belief = Belief::located(&(Matrix3::identity() * 0.003_f64.powi(2))).expect("positive definite");
        let mean = |belief: &Belief| offs(belief).iter().sum::<Vector3<f64>>() / (2 * PAIRS) as f64;
        assert!(mean(&belief).norm() < 0.003, "{}", mean(&belief));
        // What failed wherever the error is positive has taught that it is.
        let outcome = |x: f64| if x < 0.0 { TryOutcome::Held } else { TryOutcome::Missed };
        let rehearsed: Arc<[Rehearsed]> = (-20..=20)
            .map(|n| 0.001 * f64::from(n))
            .map(|x| Rehearsed::new(Vector3::new(x, 0.0, 0.0), outcome(x)))
            .collect();
        let aimed = Aimed { rehearsed: rehearsed.clone(), all: rehearsed, heading: 0.0, aim: Vector3::zeros() };
        (0..6).for_each(|_| belief.failed(&aimed, 1));
        assert!(mean(&belief).x < -0.001, "{}", mean(&belief));
    }

    #[test]
    fn outcomes_count_beside_the_odds() {
        let odds = Odds { held: 0.8, contact: 0.1 };
        assert_eq!(Foreseen::default().with(&odds), odds);
        let mut foreseen = Foreseen::default();
        foreseen.count(&[Some(TryOutcome::Held), None, Some(TryOutcome::Contact), Some(TryOutcome::Missed)]);
        assert_eq!(foreseen, Foreseen { played: 3, held: 1, contact: 1 });
        let with = foreseen.with(&odds);
        assert!((with.held - (PRIOR * 0.8 + 1.0) / (PRIOR + 3.0)).abs() < 1e-12);
        assert!((with.contact - (PRIOR * 0.1 + 1.0) / (PRIOR + 3.0)).abs() < 1e-12);
        assert!(foreseen.at_best(5).with(&odds).held > with.held);
    }
}
