//! Strategy: given where the held object really sits, which grasp takes the next object without a collision, and where is it aimed?
//!
//! A candidate's odds (held, missed, contact) come from its rehearsals under errors ([`crate::odds`]), for that aim beside what is
//! seen which is worth most. What was rehearsed is the plan's hold; the hold as felt is compared with it by geometry: the union of
//! the held object (with the digits holding it) and the target is checked along the whole motion, the approach and the target's way
//! into its place in the hand while the digits close. By as much as the probability that this clearance is negative grows from the
//! rehearsed hold to the felt one, a contact becomes more likely. A candidate that was proven after many holds has odds that count those most which are
//! like the felt one ([`crate::extent`]); what is in its way at the object is in them. A candidate without rehearsals has its proven worth and the whole
//! of that probability. A miss without contact is worth part of a hold, because it can be tried again. The plan is kept unless
//! another candidate is worth clearly more.

mod foreseen;
mod passage;
mod solids;
mod ways;

use std::sync::Arc;

use grasping::Grasp;
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

/// One candidate's assessment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// Smallest distance along the whole motion, m; negative is a collision.
    pub clearance: f64,
    /// Distance between the held object alone and the next one in its place, when the palm is at the grasp and before the digits close, m;
    /// negative where the two overlap, which is the paper's collision.
    pub separation: f64,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held after this try.
    pub held: f64,
    /// What the try is worth, 0 to 1.
    pub utility: f64,
}

/// One candidate as it was weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighed {
    /// Number of the grasp.
    pub grasp: u32,
    /// Where it would aim beside what is seen, m, world.
    pub aim: Vector3<f64>,
    /// Its odds; with a clearance only where it could still win.
    pub clearance: Option<f64>,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held.
    pub held: f64,
    /// What the try is worth, 0 to 1.
    pub utility: f64,
    /// Whether this is the plan.
    pub planned: bool,
}

/// What was decided, and why.
#[derive(Debug, Clone)]
pub struct Decision {
    /// All candidates, the plan as seen first, then by their odds.
    pub weighed: Vec<Weighed>,
    /// Place of the chosen one among them.
    pub choice: usize,
    /// How the plan would have gone, if another grasp or aim was chosen.
    pub rejected: Option<Course>,
    /// How the chosen one goes.
    pub course: Course,
    /// The grasp to use.
    pub grasp: Grasp,
    /// Where to aim beside what is seen, m, world.
    pub aim: Vector3<f64>,
    /// Its rehearsals and aim, to learn from how it goes.
    pub aimed: Aimed,
    /// Stops on the way to its approach pose.
    pub way: Vec<Isometry3<f64>>,
    /// Whether it is another than planned.
    pub switched: bool,
    /// Assessment of the plan, aimed at what is seen.
    pub plan: Assessment,
    /// Assessment of the chosen grasp.
    pub chosen: Assessment,
    /// The reason in words.
    pub reason: String,
}

/// Why no decision could be made.
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

/// What a choice depends on.
pub struct Situation<'a> {
    /// Where the palm is, and where the target is seen.
    pub executor: &'a Executor,
    pub hand: &'a Hand,
    /// What it holds.
    pub held: &'a Held<'a>,
    /// The hold of the same object after which candidates were rehearsed: `palm_from_object` and finger angles, rad.
    pub rehearsed: Option<(Isometry3<f64>, &'a [f64])>,
    /// The object to take next, in its own frame: [`object_solids`].
    pub target: &'a [Solid],
    /// Standard deviation of perceiving and reaching the target, m.
    pub target_sigma: f64,
    /// Rehearsals of all candidates.
    pub all: Arc<[Rehearsed]>,
    /// What is known about the error of the aim.
    pub belief: &'a Belief,
    /// How many looks the target's place is the mean of.
    pub looks: u32,
    /// Where to aim with a grasp that was not rehearsed, m, world.
    pub probe: Vector3<f64>,
    /// A twin in which the best are played before one is chosen.
    pub foresight: Option<Foresight<'a>>,
}

/// A candidate with an aim.
struct Aiming<'a> {
    candidate: &'a Candidate,
    aimed: Aimed,
    odds: Odds,
}

impl<'a> Aiming<'a> {
    /// `candidate` sent `aim` beside what is seen.
    fn at(situation: &Situation, candidate: &'a Candidate, aim: Vector3<f64>) -> Self {
        let heading = candidate.grasp.yaw + situation.executor.target(1).percept.yaw;
        let (rehearsed, all) = (candidate.rehearsed.clone(), situation.all.clone());
        let aimed = Aimed { rehearsed, all, heading, aim };
        let odds = candidate_odds(candidate, &aimed, (situation.belief, situation.looks));
        Self { candidate, aimed, odds }
    }

    /// `candidate` with the aim that is worth most.
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

    /// Whether it is the same grasp with the same aim.
    fn is(&self, other: &Aiming) -> bool {
        self.candidate.grasp.id == other.candidate.grasp.id && self.aimed.aim == other.aimed.aim
    }

    /// With how it goes there.
    fn assess(&self, executor: &Executor, scene: &Scene) -> Result<(Assessment, Passage), StrategyError> {
        let passage = scene.passage(executor, self.candidate, &self.aimed.aim)?;
        let (clearance, separation, free) = (passage.clearance, passage.separation, 1.0 - passage.contact);
        let odds = Odds { held: self.odds.held * free, contact: 1.0 - (1.0 - self.odds.contact) * free };
        Ok((
            Assessment { clearance, separation, risk: odds.contact, held: odds.held, utility: utility(&odds) },
            passage,
        ))
    }

    /// As it was weighed: by its odds alone, or with what is in its way.
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

/// The odds of a candidate sent as `aimed`, given a belief and the looks at the object.
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

/// What the best of `candidates` is worth at an object whose place is known as `belief` says.
pub fn promise(candidates: &[Candidate], belief: &Belief) -> f64 {
    let all = rehearsals(candidates);
    let worth = |candidate: &Candidate| {
        let (rehearsed, all) = (candidate.rehearsed.clone(), all.clone());
        let aimed = Aimed { rehearsed, all, heading: candidate.grasp.yaw, aim: Vector3::zeros() };
        utility(&candidate_odds(candidate, &aimed, (belief, 1)))
    };
    candidates.iter().map(worth).fold(0.0, f64::max)
}

/// What a try with these odds is worth.
fn utility(odds: &Odds) -> f64 {
    odds.held + MISSED * (1.0 - odds.held - odds.contact)
}

/// A candidate whose way was looked at.
struct Considered<'a> {
    /// Its place among those that were weighed.
    place: usize,
    aiming: Aiming<'a>,
    assessment: Assessment,
    passage: Passage,
    /// What came of it in the twin.
    foreseen: Option<Foreseen>,
}

/// Chooses among `candidates`; the first is the plan. None if there are none.
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

/// The best of `options`, ranked by their odds, if it is worth clearly more than the `plan`. What is in the way only takes away from an
/// option's worth: those that cannot win are not looked at.
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

/// The choice in words.
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
