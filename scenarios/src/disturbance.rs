//! Disturbances: what happens to a trial beside its noise, as a scenario file's `[disturbance]` tables say.
//!
//! Every kind is optional, and several can be asked for at once. They happen under the conditions `blind` and `touch`, in the
//! same way in both; `ideal` shows what the plan is worth when nothing goes wrong. What is random in a trial stays its noise:
//! a disturbance is the same in every trial.

use hand_model::{Digit, Hand};
use nalgebra::Vector3;
use plant::Blindness;
use serde::{Deserialize, Serialize};

use world::layout::MOST_OBJECTS;
use world::phase::{Phase, Skill};

/// One of the two objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// The one picked up first.
    First,
    /// The other.
    Second,
}

impl Which {
    /// 0 or 1.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// What a push acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// The first object, at its centre of mass.
    First,
    /// The second object, at its centre of mass.
    Second,
    /// The palm.
    Hand,
}

impl Target {
    /// Index of the object; `None` is the hand.
    pub fn object(self) -> Option<usize> {
        match self {
            Self::First => Some(0),
            Self::Second => Some(1),
            Self::Hand => None,
        }
    }
}

/// When something happens: once a trial, the first time that this part of a phase is over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    pub phase: Phase,
    /// Part of it that is over, 0 to 1.
    pub at: f64,
    /// How long it lasts, s.
    pub duration: f64,
}

/// A force for a while: somebody's hand in between.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Push {
    pub on: Target,
    /// N, world axes.
    pub force: [f64; 3],
    /// See [`Moment`].
    pub phase: Phase,
    /// See [`Moment`].
    pub at: f64,
    /// See [`Moment`].
    pub duration: f64,
}

impl Push {
    /// When.
    pub fn moment(&self) -> Moment {
        Moment { phase: self.phase, at: self.at, duration: self.duration }
    }
}

/// A held object that is tugged, or becomes slippery, for a while.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slip {
    pub object: Which,
    /// What its friction is multiplied by.
    pub friction: f64,
    /// The tug, N, world axes.
    pub force: [f64; 3],
    /// See [`Moment`].
    pub phase: Phase,
    /// See [`Moment`].
    pub at: f64,
    /// See [`Moment`].
    pub duration: f64,
    /// Whether the policy `touch` may raise tensions when it feels a slip.
    pub reaction: bool,
}

impl Slip {
    /// When.
    pub fn moment(&self) -> Moment {
        Moment { phase: self.phase, at: self.at, duration: self.duration }
    }
}

/// Prior perception that errs: by `offset` in every look at the object until the hand has touched it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrongPosition {
    pub object: Which,
    /// Perceived minus true position, m, world axes.
    pub offset: [f64; 3],
}

/// An object of another size than the control stack believes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrongSize {
    pub object: Which,
    /// True size over the believed one.
    pub factor: f64,
}

/// Balls of other sizes, one after the other. Their size is known; their grasps are those of the ball they replace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeSweep {
    /// Which object; all its names in the scenario must be balls.
    pub object: Which,
    /// m.
    pub diameters: Vec<f64>,
}

impl SizeSweep {
    /// Diameter of the ball in trial `trial`, m: over and over from the beginning.
    pub fn diameter(&self, trial: usize) -> f64 {
        self.diameters[trial % self.diameters.len()]
    }
}

/// Digits without power, and a control stack that knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisabledDigits {
    /// Which.
    pub digits: Vec<Digit>,
}

/// Pads whose cameras have failed from the beginning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlindPads {
    /// Their names, such as `ring_distal`.
    pub pads: Vec<String>,
    /// What comes instead of images.
    pub frames: Blindness,
}

/// All that happens beside noise.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbances {
    /// See [`Push`].
    pub push: Option<Push>,
    /// See [`Slip`].
    pub slip: Option<Slip>,
    /// See [`WrongPosition`].
    pub wrong_position: Option<WrongPosition>,
    /// See [`WrongSize`].
    pub wrong_size: Option<WrongSize>,
    /// See [`SizeSweep`].
    pub size_sweep: Option<SizeSweep>,
    /// See [`DisabledDigits`].
    pub disabled_digits: Option<DisabledDigits>,
    /// See [`BlindPads`].
    pub blind_pads: Option<BlindPads>,
}

/// A value that no trial can be run with: field, what was found, what was expected.
pub type Fault = (String, String, String);

impl Disturbances {
    /// Whether nothing happens.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Digits without power.
    pub fn disabled(&self) -> &[Digit] {
        self.disabled_digits.as_ref().map_or(&[], |disabled| &disabled.digits)
    }

