//! A policy that delegates to a chooser: the grasp of the second object, its aim, and whether to try again.
//!
//! The [`Chooser`] receives the knowledge of this crate's own policies, measurements and estimates, and answers with
//! one of the candidates. Everything else is as in [`super::touch`]: the look is interpreted, the eyes look again
//! before a choice, paths are rehearsed, and no try begins too late for the trial. The first object is taken as
//! planned. A chooser that fails, or gives an invalid answer, ends its trial with the reason in the record.

use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, ServoState, TactileFrame};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use tactile_perception::InHand;
use world::attempt::Attempt;

use super::{Injected, Knowledge, Policy, PolicyError, Step, Story};
use crate::executor::{Executor, Phase, Target};
use crate::percept::{Eyes, Percept};
use crate::perception::{Expected, Felt, Grip, feel, grip, trusted};
use crate::sensing::Senses;
use crate::worth::Candidate;

/// Time that a trial needs from the start of a try to its end, s. No choice is requested if less time is left.
const TRY_TIME: f64 = 10.0;
/// Largest offset of an aim from the seen pose along an axis, m, and in yaw, rad.
const FARTHEST: (f64, f64) = (0.1, std::f64::consts::PI);

/// Information for a chooser.
pub struct Situation<'a> {
    /// The decision: after a look at the first object, which should be in the hand, or at the second one, which has
    /// been tried and lifted.
    pub phase: Phase,
    /// The robot's clock, s.
    pub time: f64,
    /// Time left until the trial fails, s.
    pub time_left: f64,
    /// Number of tries at the second object so far.
    pub tries: u32,
    pub servos: &'a [ServoState],
    pub arm: &'a ArmState,
    /// Commanded `world_from_palm`.
    pub palm: Isometry3<f64>,
    /// Tactile images of the last look, one per camera that has sent one.
    pub images: &'a [TactileFrame],
    /// Names of the first and the second object.
    pub objects: Vec<&'a str>,
    /// Their latest percepts.
    pub seen: Vec<Percept>,
    /// True if the second object was seen just now; otherwise it is hidden.
    pub sees_second: bool,
    /// The grasp that took the first object.
    pub first: &'a Grasp,
    /// Grasps of the second object, the planned one first.
    pub candidates: &'a [Candidate],
    /// The first object as felt after its lift.
    pub felt: Option<&'a Felt>,
    /// Objects that are felt to be in the hand now.
    pub grip: Grip,
}

/// Offset of an aim from the seen pose of an object.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aim {
    /// Offset along x, m, world.
    pub x: f64,
    /// Offset along y, m, world.
    pub y: f64,
    /// Offset in yaw about the vertical, rad.
    pub yaw: f64,
}

/// Answer of a chooser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// Take the second object, or try again if it has been tried.
    Take {
        /// Index of the candidate.
        candidate: usize,
        aim: Aim,
    },
    /// Carry away the contents of the hand. Before the second object was tried, this leaves it alone.
    Keep,
}

/// Error of a chooser.
pub type ChooserError = Box<dyn std::error::Error + Send + Sync>;

/// Decision maker for the second grasp.
pub trait Chooser {
    /// Chooses in a situation. It may take any time: the robot's clock stands still.
    fn choose(&mut self, situation: &Situation) -> Result<Answer, ChooserError>;
}

/// Asks a [`Chooser`]; see the module documentation. Supports trials of two objects.
pub struct Chosen<'a> {
    knowledge: Knowledge<'a>,
    senses: Senses<'a>,
    chooser: &'a mut dyn Chooser,
    story: Story,
    tries: u32,
    felt: Option<Felt>,
    grip: Grip,
}

impl<'a> Chosen<'a> {
    /// The policy of a trial with the choices of `chooser`.
    pub fn new(knowledge: Knowledge<'a>, senses: Senses<'a>, chooser: &'a mut dyn Chooser) -> Self {
        Self { knowledge, senses, chooser, story: Story::default(), tries: 0, felt: None, grip: Grip::default() }
    }

