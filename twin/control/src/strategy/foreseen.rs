//! Choice by foresight: the options that are best by odds and geometry are played in the twin, one after another, until
//! one is good.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3};
use world::objects::ObjectModel;

use super::passage::Scene;
use super::{Aiming, Assessment, Considered, Situation, StrategyError, Weighed, utility};
use crate::executor::{Executor, Target};
use crate::foresight::{self, Foreseen, Foresees, Imagined, PAIRS, Unknown};
use crate::odds::Odds;
use crate::percept::Percept;
use crate::worth::SWITCH_GAIN;

/// Utility from which on no further option is played. Set by hand on seed 1.
const GOOD: f64 = 0.9;

/// Number of rounds in which the aim of the best option is shifted if none is good, and the size of the shift (m).
const ROUNDS: usize = 2;
const STEP: f64 = 0.005;

/// Inputs for playing candidates in the twin.
#[derive(Clone, Copy)]
pub struct Foresight<'a> {
    pub foresees: Foresees<'a>,
    /// The held object and the target.
    pub objects: &'a [Arc<ObjectModel>],
    /// Covariance of the held object's pose, m and rad, palm axes.
    pub covariance: &'a Matrix6<f64>,
}

impl Foresight<'_> {
    /// Best of `options`, ranked by their odds, if it is clearly better than the `plan`. They are played in turn until
    /// one is good.
    pub(super) fn best<'a>(
        &self,
        situation: &Situation,
        scene: &Scene,
        plan: &mut Considered<'a>,
        options: Vec<Aiming<'a>>,
        weighed: &mut Vec<Weighed>,
    ) -> Result<Option<Considered<'a>>, StrategyError> {
        let executor = situation.executor;
        let draws = foresight::draws(&Unknown {
            held: (situation.held.pose, self.covariance),
            target: executor.target(1).percept,
            belief: situation.belief,
            looks: situation.looks,
        });
        let (objects, joints) = (self.objects, &situation.held.joints[..]);
        let imagined = self.foresees.twin.imagine(&foresight::Scene { executor, objects, joints, draws: &draws })?;
        let imagined = imagined.as_ref();
        let others = options.into_iter().enumerate().filter(|(_, aiming)| !aiming.is(&plan.aiming));
        let others: Vec<_> = others.take(self.foresees.others).collect();
        let mut best: Option<Considered> = None;
        for (n, aiming) in others {
            if plan.foreseen.is_none() && utility(&aiming.odds) <= SWITCH_GAIN * plan.assessment.utility {
                play(executor, imagined, plan, worth(best.as_ref()))?;
            }
            let played = plan.foreseen.map_or(f64::NEG_INFINITY, |_| plan.assessment.utility);
            let utmost = worth(best.as_ref()).max(played);
            if utmost >= GOOD {
                break;
            }
            let (assessment, passage) = aiming.assess(executor, scene)?;
            let mut one = Considered { place: n + 1, aiming, assessment, passage, foreseen: None };
            play(executor, imagined, &mut one, utmost)?;
            weighed[n + 1] = one.aiming.weighed(Some(&one.assessment), false);
            if one.assessment.utility > worth(best.as_ref()) {
                best = Some(one);
            }
        }
        if plan.foreseen.is_none() && worth(best.as_ref()) < GOOD {
            play(executor, imagined, plan, worth(best.as_ref()))?;
        }
        weighed[0] = plan.aiming.weighed(Some(&plan.assessment), true);
        if self.foresees.others > 0 {
            self.search_aims(situation, scene, imagined, plan, &mut best, weighed)?;
        }
        Ok(best.filter(|best| best.assessment.utility > SWITCH_GAIN * plan.assessment.utility))
    }

    /// Shifts the aim of the best option to every side, as long as no option is good.
    fn search_aims<'a>(
        &self,
        situation: &Situation,
        scene: &Scene,
        twin: &dyn Imagined,
        plan: &Considered<'a>,
        best: &mut Option<Considered<'a>>,
        weighed: &mut Vec<Weighed>,
    ) -> Result<(), StrategyError> {
        for _ in 0..ROUNDS {
            let center = best.as_ref().filter(|best| best.assessment.utility > plan.assessment.utility).unwrap_or(plan);
            let (candidate, aim, utmost) =
                (center.aiming.candidate, center.aiming.aimed.aim, center.assessment.utility);
            if utmost >= GOOD {
                break;
            }
            for step in [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
                let aiming = Aiming::at(situation, candidate, aim + STEP * step);
                let (assessment, passage) = aiming.assess(situation.executor, scene)?;
                let place = weighed.len();
                let mut one = Considered { place, aiming, assessment, passage, foreseen: None };
                let least = worth(best.as_ref()).max(utmost);
                play(situation.executor, twin, &mut one, least)?;
                weighed.push(one.aiming.weighed(Some(&one.assessment), false));
                if one.foreseen.is_some() && one.assessment.utility > least {
                    *best = Some(one);
                }
            }
        }
        Ok(())
    }
}

/// Utility of an option; negative infinity if there is none.
fn worth(one: Option<&Considered>) -> f64 {
    one.map_or(f64::NEG_INFINITY, |one| one.assessment.utility)
}

/// Plays `one` under half of the samples, and under the others if its utility can still exceed `least`. If the arm
/// finds no way, the odds stay.
fn play(executor: &Executor, twin: &dyn Imagined, one: &mut Considered, least: f64) -> Result<(), StrategyError> {
    let Some(going) = going(executor, one)? else { return Ok(()) };
    let odds = Odds { held: one.assessment.held, contact: one.assessment.risk };
    let mut foreseen = Foreseen::default();
    for (draws, left) in [(0..PAIRS, 2 * PAIRS), (PAIRS..2 * PAIRS, PAIRS)] {
        if utility(&foreseen.at_best(left as u32).with(&odds)) <= least {
            break;
        }
        foreseen.count(&twin.play(&going, draws)?);
    }
    let odds = foreseen.with(&odds);
    one.assessment = Assessment { held: odds.held, risk: odds.contact, utility: utility(&odds), ..one.assessment };
    one.foreseen = (foreseen.played > 0).then_some(foreseen);
    Ok(())
}

/// The executor on its way to try `one`; `None` if the arm cannot get there.
fn going(executor: &Executor, one: &Considered) -> Result<Option<Executor>, StrategyError> {
    let (seen, grasp) = (executor.target(1).percept, &one.aiming.candidate.grasp);
    let beside = Percept { position: seen.position + one.aiming.aimed.aim, ..seen };
    let Some(path) = executor.rehearsed_approach(&one.passage.stops, grasp, &beside) else { return Ok(None) };
    let mut going = executor.clone();
    going.take(1, Target { grasp: grasp.clone(), percept: beside })?;
    going.redirect(path);
    Ok(Some(going))
}
