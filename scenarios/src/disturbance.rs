//! Disturbances: events in a trial beside its noise, from the `[disturbance]` tables of a scenario file.
//!
//! Every kind is optional, and several can be combined. They occur under the conditions `blind` and `touch`,
//! identically in both; `ideal` measures the plan without any of them. Only the noise of a trial is random: a
//! disturbance is the same in every trial.

use hand_model::{Digit, Hand};
use nalgebra::Vector3;
use plant::CameraFailure;
use serde::{Deserialize, Serialize};

use world::layout::MAX_OBJECTS;
use world::phase::{Phase, Skill};

/// One of the first two objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetObject {
    /// The object picked up first.
    First,
    /// The object picked up second.
    Second,
}

impl TargetObject {
    /// Index of the object, 0 or 1.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// Target of a push.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PushTarget {
    /// The first object, at its centre of mass.
    First,
    /// The second object, at its centre of mass.
    Second,
    /// The palm.
    Hand,
}

impl PushTarget {
    /// Index of the object; `None` for the hand.
    pub fn object(self) -> Option<usize> {
        match self {
            Self::First => Some(0),
            Self::Second => Some(1),
            Self::Hand => None,
        }
    }
}

/// Time of an event: once per trial, the first time that this fraction of the phase has passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventTiming {
    pub phase: Phase,
    /// Fraction of the phase that has passed, 0 to 1.
    pub at: f64,
    /// Duration of the event, s.
    pub duration: f64,
}

/// A force for a limited time, such as from a person's hand in the way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushDisturbance {
    pub on: PushTarget,
    /// Force in world axes, N.
    pub force: [f64; 3],
    /// Phase in which it begins; see [`EventTiming`].
    pub phase: Phase,
    /// Fraction of that phase that has passed when it begins, 0 to 1; see [`EventTiming`].
    pub at: f64,
    /// Duration, s; see [`EventTiming`].
    pub duration: f64,
}

impl PushDisturbance {
    /// Time of the push.
    pub fn timing(&self) -> EventTiming {
        EventTiming { phase: self.phase, at: self.at, duration: self.duration }
    }
}

/// Slip of a held object: for a while it is tugged, or its friction drops.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlipDisturbance {
    pub object: TargetObject,
    /// Factor on the object's friction.
    pub friction: f64,
    /// Tug in world axes, N.
    pub force: [f64; 3],
    /// Phase in which it begins; see [`EventTiming`].
    pub phase: Phase,
    /// Fraction of that phase that has passed when it begins, 0 to 1; see [`EventTiming`].
    pub at: f64,
    /// Duration, s; see [`EventTiming`].
    pub duration: f64,
    /// True if the policy `touch` may raise tensions when it detects slip.
    pub reaction: bool,
}

impl SlipDisturbance {
    /// Time of the slip.
    pub fn timing(&self) -> EventTiming {
        EventTiming { phase: self.phase, at: self.at, duration: self.duration }
    }
}

/// Biased detections: `offset` is added to every detection of the object until the hand has touched it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrongPosition {
    pub object: TargetObject,
    /// Detected minus true position, m, world axes.
    pub offset: [f64; 3],
}

/// An object whose size differs from the size that the control stack assumes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrongSize {
    pub object: TargetObject,
    /// True size divided by assumed size.
    pub factor: f64,
}

/// Balls of different sizes, one after the other. Their size is known; they are grasped with the grasps of the ball
/// they replace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeSweep {
    /// The object to be replaced; all its names in the scenario must be balls.
    pub object: TargetObject,
    /// Diameters, m.
    pub diameters: Vec<f64>,
}

impl SizeSweep {
    /// Returns the diameter of the ball in trial `trial`, m; the list repeats cyclically.
    pub fn diameter(&self, trial: usize) -> f64 {
        self.diameters[trial % self.diameters.len()]
    }
}

/// Digits without power, as reported to the control stack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisabledDigits {
    /// The unpowered digits.
    pub digits: Vec<Digit>,
}

/// Pads whose cameras have failed from the beginning of the trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedPadCameras {
    /// Names of the pads, such as `ring_distal`.
    pub pads: Vec<String>,
    /// Failure mode of their cameras.
    pub frames: CameraFailure,
}

/// All disturbances of a scenario.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbances {
    /// See [`PushDisturbance`].
    pub push: Option<PushDisturbance>,
    /// See [`SlipDisturbance`].
    pub slip: Option<SlipDisturbance>,
    /// See [`WrongPosition`].
    pub wrong_position: Option<WrongPosition>,
    /// See [`WrongSize`].
    pub wrong_size: Option<WrongSize>,
    /// See [`SizeSweep`].
    pub size_sweep: Option<SizeSweep>,
    /// See [`DisabledDigits`].
    pub disabled_digits: Option<DisabledDigits>,
    /// See [`FailedPadCameras`].
    pub blind_pads: Option<FailedPadCameras>,
}