    /// Asks the chooser and checks its answer. On an invalid answer, the error is the reason in words.
    fn ask(&mut self, executor: &Executor, time: f64, sees_second: bool) -> Result<Answer, String> {
        let look = executor.motion().look();
        let situation = Situation {
            phase: executor.phase(),
            time,
            time_left: self.knowledge.time_limit - time,
            tries: self.tries,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            palm: executor.motion().palm(),
            images: look.images,
            objects: self.knowledge.objects.iter().map(|object| object.name.as_str()).collect(),
            seen: executor.targets().iter().map(|target| target.percept).collect(),
            sees_second,
            first: &executor.target(0).grasp,
            candidates: &self.knowledge.second,
            felt: self.felt.as_ref(),
            grip: self.grip,
        };
        let answer = self.chooser.choose(&situation).map_err(|error| format!("the chooser failed: {error}"))?;
        if let Answer::Take { candidate, aim } = answer {
            let count = self.knowledge.second.len();
            if candidate >= count {
                return Err(format!("the chooser's candidate: found {candidate}, expected less than {count}"));
            }
            let Aim { x, y, yaw } = aim;
            if !(x.abs() <= FARTHEST.0 && y.abs() <= FARTHEST.0 && yaw.abs() <= FARTHEST.1) {
                let (most, turn) = FARTHEST;
                return Err(format!("the chooser's aim: found {aim:?}, expected up to {most} m and {turn:.2} rad"));
            }
        }
        Ok(answer)
    }

    /// Takes the second object with a candidate, aimed at an offset from its seen pose.
    fn take(&mut self, executor: &mut Executor, candidate: usize, aim: Aim) -> Result<Step, PolicyError> {
        let grasp = self.knowledge.second[candidate].grasp.clone();
        let seen = executor.target(1).percept;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), aim.yaw);
        let beside = Percept {
            position: seen.position + Vector3::new(aim.x, aim.y, 0.0),
            rotation: turn * seen.rotation,
            yaw: seen.yaw + aim.yaw,
        };
        let ways: Vec<_> = executor.ways().collect();
        let path = ways.iter().find_map(|stops| executor.rehearsed_approach(stops, &grasp, &beside));
        let Some(path) = path else {
            let at = beside.position;
            self.story.tell(format!("grasp {} is out of reach at ({:.2}, {:.2}) m", grasp.id, at.x, at.y));
            return Ok(Step::GiveUp);
        };
        self.tries += 1;
        self.story.decisions += 1;
        self.story.retries += u32::from(self.tries > 1);
        self.story.switched |= candidate > 0;
        self.story.aimed |= aim != Aim::default();
        let (id, why) = (grasp.id, "as chosen".to_owned());
        executor.take(1, Target { grasp, percept: beside })?;
        executor.redirect(path);
        self.story.attempts.push(Attempt { object: 1, grasp: id, why, ..Attempt::default() });
        self.story.tell(format!("grasp {id} was chosen"));
        Ok(Step::Play)
    }
}

impl Policy for Chosen<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<Injected>) -> Result<(), PolicyError> {
        let [Target { grasp: first, percept }, Target { grasp: second, .. }] =
            [0, 1].map(|object| executor.target(object));
        let expected = Expected::of(first, percept, Some(second));
        if !executor.phase().has_lifted(1) {
            let mut felt = feel(&self.senses, &executor.motion().look(), self.knowledge.known[0], &expected)?;
            if let Some(injected) = injected {
                felt.estimate.palm_from_object = injected.palm_from_object;
                felt.grip = injected.grip;
            }
            self.story.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
            self.grip = felt.grip;
            self.felt = Some(felt);
            return Ok(());
        }
        let held = self.felt.as_ref().map_or(expected.palm_from_object, |felt| felt.estimate.palm_from_object);
        let first = InHand { shape: self.knowledge.known[0], prior: trusted(held) };
        let second = second.held.map(|held| InHand { shape: self.knowledge.known[1], prior: trusted(held) });
        let both: Vec<InHand> = std::iter::once(first).chain(second).collect();
        self.grip = match injected {
            Some(injected) => injected.grip,
            None => grip(&self.senses, &executor.motion().look(), &expected, &both)?,
        };
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError> {
        let phase = executor.phase();
        if phase.is_done() {
            return Ok(Step::Finish);
        }
        let seen = eyes.look(1)?.map(|seen| Percept::of(&self.knowledge.objects[1], &seen.pose));
        if let Some(seen) = seen {
            executor.see(1, seen);
        }
        let late = time + TRY_TIME > self.knowledge.time_limit;
        let answer = if late { Ok(Answer::Keep) } else { self.ask(executor, time, seen.is_some()) };
        match answer {
            Ok(Answer::Take { candidate, aim }) => self.take(executor, candidate, aim),
            Ok(Answer::Keep) if phase.has_lifted(1) => {
                executor.carry_aside()?;
                Ok(Step::Play)
            }
            Ok(Answer::Keep) => {
                self.story.tell("the second object is left alone".to_owned());
                Ok(Step::Decline)
            }
            Err(why) => {
                self.story.tell(why);
                Ok(Step::Failed)
            }
        }
    }

    fn story(&mut self) -> &mut Story {
        &mut self.story
    }

    fn felt(&self) -> &[Felt] {
        self.felt.as_slice()
    }

    fn deliberates(&self) -> bool {
        true
    }
}
