//! Outcomes: second grasps of a grasp pair tried under drawn aim errors, for the outcome model of a policy. Some draws
//! are as wide as the error expected for an object that was only detected. The others are as wide as the error that
//! remains after the object was touched in place.
//!
//! All grasps meet the same draws. A file therefore keeps one letter per draw, with the wide and the near draws apart:
//! `h` held, `m` missed, `c` contact.

use std::ops::Range;

use anyhow::{Result, bail};
use control::outcome_model::{Rollout, TryOutcome};
use control::score::MISS_SCORE;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use nalgebra::{Rotation3, Vector3};
use scenarios::noise::TrialNoise;
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;

use super::{AlternativeFirstGrasp, FAILED_SCORE_FACTOR, GraspPair, GraspPairTable, PlannedGrasps};
use crate::rollout::{
    FirstGraspRollout, RolloutSnapshot, misaimed, narrow_errors, roll_out_first, try_second, wide_errors,
};
use crate::simulated_world::SimulatedWorld;

/// Threshold: other first grasps are tried until some second grasp after one of them scores this much near its planned
/// pose.
pub(super) const GOOD_SCORE: f64 = 0.85;
/// Number of wide draws under which a grasp is tried.
const WIDE_DRAWS: usize = 12;
/// Number of draws of the errors that remain once the object has been touched.
pub(super) const NARROW_DRAWS: usize = 10;
/// Number of draws of either kind in the first heat. Every grasp that works without errors is tried under them.
const FIRST_HEAT_DRAWS: usize = 3;
/// Number of a pair's best grasps in the first heat that are tried under all draws.
const FINALISTS: usize = 4;
/// Number of working grasps that are tried for each resting pose of the fallen second object.
const FALLEN_CANDIDATES: usize = 4;
/// Number of these that are tried under all draws.
const FALLEN_FINALISTS: usize = 2;

/// Outcomes of a second grasp under each draw.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GraspOutcomes {
    /// Number of the grasp.
    pub grasp: u32,
    /// One letter per wide draw.
    pub outcomes: String,
    /// One letter per narrow draw.
    #[serde(default)]
    pub near: String,
}

impl GraspOutcomes {
    fn new(grasp: u32, wide: &[TryOutcome], narrow: &[TryOutcome]) -> Self {
        let letters = |outcomes: &[TryOutcome]| outcomes.iter().copied().map(outcome_letter).collect();
        Self { grasp, outcomes: letters(wide), near: letters(narrow) }
    }

    /// Returns the score of all tries together. A miss counts as much as to a policy that may try again.
    fn score(&self) -> f64 {
        total_score(self.outcomes.chars().chain(self.near.chars()))
    }

    /// Returns the score of a try under narrow errors, or 0 if too few were drawn.
    pub(super) fn score_once_touched(&self) -> f64 {
        if self.near.len() < NARROW_DRAWS { 0.0 } else { total_score(self.near.chars()) / self.near.len() as f64 }
    }

    /// Returns the rollouts, with the errors in axes that turn with `grasp`'s heading. The first one is without errors
    /// and held.
    pub fn rollouts(&self, grasp: &Grasp) -> Result<Vec<Rollout>> {
        let with = |(error, letter): (TrialNoise, char)| {
            Ok(Rollout::new(aim_error(&error, grasp.yaw), parse_outcome(self.grasp, letter)?))
        };
        let faultless = Rollout::new(Vector3::zeros(), TryOutcome::Held);
        let wide = wide_errors(self.outcomes.len()).into_iter().zip(self.outcomes.chars());
        let narrow = narrow_errors(self.near.len()).into_iter().zip(self.near.chars());
        std::iter::once(Ok(faultless)).chain(wide.chain(narrow).map(with)).collect()
    }
}

/// Returns the letter of an outcome in a file.
pub(super) fn outcome_letter(outcome: TryOutcome) -> char {
    match outcome {
        TryOutcome::Held => 'h',
        TryOutcome::Missed => 'm',
        TryOutcome::Contact => 'c',
    }
}

/// Parses the letter of a try of `grasp`.
pub(super) fn parse_outcome(grasp: u32, letter: char) -> Result<TryOutcome> {
    Ok(match letter {
        'h' => TryOutcome::Held,
        'm' => TryOutcome::Missed,
        'c' => TryOutcome::Contact,
        other => bail!("outcomes of grasp {grasp}: found {other:?}, expected h, m or c"),
    })
}

