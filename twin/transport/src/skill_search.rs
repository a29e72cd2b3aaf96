//! Rollouts in physics of a sequence of picks: each pick is searched while the digits of the earlier picks go on
//! holding.
//!
//! A proposal closes its digits on the ball. Digits that touch nothing open again; the others must lift everything and
//! hold it over the goal. Proposals that hold are tried again under the errors that a planner expects, and the next
//! pick of the sequence starts from the best of them.

use std::sync::Arc;

use anyhow::{Context, Result, bail};
use control::detection::DetectedObject;
use control::executor::{GraspTarget, Skill};
use control::policy::pick_sequence::plan::PickSkill;
use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets::propose_ball_grasp;
use dexterous_grasping::sampler::vary;
use grasp_verification::rollout::{RolloutSnapshot, digit_bits, misaimed, verification_errors};
use hand_model::Digit;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use scenarios::noise::TrialNoise;
use sim::robot::GroundTruth;
use sim::tactile::TactileBoard;

use super::site::{build_scene, is_in_hand, run_until_decision};
use super::trial::TransportSite;

/// Number of draws of the expected noise under which a pick is verified, after one try without noise.
const ERROR_DRAWS: usize = 5;
/// Number of holds from which the next pick of a sequence is searched.
const MAX_BASES: usize = 4;
/// Number of skills kept for each pick.
const SKILLS_KEPT: usize = 6;
/// Least score (share of tries that hold) of a skill that mostly holds.
const LIKELY_HOLD_SCORE: f64 = 0.6;
/// Slip tolerance, m: a ball that moves farther than this in the hand on its way to the goal is not held.
const SLIP_TOLERANCE: f64 = 0.012;

/// One pick of a sequence: the ball, and the digits that close on it.
#[derive(Debug, Clone, PartialEq)]
pub struct PickRequest {
    /// Index of the ball.
    pub ball: usize,
    /// Digits that close.
    pub digits: Vec<Digit>,
}

/// Result of the search for one pick.
#[derive(Debug, Clone)]
pub struct SequencePickResult {
    /// The pick that was searched.
    pub request: PickRequest,
    /// Number of proposals within the arm's reach that were closed in physics.
    pub tried: usize,
    /// Number of these that touched the ball when the lift began.
    pub touched: usize,
    /// Number of these that lifted the ball together with everything held before.
    pub lifted: usize,
    /// Number of these that still held everything over the goal.
    pub held: usize,
    /// The best skills, most robust first.
    pub skills: Vec<PickSkill>,
}

/// A hold: the state from which the next pick begins.
#[derive(Clone)]
struct PickBase {
    branch: RolloutSnapshot,
    held_balls: Vec<usize>,
    holding_digits: Vec<Digit>,
}

/// A skill that holds, and the hold that it leads to.
type SkillWithHold = (PickSkill, PickBase);

/// Stage that a try reached.
enum AttemptStage {
    OutOfReach,
    NotTouched,
    Touched,
    Lifted,
    Held(Box<(RolloutSnapshot, Vec<Digit>, GroundTruth)>),
}

impl std::str::FromStr for PickRequestText {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let expected = "BALL=DIGIT+DIGIT, such as ball_1=ring+little";
        let Some((ball, digits)) = text.split_once('=') else { bail!("found {text:?}, expected {expected}") };
        let digit = |name: &str| {
            let named = Digit::ALL.into_iter().find(|digit| digit.name() == name);
            named.with_context(|| format!("found digit {name:?}, expected thumb, index, middle, ring or little"))
        };
        Ok(Self { ball: ball.to_owned(), digits: digits.split('+').map(digit).collect::<Result<_>>()? })
    }
}

/// A pick as text of the command line: BALL=DIGIT+DIGIT.
#[derive(Debug, Clone)]
pub struct PickRequestText {
    ball: String,
    digits: Vec<Digit>,
}

impl PickRequestText {
    /// Resolves the ball's name to its index in `site`.
    pub fn in_site(&self, site: &TransportSite) -> Result<PickRequest> {
        let balls = &site.transport.ball;
        let ball = balls.iter().position(|ball| ball.name == self.ball).with_context(|| {
            let names: Vec<&str> = balls.iter().map(|ball| ball.name.as_str()).collect();
            format!("--pick: found ball {:?}, expected one of {}", self.ball, names.join(", "))
        })?;
        Ok(PickRequest { ball, digits: self.digits.clone() })
    }
}

