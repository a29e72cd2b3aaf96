//! Script of an excitation, as data: `data/excitation.toml`.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use hand_model::hand::MAX_DIGITS;
use hand_model::{Hand, RobotModel};
use serde::{Deserialize, Serialize};

use crate::ball::{CalibrationBall, PadPress};
use crate::payload::{MIN_POSTURE_DIFFERENCE, Payload, PayloadStep, ScriptPosture};

/// Index of the actuator that turns the thumb of the F-TAC Hand.
pub const OPPOSITION_ACTUATOR: usize = MAX_DIGITS;
/// Maximum current of a motion, A: no more is needed to bend a free finger.
const MAX_CURRENT: f64 = 0.2;

/// Winding of some cables under a current that rises and falls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindingMotion {
    /// Names of the actuators.
    pub actuators: Vec<String>,
    /// Maximum current, A.
    pub current: f64,
    /// Time in which the current rises, and in which it falls again, s.
    pub time: f64,
}

/// All motions in all postures, presses of all pads on a ball, if any, and the lifting of a payload, if any.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExcitationScript {
    pub version: u32,
    /// Current limit of the position control that opens the hand, A.
    pub open_current: f64,
    /// Time for which the hand opens before a motion, s.
    pub open_time: f64,
    /// Time at the greatest current, s.
    pub stay: f64,
    /// Time at zero current after the fall, s.
    pub slack: f64,
    /// Speed of the fastest arm joint, rad/s.
    pub arm_speed: f64,
    pub posture: Vec<ScriptPosture>,
    pub motion: Vec<WindingMotion>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ball: Option<CalibrationBall>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "weight")]
    pub payload: Option<Payload>,
}

impl ScriptPosture {
    /// True if some joint differs from that in `other` by at least [`MIN_POSTURE_DIFFERENCE`].
    pub fn differs_from(&self, other: &Self) -> bool {
        self.turn.iter().zip(&other.turn).any(|(own, other)| (own - other).abs() >= MIN_POSTURE_DIFFERENCE)
    }
}

