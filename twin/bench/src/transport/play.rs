//! One transport: trips to the goal, as many as it takes, under one policy.

use std::sync::Arc;

use anyhow::Result;
use control::carrier::Stage;
use control::executive::{Percept, Protocol};
use control::load::{LoadPlan, Pick, Ready, Skill, feeling, in_words, listed, plan, why_not};
use hand_model::Digit;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use scenarios::noise::{TrialNoise, trial_rng};
use scenarios::transport::{PushStage, Transport};
use serde::{Deserialize, Serialize};
use sim::robot::Truth;
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

use super::site::{Branch, in_hand, seen};
use crate::trial::adapt::TURNS;
use proving::world::World;

/// How the load is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Policy {
    /// One object a trip, with touch: what carrying together is compared to.
    OneByOne,
    /// As many as fit, all as planned, unfelt.
    Blind,
    /// As many as fit, by what is felt after each pick.
    Touch,
}

impl std::str::FromStr for Policy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::argument).join(", ");
        let policy = Self::ALL.into_iter().find(|policy| policy.argument() == text);
        policy.ok_or_else(|| format!("found `{text}`, expected one of {}", known()))
    }
}

impl Policy {
    /// As the command line writes it.
    pub fn argument(self) -> &'static str {
        match self {
            Self::OneByOne => "one-by-one",
            Self::Blind => "blind",
            Self::Touch => "touch",
        }
    }

    /// All, the baseline first.
    pub const ALL: [Self; 3] = [Self::OneByOne, Self::Blind, Self::Touch];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::OneByOne => "one by one",
            Self::Blind => "blind",
            Self::Touch => "touch",
        }
    }
}

/// What came of a transport.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TransportRecord {
    /// How it was done.
    pub policy: Policy,
    /// Number of the transport.
    pub trial: usize,
    /// Balls that were to be carried.
    pub balls: usize,
    /// Objects truly in the hand at the end of the hold over the goal, for each trip.
    pub carried: Vec<usize>,
    /// Names of all that was carried.
    pub names: Vec<String>,
    /// Their volume, cm3.
    pub volume_cm3: f64,
    /// Picks tried.
    pub picks: usize,
    /// Simulated time up to the last letting go, s.
    pub seconds: f64,
    /// What was decided, felt and done to it, in words.
    pub story: Vec<String>,
}

/// Everything transports of a scenario share.
pub struct Site {
    /// Robot and protocol.
    pub world: World,
    /// What is to be carried.
    pub transport: Transport,
    /// Skills, each with the number of the ball's size that it is for.
    pub skills: Vec<Skill>,
    /// For each ball, the skills that suit it.
    pub suited: Vec<Vec<usize>>,
    /// The hand unit's cameras.
    pub board: TactileBoard,
    /// Perception.
    pub pipeline: TouchPipeline,
    /// Seed of everything.
    pub seed: u64,
}

/// Sees every tick of a transport.
pub trait Witness {
    /// One tick; the note says what has just been decided or done.
    fn see(&mut self, truth: &Truth, branch: &control::carrier::Carrier, note: Option<&str>) -> Result<()>;
}

/// Sees nothing.
pub struct Nobody;

impl Witness for Nobody {
    fn see(&mut self, _: &Truth, _: &control::carrier::Carrier, _: Option<&str>) -> Result<()> {
        Ok(())
    }
}

/// A ball that the controller believes to be in the hand.
struct Had {
    ball: usize,
    digits: Vec<Digit>,
}

/// A transport in progress.
struct Going<'a> {
    site: &'a Site,
    policy: Policy,
    branch: Branch,
    rng: ChaCha8Rng,
    /// Balls that are believed to be on the table still.
    left: Vec<usize>,
    had: Vec<Had>,
    /// What the plan goes on with.
    planned: Vec<Pick>,
    failures: Vec<(usize, usize)>,
    /// Balls truly in the hand at the newest tick of a hold.
    held: Vec<usize>,
    pushed: Option<f64>,
    /// What is told at the next tick.
    note: Option<String>,
    record: TransportRecord,
}

impl Site {
    /// Distances and times.
    pub fn protocol(&self) -> Protocol {
        let times = &self.transport.protocol;
        Protocol { lift: times.lift_height, hold: times.hold_time, ..self.world.protocol() }
    }

    /// Names of the balls.
    fn names(&self) -> Vec<String> {
        self.transport.ball.iter().map(|ball| ball.name.clone()).collect()
    }

