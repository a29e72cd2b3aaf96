//! Phases of a task: which skill runs, on which object, and at which stage. The executor reports them; the referee, recordings and fault
//! detection go by them.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A motion with a beginning and an end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Skill {
    /// At rest before anything has moved.
    Begin,
    /// Touches an object with free digits where it stands.
    Palpate,
    /// The palm goes to an object.
    Approach,
    /// The digits close on it.
    Grasp,
    /// Raises it.
    Lift,
    /// Rests after a lift, for tactile images of what is held.
    Look,
    /// Brings everything that is held somewhere else.
    Carry,
    /// Holds it still.
    Hold,
    /// Rests after the hold, for tactile images once more.
    Verify,
    /// Lays everything down and opens the hand.
    PutDown,
    /// Moves the hand out of the detector's view.
    StepAside,
}

/// Part of a skill.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// On the way to where a palpation begins.
    Reach,
    /// Slowly on until a pad feels the object.
    Touch,
    /// Still, for tactile images of the touch.
    Feel,
    /// Under way: the only stage of the skills without parts.
    Run,
    /// Over: the executor waits for a decision.
    Decide,
}

/// The executor's state at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Phase {
    /// The motion under way, or the last one.
    pub skill: Skill,
    /// Index of the object in the order in which objects are taken; 0 for the skills that are about all that is held.
    pub object: usize,
    /// Its part.
    pub stage: Stage,
}

impl Phase {
    /// `skill` on `object`, under way.
    pub const fn run(skill: Skill, object: usize) -> Self {
        Self { skill, object, stage: Stage::Run }
    }

    /// `skill` on `object`, over.
    pub const fn decide(skill: Skill, object: usize) -> Self {
        Self { skill, object, stage: Stage::Decide }
    }

    /// A stage of the palpation of `object`.
    pub const fn palpate(object: usize, stage: Stage) -> Self {
        Self { skill: Skill::Palpate, object, stage }
    }

    /// True while the executor waits for a decision.
    pub fn waits(self) -> bool {
        self.stage == Stage::Decide
    }

    /// True once the task is over.
    pub fn is_done(self) -> bool {
        self == Self::decide(Skill::Verify, 0)
    }

    /// True from the moment the hand goes to `object` until what it took is laid down.
    pub fn begins(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach | Skill::Grasp | Skill::Lift | Skill::Look => self.object >= object,
            Skill::Carry | Skill::Hold | Skill::Verify => true,
            Skill::Begin | Skill::PutDown | Skill::StepAside => false,
        }
    }

    /// The same from the grasp of `object` on.
    pub fn closes(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach => self.object > object,
            _ => self.lifts(object) || self == Self::run(Skill::Grasp, object),
        }
    }

    /// The same from the lift of `object` on. The decision after a laying down or a step aside counts as one about the first object.
    pub fn lifts(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach | Skill::Grasp => self.object > object,
            Skill::Lift | Skill::Look => self.object >= object,
            Skill::Carry | Skill::Hold | Skill::Verify => true,
            Skill::Begin => false,
            Skill::PutDown | Skill::StepAside => self.waits() && object == 0,
        }
    }

    /// The same from the end of the lift of `object` on.
    pub fn has_lifted(self, object: usize) -> bool {
        self.lifts(object) && self != Self::run(Skill::Lift, object)
    }

    /// True from the moment everything is carried to the end of the task.
    pub fn carries(self) -> bool {
        matches!(self.skill, Skill::Carry | Skill::Hold | Skill::Verify)
    }

    /// In words, as people and files know it.
    pub fn name(self) -> Cow<'static, str> {
        let of = |verb: &str| Cow::Owned(format!("{verb} {}", ordinal(self.object)));
        match (self.skill, self.stage) {
            (Skill::Palpate, Stage::Reach) => of("reach"),
            (Skill::Palpate, Stage::Touch) => of("touch"),
            (Skill::Palpate, Stage::Feel) => of("feel"),
            (Skill::Palpate, _) => of("locate"),
            (Skill::Approach, _) => of("approach"),
            (Skill::Grasp, _) => of("grasp"),
            (Skill::Lift, _) => of("lift"),
            (Skill::Begin, _) => "begin".into(),
            (Skill::Look, Stage::Decide) => match self.object {
                0 => "decide".into(),
                1 => "confirm".into(),
                _ => of("confirm"),
            },
            (Skill::Look, _) => match self.object {
                0 => "look".into(),
                1 => "check".into(),
                _ => of("check"),
            },
            (Skill::Verify, Stage::Decide) => "done".into(),
            (_, Stage::Decide) => "decide".into(),
            (Skill::Carry, _) => "carry".into(),
            (Skill::Hold, _) => "hold".into(),
            (Skill::Verify, _) => "verify".into(),
            (Skill::PutDown, _) => "put down".into(),
            (Skill::StepAside, _) => "step aside".into(),
        }
    }

    /// All phases of a trial with `objects` objects, in the order in which a trial that explores and succeeds comes to them.
    pub fn of_trial(objects: usize) -> Vec<Self> {
        let mut all = vec![Self::decide(Skill::Begin, 0)];
        for object in 0..objects {
            let palpation = [Stage::Reach, Stage::Touch, Stage::Feel, Stage::Decide];
            all.extend(palpation.map(|stage| Self::palpate(object, stage)));
            all.extend([Skill::Approach, Skill::Grasp, Skill::Lift, Skill::Look].map(|skill| Self::run(skill, object)));
            all.push(Self::decide(Skill::Look, object));
        }
        all.extend([Skill::Carry, Skill::Hold, Skill::Verify].map(|skill| Self::run(skill, 0)));
        all.push(Self::decide(Skill::Verify, 0));
        all
    }

    /// The phase with this name, with or without underscores, of a trial with at most eight objects.
    pub fn named(name: &str) -> Option<Self> {
        let words = name.replace('_', " ");
        let aside = [Skill::PutDown, Skill::StepAside].map(|skill| Self::run(skill, 0));
        Self::of_trial(ORDINALS.len()).into_iter().chain(aside).find(|phase| phase.name() == words)
    }
}

