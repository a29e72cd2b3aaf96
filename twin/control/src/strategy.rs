//! Strategy: chooses the grasp of the next object and its aim, given the felt pose of the held object.
//!
//! The odds of a candidate (held, missed, contact) come from its rehearsals under errors ([`crate::odds`]), at the
//! offset of the aim with the highest utility. Rehearsals used the planned hold. The felt hold is compared with it by
//! geometry: the union of the held object (with the digits that hold it) and the target is checked along the whole
//! motion, which is the approach and the way of the target into the hand while the digits close. The probability that
//! this clearance is negative may be larger for the felt hold than for the rehearsed one; the probability of a contact
//! rises by the difference. The odds of a candidate that was proven after many holds give most weight to those similar
//! to the felt one ([`crate::extent`]) and already include obstacles at the object. A candidate without rehearsals has
//! its proven worth and the whole of that probability. A miss without contact is worth part of a hold, because it can
//! be tried again. The plan is kept unless another candidate is clearly better.

mod foreseen;
mod passage;
mod solids;
mod ways;

use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::Hand;
use nalgebra::{Isometry3, Vector3};

use crate::collision::{CollisionError, Solid};
use crate::executor::Executor;
use crate::foresight::{Foreseen, TwinError};
use crate::motion::MotionError;
use crate::odds::{Aimed, Belief, Odds, Rehearsed, aim_beside};
use crate::worth::{Candidate, MISSED, SWITCH_GAIN, UNREHEARSED_CONTACT};

pub use self::foreseen::Foresight;
pub use self::passage::Course;
use self::passage::{Passage, Scene};
pub use self::solids::{Held, object_solids, placed};
pub use self::ways::{CLEAR, clear_stops, clearest};

/// Assessment of one candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// Smallest distance along the whole motion, m; negative for a collision.
    pub clearance: f64,
    /// Distance between the held object alone and the next object at its place, with the palm at the grasp and the
    /// digits not yet closed, m. Negative where the two overlap, which is a collision in the sense of the paper.
    pub separation: f64,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held after this try.
    pub held: f64,
    /// Utility of the try, 0 to 1.
    pub utility: f64,
}

/// Record of one weighed candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighed {
    /// Number of the grasp.
    pub grasp: u32,
    /// Offset of its aim from the seen position, m, world.
    pub aim: Vector3<f64>,
    /// Clearance, m; only for candidates that could still win.
    pub clearance: Option<f64>,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held.
    pub held: f64,
    /// Utility of the try, 0 to 1.
    pub utility: f64,
    /// True for the plan.
    pub planned: bool,
}

/// A decision with its reasons.
#[derive(Debug, Clone)]
pub struct Decision {
    /// All candidates: the plan, aimed at the seen position, first, then the others by their odds.
    pub weighed: Vec<Weighed>,
    /// Index of the chosen candidate.
    pub choice: usize,
    /// Predicted course of the plan, if another grasp or aim was chosen.
    pub rejected: Option<Course>,
    /// Predicted course of the chosen option.
    pub course: Course,
    /// Chosen grasp.
    pub grasp: Grasp,
    /// Offset of its aim from the seen position, m, world.
    pub aim: Vector3<f64>,
    /// Rehearsals and aim of the chosen grasp, for learning from its outcome.
    pub aimed: Aimed,
    /// Via poses on the way to its approach pose.
    pub way: Vec<Isometry3<f64>>,
    /// True if it differs from the planned grasp.
    pub switched: bool,
    /// Assessment of the plan, aimed at the seen position.
    pub plan: Assessment,
    /// Assessment of the chosen grasp.
    pub chosen: Assessment,
    /// Reason in words.
    pub reason: String,
}

