//! Phases of a task: the running skill, its object and its stage. The executor reports them; the referee, recordings
//! and fault detection rely on them.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// Skill: a motion with a beginning and an end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Skill {
    /// At rest before anything has moved.
    Begin,
    /// Touches an object with free digits where it stands (palpation).
    Palpate,
    /// Moves the palm to an object.
    Approach,
    /// Closes the digits on it.
    Grasp,
    /// Raises the object.
    Lift,
    /// Stays still after a lift, for tactile images of the held objects.
    Snapshot,
    /// Carries everything that is held to another place.
    Carry,
    /// Holds everything still.
    Hold,
    /// Stays still after the hold, for further tactile images.
    Verify,
    /// Puts everything down and opens the hand.
    PutDown,
    /// Moves the hand out of the detector's view.
    StepAside,
}

/// Stage of a skill.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SkillStage {
    /// Motion to the start of a palpation.
    Reach,
    /// Slow motion until a pad feels the object.
    Touch,
    /// Standstill for tactile images of the touch.
    Feel,
    /// Under way: the only stage of skills that are not subdivided.
    Run,
    /// Finished: the executor waits for a decision.
    Decide,
}

/// State of the executor at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Phase {
    /// Skill under way, or the last one.
    pub skill: Skill,
    /// Index of the object in picking order; 0 for skills that concern everything held.
    pub object: usize,
    /// Stage of the skill.
    pub stage: SkillStage,
}

impl Phase {
    /// Returns the phase in which `skill` on `object` is under way.
    pub const fn run(skill: Skill, object: usize) -> Self {
        Self { skill, object, stage: SkillStage::Run }
    }

    /// Returns the phase after `skill` on `object`, which waits for a decision.
    pub const fn decide(skill: Skill, object: usize) -> Self {
        Self { skill, object, stage: SkillStage::Decide }
    }

    /// Returns a stage of the palpation of `object`.
    pub const fn palpate(object: usize, stage: SkillStage) -> Self {
        Self { skill: Skill::Palpate, object, stage }
    }

    /// True while the executor waits for a decision.
    pub fn waits_for_decision(self) -> bool {
        self.stage == SkillStage::Decide
    }

    /// True once the task is over.
    pub fn is_done(self) -> bool {
        self == Self::decide(Skill::Verify, 0)
    }

    /// True from the moment the hand moves to `object` until the held objects are put down.
    pub fn has_begun(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach | Skill::Grasp | Skill::Lift | Skill::Snapshot => self.object >= object,
            Skill::Carry | Skill::Hold | Skill::Verify => true,
            Skill::Begin | Skill::PutDown | Skill::StepAside => false,
        }
    }

    /// True from the grasp of `object` until the held objects are put down.
    pub fn has_begun_grasp(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach => self.object > object,
            _ => self.has_begun_lift(object) || self == Self::run(Skill::Grasp, object),
        }
    }

    /// True from the lift of `object` until the held objects are put down. The decision after putting down or stepping
    /// aside counts as one about the first object.
    pub fn has_begun_lift(self, object: usize) -> bool {
        match self.skill {
            Skill::Palpate | Skill::Approach | Skill::Grasp => self.object > object,
            Skill::Lift | Skill::Snapshot => self.object >= object,
            Skill::Carry | Skill::Hold | Skill::Verify => true,
            Skill::Begin => false,
            Skill::PutDown | Skill::StepAside => self.waits_for_decision() && object == 0,
        }
    }

    /// True from the end of the lift of `object` until the held objects are put down.
    pub fn has_lifted(self, object: usize) -> bool {
        self.has_begun_lift(object) && self != Self::run(Skill::Lift, object)
    }

    /// True from the start of the carry to the end of the task.
    pub fn has_begun_carry(self) -> bool {
        matches!(self.skill, Skill::Carry | Skill::Hold | Skill::Verify)
    }

    /// Name for people and files.
    pub fn name(self) -> Cow<'static, str> {
        let of = |verb: &str| Cow::Owned(format!("{verb} {}", ordinal(self.object)));
        match (self.skill, self.stage) {
            (Skill::Palpate, SkillStage::Reach) => of("reach"),
            (Skill::Palpate, SkillStage::Touch) => of("touch"),
            (Skill::Palpate, SkillStage::Feel) => of("feel"),
            (Skill::Palpate, _) => of("locate"),
            (Skill::Approach, _) => of("approach"),
            (Skill::Grasp, _) => of("grasp"),
            (Skill::Lift, _) => of("lift"),
            (Skill::Begin, _) => "begin".into(),
            (Skill::Snapshot, SkillStage::Decide) => match self.object {
                0 => "decide".into(),
                1 => "confirm".into(),
                _ => of("confirm"),
            },
            (Skill::Snapshot, _) => match self.object {
                0 => "look".into(),
                1 => "check".into(),
                _ => of("check"),
            },
            (Skill::Verify, SkillStage::Decide) => "done".into(),
            (_, SkillStage::Decide) => "decide".into(),
            (Skill::Carry, _) => "carry".into(),
            (Skill::Hold, _) => "hold".into(),
            (Skill::Verify, _) => "verify".into(),
            (Skill::PutDown, _) => "put down".into(),
            (Skill::StepAside, _) => "step aside".into(),
        }
    }

    /// Returns all phases of a trial with `objects` objects, in the order of a trial that explores and succeeds.
    pub fn trial_phases(objects: usize) -> Vec<Self> {
        let mut all = vec![Self::decide(Skill::Begin, 0)];
        for object in 0..objects {
            let palpation = [SkillStage::Reach, SkillStage::Touch, SkillStage::Feel, SkillStage::Decide];
            all.extend(palpation.map(|stage| Self::palpate(object, stage)));
            all.extend(
                [Skill::Approach, Skill::Grasp, Skill::Lift, Skill::Snapshot].map(|skill| Self::run(skill, object)),
            );
            all.push(Self::decide(Skill::Snapshot, object));
        }
        all.extend([Skill::Carry, Skill::Hold, Skill::Verify].map(|skill| Self::run(skill, 0)));
        all.push(Self::decide(Skill::Verify, 0));
        all
    }

    /// Returns the phase with this name, with or without underscores, of a trial with at most eight objects.
    pub fn from_name(name: &str) -> Option<Self> {
        let words = name.replace('_', " ");
        let aside = [Skill::PutDown, Skill::StepAside].map(|skill| Self::run(skill, 0));
        Self::trial_phases(ORDINALS.len()).into_iter().chain(aside).find(|phase| phase.name() == words)
    }
}

