//! Strategy: given where the held object really sits, which grasp takes the next object without a collision, and where is it aimed?
//!
//! A candidate's odds (held, missed, contact) come from its rehearsals under errors ([`crate::odds`]), for that aim beside what is
//! seen which is worth most. What was rehearsed is the plan's hold; the hold as felt is compared with it by geometry: the union of
//! the held object (with the digits holding it) and the target is checked along the whole motion, the approach and the target's way
//! into its place in the hand while the digits close. By as much as the probability that this clearance is negative grows from the
//! rehearsed hold to the felt one, a contact becomes more likely. A candidate without rehearsals has its proven worth and the whole
//! of that probability. A miss without contact is worth part of a hold, because it can be tried again. The plan is kept unless
//! another candidate is worth clearly more.

mod solids;
mod ways;

use std::sync::Arc;

use grasping::Grasp;
use hand_model::Hand;
use nalgebra::{Isometry3, Translation3, Vector3};

use crate::collision::{CollisionError, Solid, clearance_along, clearance_at};
use crate::executive::Executive;
use crate::motion::MotionError;
use crate::odds::{Aimed, Belief, Odds, Rehearsed};
use crate::percept::Percept;
use crate::trajectory::PosePath;
use crate::worth::{Candidate, MISSED, SWITCH_GAIN, UNREHEARSED_CONTACT};

pub use self::solids::{Held, object_solids, placed};
use self::solids::{free_solids, held_solids};
pub use self::ways::{CLEAR, clear_stops, clearest};
use self::ways::{clear_enough, clearance_after};

/// Stages of the target's way into the hand that are checked.
const CLOSING_STAGES: usize = 4;
/// Offsets that are tried of the aim from what is seen, m, along each of the world's x and y.
const AIMS: [f64; 5] = [-0.008, -0.004, 0.0, 0.004, 0.008];
/// Beyond this many standard deviations a clearance says nothing.
const FAR: f64 = 2.0;

/// One candidate's assessment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// Smallest distance along the whole motion, m; negative is a collision.
    pub clearance: f64,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held after this try.
    pub held: f64,
    /// What the try is worth, 0 to 1.
    pub utility: f64,
}

/// What was decided, and why.
#[derive(Debug, Clone)]
pub struct Decision {
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
}

/// What a choice depends on.
pub struct Situation<'a> {
    /// Where the palm is, and where the target is seen.
    pub executive: &'a Executive,
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
}

/// The geometry of a decision: what moves with the palm (palm frame), as felt and as rehearsed, and the target (its own frame).
struct Scene<'a> {
    moving: Vec<Solid>,
    /// That and the rest of the hand, which is to stay clear on the way to the approach pose.
    whole: Vec<Solid>,
    rehearsed: Option<Vec<Solid>>,
    target: &'a [Solid],
    sigma: f64,
}

impl<'a> Scene<'a> {
    fn new(situation: &Situation<'a>) -> Self {
        let (hand, held) = (situation.hand, situation.held);
        let rehearsed = situation.rehearsed.map(|(pose, joints)| held_solids(hand, held, (&pose, joints)));
        let moving = held_solids(hand, held, (&held.pose, &held.joints));
        let whole = [&moving[..], &free_solids(hand, held)].concat();
        Self {
            moving,
            whole,
            rehearsed,
            target: situation.target,
            sigma: held.sigma.hypot(situation.target_sigma).max(1e-4),
        }
    }

    /// The way to the approach pose of `grasp` that keeps the whole hand clear of the target, which is seen at `percept`: of those
    /// that do so the first, else the one that does best. With its smallest distance, m.
    fn way(
        &self,
        executive: &Executive,
        grasp: &Grasp,
        (percept, beside): (&Percept, &Percept),
    ) -> Result<(f64, Vec<Isometry3<f64>>), StrategyError> {
        let fixed = placed(self.target, &percept.pose());
        let best = clear_enough(executive.ways(), FAR * self.sigma, |stops| {
            clearance_after(stops, &self.whole, &fixed, |stops| {
                let [way, _] = executive.path_to(stops, grasp, beside)?;
                Ok(way)
            })
        })?;
        Ok(best.unwrap_or((f64::NEG_INFINITY, Vec::new())))
    }

    /// Smallest distance of `moving` to the target, which is seen at `percept`, while `path` is followed and `grasp` closes.
    fn clearance(
        &self,
        moving: &[Solid],
        path: &PosePath,
        grasp: &Grasp,
        percept: &Percept,
    ) -> Result<f64, StrategyError> {
        let fixed = placed(self.target, &percept.pose());
        let mut clearance =
            clearance_along(path, moving, &fixed, 2000)?.map_or(f64::INFINITY, |found| found.min_distance);
        let before = path.end().inverse() * percept.pose();
        if let Some(after) = grasp.held {
            for stage in 1..=CLOSING_STAGES {
                let part = stage as f64 / CLOSING_STAGES as f64;
                // Only the place matters for most targets; the turn into the hand is taken over at the end.
                let place = before.translation.vector.lerp(&after.translation.vector, part);
                let rotation = if stage == CLOSING_STAGES { after.rotation } else { before.rotation };
                let there = Isometry3::from_parts(Translation3::from(place), rotation);
                let found = clearance_at(&Isometry3::identity(), moving, &placed(self.target, &there))?;
                clearance = clearance.min(found.map_or(f64::INFINITY, |found| found.min_distance));
            }
        }
        Ok(clearance)
    }