    /// One transport. Its errors depend on seed and trial alone, so that every policy meets the same arm.
    pub fn play(&self, trial: usize, policy: Policy, witness: &mut dyn Witness) -> Result<TransportRecord> {
        let mut rng = trial_rng(self.seed, 0, trial);
        let noise = TrialNoise::draw(&self.transport.noise, &mut rng);
        let board = self.board.with_noise(rand::RngExt::random(&mut rng));
        let balls: Vec<_> = self.transport.ball.iter().map(|ball| (Arc::new(ball.model()), ball.pose())).collect();
        let mut going = Going {
            site: self,
            policy,
            branch: Branch::begin(&self.world, self.protocol(), &balls, &noise, board)?,
            rng,
            left: (0..balls.len()).collect(),
            had: Vec::new(),
            planned: Vec::new(),
            failures: Vec::new(),
            held: Vec::new(),
            pushed: None,
            note: None,
            record: TransportRecord {
                policy,
                trial,
                balls: self.transport.ball.len(),
                carried: Vec::new(),
                names: Vec::new(),
                volume_cm3: 0.0,
                picks: 0,
                seconds: 0.0,
                story: Vec::new(),
            },
        };
        let tries = self.transport.protocol.tries * balls.len();
        loop {
            let next = if going.record.picks < tries { going.decide()? } else { None };
            match next {
                Some((pick, percept)) => going.take(pick, &percept, witness)?,
                None if going.had.is_empty() => return Ok(going.record),
                None => going.deliver(witness)?,
            }
        }
    }

    /// The skills for `ball` where it is seen, turned about the vertical into the arm's reach.
    fn reachable(&self, ball: usize, percept: &Percept, failures: &[(usize, usize)]) -> Ready {
        let failed = |skill: usize| failures.iter().filter(|failed| **failed == (ball, skill)).count() as i32;
        let skills = self.suited[ball].iter().filter(|skill| self.turn(**skill, percept).is_some());
        Ready {
            object: ball,
            volume: self.transport.ball[ball].volume(),
            skills: skills.map(|skill| (*skill, failed(*skill))).collect(),
        }
    }

    /// The smallest turn that brings a skill's grasp into the arm's reach, rad.
    fn turn(&self, skill: usize, percept: &Percept) -> Option<f64> {
        let grasp = &self.skills[skill].grasp;
        TURNS.into_iter().find(|turn| {
            let target = grasp.palm_pose(&percept.position, percept.yaw + turn);
            self.world.posture(&target, &self.world.cell.ready).is_ok()
        })
    }
}