/// Ordinal numbers.
const ORDINALS: [&str; 8] = ["first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"];

/// Returns the ordinal number of a place counted from 0.
pub fn ordinal(object: usize) -> Cow<'static, str> {
    ORDINALS.get(object).map_or_else(|| format!("object {}", object + 1).into(), |name| (*name).into())
}

impl std::fmt::Display for Phase {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(&self.name())
    }
}

/// Serialized as the name with underscores.
impl Serialize for Phase {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name().replace(' ', "_"))
    }
}

impl<'de> Deserialize<'de> for Phase {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = Cow::<str>::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| {
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
        let names: Vec<String> = Phase::trial_phases(2).iter().map(Phase::to_string).collect();
        let first = "reach first, touch first, feel first, locate first, approach first, grasp first, lift first, look";
        let second = first.replace("first", "second").replace("look", "check");
        assert_eq!(names.join(", "), format!("begin, {first}, decide, {second}, confirm, carry, hold, verify, done"));
    }

    /// All phases of trials with any number of objects have distinct names, which can be parsed back.
    #[test]
    fn names_are_read_back() {
        let aside = [Phase::run(Skill::PutDown, 0), Phase::run(Skill::StepAside, 0)];
        for phase in Phase::trial_phases(8).into_iter().chain(aside) {
            let text = serde_json::to_string(&phase).expect("text");
            assert!(!text.contains(' '), "{text}");
            assert_eq!(serde_json::from_str::<Phase>(&text).expect("a phase"), phase, "{text}");
        }
        let error = serde_json::from_str::<Phase>("\"grasp_tenth\"").expect_err("no such phase").to_string();
        assert!(error.contains("grasp_tenth") && error.contains("approach_first"), "{error}");
    }

    /// In a trial of three objects, each object is approached, closed on and lifted in turn, and stays lifted.
    #[test]
    fn objects_are_lifted_one_after_the_other() {
        let phases = Phase::trial_phases(3);
        let since = |begun: &dyn Fn(&Phase) -> bool| {
            let at = phases.iter().position(begun).expect("it begins");
            assert!(phases[at..].iter().all(begun), "{}", phases[at]);
            phases[at]
        };
        for object in 0..3 {
            assert_eq!(since(&|phase| phase.has_begun(object)), Phase::palpate(object, SkillStage::Reach));
            assert_eq!(since(&|phase| phase.has_begun_grasp(object)), Phase::run(Skill::Grasp, object));
            assert_eq!(since(&|phase| phase.has_begun_lift(object)), Phase::run(Skill::Lift, object));
            assert_eq!(since(&|phase| phase.has_lifted(object)), Phase::run(Skill::Snapshot, object));
        }
        assert_eq!(since(&|phase| phase.has_begun_carry()), Phase::run(Skill::Carry, 0));
        assert!(phases.last().is_some_and(|phase| phase.is_done()));
    }
}