/// Invalid value: field, value found, value expected.
pub type InvalidValue = (String, String, String);

impl Disturbances {
    /// True if there is no disturbance.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the digits without power.
    pub fn disabled(&self) -> &[Digit] {
        self.disabled_digits.as_ref().map_or(&[], |disabled| &disabled.digits)
    }

    /// Returns the fields that name an object, each with the object's index.
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

    /// Returns the true size of each object divided by its model's size.
    pub fn size_factors(&self) -> [f64; MAX_OBJECTS] {
        let mut sizes = [1.0; MAX_OBJECTS];
        if let Some(wrong) = self.wrong_size {
            sizes[wrong.object.index()] = wrong.factor;
        }
        sizes
    }

    /// Checks every value and returns the first with which no trial can be run.
    pub(crate) fn check(&self) -> Result<(), InvalidValue> {
        if let Some(push) = &self.push {
            check_timing("push", &push.timing())?;
            check_vector("disturbance.push.force", &push.force, 100.0, "N")?;
            if push.force == [0.0; 3] {
                return invalid_value("disturbance.push.force", &push.force, "a force that is not zero");
            }
        }
        if let Some(slip) = &self.slip {
            check_timing("slip", &slip.timing())?;
            check_vector("disturbance.slip.force", &slip.force, 100.0, "N")?;
            check_range("disturbance.slip.friction", slip.friction, [0.0, 1.0])?;
            if slip.force == [0.0; 3] && slip.friction >= 1.0 {
                return invalid_value("disturbance.slip", &slip, "a friction below 1 or a force that is not zero");
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
                return invalid_value("disturbance.size_sweep.diameters", &sweep.diameters, "at least one");
            }
            for diameter in &sweep.diameters {
                check_range("disturbance.size_sweep.diameters", *diameter, [0.02, 0.12])?;
            }
        }
        if let Some(DisabledDigits { digits }) = &self.disabled_digits
            && (digits.is_empty() || (1..digits.len()).any(|n| digits[..n].contains(&digits[n])))
        {
            return invalid_value("disturbance.disabled_digits.digits", digits, "one digit or more, each once");
        }
        if let Some(FailedPadCameras { pads, .. }) = &self.blind_pads
            && pads.is_empty()
        {
            return invalid_value("disturbance.blind_pads.pads", pads, "at least one");
        }
        Ok(())
    }

    /// Checks that `hand` has the named pads.
    ///
    /// # Errors
    /// The field, the value found, and the values that would be valid.
    pub fn check_pads(&self, hand: &Hand) -> Result<(), InvalidValue> {
        if let Some(FailedPadCameras { pads, .. }) = &self.blind_pads {
            let names: Vec<&str> = hand.pads.iter().map(|pad| pad.name.as_str()).collect();
            if let Some(unknown) = pads.iter().find(|pad| !names.contains(&pad.as_str())) {
                return invalid_value("disturbance.blind_pads.pads", unknown, &format!("one of {}", names.join(", ")));
            }
        }
        Ok(())
    }
}

fn invalid_value(field: &str, found: &impl std::fmt::Debug, expected: &str) -> Result<(), InvalidValue> {
    Err((field.into(), format!("{found:?}"), expected.into()))
}

fn check_range(field: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), InvalidValue> {
    if (low..=high).contains(&value) { Ok(()) } else { invalid_value(field, &value, &format!("{low} to {high}")) }
}

fn check_vector(field: &str, value: &[f64; 3], most: f64, unit: &str) -> Result<(), InvalidValue> {
    // NaN fails this comparison and is refused.
    if Vector3::from(*value).norm() <= most {
        return Ok(());
    }
    invalid_value(field, value, &format!("three numbers, together at most {most} {unit}"))
}

fn check_timing(kind: &str, moment: &EventTiming) -> Result<(), InvalidValue> {
    check_range(&format!("disturbance.{kind}.at"), moment.at, [0.0, 1.0])?;
    check_range(&format!("disturbance.{kind}.duration"), moment.duration, [0.01, 30.0])?;
    // These phases last as long as a decision, so they have no fractions.
    let phase = moment.phase;
    if phase.waits_for_decision() && !matches!(phase.skill, Skill::Begin | Skill::Palpate) || phase.object > 1 {
        let expected = "a phase in which the robot acts, in a trial with two objects";
        return invalid_value(&format!("disturbance.{kind}.phase"), &phase.name(), expected);
    }
    Ok(())
}

#[cfg(test)]
mod tests;