/// Names of places in an order.
const ORDINALS: [&str; 8] = ["first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"];

/// Name of a place in an order, from 0.
pub fn ordinal(object: usize) -> Cow<'static, str> {
    ORDINALS.get(object).map_or_else(|| format!("object {}", object + 1).into(), |name| (*name).into())
}

impl std::fmt::Display for Phase {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(&self.name())
    }
}

/// As its name with underscores.
impl Serialize for Phase {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name().replace(' ', "_"))
    }
}

impl<'de> Deserialize<'de> for Phase {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = Cow::<str>::deserialize(deserializer)?;
        Self::named(&name).ok_or_else(|| {
            de::Error::custom(format!("found `{name}`, expected a phase, such as approach_first or carry"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The names in files of two-object trials.
    #[test]
    fn a_trial_of_two_objects_goes_by_these_names() {
        let names: Vec<String> = Phase::of_trial(2).iter().map(Phase::to_string).collect();
        let first = "reach first, touch first, feel first, locate first, approach first, grasp first, lift first, look";
        let second = first.replace("first", "second").replace("look", "check");
        assert_eq!(names.join(", "), format!("begin, {first}, decide, {second}, confirm, carry, hold, verify, done"));
    }

    /// Every name of a trial with any number of objects is another one and says which phase it is.
    #[test]
    fn names_are_read_back() {
        let aside = [Phase::run(Skill::PutDown, 0), Phase::run(Skill::StepAside, 0)];
        for phase in Phase::of_trial(8).into_iter().chain(aside) {
            let text = serde_json::to_string(&phase).expect("text");
            assert!(!text.contains(' '), "{text}");
            assert_eq!(serde_json::from_str::<Phase>(&text).expect("a phase"), phase, "{text}");
        }
        let error = serde_json::from_str::<Phase>("\"grasp_tenth\"").expect_err("no such phase").to_string();
        assert!(error.contains("grasp_tenth") && error.contains("approach_first"), "{error}");
    }

    /// On the way through a trial of three objects each object is gone to, closed on and lifted in turn, and stays lifted.
    #[test]
    fn objects_are_lifted_one_after_the_other() {
        let phases = Phase::of_trial(3);
        let since = |begun: &dyn Fn(&Phase) -> bool| {
            let at = phases.iter().position(begun).expect("it begins");
            assert!(phases[at..].iter().all(begun), "{}", phases[at]);
            phases[at]
        };
        for object in 0..3 {
            assert_eq!(since(&|phase| phase.begins(object)), Phase::palpate(object, Stage::Reach));
            assert_eq!(since(&|phase| phase.closes(object)), Phase::run(Skill::Grasp, object));
            assert_eq!(since(&|phase| phase.lifts(object)), Phase::run(Skill::Lift, object));
            assert_eq!(since(&|phase| phase.has_lifted(object)), Phase::run(Skill::Look, object));
        }
        assert_eq!(since(&|phase| phase.carries()), Phase::run(Skill::Carry, 0));
        assert!(phases.last().is_some_and(|phase| phase.is_done()));
    }
}
