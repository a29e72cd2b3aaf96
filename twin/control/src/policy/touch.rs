//! The policy `touch`: decides on tactile perception, and retries a grasp that has failed according to touch.
//!
//! At each decision the look is interpreted ([`crate::perception`]), [`crate::recovery`] determines the next step, and
//! [`crate::strategy`] chooses the grasp of the second object given the felt pose of the first. A failed grasp is tried
//! again at the object's new percept. If a required object is not visible, the hand steps aside and the eyes look
//! again. An object that comes later is assumed to be where it was last seen, and is looked for when its turn comes. An
//! object is palpated before it is taken (`exploration`), because the pose of the first one in the hand determines how
//! well the second one can be taken. `empty_hand` takes the first object, and `beside` an object beside held ones.
//!
//! Each decision leads from one `State` to another: `Start -> Palpates(0) -> Takes(0) -> Palpates(1) -> Takes(1) ->
//! Carries` if all goes well, and from `Takes(0)` to `Carries` in a trial of one object. A lost object leads back to a
//! palpation or to `LaysDown`, a hidden one to `StepsAside`. A decision that begins nothing ends the trial.

mod beside;
pub(super) mod empty_hand;
mod exploration;

use dexterous_grasping::{Grasp, digit_sets};
use nalgebra::Vector3;
use tactile_perception::{InHand, PoseEstimate};

use super::reach::{Wanted, within_reach};
use super::tracked::Tracked;
use super::{Injected, Knowledge, Policy, PolicyError, Reordered, Step, Story};
use crate::collision::Solid;
use crate::executor::{Executor, Skill, Target};
use crate::odds::{Aimed, Belief};
use crate::percept::{Eyes, Percept};
use crate::perception::{Expected, Felt, Grip, feel, grip, trusted};
use crate::recovery::{Next, probe};
use crate::sensing::Senses;
use crate::strategy::object_solids;
use crate::worth::Candidate;

/// Time that a trial needs from the start of a new try at the first object to its end, s; no try begins later.
const TRY_TIME: f64 = 14.0;
/// Height above the table, as a share of the lift, above which a seen object must be in the hand.
const HANGS: f64 = 0.5;
/// Upper limit on the standard deviation that is assumed for the felt pose, m.
const MOST_SIGMA: f64 = 0.01;

/// Activity of the executor until the next decision.
enum State {
    /// Waiting to begin, or taking the first object as planned.
    Start,
    /// Palpating an object; `found` is its pose in the hand, if it was felt.
    Palpates { object: usize, found: Option<Box<PoseEstimate>> },
    /// Taking an object; `aimed` is the aim, if only the detector located the object.
    Takes { object: usize, aimed: Option<Aimed> },
    /// Carrying the held objects.
    Carries,
    /// Laying everything down. The first object comes next, without a look at the hand.
    LaysDown,
    /// Moving out of the detector's view, in order to look for an object.
    StepsAside { sought: usize },
}

/// State of the policy during a trial.
pub struct Touch<'a> {
    knowledge: Knowledge<'a>,
    senses: Senses<'a>,
    /// Solids of each object, in its own frame.
    solids: Vec<Vec<Solid>>,
    /// Grasps of the first object, the planned one first; their worth includes the second grasps that can follow.
    first: Vec<Candidate>,
    story: Story,
    state: State,
    /// Time of the present decision, by the robot's clock, s.
    time: f64,
    objects: Vec<Tracked>,
    /// Number of consecutive failed grasps.
    in_a_row: usize,
    /// First percepts of the objects.
    seen: Option<Vec<Percept>>,
    /// Offset of the aim from the seen position, m, where no rehearsal suggests a better one. Kept while it works.
    aim: Vector3<f64>,
    /// Belief about the error of the aim at the second object, if only the detector has located it.
    belief: Belief,
    felt: Option<Felt>,
    grip: Grip,
}

impl<'a> Touch<'a> {
    /// The policy of a trial whose first grasp is planned as `first`.
    pub fn new(knowledge: Knowledge<'a>, senses: Senses<'a>, first: &Grasp) -> Self {
        let mut story = Story::default();
        if let Some(Reordered { planned, other }) = knowledge.reordered {
            let name = &knowledge.objects[0].name;
            story.tell(format!("{name} is taken first: that promises {other:.2}, the planned order {planned:.2}"));
        }
        Self {
            solids: knowledge.objects.iter().map(|object| object_solids(object)).collect(),
            first: empty_hand::candidates(&knowledge, &senses, first),
            state: State::Start,
            time: 0.0,
            belief: Belief::new(&knowledge.uncertainty.stated(knowledge.sighted[1])),
            objects: Tracked::all(&knowledge),
            knowledge,
            senses,
            story,
            in_a_row: 0,
            seen: None,
            aim: Vector3::zeros(),
            felt: None,
            grip: Grip::default(),
        }
    }

