//! Outcomes: second grasps of a plan tried under drawn errors of their aim, for the odds that a policy goes by.
//!
//! All grasps meet the same draws, so a file keeps a letter for each draw: `h` held, `m` missed, `c` contact.

use anyhow::{Result, bail};
use control::odds::{Rehearsed, TryOutcome};
use grasping::{Grasp, Repertoire};
use indicatif::ProgressBar;
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;
use scenarios::noise::TrialNoise;
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;

use super::{FAILED_WORTH, Plan, Plans};
use crate::rehearsal::{FirstRehearsal, StartPosture, misaimed, rehearse_first, try_second, wide_errors};
use crate::world::World;

/// Draws under which each grasp is tried.
const DRAWS: usize = 24;
/// Grasps of a plan that are tried: the best of those that worked without errors.
const GRASPS: usize = 6;

/// How a second grasp went under each draw.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outcomes {
    /// Number of the grasp.
    pub grasp: u32,
    /// A letter for each draw.
    pub outcomes: String,
}

impl Outcomes {
    fn new(grasp: u32, outcomes: &[TryOutcome]) -> Self {
        let letter = |outcome: &TryOutcome| match outcome {
            TryOutcome::Held => 'h',
            TryOutcome::Missed => 'm',
            TryOutcome::Contact => 'c',
        };
        Self { grasp, outcomes: outcomes.iter().map(letter).collect() }
    }

    /// The rehearsals, with the errors in axes that turn with `grasp`'s heading; first the one without errors, which held.
    pub fn rehearsed(&self, grasp: &Grasp) -> Result<Vec<Rehearsed>> {
        let errors = wide_errors(self.outcomes.len());
        let with = |(error, letter): (&TrialNoise, char)| {
            let outcome = match letter {
                'h' => TryOutcome::Held,
                'm' => TryOutcome::Missed,
                'c' => TryOutcome::Contact,
                other => bail!("outcomes of grasp {}: found {other:?}, expected h, m or c", self.grasp),
            };
            Ok(Rehearsed { error: aim_error(error, grasp.yaw), outcome })
        };
        let faultless = Rehearsed { error: Vector3::zeros(), outcome: TryOutcome::Held };
        std::iter::once(Ok(faultless)).chain(errors.iter().zip(self.outcomes.chars()).map(with)).collect()
    }
}

/// By how much the second grasp is aimed beside the object, m, in axes turned by `heading` (rad) about the vertical.
fn aim_error(noise: &TrialNoise, heading: f64) -> Vector3<f64> {
    let world = noise.objects[1].offset + noise.position;
    Rotation3::from_axis_angle(&Vector3::z_axis(), -heading) * world
}

/// Tries the best grasps of all `plans` under errors, in the place of what they knew; shows a progress bar unless `quiet`. Takes
/// about a minute of a core for each plan.
pub fn rehearse(world: &World, repertoire: &Repertoire, plans: &mut Plans, quiet: bool) -> Result<()> {
    let progress = if quiet { ProgressBar::hidden() } else { ProgressBar::new(plans.plans.len() as u64) };
    let board = TactileBoard::unit(&world.cell.hand, 0);
    plans.plans.par_iter_mut().try_for_each(|plan| {
        plan.outcomes = rehearse_plan(world, repertoire, plan, &board)?;
        progress.inc(1);
        Ok::<(), anyhow::Error>(())
    })?;
    progress.finish_and_clear();
    Ok(())
}

/// Tries the best grasps of `plan`; nothing where its first grasp does not hold.
fn rehearse_plan(world: &World, repertoire: &Repertoire, plan: &Plan, board: &TactileBoard) -> Result<Vec<Outcomes>> {
    let (first, seconds) = plan.grasps(repertoire)?;
    let Some(any) = seconds.first() else { return Ok(Vec::new()) };
    let rehearsal = FirstRehearsal {
        protocol: world.protocol(),
        start: StartPosture::Ready,
        grasps: [&first, &any.grasp],
        noise: &TrialNoise::none(),
    };
    let Some((hold, _)) = rehearse_first(world, &rehearsal, board)? else { return Ok(Vec::new()) };
    let worked = seconds.iter().filter(|second| second.worth > FAILED_WORTH * second.grasp.score);
    let errors = wide_errors(DRAWS);
    worked
        .take(GRASPS)
        .map(|second| {
            let tries: Result<Vec<TryOutcome>> =
                errors.iter().map(|noise| try_second(&hold, &misaimed(&second.grasp, noise, 1))).collect();
            Ok(Outcomes::new(second.grasp.id, &tries?))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plan's letters come back as the errors they were drawn for, turned with the grasp; another letter is refused.
    #[test]
    fn letters_stand_for_draws() {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let grasp = repertoire.grasps.values().flatten().next().expect("a grasp");
        let turned = Grasp { yaw: std::f64::consts::FRAC_PI_2, ..grasp.clone() };
        let outcomes = Outcomes::new(grasp.id, &[TryOutcome::Held, TryOutcome::Contact, TryOutcome::Missed]);
        assert_eq!(outcomes.outcomes, "hcm");
        let straight = outcomes.rehearsed(&Grasp { yaw: 0.0, ..grasp.clone() }).expect("letters");
        let noise = wide_errors(3)[1];
        let error = noise.objects[1].offset + noise.position;
        assert_eq!((straight[0].error, straight[0].outcome), (Vector3::zeros(), TryOutcome::Held));
        assert_eq!((straight[2].error, straight[2].outcome), (error, TryOutcome::Contact));
        let turned = outcomes.rehearsed(&turned).expect("letters")[2].error;
        assert!((turned - Vector3::new(error.y, -error.x, error.z)).norm() < 1e-12);
        let wrong = Outcomes { outcomes: "hx".into(), ..outcomes };
        assert!(wrong.rehearsed(grasp).expect_err("refused").to_string().contains("'x'"));
    }
}