    /// The fields that name an object, with its index.
    pub(crate) fn objects(&self) -> Vec<(&'static str, usize)> {
        let all = [
            ("push.on", self.push.as_ref().and_then(|push| push.on.object())),
            ("slip.object", self.slip.as_ref().map(|slip| slip.object.index())),
            ("wrong_position.object", self.wrong_position.as_ref().map(|wrong| wrong.object.index())),
            ("wrong_size.object", self.wrong_size.as_ref().map(|wrong| wrong.object.index())),
            ("size_sweep.object", self.size_sweep.as_ref().map(|sweep| sweep.object.index())),
        ];
        all.into_iter().filter_map(|(field, index)| Some((field, index?))).collect()
    }

    /// True size over the model's size of each object.
    pub fn sizes(&self) -> [f64; MOST_OBJECTS] {
        let mut sizes = [1.0; MOST_OBJECTS];
        if let Some(wrong) = self.wrong_size {
            sizes[wrong.object.index()] = wrong.factor;
        }
        sizes
    }

    /// What no trial can be run with.
    pub(crate) fn check(&self) -> Result<(), Fault> {
        if let Some(push) = &self.push {
            check_moment("push", &push.moment())?;
            check_vector("disturbance.push.force", &push.force, 100.0, "N")?;
            if push.force == [0.0; 3] {
                return fault("disturbance.push.force", &push.force, "a force that is not zero");
            }
        }
        if let Some(slip) = &self.slip {
            check_moment("slip", &slip.moment())?;
            check_vector("disturbance.slip.force", &slip.force, 100.0, "N")?;
            check_range("disturbance.slip.friction", slip.friction, [0.0, 1.0])?;
            if slip.force == [0.0; 3] && slip.friction >= 1.0 {
                return fault("disturbance.slip", &slip, "a friction below 1 or a force that is not zero");
            }
        }
        if let Some(wrong) = &self.wrong_position {
            check_vector("disturbance.wrong_position.offset", &wrong.offset, 0.2, "m")?;
        }
        if let Some(wrong) = &self.wrong_size {
            check_range("disturbance.wrong_size.factor", wrong.factor, [0.5, 2.0])?;
        }
        if let Some(sweep) = &self.size_sweep {
            if sweep.diameters.is_empty() {
                return fault("disturbance.size_sweep.diameters", &sweep.diameters, "at least one");
            }
            for diameter in &sweep.diameters {
                check_range("disturbance.size_sweep.diameters", *diameter, [0.02, 0.12])?;
            }
        }
        if let Some(DisabledDigits { digits }) = &self.disabled_digits
            && (digits.is_empty() || (1..digits.len()).any(|n| digits[..n].contains(&digits[n])))
        {
            return fault("disturbance.disabled_digits.digits", digits, "one digit or more, each once");
        }
        if let Some(BlindPads { pads, .. }) = &self.blind_pads
            && pads.is_empty()
        {
            return fault("disturbance.blind_pads.pads", pads, "at least one");
        }
        Ok(())
    }

    /// Whether `hand` has the pads that are named.
    ///
    /// # Errors
    /// The field, what it says, and what would be right.
    pub fn check_pads(&self, hand: &Hand) -> Result<(), Fault> {
        if let Some(BlindPads { pads, .. }) = &self.blind_pads {
            let names: Vec<&str> = hand.pads.iter().map(|pad| pad.name.as_str()).collect();
            if let Some(unknown) = pads.iter().find(|pad| !names.contains(&pad.as_str())) {
                return fault("disturbance.blind_pads.pads", unknown, &format!("one of {}", names.join(", ")));
            }
        }
        Ok(())
    }
}

fn fault(field: &str, found: &impl std::fmt::Debug, expected: &str) -> Result<(), Fault> {
    Err((field.into(), format!("{found:?}"), expected.into()))
}

fn check_range(field: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), Fault> {
    if (low..=high).contains(&value) { Ok(()) } else { fault(field, &value, &format!("{low} to {high}")) }
}

fn check_vector(field: &str, value: &[f64; 3], most: f64, unit: &str) -> Result<(), Fault> {
    // A value that is not a number has no norm below the limit.
    if Vector3::from(*value).norm() <= most {
        return Ok(());
    }
    fault(field, value, &format!("three numbers, together at most {most} {unit}"))
}

fn check_moment(kind: &str, moment: &Moment) -> Result<(), Fault> {
    check_range(&format!("disturbance.{kind}.at"), moment.at, [0.0, 1.0])?;
    check_range(&format!("disturbance.{kind}.duration"), moment.duration, [0.01, 30.0])?;
    // These last as long as a decision does: they have no parts.
    let phase = moment.phase;
    if phase.waits() && !matches!(phase.skill, Skill::Begin | Skill::Palpate) || phase.object > 1 {
        let expected = "a phase in which the robot acts, in a trial with two objects";
        return fault(&format!("disturbance.{kind}.phase"), &phase.name(), expected);
    }
    Ok(())
}

#[cfg(test)]
mod tests;