    /// Expected poses of the objects in the hand: of the first as it was last felt, of the second from its grasp.
    fn in_hand(&self, expected: &Expected, second: Option<&Grasp>) -> Vec<InHand<'_>> {
        let felt = self.felt.as_ref().map(|felt| felt.estimate.palm_from_object);
        let first = trusted(felt.unwrap_or(expected.palm_from_object));
        let first = InHand { shape: self.knowledge.known[0], prior: first };
        let held = second.and_then(|second| second.held);
        let second = held.map(|held| InHand { shape: self.knowledge.known[1], prior: trusted(held) });
        std::iter::once(first).chain(second).collect()
    }

    /// Lowers the worth of a failed grasp for the rest of the trial, and changes the aim of the next one.
    fn mark_down(&mut self, next: Next, executor: &Executor) {
        let (object, failed) = match next {
            Next::GoOn => return,
            Next::StartOver => (0, executor.target(0).grasp.id),
            Next::Again(object) => (object, executor.target(object).grasp.id),
        };
        self.objects[object].failed(failed);
        if next != Next::StartOver {
            self.in_a_row += 1;
            if self.in_a_row > 1 {
                self.aim = probe(self.in_a_row, self.knowledge.uncertainty.arm);
            }
        }
    }

    /// Looks at an object again; `None` if it is hidden.
    fn see(&mut self, index: usize, eyes: &mut dyn Eyes) -> Result<Option<Percept>, PolicyError> {
        match self.seen.as_ref().filter(|_| !self.knowledge.recovery.new_look) {
            Some(seen) => Ok(Some(seen[index])),
            None => self.objects[index].look(&self.knowledge, eyes),
        }
    }

    /// Looks at an object and all later ones, which a try may have moved, and takes it. With `aside`, the hand is out
    /// of the way already.
    fn again(
        &mut self,
        object: usize,
        executor: &mut Executor,
        eyes: &mut dyn Eyes,
        aside: bool,
    ) -> Result<Step, PolicyError> {
        let seen = self.see(object, eyes)?;
        self.again_at(object, seen, executor, eyes, aside)
    }

    /// Like [`Self::again`], for an object that was `seen` just now.
    fn again_at(
        &mut self,
        object: usize,
        seen: Option<Percept>,
        executor: &mut Executor,
        eyes: &mut dyn Eyes,
        aside: bool,
    ) -> Result<Step, PolicyError> {
        self.objects[object].replace(seen, executor);
        for index in object + 1..self.objects.len() {
            let seen = self.see(index, eyes)?;
            self.objects[index].replace(seen, executor);
        }
        if self.objects[object].hidden {
            self.seek(object, executor, aside)
        } else {
            self.touch_or_take(object, executor)
        }
    }

    /// Takes an object at its seen or felt position.
    fn take(&mut self, object: usize, executor: &mut Executor) -> Result<Step, PolicyError> {
        if object == 0 { self.take_with_empty_hand(executor) } else { self.take_beside(object, executor) }
    }

    /// Handles a required object that is hidden: the hand steps aside once; after that, the trial is given up.
    fn seek(&mut self, index: usize, executor: &mut Executor, aside: bool) -> Result<Step, PolicyError> {
        let name = &self.knowledge.objects[index].name;
        if aside {
            self.story.reasons.push(format!("{name} is nowhere to be seen"));
            return Ok(Step::NotSeen);
        }
        self.story.tell(format!("{name} is hidden: the hand steps aside to look again"));
        executor.step_aside(index)?;
        self.state = State::StepsAside { sought: index };
        Ok(Step::Play)
    }

    fn within_reach(&self, index: usize, executor: &Executor, seen: &Percept) -> Vec<Candidate> {
        let candidates = [&self.first, self.following(executor).1][index];
        let (object, tracked) = (&*self.knowledge.objects[index], &self.objects[index]);
        // A grasp may leave out one of the digits that are meant for the object.
        let digits = &digit_sets(executor.motion().hand(), self.objects.len())[index];
        within_reach(&self.knowledge, &Wanted { object, digits, candidates, tracked }, seen)
    }

    /// Decides from the look at the hand after the activity of the state `looked`.
    fn after_look(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, looked: State) -> Result<Step, PolicyError> {
        let tries = !self.is_late() && self.knowledge.recovery.retry;
        let last = self.knowledge.objects.len() - 1;
        let mut next = if tries { Next::after(executor.phase(), self.grip, last) } else { Next::GoOn };
        let mut seen = None;
        if let Some(missing) = next.missing() {
            seen = self.see(missing, eyes)?;
            if seen.is_some_and(|there| self.hangs(missing, &there, executor)) {
                let name = &self.knowledge.objects[missing].name;
                self.story.tell(format!("{name} is not felt, but seen above the table: it is held"));
                next = Next::GoOn;
            }
        }
        match (looked, next) {
            (State::Carries, Next::GoOn) => return Ok(Step::Finish),
            (State::Takes { object: 1, .. }, Next::GoOn) => {
                executor.carry_aside()?;
                self.state = State::Carries;
                return Ok(Step::Play);
            }
            (State::Takes { object, aimed: Some(aimed) }, Next::Again(again)) if object == again => {
                self.belief.failed(&aimed, self.objects[object].looks);
            }
            _ => {}
        }
        match next {
            Next::GoOn => self.in_a_row = 0,
            _ => {
                self.story.retries += 1;
                let taken = if let Next::Again(object) = next { object } else { 0 };
                self.story.tell(next.reason(&executor.target(taken).grasp.digits));
                self.mark_down(next, executor);
            }
        }
        match next {
            Next::GoOn if last == 0 => {
                executor.carry_aside()?;
                self.state = State::Carries;
                Ok(Step::Play)
            }
            Next::Again(object) => self.again_at(object, seen, executor, eyes, false),
            Next::StartOver => self.lay_down(executor),
            Next::GoOn if self.objects[1].hidden => self.again(1, executor, eyes, false),
            Next::GoOn => {
                if self.knowledge.recovery.new_look
                    && let Some(seen) = self.see(1, eyes)?
                {
                    self.objects[1].refine(seen, &self.knowledge, executor);
                }
                self.touch_or_take(1, executor)
            }
        }
    }

    /// True if an object seen at `there` is so far above the table that only the hand can hold it.
    fn hangs(&self, object: usize, there: &Percept, executor: &Executor) -> bool {
        let pose = there.pose();
        let down = pose.inverse_transform_vector(&-Vector3::z());
        let lowest = (pose * self.knowledge.objects[object].shape.support(&down)).z;
        lowest > HANGS * executor.lift()
    }

    fn lay_down(&mut self, executor: &mut Executor) -> Result<Step, PolicyError> {
        executor.put_down()?;
        self.state = State::LaysDown;
        Ok(Step::Play)
    }

    /// True when it is too late to begin another try.
    fn is_late(&self) -> bool {
        self.time + TRY_TIME > self.knowledge.time_limit
    }

    fn give_up(&mut self, index: usize, seen: &Percept) -> Step {
        let object = &self.knowledge.objects[index];
        let tilt = (seen.rotation * object.rest.inverse() * Vector3::z()).angle(&Vector3::z()).to_degrees();
        let at = seen.position;
        self.story.reasons.push(format!(
            "no grasp of {} is in reach at ({:.2}, {:.2}, {:.2}) m, tilted by {tilt:.0} deg",
            object.name, at.x, at.y, at.z
        ));
        Step::GiveUp
    }
}

