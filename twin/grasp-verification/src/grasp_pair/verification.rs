//! Grasp verification: second grasps of a grasp pair that hold in realistic circumstances, found by a race of many
//! grasps and variations of the best.
//!
//! Each draw of the circumstances (`rollout::draw_circumstances`) has its own hold of the first object. Grasps are
//! tried from it up to the end of the lift. Many grasps meet few draws and few grasps meet many (successive halving,
//! Karnin, Koren and Somekh 2013). The entrants are the known grasps, proposals, and proposals with more roll, so that
//! the ring and little fingers with the object they hold are lifted off the table. Variations of the best then race in
//! turn. The grasps that are kept form a set in which one holds if another does not. Their outcome letters come from
//! draws that played no part in the selection.

mod firsts;
mod race;

use std::borrow::Cow;

use anyhow::Result;
use control::extent::HeldExtent;
use control::outcome_model::Rollout;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;
use world::objects::Symmetry;

use self::race::Race;
use super::outcomes::{aim_error, parse_outcome};
use super::{AlternativeFirstGrasp, GraspPair, GraspPairTable, plan_pair};
use crate::rollout::circumstances::{ErrorMagnitude, draw_errors};
use crate::rollout::wide_errors;
use crate::simulated_world::SimulatedWorld;

/// Search effort for a grasp pair.
#[derive(Debug, Clone, Copy)]
pub struct VerificationEffort {
    /// Number of draws under which grasps are selected.
    pub selection_draws: usize,
    /// Number of separate draws under which the selected grasps are tried.
    pub verification_draws: usize,
    /// Number of the first of those draws under which they are also tried with wide errors.
    pub wide_draws: usize,
    /// Number of proposals from the hand's ranges, besides the known grasps. Half of them have more roll.
    pub drawn_proposals: u32,
    /// Number of proposals by synthesis.
    pub synthesized: u32,
    /// Maximum number of rounds of variations.
    pub rounds: usize,
    /// Number of variations per round.
    pub batch: usize,
    /// Level of effort. A verification that is not sure is repeated at a higher level.
    pub level: u32,
}

impl VerificationEffort {
    /// Returns the effort at a level from 1 on. Level 1 takes about 3 minutes of one core for a pair that is sure at
    /// once, and up to four times as much if other first grasps and the other order are tried. Levels 2 and 3 make two
    /// and three times the proposals.
    pub fn of_level(level: u32) -> Self {
        let (drawn, synthesized) = (16 * level, 16 * level);
        Self {
            selection_draws: 16,
            verification_draws: 32,
            wide_draws: 12,
            drawn_proposals: drawn,
            synthesized,
            rounds: 2,
            batch: 12,
            level,
        }
    }
}

/// Minimum number of holds for a mean and standard deviations.
const MIN_HOLDS: usize = 8;
/// Iterations of the mean rotation.
const MEAN_ITERATIONS: usize = 3;
/// Threshold above which a grasp pair is sure: the share of the draws in which its best second grasp holds. No other
/// first grasp is searched for then.
const SURE_SHARE: f64 = 0.92;
/// Threshold on the same share below which the other order is searched.
const POOR_SHARE: f64 = 0.8;

/// Second grasps after one first grasp, with their outcomes in drawn circumstances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verification {
    /// Level of effort of the race ([`VerificationEffort::level`]).
    #[serde(default = "first_level")]
    pub effort: u32,
    /// Extent of the held object in the palm per draw ([`HeldExtent`]), mm. `None` if the first grasp did not hold.
    pub holds: Vec<Option<[f64; 6]>>,
    /// Pose of the first object in the palm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<HoldStatistics>,
    /// Verified grasps, the best first.
    pub grasps: Vec<VerifiedGrasp>,
}

/// Pose of an object in the hand over the draws in which it was held.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HoldStatistics {
    /// Mean of `palm_from_object`.
    pub mean: Isometry3<f64>,
    /// Standard deviations of position (m) and rotation (rad), per axis.
    #[serde(alias = "spread")]
    pub sigmas: [f64; 2],
}