/// One step of a script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExcitationStep<'a> {
    /// One motion in one posture.
    Motion(&'a ScriptPosture, &'a WindingMotion),
    /// One press on the ball.
    Press(&'a CalibrationBall, PadPress),
    /// One part of payload calibration.
    CalibratePayload(&'a Payload, PayloadStep),
}

impl ExcitationScript {
    /// Returns the built-in script.
    ///
    /// # Errors
    /// [`DataError`] for a robot that lacks an item named in the script.
    pub fn standard(robot: &RobotModel) -> Result<Self, DataError> {
        Self::parse(include_str!("../data/excitation.toml"), Path::new("excitation.toml"), robot)
    }

    /// Reads and checks a script's text; `path` is used in errors.
    pub fn parse(text: &str, path: &Path, robot: &RobotModel) -> Result<Self, DataError> {
        let RobotModel { hand, arm, .. } = robot;
        let script: Self = parse_toml(text, path)?;
        let fault = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if script.version != 1 {
            return fault("version", script.version.to_string(), "1");
        }
        let within = |value: f64, low: f64, high: f64| value.is_finite() && (low..=high).contains(&value);
        for (field, value, low, high) in [
            ("open_current", script.open_current, 0.05, 0.4),
            ("open_time", script.open_time, 0.5, 10.0),
            ("stay", script.stay, 0.0, 10.0),
            ("slack", script.slack, 0.1, 10.0),
            ("arm_speed", script.arm_speed, 0.01, 0.8),
        ] {
            if !within(value, low, high) {
                return fault(field, value.to_string(), &format!("{low} to {high} (SI units)"));
            }
        }
        for posture in &script.posture {
            if posture.turn.len() != arm.joints() {
                let expected = format!("{}, one for each joint of the arm", arm.joints());
                return fault(
                    &format!("posture[{}].turn", posture.name),
                    format!("{} angles", posture.turn.len()),
                    &expected,
                );
            }
            if let Some(turn) = posture.turn.iter().find(|turn| !within(**turn, -4.0, 4.0)) {
                return fault(&format!("posture[{}].turn", posture.name), turn.to_string(), "angles within 4 rad");
            }
        }
        for (n, motion) in script.motion.iter().enumerate() {
            let field = |what: &str| format!("motion[{n}].{what}");
            if !within(motion.current, 0.002, MAX_CURRENT) {
                return fault(&field("current"), motion.current.to_string(), "0.002 to 0.2 A");
            }
            if !within(motion.time, 0.3, 60.0) {
                return fault(&field("time"), motion.time.to_string(), "0.3 to 60 s");
            }
            for name in &motion.actuators {
                if actuator(hand, name).is_none() {
                    return fault(&field("actuators"), format!("`{name}`"), "names of the hand's actuators");
                }
            }
        }
        if script.posture.is_empty() || script.motion.is_empty() {
            return fault("posture/motion", "none".into(), "at least one of each");
        }
        if let Some(ball) = &script.ball {
            check_ball(ball, path)?;
        }
        if let Some(weight) = &script.payload {
            weight.check(&script.posture, path)?;
        }
        Ok(script)
    }

    /// Returns the steps for `hand` in order. Motions come first, so that the ball can be put in its place when they
    /// are done. The payload comes last, because the arm is calibrated by then.
    pub fn steps(&self, hand: &Hand) -> Vec<ExcitationStep<'_>> {
        let of = |posture| self.motion.iter().map(move |motion| ExcitationStep::Motion(posture, motion));
        let motions = self.posture.iter().flat_map(of);
        let presses = |ball: &'_ CalibrationBall| ball.presses(hand);
        let on = self
            .ball
            .iter()
            .flat_map(|ball| presses(ball).into_iter().map(move |press| ExcitationStep::Press(ball, press)));
        let weighing = self.payload.iter().flat_map(|weight| {
            weight.payload_steps().into_iter().map(move |part| ExcitationStep::CalibratePayload(weight, part))
        });
        motions.chain(on).chain(weighing).collect()
    }

    /// Returns the current (A) of a motion `elapsed` (s) after its start, rounded to whole milliamperes, the resolution
    /// of a servo; none when the motion is over.
    pub fn current(&self, motion: &WindingMotion, elapsed: f64) -> Option<f64> {
        let falls = motion.time + self.stay;
        let share = match elapsed {
            t if t < motion.time => t / motion.time,
            t if t < falls => 1.0,
            t if t < falls + motion.time => 1.0 - (t - falls) / motion.time,
            t if t < falls + motion.time + self.slack => 0.0,
            _ => return None,
        };
        Some((1e3 * share * motion.current).round() / 1e3)
    }

    /// Returns the duration of a step without the arm's travel, s. For a press, contact is assumed at the expected
    /// position.
    pub fn step_duration(&self, step: &ExcitationStep, hand: &Hand) -> f64 {
        match step {
            ExcitationStep::Motion(_, motion) => self.open_time + 2.0 * motion.time + self.stay + self.slack,
            ExcitationStep::Press(ball, press) => {
                let slides = ball.slide_of(hand, press).map_or(0.0, |slide| slide.way);
                ball.settle * (2.0 + (ball.depth + slides) / ball.stride)
            }
            ExcitationStep::CalibratePayload(weight, PayloadStep::Empty(_)) => weight.hold,
            ExcitationStep::CalibratePayload(weight, PayloadStep::Lifted) => {
                weight.hold * (1 + weight.posture.len()) as f64
            }
        }
    }
}