/// Failure to make a decision.
#[derive(Debug, thiserror::Error)]
pub enum StrategyError {
    /// The geometric check failed.
    #[error(transparent)]
    Collision(#[from] CollisionError),
    /// A path could not be planned.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The twin failed.
    #[error(transparent)]
    Twin(#[from] TwinError),
}

/// Inputs of a choice.
pub struct Situation<'a> {
    /// Executor with the present palm pose and the target's percept.
    pub executor: &'a Executor,
    pub hand: &'a Hand,
    /// Contents of the hand.
    pub held: &'a Held<'a>,
    /// Hold of the same object after which the candidates were rehearsed: `palm_from_object` and finger joint angles,
    /// rad.
    pub rehearsed: Option<(Isometry3<f64>, &'a [f64])>,
    /// Solids of the object to take next, in its own frame: [`object_solids`].
    pub target: &'a [Solid],
    /// Standard deviation of the target's position relative to the hand, from perceiving and reaching it, m.
    pub target_sigma: f64,
    /// Rehearsals of all candidates.
    pub all: Arc<[Rehearsed]>,
    /// Belief about the error of the aim.
    pub belief: &'a Belief,
    /// Number of looks over which the target's position is averaged.
    pub looks: u32,
    /// Offset of the aim for a grasp that was not rehearsed, m, world.
    pub probe: Vector3<f64>,
    /// Twin in which the best candidates are played before one is chosen.
    pub foresight: Option<Foresight<'a>>,
}

/// A candidate with an aim.
struct Aiming<'a> {
    candidate: &'a Candidate,
    aimed: Aimed,
    odds: Odds,
}

impl<'a> Aiming<'a> {
    /// `candidate` with its aim at the offset `aim` (m) from the seen position.
    fn at(situation: &Situation, candidate: &'a Candidate, aim: Vector3<f64>) -> Self {
        let heading = candidate.grasp.yaw + situation.executor.target(1).percept.yaw;
        let (rehearsed, all) = (candidate.rehearsed.clone(), situation.all.clone());
        let aimed = Aimed { rehearsed, all, heading, aim };
        let odds = candidate_odds(candidate, &aimed, (situation.belief, situation.looks));
        Self { candidate, aimed, odds }
    }

    /// `candidate` with the aim of the highest utility.
    fn best(situation: &Situation, candidate: &'a Candidate) -> Self {
        if candidate.rehearsed.is_empty() {
            return Self::at(situation, candidate, situation.probe);
        }
        let mut best = Self::at(situation, candidate, Vector3::zeros());
        let around = situation.belief.odds_around(&best.aimed, situation.looks);
        for (x, line) in around.iter().enumerate() {
            for (y, odds) in line.iter().enumerate() {
                let odds = Odds { held: odds.held * candidate.trust, ..*odds };
                if utility(&odds) > utility(&best.odds) {
                    (best.odds, best.aimed.aim) = (odds, Vector3::new(aim_beside(x), aim_beside(y), 0.0));
                }
            }
        }
        best
    }

    /// True if grasp and aim are the same.
    fn is(&self, other: &Aiming) -> bool {
        self.candidate.grasp.id == other.candidate.grasp.id && self.aimed.aim == other.aimed.aim
    }

    /// Assesses the option with the geometry of its motion.
    fn assess(&self, executor: &Executor, scene: &Scene) -> Result<(Assessment, Passage), StrategyError> {
        let passage = scene.passage(executor, self.candidate, &self.aimed.aim)?;
        let (clearance, separation, free) = (passage.clearance, passage.separation, 1.0 - passage.contact);
        let odds = Odds { held: self.odds.held * free, contact: 1.0 - (1.0 - self.odds.contact) * free };
        Ok((
            Assessment { clearance, separation, risk: odds.contact, held: odds.held, utility: utility(&odds) },
            passage,
        ))
    }

    /// Record of the option, with its odds alone or with its assessment.
    fn weighed(&self, assessed: Option<&Assessment>, planned: bool) -> Weighed {
        let Odds { held, contact } = self.odds;
        let (held, risk, worth) = match assessed {
            Some(assessed) => (assessed.held, assessed.risk, assessed.utility),
            None => (held, contact, utility(&self.odds)),
        };
        let clearance = assessed.map(|assessed| assessed.clearance);
        Weighed { grasp: self.candidate.grasp.id, aim: self.aimed.aim, clearance, risk, held, utility: worth, planned }
    }
}

/// Odds of a candidate with the aim `aimed`, given a belief and the number of looks at the object.
fn candidate_odds(candidate: &Candidate, aimed: &Aimed, (belief, looks): (&Belief, u32)) -> Odds {
    if candidate.rehearsed.is_empty() {
        return Odds { held: candidate.worth * (1.0 - UNREHEARSED_CONTACT), contact: UNREHEARSED_CONTACT };
    }
    let odds = belief.odds(aimed, looks);
    Odds { held: odds.held * candidate.trust, ..odds }
}

/// Rehearsals of all `candidates`.
pub fn rehearsals(candidates: &[Candidate]) -> Arc<[Rehearsed]> {
    candidates.iter().flat_map(|candidate| candidate.rehearsed.iter().copied()).collect()
}

/// Utility of the best of `candidates` at an object whose position has the error of `belief`.
pub fn promise(candidates: &[Candidate], belief: &Belief) -> f64 {
    let all = rehearsals(candidates);
    let worth = |candidate: &Candidate| {
        let (rehearsed, all) = (candidate.rehearsed.clone(), all.clone());
        let aimed = Aimed { rehearsed, all, heading: candidate.grasp.yaw, aim: Vector3::zeros() };
        utility(&candidate_odds(candidate, &aimed, (belief, 1)))
    };
    candidates.iter().map(worth).fold(0.0, f64::max)
}

/// Utility of a try with these odds.
fn utility(odds: &Odds) -> f64 {
    odds.held + MISSED * (1.0 - odds.held - odds.contact)
}

/// A candidate whose motion was checked.
struct Considered<'a> {
    /// Its index among the weighed candidates.
    place: usize,
    aiming: Aiming<'a>,
    assessment: Assessment,
    passage: Passage,
    /// Outcomes in the twin, if it was played.
    foreseen: Option<Foreseen>,
}