impl HoldStatistics {
    /// Computes the hold of an object of this symmetry. Returns `None` for fewer than [`MIN_HOLDS`] holds.
    fn from_poses(poses: &[Isometry3<f64>], symmetry: &Symmetry) -> Option<Self> {
        let like = poses.get(MIN_HOLDS - 1).and(poses.first())?.rotation;
        let turns: Vec<_> = poses.iter().map(|pose| symmetry.nearest(&pose.rotation, &like)).collect();
        let mut turn = like;
        for _ in 0..MEAN_ITERATIONS {
            let off: Vector3<f64> = turns.iter().map(|other| (turn.inverse() * other).scaled_axis()).sum();
            turn *= UnitQuaternion::new(off / turns.len() as f64);
        }
        let count = poses.len() as f64;
        let place = poses.iter().map(|pose| pose.translation.vector).sum::<Vector3<f64>>() / count;
        let places: f64 = poses.iter().map(|pose| (pose.translation.vector - place).norm_squared()).sum();
        let angles: f64 = turns.iter().map(|other| turn.angle_to(other).powi(2)).sum();
        let spread = [places, angles].map(|squares| (squares / (3.0 * count)).sqrt());
        Some(Self { mean: Isometry3::from_parts(place.into(), turn), sigmas: spread })
    }
}

fn first_level() -> u32 {
    1
}

/// Outcomes of one grasp.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct VerifiedGrasp {
    /// Number of the grasp.
    pub grasp: u32,
    /// One outcome letter per draw that has a hold.
    pub near: String,
    /// Outcome letters of the first draws, with a wide error added to the narrow one.
    pub wide: String,
}

impl Verification {
    /// Returns the share of the draws in which the first grasp holds.
    pub fn first_holds(&self) -> f64 {
        self.holds.iter().flatten().count() as f64 / self.holds.len().max(1) as f64
    }

    /// Returns the share of the draws in which the grasp that holds most often holds its object.
    pub fn best_share(&self) -> f64 {
        let held = |verified: &VerifiedGrasp| verified.near.chars().filter(|letter| *letter == 'h').count();
        self.grasps.iter().map(held).max().unwrap_or(0) as f64 / self.holds.len().max(1) as f64
    }

    /// Returns the rollouts of `grasp`, with the errors in axes that turn with its heading. `None` if it is not among
    /// the verified grasps.
    pub fn rollouts(&self, grasp: &Grasp) -> Result<Option<Vec<Rollout>>> {
        let Some(verified) = self.grasps.iter().find(|verified| verified.grasp == grasp.id) else { return Ok(None) };
        let narrow = (0..self.holds.len()).map(|number| draw_errors(ErrorMagnitude::Residual, number));
        let draws = self.holds.iter().zip(narrow).zip(wide_errors(self.holds.len()));
        let draws = draws.filter_map(|((hold, narrow), wide)| {
            let hold = HeldExtent((*hold)?.map(|reach| reach * 1e-3));
            let [narrow, wide] = [narrow, wide].map(|error| aim_error(&error, grasp.yaw));
            Some((hold, narrow, narrow + wide))
        });
        let draws: Vec<_> = draws.collect();
        let near = verified.near.chars().zip(&draws).map(|(letter, (hold, error, _))| (letter, hold, error));
        let wide = verified.wide.chars().zip(&draws).map(|(letter, (hold, _, error))| (letter, hold, error));
        let tried = near.chain(wide).map(|(letter, hold, error)| {
            Ok(Rollout { hold: Some(*hold), ..Rollout::new(*error, parse_outcome(grasp.id, letter)?) })
        });
        tried.collect::<Result<_>>().map(Some)
    }
}

/// Verifies second grasps for those of the pairs `plans` that have no verification, or an unsure one that took less
/// than this effort. `done` is called after each step. Shows a progress bar unless `quiet`.
pub fn verify_pairs(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &mut GraspPairTable,
    effort: VerificationEffort,
    quiet: bool,
    done: impl Fn(&GraspPair) -> Result<()> + Sync,
) -> Result<()> {
    let prover = GraspVerifier::new(world, repertoire, effort);
    plans.for_each_pair("pairs verified", quiet, |plan| {
        if prover.recompute_holds(plan)? {
            done(plan)?;
        }
        if plan.verification_level < effort.level {
            for step in VERIFICATION_STEPS {
                prover.step(step, plan)?;
                done(plan)?;
            }
        }
        Ok(())
    })
}