fn check_ball(ball: &CalibrationBall, path: &Path) -> Result<(), DataError> {
    let shares = ball.spots.iter().flatten().map(|share| ("spots", *share, -0.4, 0.4));
    let [x, y, z] = ball.place;
    let values = [
        ("radius", ball.radius, 0.003, 0.03),
        ("place", x, 0.2, 0.8),
        ("place", y, -0.5, 0.5),
        ("place", z, 0.1, 0.7),
        ("uncertain", ball.uncertain, 1e-4, 0.01),
        ("tilt", ball.tilt, 0.0, 0.6),
        ("standoff", ball.standoff, 0.02, 0.1),
        ("stride", ball.stride, 1e-4, 0.001),
        ("settle", ball.settle, 0.05, 2.0),
        ("depth", ball.depth, 2e-4, 0.002),
    ];
    let slide = ball.slide.iter().flat_map(|slide| {
        [
            ("slide.way", slide.way, 0.003, 0.01),
            ("slide.friction", slide.friction, 0.1, 2.0),
            ("slide.uncertain", slide.uncertain, 0.0, 0.2),
        ]
    });
    for (field, value, low, high) in values.into_iter().chain(slide).chain(shares) {
        if !(value.is_finite() && (low..=high).contains(&value)) {
            let expected = format!("{low} to {high} (SI units)");
            return Err(DataError::field(path, format!("ball.{field}"), value, expected));
        }
    }
    if ball.spots.is_empty() {
        return Err(DataError::field(path, "ball.spots", "none", "at least one"));
    }
    Ok(())
}

/// Returns the index of an actuator by name.
pub fn actuator(hand: &Hand, name: &str) -> Option<usize> {
    hand.parameters.actuator.iter().position(|actuator| actuator.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_script_moves_every_actuator_in_every_posture() {
        let (script, hand) = (ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid"), Hand::ftac());
        for own in &hand.parameters.actuator {
            assert!(script.motion.iter().any(|motion| motion.actuators.contains(&own.name)), "{}", own.name);
        }
        let presses = script.ball.as_ref().expect("a ball").presses(&hand);
        let weighing = script.payload.as_ref().expect("a weight").payload_steps();
        let motions = script.posture.len() * script.motion.len();
        assert_eq!(script.steps(&hand).len(), motions + presses.len() + weighing.len());
        assert!((0..hand.cameras.len()).all(|camera| presses.iter().any(|press| press.camera == camera)));
    }

    /// A current rises, stays, falls to zero and ends.
    #[test]
    fn a_current_rises_and_falls() {
        let script = ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid");
        let motion = &script.motion[1];
        assert_eq!(script.current(motion, 0.0), Some(0.0));
        assert_eq!(script.current(motion, 3.1), Some(0.07));
        assert_eq!(script.current(motion, 4.8), Some(0.035));
        assert_eq!(script.current(motion, 6.5), Some(0.0));
        assert_eq!(script.current(motion, 7.0), None);
    }

    #[test]
    fn a_wrong_script_is_refused_by_field() {
        let text = include_str!("../data/excitation.toml");
        for (from, to, says) in [
            ("current = 0.035", "current = 2.0", "mine.toml: motion[0].current: found 2, expected 0.002 to 0.2 A"),
            ("\"index\"", "\"sixth\"", "motion[0].actuators: found `sixth`"),
            ("arm_speed = 0.35", "arm_speed = 9.0", "arm_speed: found 9"),
            ("depth = ", "depth = 1", "ball.depth: found 1"),
            ("spots = [", "spots = [[0.9, 0.0], ", "ball.spots: found 0.9"),
            ("object = ", "object = \"my \" # ", "weight.object: found `my `, expected the name of a built-in object"),
            ("mass = ", "mass = 40", "mine.toml: weight.mass: found 40"),
            ("mass_uncertain = ", "mass_uncertain = 3", "weight.mass_uncertain: found 3"),
            ("place = [0.55", "place = [0.95", "weight.place: found 0.95"),
            ("hold = ", "hold = 60 # ", "weight.hold: found 60, expected 0.2 to 10"),
            ("lift = ", "lift = nan # ", "weight.lift: found NaN"),
            (
                "turn = [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
                "turn = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
                "weight.posture[ahead].turn: found that of `ready`, expected 0.05 rad in some joint",
            ),
        ] {
            let error =
                ExcitationScript::parse(&text.replacen(from, to, 1), Path::new("mine.toml"), &RobotModel::ftac_gen3())
                    .unwrap_err();
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