/// Returns the summed score of tries with these letters.
pub(super) fn total_score(letters: impl Iterator<Item = char>) -> f64 {
    letters.map(|letter| if letter == 'h' { 1.0 } else { MISS_SCORE * f64::from(letter == 'm') }).sum()
}

/// Returns the aim error of the second grasp, m, in axes turned by `heading` (rad) about the vertical.
pub(super) fn aim_error(noise: &TrialNoise, heading: f64) -> Vector3<f64> {
    let world = noise.objects[1].offset + noise.position;
    Rotation3::from_axis_angle(&Vector3::z_axis(), -heading) * world
}

/// Tries the second grasps of all pairs `plans` under errors and replaces their earlier outcomes. Shows a progress bar
/// unless `quiet`. Takes a minute of one core per pair.
pub fn roll_out_pairs(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &mut GraspPairTable,
    quiet: bool,
) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let context = RolloutContext::new(world, &board);
    plans.for_each_pair("pairs tried", quiet, |plan| context.roll_out_pair(repertoire, plan))
}

/// Tries second grasps after other first grasps, for those of the pairs `plans` without a second grasp that scores
/// high.
pub fn roll_out_alternatives(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &mut GraspPairTable,
    quiet: bool,
) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let context = RolloutContext::new(world, &board);
    plans.for_each_pair("pairs tried", quiet, |plan| {
        plan.alternative_firsts = context.alternatives(repertoire, plan)?;
        Ok(())
    })
}

/// Data that all rollouts share.
pub(super) struct RolloutContext<'a> {
    world: &'a SimulatedWorld,
    board: &'a TactileBoard,
    wide: Vec<TrialNoise>,
    narrow: Vec<TrialNoise>,
}

impl<'a> RolloutContext<'a> {
    /// Draws the errors that all grasps meet.
    pub(super) fn new(world: &'a SimulatedWorld, board: &'a TactileBoard) -> Self {
        Self { world, board, wide: wide_errors(WIDE_DRAWS), narrow: narrow_errors(NARROW_DRAWS) }
    }

    /// Tries the second grasps of `plan` that work without errors. There are no outcomes if its first grasp does not
    /// hold.
    pub(super) fn roll_out_pair(&self, repertoire: &Repertoire, plan: &mut GraspPair) -> Result<()> {
        plan.forget_variations();
        let PlannedGrasps { first, second_candidates: second, .. } =
            plan.grasps(&self.world.cell.robot.hand, repertoire)?;
        let worked = second.iter().filter(|second| second.score > FAILED_SCORE_FACTOR * second.grasp.score);
        let worked: Vec<&Grasp> = worked.map(|second| &second.grasp).collect();
        plan.outcomes = match self.hold_first(&first, worked.first().copied())? {
            Some(hold) => self.outcomes(&hold, &worked, FINALISTS)?,
            None => Vec::new(),
        };
        plan.fallen.clear();
        let object = self.world.object(&plan.second)?;
        let sets = digit_sets(&self.world.cell.robot.hand, 2);
        for way in self.world.objects.fallen_of(&object) {
            let grasps: Vec<&Grasp> = repertoire.for_digits(&way.name, &sets[1]).collect();
            let Some(hold) = self.hold_first(&first, grasps.first().copied())? else { continue };
            let mut works = Vec::new();
            for grasp in grasps {
                if works.len() < FALLEN_CANDIDATES && try_second(&hold, grasp)? == TryOutcome::Held {
                    works.push(grasp);
                }
            }
            if !works.is_empty() {
                plan.fallen.insert(way.name.clone(), self.outcomes(&hold, &works, FALLEN_FINALISTS)?);
            }
        }
        Ok(())
    }