impl GraspPair {
    /// Returns the share of the draws in which the best second grasp holds its object, after any of the first grasps.
    pub fn best_share(&self) -> f64 {
        let others = self.alternative_firsts.iter().filter_map(|other| other.verification.as_ref());
        self.verification.iter().chain(others).map(Verification::best_share).fold(0.0, f64::max)
    }
}

/// Step of the verification of a grasp pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VerificationStep {
    /// Verifies second grasps after the planned first grasp.
    Planned,
    /// Verifies second grasps after another first grasp, if the pair is not sure.
    Another,
    /// Verifies the reversed pair, if the pair scores low. The search is complete after this step.
    OtherOrder,
}

/// Steps in their order.
pub const VERIFICATION_STEPS: [VerificationStep; 3] =
    [VerificationStep::Planned, VerificationStep::Another, VerificationStep::OtherOrder];

/// Verifier of grasp pairs in a world.
pub struct GraspVerifier<'a> {
    world: Cow<'a, SimulatedWorld>,
    repertoire: &'a Repertoire,
    board: TactileBoard,
    effort: VerificationEffort,
}

impl<'a> GraspVerifier<'a> {
    pub fn new(world: &'a SimulatedWorld, repertoire: &'a Repertoire, effort: VerificationEffort) -> Self {
        let board = TactileBoard::unit(&world.cell.robot.hand, 0);
        Self { world: Cow::Borrowed(world), repertoire, board, effort }
    }

    /// Takes the first object once more if a verification lacks its pose in the hand. Returns true if a pose was added.
    fn recompute_holds(&self, plan: &mut GraspPair) -> Result<bool> {
        let firsts = plan.grasps(&self.world.cell.robot.hand, self.repertoire)?;
        let race = Race::new(&self.world, self.repertoire, &self.board, plan, self.effort)?;
        let firsts: Vec<Grasp> = std::iter::once(firsts.first)
            .chain(firsts.alternative_firsts.into_iter().map(|other| other.first))
            .collect();
        let others = plan
            .alternative_firsts
            .iter_mut()
            .filter_map(|other| Some((other.first_grasp, other.verification.as_mut()?)));
        let proofs = plan.verification.as_mut().map(|proof| (plan.first_grasp, proof)).into_iter().chain(others);
        let mut found = false;
        for (first, proof) in proofs.filter(|(_, proof)| proof.hold.is_none()) {
            let Some(first) = firsts.iter().find(|grasp| grasp.id == first) else { continue };
            proof.hold = race.with_first(first.clone()).hold_statistics()?;
            found |= proof.hold.is_some();
        }
        Ok(found)
    }

    /// Runs one step for a grasp pair.
    pub fn step(&self, step: VerificationStep, plan: &mut GraspPair) -> Result<()> {
        match step {
            VerificationStep::OtherOrder => {
                if plan.best_share() < POOR_SHARE {
                    self.verify_other_order(plan)?;
                }
                plan.verification_level = self.effort.level;
                return Ok(());
            }
            _ if plan.best_share() >= SURE_SHARE => return Ok(()),
            _ => {}
        }
        let race = Race::new(&self.world, self.repertoire, &self.board, plan, self.effort)?;
        if step == VerificationStep::Another {
            return self.verify_another(&race, plan);
        }
        if plan.verification.as_ref().is_none_or(|proof| proof.effort < self.effort.level)
            && let Some((proof, found)) = race.run(plan)?
        {
            // A further race draws other proposals and may end with fewer holds. The better verification stays, as
            // searched at this level.
            match &mut plan.verification {
                Some(known) if known.best_share() >= proof.best_share() => known.effort = proof.effort,
                _ => {
                    plan.verification = Some(proof);
                    plan.variations.extend(found);
                }
            }
        }
        Ok(())
    }