/// Searches the picks of a sequence one after the other with `n` proposals each. Ends early at the first pick for which
/// nothing holds.
pub fn search_skills(
    site: &TransportSite,
    sequence: &[PickRequest],
    n: u32,
    quiet: bool,
) -> Result<Vec<SequencePickResult>> {
    let balls: Vec<_> = site.transport.ball.iter().map(|ball| (Arc::new(ball.model()), ball.pose())).collect();
    let empty = build_scene(&site.world, site.protocol(), &balls, &TrialNoise::none(), TactileBoard::blank())?;
    let mut bases = vec![PickBase { branch: empty, held_balls: Vec::new(), holding_digits: Vec::new() }];
    let mut all = Vec::new();
    for (k, wanted) in sequence.iter().enumerate() {
        let random = |id: u32| ChaCha8Rng::seed_from_u64(site.seed ^ (k as u64) << 40 ^ u64::from(id) << 8);
        let radius = 0.5 * site.transport.ball[wanted.ball].diameter;
        let propose = |id: u32| {
            propose_ball_grasp(&site.world.cell.robot.hand, &wanted.digits, "ball", radius, id, &mut random(id))
        };
        let mut searched = SequencePickResult {
            request: wanted.clone(),
            tried: 0,
            touched: 0,
            lifted: 0,
            held: 0,
            skills: Vec::new(),
        };
        let mut found = search_pick(site, &bases, wanted, (0..n).map(propose).collect(), &mut searched)?;
        // Then half as many variations of the proposals that held.
        let parents: Vec<Grasp> = found.iter().take(8).map(|(skill, _)| skill.grasp.clone()).collect();
        if !parents.is_empty() {
            let vary = |id: u32| vary(&parents[id as usize % parents.len()], id, &mut random(id));
            found.extend(search_pick(site, &bases, wanted, (n..n + n / 2).map(vary).collect(), &mut searched)?);
        }
        // Among skills that mostly hold, those that leave more digits free are better for the next pick.
        let rank = |skill: &PickSkill| (skill.grasp.score < LIKELY_HOLD_SCORE, skill.keeps.len());
        found.sort_by(|(a, _), (b, _)| {
            rank(a).cmp(&rank(b)).then(b.grasp.score.total_cmp(&a.grasp.score)).then(a.grasp.id.cmp(&b.grasp.id))
        });
        searched.skills = found.iter().take(SKILLS_KEPT).map(|(skill, _)| skill.clone()).collect();
        all.push(searched);
        if !quiet {
            let best = all
                .last()
                .and_then(|searched: &SequencePickResult| searched.skills.first())
                .map_or(0.0, |skill| skill.grasp.score);
            eprintln!("{}: {} holds found, best {best:.2}", site.transport.ball[wanted.ball].name, found.len());
        }
        bases = found.into_iter().take(MAX_BASES).map(|(_, base)| base).collect();
        if bases.is_empty() {
            break;
        }
    }
    Ok(all)
}