    /// Tries other first grasps in the repertoire's order, until a second grasp after one scores high.
    pub(super) fn alternatives(&self, repertoire: &Repertoire, plan: &GraspPair) -> Result<Vec<AlternativeFirstGrasp>> {
        let best =
            |outcomes: &[GraspOutcomes]| outcomes.iter().map(GraspOutcomes::score_once_touched).fold(0.0, f64::max);
        let sets = digit_sets(&self.world.cell.robot.hand, 2);
        let seconds: Vec<&Grasp> = repertoire.for_digits(&plan.second, &sets[1]).collect();
        let mut others = Vec::new();
        let mut most = best(&plan.outcomes);
        for first in repertoire.for_digits(&plan.first, &sets[0]).filter(|first| first.id != plan.first_grasp) {
            if most >= GOOD_SCORE {
                break;
            }
            let Some(hold) = self.hold_first(first, seconds.first().copied())? else { continue };
            let mut works = Vec::new();
            for second in &seconds {
                if try_second(&hold, second)? == TryOutcome::Held {
                    works.push(*second);
                }
            }
            let outcomes = self.outcomes(&hold, &works, FINALISTS)?;
            most = most.max(best(&outcomes));
            if !outcomes.is_empty() {
                others.push(AlternativeFirstGrasp { first_grasp: first.id, outcomes, verification: None });
            }
        }
        Ok(others)
    }

    /// Returns the hold of the first object beside the second, which lies as the grasp `any` expects.
    pub(super) fn hold_first(&self, first: &Grasp, any: Option<&Grasp>) -> Result<Option<RolloutSnapshot>> {
        let Some(any) = any else { return Ok(None) };
        let grasps = [first, any];
        let rollout = FirstGraspRollout::ideal(self.world, &grasps);
        Ok(roll_out_first(self.world, &rollout, self.board)?.map(|(hold, _)| hold))
    }

    /// Tries `grasps` under the first errors of either kind, and the `best` of them under all.
    pub(super) fn outcomes(
        &self,
        hold: &RolloutSnapshot,
        grasps: &[&Grasp],
        best: usize,
    ) -> Result<Vec<GraspOutcomes>> {
        let under = |grasp: &Grasp, draws: Range<usize>| -> Result<GraspOutcomes> {
            let tries = |errors: &[TrialNoise]| -> Result<Vec<TryOutcome>> {
                let errors = errors.iter().take(draws.end).skip(draws.start);
                errors.map(|noise| try_second(hold, &misaimed(grasp, noise, 1))).collect()
            };
            Ok(GraspOutcomes::new(grasp.id, &tries(&self.wide)?, &tries(&self.narrow)?))
        };
        let mut tried = grasps.iter().map(|grasp| under(grasp, 0..FIRST_HEAT_DRAWS)).collect::<Result<Vec<_>>>()?;
        let mut order: Vec<usize> = (0..grasps.len()).collect();
        order.sort_by(|a, b| tried[*b].score().total_cmp(&tried[*a].score()));
        for n in order.into_iter().take(best) {
            let rest = under(grasps[n], FIRST_HEAT_DRAWS..usize::MAX)?;
            tried[n].outcomes += &rest.outcomes;
            tried[n].near += &rest.near;
        }
        Ok(tried)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pair's letters come back as the errors they were drawn for, turned with the grasp. Another letter is refused.
    #[test]
    fn letters_stand_for_draws() {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let grasp = repertoire.grasps.values().flatten().next().expect("a grasp");
        let turned = Grasp { yaw: std::f64::consts::FRAC_PI_2, ..grasp.clone() };
        let tries = [TryOutcome::Held, TryOutcome::Contact, TryOutcome::Missed];
        let outcomes = GraspOutcomes::new(grasp.id, &tries, &tries[1..]);
        assert_eq!((&*outcomes.outcomes, &*outcomes.near), ("hcm", "cm"));
        let straight = outcomes.rollouts(&Grasp { yaw: 0.0, ..grasp.clone() }).expect("letters");
        let noise = wide_errors(3)[1];
        let error = noise.objects[1].offset + noise.position;
        assert_eq!((straight[0].error, straight[0].outcome), (Vector3::zeros(), TryOutcome::Held));
        assert_eq!((straight[2].error, straight[2].outcome), (error, TryOutcome::Contact));
        assert_eq!(straight.len(), 6);
        let turned = outcomes.rollouts(&turned).expect("letters")[2].error;
        assert!((turned - Vector3::new(error.y, -error.x, error.z)).norm() < 1e-12);
        let narrow = narrow_errors(2)[1];
        let narrow = narrow.objects[1].offset + narrow.position;
        assert_eq!((straight[5].error, straight[5].outcome), (narrow, TryOutcome::Missed));
        let wrong = GraspOutcomes { near: "hx".into(), ..outcomes };
        assert!(wrong.rollouts(grasp).expect_err("refused").to_string().contains("'x'"));
    }
}