    /// Verifies the grasp pair of the same two objects in the other order.
    fn verify_other_order(&self, plan: &mut GraspPair) -> Result<()> {
        let other =
            GraspVerifier { world: Cow::Owned(self.world.with_places_swapped()), board: self.board.clone(), ..*self };
        if plan.reversed.as_ref().is_none_or(|reversed| reversed.verification.is_none()) {
            let reversed = plan_pair(&other.world, self.repertoire, &self.board, [&plan.second, &plan.first])?;
            plan.reversed = reversed.map(Box::new).or(plan.reversed.take());
        }
        let Some(reversed) = &mut plan.reversed else { return Ok(()) };
        other.step(VerificationStep::Planned, reversed)?;
        other.step(VerificationStep::Another, reversed)
    }

    /// Verifies second grasps after another first grasp, known or newly found. Among those that are neither planned nor
    /// verified, it takes the one after which the known second grasps score highest.
    fn verify_another(&self, race: &Race, plan: &mut GraspPair) -> Result<()> {
        let sets = digit_sets(&self.world.cell.robot.hand, 2);
        let verified: Vec<u32> =
            plan.verification.iter().flat_map(|proof| &proof.grasps).map(|verified| verified.grasp).collect();
        let known =
            self.repertoire.for_digits(&plan.second, &sets[1]).chain(plan.variations_for(&plan.second, &sets[1]));
        let seconds: Vec<Grasp> = known.filter(|grasp| verified.contains(&grasp.id)).cloned().collect();
        let done =
            plan.alternative_firsts.iter().filter(|other| other.verification.is_some()).map(|other| other.first_grasp);
        let done: Vec<u32> = done.chain([plan.first_grasp]).collect();
        let mut firsts: Vec<Grasp> = self.repertoire.for_digits(&plan.first, &sets[0]).cloned().collect();
        // If the first grasp is the one that fails, new first grasps may hold more often than any known one.
        if plan.verification.as_ref().is_none_or(|proof| proof.first_holds() < SURE_SHARE) {
            let new = race.first_grasps(plan)?;
            firsts.extend(
                new.into_iter()
                    .filter(|new| self.repertoire.for_digits(&plan.first, &sets[0]).all(|known| known.id != new.id)),
            );
        }
        let mut best: Option<(f64, Race)> = None;
        for first in firsts.into_iter().filter(|first| !done.contains(&first.id)) {
            let after = race.for_other_first(plan, first);
            let share = after.sampled_hold_share(&seconds)?;
            if best.as_ref().is_none_or(|(most, _)| share > *most) {
                best = Some((share, after));
            }
        }
        let Some((_, race)) = best else { return Ok(()) };
        let first = race.first.clone();
        let first_grasp = first.id;
        let Some((proof, found)) = race.run(plan)? else { return Ok(()) };
        let new = self
            .repertoire
            .for_digits(&plan.first, &sets[0])
            .chain(plan.variations_for(&plan.first, &sets[0]))
            .all(|known| known.id != first_grasp);
        plan.variations.extend(found.into_iter().chain(new.then_some(first)));
        match plan.alternative_firsts.iter_mut().find(|other| other.first_grasp == first_grasp) {
            Some(other) => other.verification = Some(proof),
            None => plan.alternative_firsts.push(AlternativeFirstGrasp {
                first_grasp,
                outcomes: Vec::new(),
                verification: Some(proof),
            }),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use control::outcome_model::TryOutcome;

    use super::*;

    fn grasp(id: u32) -> Grasp {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let any = repertoire.grasps.values().flatten().next().expect("a grasp");
        Grasp { id, yaw: 0.0, ..any.clone() }
    }

    /// Rotations of a symmetry add no variance. Visible rotations do, and so do positions.
    #[test]
    fn holds_have_a_mean_and_a_spread() {
        let about = |axis: usize, angle: f64| UnitQuaternion::new(Vector3::ith(axis, angle));
        let pose = |n: usize| {
            let sign = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
            let turn = about(0, 0.1 * sign) * about(2, n as f64);
            Isometry3::from_parts(Vector3::new(0.02 + 0.003 * sign, 0.0, -0.03).into(), turn)
        };
        let poses: Vec<_> = (0..MIN_HOLDS).map(pose).collect();
        let hold = HoldStatistics::from_poses(&poses, &Symmetry::Axis { flip: false }).expect("enough");
        assert!((hold.mean.translation.vector - Vector3::new(0.02, 0.0, -0.03)).norm() < 1e-12);
        assert!((hold.mean * Vector3::z()).angle(&Vector3::z()) < 1e-6);
        let expected = [0.003, 0.1].map(|one| one / 3f64.sqrt());
        assert!(hold.sigmas.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{hold:?}");
        assert_eq!(HoldStatistics::from_poses(&poses[1..], &Symmetry::Full), None);
    }

    /// With little effort, a pair that is sure gets a verification: some grasps, among them the planned one, and a
    /// letter for each draw that has a hold. Grasps that were found belong to the pair and have the pose in which they
    /// hold the object.
    #[test]
    fn a_pair_is_verified() {
        let world = SimulatedWorld::new(&hand_model::RobotModel::ftac_gen3(), scenarios::Scenario::benchmark())
            .expect("the world");
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let mut plans = crate::builtin::grasp_pairs().expect("the built-in plans");
        plans.pairs.retain(|plan| plan.objects() == ["ball_45", "box_50"]);
        (plans.pairs[0].verification, plans.pairs[0].verification_level) = (None, 0);
        let effort = VerificationEffort {
            selection_draws: 2,
            verification_draws: 3,
            wide_draws: 1,
            drawn_proposals: 2,
            synthesized: 1,
            rounds: 1,
            batch: 2,
            level: 1,
        };
        verify_pairs(&world, &repertoire, &mut plans, effort, true, |_| Ok(())).expect("a verification");
        let plan = &plans.pairs[0];
        let proof = plan.verification.as_ref().expect("a verification");
        let held = proof.holds.iter().flatten().count();
        assert!(proof.holds.len() == 3 && held > 0 && proof.best_share() > 0.5, "{proof:?}");
        assert!(
            proof.grasps.iter().all(|verified| verified.near.len() == held && verified.wide.len() <= 1),
            "{proof:?}"
        );
        let grasps = plan.grasps(&world.cell.robot.hand, &repertoire).expect("the grasps");
        assert!(!grasps.second_candidates[0].rollouts.is_empty());
        let found = plan.variations.iter().filter(|grasp| grasp.id >= race::FIRST_NUMBER);
        assert!(found.into_iter().all(|grasp| grasp.held.is_some()));
    }

    /// Letters come back with the errors and holds of their draws. A draw in which the first grasp did not hold has
    /// none.
    #[test]
    fn letters_stand_for_circumstances() {
        let holds = vec![None, Some([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), Some([0.0; 6])];
        let verification = Verification {
            effort: 1,
            holds,
            hold: None,
            grasps: vec![VerifiedGrasp { grasp: 7, near: "hc".into(), wide: "m".into() }],
        };
        assert_eq!(verification.rollouts(&grasp(8)).expect("letters"), None);
        let tried = verification.rollouts(&grasp(7)).expect("letters").expect("verified");
        let outcomes: Vec<TryOutcome> = tried.iter().map(|one| one.outcome).collect();
        assert_eq!(outcomes, [TryOutcome::Held, TryOutcome::Contact, TryOutcome::Missed]);
        let errors =
            [1, 2].map(|number| draw_errors(ErrorMagnitude::Residual, number)).map(|noise| aim_error(&noise, 0.0));
        let wide = aim_error(&wide_errors(2)[1], 0.0);
        assert_eq!(tried.iter().map(|one| one.error).collect::<Vec<_>>(), [errors[0], errors[1], errors[0] + wide]);
        assert_eq!(tried[0].hold.map(|hold| hold.0[2]), Some(0.003));
        assert!(
            (verification.first_holds() - 2.0 / 3.0).abs() < 1e-12
                && (verification.best_share() - 1.0 / 3.0).abs() < 1e-12
        );
    }
}