/// Tries `grasps` on all `bases` in turn. Returns the skills that hold, verified under errors, each with its hold.
fn search_pick(
    site: &TransportSite,
    bases: &[PickBase],
    wanted: &PickRequest,
    grasps: Vec<Grasp>,
    searched: &mut SequencePickResult,
) -> Result<Vec<SkillWithHold>> {
    let errors = verification_errors(ERROR_DRAWS);
    let one = |grasp: Grasp| -> Result<(AttemptStage, Option<SkillWithHold>)> {
        let base = &bases[grasp.id as usize % bases.len()];
        if wanted.digits.iter().any(|digit| base.holding_digits.contains(digit))
            || base.held_balls.contains(&wanted.ball)
        {
            return Ok((AttemptStage::OutOfReach, None));
        }
        let came = attempt(site, base, wanted.ball, &grasp, None)?;
        let AttemptStage::Held(held) = &came else { return Ok((came, None)) };
        let (branch, keeps, truth) = &**held;
        let mut good = 1;
        for noise in &errors {
            let tried = attempt(site, base, wanted.ball, &misaimed(&grasp, noise, 0), Some(keeps))?;
            good += usize::from(matches!(tried, AttemptStage::Held(_)));
        }
        let grasp = Grasp {
            object: format!("ball_{:.1}_mm", 1e3 * site.transport.ball[wanted.ball].diameter),
            score: good as f64 / (1 + ERROR_DRAWS) as f64,
            held: Some(truth.palm.inverse() * truth.objects[wanted.ball]),
            held_joints: Some(truth.hand.clone()),
            ..grasp
        };
        let verified = PickSkill {
            diameter: site.transport.ball[wanted.ball].diameter,
            beside: base.holding_digits.clone(),
            keeps: keeps.clone(),
            grasp,
        };
        let base = PickBase {
            branch: branch.clone(),
            held_balls: [&base.held_balls[..], &[wanted.ball]].concat(),
            holding_digits: [&base.holding_digits[..], keeps].concat(),
        };
        Ok((came, Some((verified, base))))
    };
    let tried: Vec<Result<_>> = grasps.into_par_iter().map(one).collect();
    let mut found = Vec::new();
    for tried in tried {
        let (came, verified) = tried?;
        let far = match came {
            AttemptStage::OutOfReach => continue,
            AttemptStage::NotTouched => 0,
            AttemptStage::Touched => 1,
            AttemptStage::Lifted => 2,
            AttemptStage::Held(_) => 3,
        };
        searched.tried += 1;
        searched.touched += usize::from(far > 0);
        searched.lifted += usize::from(far > 1);
        searched.held += usize::from(far > 2);
        found.extend(verified);
    }
    Ok(found)
}

/// Picks `ball` from `base` and carries everything over the goal. With `keeps`, these digits go on holding whether they
/// touch the ball or not.
fn attempt(
    site: &TransportSite,
    base: &PickBase,
    ball: usize,
    grasp: &Grasp,
    keeps: Option<&Vec<Digit>>,
) -> Result<AttemptStage> {
    let place = base.branch.robot.truth().objects[ball];
    let percept = DetectedObject::from_ball_pose(&place);
    let target = grasp.palm_pose(&percept.position, 0.0);
    if site.world.posture(&target, &site.world.cell.ready_posture).is_err() {
        return Ok(AttemptStage::OutOfReach);
    }
    let mut branch = base.branch.clone();
    branch.executor.take(base.held_balls.len(), GraspTarget { grasp: grasp.clone(), detected: percept })?;
    let reached = run_until_decision(&mut branch, |robot, executor| {
        let lifts = executor.phase().skill == Skill::Lift && executor.motion().progress() < 0.1;
        Ok(!lifts || robot.truth().touched_by[ball] > 0)
    })?;
    if !reached {
        return Ok(AttemptStage::NotTouched);
    }
    let truth = branch.robot.truth();
    let had: Vec<usize> = base.held_balls.iter().copied().chain([ball]).collect();
    if !had.iter().all(|one| is_in_hand(&truth, *one)) {
        return Ok(AttemptStage::Touched);
    }
    let touching = |digit: &Digit| truth.touched_by[ball] & digit_bits(&site.world.cell.robot.hand, &[*digit]) != 0;
    let keeps: Vec<Digit> = match keeps {
        Some(keeps) => keeps.clone(),
        None => grasp.digits.iter().copied().filter(touching).collect(),
    };
    if keeps.is_empty() {
        return Ok(AttemptStage::Lifted);
    }
    branch.executor.keep_only(&[&base.holding_digits[..], &keeps].concat());
    let hold = branch.clone();
    branch.executor.deliver([site.transport.goal.x, site.transport.goal.y])?;
    run_until_decision(&mut branch, |_, executor| Ok(executor.phase().skill != Skill::PutDown))?;
    let last = branch.robot.truth();
    let inside = |truth: &GroundTruth, one: usize| (truth.palm.inverse() * truth.objects[one]).translation.vector;
    let stays =
        |one: &usize| is_in_hand(&last, *one) && (inside(&last, *one) - inside(&truth, *one)).norm() < SLIP_TOLERANCE;
    Ok(if had.iter().all(stays) { AttemptStage::Held(Box::new((hold, keeps, truth))) } else { AttemptStage::Lifted })
}
