//! The choice by foresight: of the candidates that are best by odds and geometry, the one that leads is played in the twin, until one leads
//! that has been played enough and is good.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3};
use scenarios::objects::ObjectModel;

use super::passage::Scene;
use super::{Aiming, Assessment, Considered, Situation, StrategyError, Weighed, utility};
use crate::executive::Executive;
use crate::foresight::{self, AT_ONCE, Foreseen, Foresees, Imagined, PAIRS, Unknown};
use crate::odds::Odds;
use crate::percept::Percept;
use crate::worth::SWITCH_GAIN;

/// No other is played after one that is worth at least this much. Set by hand on seed 1.
const GOOD: f64 = 0.9;

/// How often and by how much (m) the aim of the leader is moved where it is not good.
const ROUNDS: usize = 2;
const STEP: f64 = 0.005;

/// What it takes to play candidates.
#[derive(Clone, Copy)]
pub struct Foresight<'a> {
    pub foresees: Foresees<'a>,
    /// The held object and the target.
    pub objects: &'a [Arc<ObjectModel>; 2],
    /// Covariance of the held object's pose, m and rad, palm axes.
    pub covariance: &'a Matrix6<f64>,
}

/// What plays came to.
pub(super) struct Outcome<'a> {
    pub plan: Considered<'a>,
    /// The best of the others, if it is worth clearly more than the plan.
    pub other: Option<Considered<'a>>,
    /// How many tries were played.
    pub plays: u32,
}

impl Foresight<'_> {
    /// Plays the `plan` and the best of `options`, which are ranked by their odds.
    pub(super) fn best<'a>(
        &self,
        situation: &Situation,
        scene: &Scene,
        plan: Considered<'a>,
        options: Vec<Aiming<'a>>,
        weighed: &mut Vec<Weighed>,
    ) -> Result<Outcome<'a>, StrategyError> {
        let executive = situation.executive;
        let draws = foresight::draws(&Unknown {
            held: (situation.held.pose, self.covariance),
            target: executive.second().1,
            belief: situation.belief,
            looks: situation.looks,
        });
        let (objects, joints) = (self.objects, &situation.held.joints[..]);
        let twin = self.foresees.twin.imagine(&foresight::Scene { executive, objects, joints, draws: &draws })?;
        let others = options.into_iter().enumerate().filter(|(_, aiming)| !aiming.is(&plan.aiming));
        let others: Vec<_> = others.take(self.foresees.others).collect();
        let mut race = Race { executive, twin: twin.as_ref(), left: self.foresees.plays, runners: Vec::new() };
        race.runners.push(Runner::new(plan));
        for (n, aiming) in others {
            race.enter(n + 1, aiming, scene)?;
        }
        race.run()?;
        let rounds = if self.foresees.others > 0 { ROUNDS } else { 0 };
        for _ in 0..rounds {
            let leader = race.leader();
            if leader.rank() >= GOOD || race.left < AT_ONCE {
                break;
            }
            let (candidate, aim) = (leader.one.aiming.candidate, leader.one.aiming.aimed.aim);
            for step in [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
                let aiming = Aiming::at(situation, candidate, aim + STEP * step);
                let place = weighed.len();
                weighed.push(aiming.weighed(None, false));
                race.enter(place, aiming, scene)?;
            }
            race.run()?;
        }
        let plays = self.foresees.plays - race.left;
        for Runner { one, .. } in &race.runners {
            weighed[one.place] = one.aiming.weighed(Some(&one.assessment), one.place == 0);
        }
        let leader = race.leading();
        let other = (leader > 0).then(|| race.runners.swap_remove(leader).one);
        let plan = race.runners.swap_remove(0).one;
        Ok(Outcome { plan, other, plays })
    }
}

/// Candidates that are played in turn. The plan is the first of them.
struct Race<'s, 'a> {
    executive: &'s Executive,
    twin: &'s dyn Imagined,
    /// How many tries may still be played.
    left: u32,
    runners: Vec<Runner<'a>>,
}

/// A candidate that is played.
struct Runner<'a> {
    one: Considered<'a>,
    /// Its odds before any play.
    odds: Odds,
    foreseen: Foreseen,
    /// On its way to try it, once it has been played.
    going: Option<Executive>,
    /// How many draws it has been played under.
    draws: usize,
}