impl Going<'_> {
    fn say(&mut self, text: String) {
        self.record.story.push(text.clone());
        self.note = Some(match self.note.take() {
            Some(before) => format!("{before}; {text}"),
            None => text,
        });
    }

    /// Prior perception looks at a ball, with an error of its own.
    fn look(&mut self, ball: usize) -> Percept {
        let noise = TrialNoise::draw(&self.site.transport.noise, &mut self.rng).objects[0];
        seen(&noise.perceived(&self.branch.robot.truth().objects[ball]))
    }

    fn holding(&self) -> Vec<Digit> {
        self.had.iter().flat_map(|had| had.digits.iter().copied()).collect()
    }

    /// What to take next, if anything, and where it is seen.
    fn decide(&mut self) -> Result<Option<(Pick, Percept)>> {
        let most = match self.policy {
            Policy::OneByOne => 1_usize.saturating_sub(self.had.len()),
            Policy::Blind | Policy::Touch => Digit::ALL.len() - self.had.len(),
        };
        if most == 0 || self.left.is_empty() {
            return Ok(None);
        }
        let percepts: Vec<(usize, Percept)> =
            self.left.clone().into_iter().map(|ball| (ball, self.look(ball))).collect();
        let of = |ball: usize| percepts.iter().find(|(other, _)| *other == ball).map(|(_, percept)| *percept);
        if self.policy == Policy::Blind && !self.had.is_empty() {
            // What was planned is carried out.
            let Some(pick) = self.planned.first().copied() else { return Ok(None) };
            self.planned.remove(0);
            return Ok(of(pick.object).map(|percept| (pick, percept)));
        }
        let holding = self.holding();
        let site = self.site;
        let ready: Vec<Ready> =
            percepts.iter().map(|(ball, percept)| site.reachable(*ball, percept, &self.failures)).collect();
        let now = plan(&site.skills, &ready, &holding, most);
        self.tell_plan(&now, &holding);
        self.planned = now.picks.clone();
        if self.planned.is_empty() {
            return Ok(None);
        }
        let pick = self.planned.remove(0);
        Ok(of(pick.object).map(|percept| (pick, percept)))
    }

    fn tell_plan(&mut self, now: &LoadPlan, holding: &[Digit]) {
        let (skills, names) = (&self.site.skills, self.site.names());
        let changed = why_not(&self.planned, now, skills, holding, &names);
        let text = match (changed, now.picks.is_empty()) {
            (Some(why), false) => format!("{why}: {} instead", in_words(now, skills, &names)),
            (Some(why), true) => format!("{why}: nothing else fits"),
            (None, false) if self.had.is_empty() => format!("plan: {}", in_words(now, skills, &names)),
            (None, false) => format!("on with {}", in_words(now, skills, &names)),
            (None, true) => format!("no ball left fits beside what {} holds", listed(holding)),
        };
        self.say(text);
    }

    fn take(&mut self, pick: Pick, percept: &Percept, witness: &mut dyn Witness) -> Result<()> {
        self.record.picks += 1;
        let skill = &self.site.skills[pick.skill];
        let turn = self.site.turn(pick.skill, percept).unwrap_or(0.0);
        let grasp = grasping::Grasp { yaw: skill.grasp.yaw + turn, ..skill.grasp.clone() };
        // A digit that is felt to have nothing may still keep a ball from rolling out: it opens where it is needed, no earlier.
        let holding = self.holding();
        let needed = |digit: &Digit| skill.grasp.digits().contains(digit) && !holding.contains(digit);
        let kept: Vec<Digit> = self.branch.carrier.holding().into_iter().filter(|digit| !needed(digit)).collect();
        self.branch.carrier.keep_only(&kept);
        self.branch.carrier.take(grasp, percept)?;
        self.play_on(witness)?;
        if self.policy == Policy::Blind {
            self.left.retain(|ball| *ball != pick.object);
            self.had.push(Had { ball: pick.object, digits: skill.keeps.clone() });
            return Ok(());
        }
        let carrier = &self.branch.carrier;
        let perceived = self.site.pipeline.perceive_frames(carrier.images(), carrier.sequences_before())?;
        let (hand, servos) = (self.site.pipeline.hand(), carrier.servos());
        let feels = |digits: &[Digit]| feeling(hand, &perceived.touches, servos, digits);
        let new = feels(&skill.grasp.digits());
        let name = &self.site.transport.ball[pick.object].name;
        let mut told = Vec::new();
        if new.is_empty() {
            told.push(format!("nothing felt of {name}: not picked up"));
            self.failures.push((pick.object, pick.skill));
            self.planned.clear();
        } else {
            let as_planned = if new == skill.keeps { "as planned" } else { "not as planned" };
            told.push(format!("{name} is felt by {}, {as_planned} ({})", listed(&new), listed(&skill.keeps)));
            self.left.retain(|ball| *ball != pick.object);
        }
        for had in &mut self.had {
            had.digits = feels(&had.digits);
            if had.digits.is_empty() {
                told.push(format!("{} is no longer felt", self.site.transport.ball[had.ball].name));
                self.left.push(had.ball);
            }
        }
        self.had.retain(|had| !had.digits.is_empty());
        if !new.is_empty() {
            self.had.push(Had { ball: pick.object, digits: new.clone() });
        }
        self.left.sort_unstable();
        if new.is_empty() {
            let kept: Vec<Digit> = self
                .branch
                .carrier
                .holding()
                .into_iter()
                .filter(|digit| !skill.grasp.digits().contains(digit))
                .collect();
            self.branch.carrier.keep_only(&kept);
        }
        for text in told {
            self.say(text);
        }
        Ok(())
    }

    fn deliver(&mut self, witness: &mut dyn Witness) -> Result<()> {
        let goal = self.site.transport.goal;
        self.held.clear();
        self.branch.carrier.deliver([goal.x, goal.y])?;
        self.play_on(witness)?;
        let balls = &self.site.transport.ball;
        let carried: Vec<&scenarios::transport::Ball> = self.held.iter().map(|ball| &balls[*ball]).collect();
        self.record.volume_cm3 += carried.iter().map(|ball| ball.volume() * 1e6).sum::<f64>();
        let names: Vec<String> = carried.iter().map(|ball| ball.name.clone()).collect();
        self.record.carried.push(names.len());
        self.record.seconds = self.branch.robot.time();
        let text = format!(
            "trip {}: {} in the hand over the goal",
            self.record.carried.len(),
            match names.as_slice() {
                [] => "nothing".to_owned(),
                names => names.join(", "),
            }
        );
        self.record.names.extend(names);
        self.say(text);
        self.had.clear();
        self.planned.clear();
        Ok(())
    }

    /// Plays on to the next decision: the push happens, what is in the hand over the goal is noted, the witness looks on.
    fn play_on(&mut self, witness: &mut dyn Witness) -> Result<()> {
        let Self { site, branch, pushed, held, note, record, .. } = self;
        let count = site.transport.ball.len();
        let first = record.picks == 1;
        branch.play(|robot, carrier| {
            if let Some(push) = site.transport.push.as_ref().filter(|_| first) {
                let stage = match push.stage {
                    PushStage::Approach => Stage::Approach,
                    PushStage::Close => Stage::Close,
                    PushStage::Lift => Stage::Lift,
                };
                let due = carrier.stage() == stage && carrier.progress() >= push.at;
                if due && pushed.is_none() {
                    *pushed = Some(robot.time());
                    let text = format!("push of {:.2} N on {}", Vector3::from(push.force).norm(), push.ball);
                    record.story.push(text.clone());
                    *note = Some(text);
                }
                if pushed.is_some_and(|since| robot.time() - since < push.duration) {
                    let ball = site.transport.ball.iter().position(|ball| ball.name == push.ball);
                    robot.pull(ball, Vector3::from(push.force));
                }
            }
            let truth = robot.truth();
            if carrier.stage() == Stage::Hold {
                *held = (0..count).filter(|ball| in_hand(&truth, *ball)).collect();
            }
            witness.see(&truth, carrier, note.take().as_deref())?;
            Ok(true)
        })?;
        Ok(())
    }
}