    /// How the hold as felt gets to the target and takes it with `candidate`, aimed `aim` beside what is seen.
    fn passage(
        &self,
        executive: &Executive,
        candidate: &Candidate,
        aim: &Vector3<f64>,
    ) -> Result<Passage, StrategyError> {
        let (percept, grasp) = (executive.second().1, &candidate.grasp);
        let beside = Percept { position: percept.position + aim, ..percept };
        let risk = |clearance: f64| normal_cdf(-clearance / self.sigma);
        let (there, stops) = self.way(executive, grasp, (&percept, &beside))?;
        let [_, last] = executive.path_to(&stops, grasp, &beside)?;
        let taking = self.clearance(&self.moving, &last, grasp, &percept)?;
        let contact = if taking > FAR * self.sigma {
            0.0
        } else {
            let known = match &self.rehearsed {
                Some(rehearsed) if !candidate.rehearsed.is_empty() => {
                    risk(self.clearance(rehearsed, &last, grasp, &percept)?)
                }
                _ => 0.0,
            };
            (risk(taking) - known).max(0.0)
        };
        let on_the_way = if there > FAR * self.sigma { 0.0 } else { risk(there) };
        Ok(Passage { clearance: taking.min(there), contact: 1.0 - (1.0 - contact) * (1.0 - on_the_way), stops })
    }
}

/// How what is held passes the target.
struct Passage {
    /// Smallest distance, m.
    clearance: f64,
    /// Probability of a contact beyond what rehearsals have seen: they began where the trial's plan does, and took the same last
    /// stretch.
    contact: f64,
    /// Of the way to the approach pose.
    stops: Vec<Isometry3<f64>>,
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
        let heading = candidate.grasp.yaw + situation.executive.second().1.yaw;
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
        for (x, y) in AIMS.iter().flat_map(|x| AIMS.iter().map(move |y| (*x, *y))) {
            let other = Self::at(situation, candidate, Vector3::new(x, y, 0.0));
            if utility(&other.odds) > utility(&best.odds) {
                best = other;
            }
        }
        best
    }

    /// With the stops of the way there.
    fn assess(&self, executive: &Executive, scene: &Scene) -> Result<(Assessment, Vec<Isometry3<f64>>), StrategyError> {
        let Passage { clearance, contact, stops } = scene.passage(executive, self.candidate, &self.aimed.aim)?;
        let free = 1.0 - contact;
        let odds = Odds { held: self.odds.held * free, contact: 1.0 - (1.0 - self.odds.contact) * free };
        Ok((Assessment { clearance, risk: odds.contact, held: odds.held, utility: utility(&odds) }, stops))
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

/// Chooses among `candidates`; the first is the plan. None if there are none.
pub fn choose(situation: &Situation, candidates: &[Candidate]) -> Result<Option<Decision>, StrategyError> {
    let Some(planned) = candidates.first() else { return Ok(None) };
    let (executive, scene) = (situation.executive, Scene::new(situation));
    let as_planned = Aiming::at(situation, planned, Vector3::zeros());
    let (plan, stops) = as_planned.assess(executive, &scene)?;
    let mut options: Vec<Aiming> = candidates.iter().map(|candidate| Aiming::best(situation, candidate)).collect();
    options.sort_by(|a, b| utility(&b.odds).total_cmp(&utility(&a.odds)));
    // What is in the way only takes away from an option's worth: those that cannot win are not looked at.
    let (mut chosen, mut assessment, mut way) = (as_planned, plan, stops);
    for option in options {
        let least = assessment.utility.max(SWITCH_GAIN * plan.utility);
        if utility(&option.odds) <= least {
            break;
        }
        let (assessed, stops) = option.assess(executive, &scene)?;
        if assessed.utility > least {
            (chosen, assessment, way) = (option, assessed, stops);
        }
    }
    let grasp = chosen.candidate.grasp.clone();
    let switched = grasp.id != planned.grasp.id;
    let reason = reason(situation.held.name, (&planned.grasp, &plan), (&chosen, &assessment));
    let aim = chosen.aimed.aim;
    Ok(Some(Decision { grasp, aim, aimed: chosen.aimed, way, switched, plan, chosen: assessment, reason }))
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

/// Distribution function of the standard normal.
fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::normal_cdf;

    #[test]
    fn normal_distribution() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.841344746), (-1.959963984540054, 0.025)] {
            assert!((normal_cdf(x) - p).abs() < 1e-9, "{x}");
        }
    }
}