/// Chooses among `candidates`, the first of which is the plan. `None` if there are none.
pub fn choose(situation: &Situation, candidates: &[Candidate]) -> Result<Option<Decision>, StrategyError> {
    let Some(planned) = candidates.first() else { return Ok(None) };
    let scene = Scene::new(situation);
    let aiming = Aiming::at(situation, planned, Vector3::zeros());
    let (assessment, passage) = aiming.assess(situation.executor, &scene)?;
    let mut plan = Considered { place: 0, aiming, assessment, passage, foreseen: None };
    let mut options: Vec<Aiming> = candidates.iter().map(|candidate| Aiming::best(situation, candidate)).collect();
    options.sort_by(|a, b| utility(&b.odds).total_cmp(&utility(&a.odds)));
    let mut weighed = vec![plan.aiming.weighed(Some(&plan.assessment), true)];
    weighed.extend(options.iter().map(|option| option.weighed(None, false)));
    let other = match &situation.foresight {
        Some(foresight) => foresight.best(situation, &scene, &mut plan, options, &mut weighed)?,
        None => best_by_odds(situation.executor, &scene, &plan, options, &mut weighed)?,
    };
    let plan_assessment = plan.assessment;
    let (chosen, rejected) = match other {
        Some(other) => (other, Some(plan.passage)),
        None => (plan, None),
    };
    let Considered { place: choice, aiming, assessment, passage: way, foreseen } = chosen;
    let grasp = aiming.candidate.grasp.clone();
    let switched = grasp.id != planned.grasp.id;
    let mut reason = reason(situation.held.name, (&planned.grasp, &plan_assessment), (&aiming, &assessment));
    match foreseen {
        Some(Foreseen { played, held, contact }) => {
            reason.push_str(&format!("; of {played} tries in the twin {held} hold and {contact} touch"));
        }
        None if situation.foresight.is_some() => {
            reason.push_str("; not played: there is no such hold or way in the twin")
        }
        None => {}
    }
    let course = way.course(&situation.held.pose);
    Ok(Some(Decision {
        weighed,
        choice,
        rejected: rejected.map(|way| way.course(&situation.held.pose)),
        course,
        grasp,
        aim: aiming.aimed.aim,
        aimed: aiming.aimed,
        way: way.stops,
        switched,
        plan: plan_assessment,
        chosen: assessment,
        reason,
    }))
}

/// Best of `options`, ranked by their odds, if it is clearly better than the `plan`. Obstacles can only lower the
/// utility of an option, so those that cannot win are not checked.
fn best_by_odds<'a>(
    executor: &Executor,
    scene: &Scene,
    plan: &Considered,
    options: Vec<Aiming<'a>>,
    weighed: &mut [Weighed],
) -> Result<Option<Considered<'a>>, StrategyError> {
    let mut best: Option<Considered> = None;
    for (n, aiming) in options.into_iter().enumerate() {
        let utmost = best.as_ref().map_or(plan.assessment.utility, |best| best.assessment.utility);
        let least = utmost.max(SWITCH_GAIN * plan.assessment.utility);
        if utility(&aiming.odds) <= least {
            break;
        }
        let (assessment, passage) = aiming.assess(executor, scene)?;
        weighed[n + 1] = aiming.weighed(Some(&assessment), false);
        if assessment.utility > least {
            best = Some(Considered { place: n + 1, aiming, assessment, passage, foreseen: None });
        }
    }
    Ok(best)
}

/// Describes the choice in words.
fn reason(held: &str, plan: (&Grasp, &Assessment), chosen: (&Aiming, &Assessment)) -> String {
    let odds = |assessed: &Assessment| format!("holds with {:.2}, contact {:.2}", assessed.held, assessed.risk);
    let (grasp, aim) = (&chosen.0.candidate.grasp, chosen.0.aimed.aim * 1e3);
    let passes = format!("passes the held {held} at {:.1} mm", chosen.1.clearance * 1e3);
    if grasp.id == plan.0.id && aim == Vector3::zeros() {
        return format!("grasp {} as planned {passes}: {}", grasp.id, odds(plan.1));
    }
    format!(
        "grasp {} as planned: {}; grasp {} aimed ({:.0}, {:.0}, {:.0}) mm beside what is seen {passes}: {}",
        plan.0.id,
        odds(plan.1),
        grasp.id,
        aim.x,
        aim.y,
        aim.z,
        odds(chosen.1)
    )
}