impl<'a> Runner<'a> {
    fn new(one: Considered<'a>) -> Self {
        let odds = Odds { held: one.assessment.held, contact: one.assessment.risk };
        Self { one, odds, foreseen: Foreseen::default(), going: None, draws: 0 }
    }

    /// What it is worth. The plan is preferred a little.
    fn rank(&self) -> f64 {
        self.preference() * self.one.assessment.utility
    }

    fn preference(&self) -> f64 {
        if self.one.place == 0 { SWITCH_GAIN } else { 1.0 }
    }

    /// Whether there is nothing left to play.
    fn is_over(&self) -> bool {
        self.draws == 2 * PAIRS
    }

    /// The rank that it has if all that is left to play holds.
    fn utmost(&self) -> f64 {
        let left = (2 * PAIRS - self.draws) as u32;
        self.preference() * utility(&self.foreseen.at_best(left).with(&self.odds))
    }
}

impl<'a> Race<'_, 'a> {
    /// Adds a candidate, which is at `place` among those that were weighed.
    fn enter(&mut self, place: usize, aiming: Aiming<'a>, scene: &Scene) -> Result<(), StrategyError> {
        let (assessment, passage) = aiming.assess(self.executive, scene)?;
        self.runners.push(Runner::new(Considered { place, aiming, assessment, passage, foreseen: None }));
        Ok(())
    }

    /// The first of those that rank highest.
    fn leading(&self) -> usize {
        let ranks = self.runners.iter().map(Runner::rank).enumerate();
        ranks.fold((0, f64::NEG_INFINITY), |best, (n, rank)| if rank > best.1 { (n, rank) } else { best }).0
    }

    fn leader(&self) -> &Runner<'a> {
        &self.runners[self.leading()]
    }

    /// Plays until a good one leads, none can come to lead, or no play is left.
    fn run(&mut self) -> Result<(), StrategyError> {
        while self.left >= AT_ONCE {
            let leading = self.leading();
            let leader = &self.runners[leading];
            let next = if !leader.is_over() {
                leading
            } else if leader.rank() >= GOOD {
                break;
            } else {
                let rank = leader.rank();
                let rest = self.runners.iter().enumerate().filter(|(_, one)| !one.is_over() && one.utmost() > rank);
                match rest.max_by(|(_, a), (_, b)| a.rank().total_cmp(&b.rank())) {
                    Some((next, _)) => next,
                    None => break,
                }
            };
            self.play(next)?;
        }
        Ok(())
    }

    /// Plays one under the next draws. If the arm finds no way, it keeps its odds.
    fn play(&mut self, number: usize) -> Result<(), StrategyError> {
        let runner = &mut self.runners[number];
        if runner.going.is_none() {
            runner.going = going(self.executive, &runner.one)?;
        }
        let Some(going) = &runner.going else {
            runner.draws = 2 * PAIRS;
            return Ok(());
        };
        let draws = runner.draws..runner.draws + AT_ONCE as usize;
        runner.draws = draws.end;
        runner.foreseen.count(&self.twin.play(going, draws)?);
        self.left -= AT_ONCE;
        let odds = runner.foreseen.with(&runner.odds);
        let assessment = runner.one.assessment;
        runner.one.assessment =
            Assessment { held: odds.held, risk: odds.contact, utility: utility(&odds), ..assessment };
        runner.one.foreseen = (runner.foreseen.played > 0).then_some(runner.foreseen);
        Ok(())
    }
}

/// The executive on its way to try `one`; none if the arm does not get there.
fn going(executive: &Executive, one: &Considered) -> Result<Option<Executive>, StrategyError> {
    let (seen, grasp) = (executive.second().1, &one.aiming.candidate.grasp);
    let beside = Percept { position: seen.position + one.aiming.aimed.aim, ..seen };
    let Some(path) = executive.rehearsed_approach(&one.passage.stops, grasp, &beside) else { return Ok(None) };
    let mut going = executive.clone();
    going.take_second(grasp.clone(), beside, path)?;
    Ok(Some(going))
}