impl Policy for Touch<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<Injected>) -> Result<(), PolicyError> {
        if matches!(self.state, State::LaysDown | State::StepsAside { .. }) {
            return Ok(());
        }
        self.seen.get_or_insert_with(|| executor.targets().iter().map(|target| target.percept).collect());
        if executor.phase().skill == Skill::Begin {
            return Ok(());
        }
        let Target { grasp: first, percept } = executor.target(0);
        let second = executor.targets().get(1).map(|second| &second.grasp);
        let expected = Expected::of(first, percept, second);
        if let State::Palpates { object, .. } = self.state {
            return self.perceive_touch(object, executor, &expected);
        }
        if matches!(self.state, State::Start | State::Takes { object: 0, .. }) {
            let mut felt = feel(&self.senses, &executor.motion().look(), self.knowledge.known[0], &expected)?;
            if let Some(injected) = injected {
                felt.estimate.palm_from_object = injected.palm_from_object;
                felt.estimate.covariance.fill(0.0);
                felt.grip = injected.grip;
            }
            self.story.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
            self.grip = felt.grip;
            self.felt = Some(felt);
        } else {
            self.grip = match injected {
                Some(injected) => injected.grip,
                None => grip(&self.senses, &executor.motion().look(), &expected, &self.in_hand(&expected, second))?,
            };
        }
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError> {
        self.time = time;
        match std::mem::replace(&mut self.state, State::Start) {
            State::Start if executor.phase().skill == Skill::Begin => self.touch_or_take(0, executor),
            looked @ (State::Start | State::Takes { .. } | State::Carries) => self.after_look(executor, eyes, looked),
            State::Palpates { object, found } => {
                self.locate(object, executor, found);
                self.take(object, executor)
            }
            State::LaysDown => self.again(0, executor, eyes, false),
            State::StepsAside { sought } => self.again(sought, executor, eyes, true),
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
