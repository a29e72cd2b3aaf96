//! What a policy that drives the robot step by step may ask of it, and its limits.
//!
//! A step is a twentieth of a second. An action out of its limits is refused, with the place and the limits in the error: it is not cut to fit.
//! [`Stepper`] turns actions into what arm and servos are asked for in every tick.

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, ArmVector, DigitVector};

use crate::Twist;
use crate::inverse_kinematics::{IkError, Joints};
use crate::slip::most_tension;
use crate::trajectory::PathLimits;
use crate::workcell::Workcell;

pub use self::stepper::{Stepper, TICKS};

mod stepper;

/// Current with which the opposition servo holds its angle at most, A.
const OPPOSITION_CURRENT: f64 = 0.6;

/// Limit of a joint that turns without end, rad.
const ENDLESS: f64 = 100.0;

/// What the arm is asked to do during one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmAction {
    /// Move the palm with this twist: m/s of its origin and rad/s, world axes.
    Twist(Twist),
    /// Go to these joint set-points, rad.
    Joints(Joints),
}

/// What the hand's servos are asked to do during one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HandAction {
    /// Pull the cables, and turn the thumb's opposition joint.
    Tensions {
        /// At the spools, N: thumb, index, middle, ring, little. Reached evenly over the step.
        tensions: DigitVector,
        /// rad.
        opposition: f64,
    },
    /// Turn the servos to these output angles, rad: a larger one winds more cable.
    Spools(ActuatorVector),
}

/// What is asked of the robot during one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Action {
    pub arm: ArmAction,
    pub hand: HandAction,
}

/// Why an action is not carried out; the scene is as it was.
#[derive(Debug, thiserror::Error)]
pub enum ActionError {
    /// A value is not a number, or out of its limits.
    #[error("{what}[{index}]: found {found}, expected {low} to {high} {unit}")]
    Range { what: &'static str, index: usize, found: f64, low: f64, high: f64, unit: &'static str },
    /// Another number of values than the robot has joints, cables or servos.
    #[error("{what}: found {found} values, expected {expected}")]
    Count { what: &'static str, found: usize, expected: usize },
    /// The arm's reference cannot be moved.
    #[error(transparent)]
    Arm(#[from] IkError),
}

/// Limits of actions.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionLimits {
    /// Of each axis of the palm's velocity, m/s.
    pub speed: f64,
    /// Of each axis of its angular velocity, rad/s.
    pub turn_speed: f64,
    /// Of the arm's joints, rad; wide where a joint is continuous.
    pub joints: ArmVector<[f64; 2]>,
    /// Greatest tension of a cable, N.
    pub tension: f64,
    /// Of the opposition joint, rad.
    pub opposition: [f64; 2],
    /// Of the servos' output angles, rad.
    pub spools: ActuatorVector<[f64; 2]>,
    /// Greatest current of a cable's servo, A.
    current: f64,
    /// How many digits have a cable.
    pub digits: usize,
}

impl ActionLimits {
    /// Of the robot in this cell.
    pub fn of(cell: &Workcell) -> Self {
        let (hand, PathLimits { speed, turn_speed, .. }) = (&cell.robot.hand, PathLimits::default());
        let opposition = hand.transmission.opposition.map_or([0.0; 2], |joint| {
            let thumb = &hand.tree.joints[joint];
            [thumb.lower, thumb.upper]
        });
        let tension = most_tension(hand);
        Self {
            speed,
            turn_speed,
            joints: cell.robot.arm.each(|n| {
                let joint = &cell.robot.arm.tree.joints[n];
                [joint.lower.max(-ENDLESS), joint.upper.min(ENDLESS)]
            }),
            tension,
            opposition,
            spools: hand.each_actuator(|n| match hand.transmission.cables.get(n) {
                Some(path) => {
                    let stretch = tension / hand.cables[n].stiffness;
                    [0.0, (path.full_excursion() + stretch) / hand.cables[n].spool_radius]
                }
                None => opposition.map(|angle| angle * hand.servos[n].gear_ratio_opposition),
            }),
            current: hand.servos.iter().map(|servo| servo.current_limit).fold(f64::INFINITY, f64::min),
            digits: hand.cables.len(),
        }
    }

    /// Whether an action keeps to the limits.
    pub fn check(&self, action: &Action) -> Result<(), ActionError> {
        match action.arm {
            ArmAction::Twist(twist) => {
                let (linear, angular) = twist.as_slice().split_at(3);
                within("palm velocity", linear, |_| [-self.speed, self.speed], "m/s")?;
                within("palm angular velocity", angular, |_| [-self.turn_speed, self.turn_speed], "rad/s")?;
            }
            ArmAction::Joints(joints) => {
                count("arm joints", joints.len(), self.joints.len())?;
                within("arm joints", &joints, |n| self.joints[n], "rad")?;
            }
        }
        match action.hand {
            HandAction::Tensions { tensions, opposition } => {
                count("tensions", tensions.len(), self.digits)?;
                within("tensions", &tensions, |_| [0.0, self.tension], "N")?;
                within("opposition", &[opposition], |_| self.opposition, "rad")
            }
            HandAction::Spools(angles) => {
                count("spools", angles.len(), self.spools.len())?;
                within("spools", &angles, |n| self.spools[n], "rad")
            }
        }
    }

    /// What the servos are asked for by spool angles (rad).
    fn spool_goals(&self, angles: &[f64]) -> ActuatorVector<ServoGoal> {
        let goal = |(n, angle): (usize, &f64)| {
            let current_limit = if n + 1 == self.spools.len() { OPPOSITION_CURRENT } else { self.current };
            ServoGoal::Position { angle: *angle, current_limit }
        };
        angles.iter().enumerate().map(goal).collect()
    }

    /// What the servos are asked for by tensions (N) and the angle of the opposition joint (rad).
    fn tension_goals(cell: &Workcell, tensions: &[f64], opposition: f64) -> ActuatorVector<ServoGoal> {
        cell.robot.hand.servo_goals(tensions, opposition, OPPOSITION_CURRENT)
    }
}

fn count(what: &'static str, found: usize, expected: usize) -> Result<(), ActionError> {
    if found == expected { Ok(()) } else { Err(ActionError::Count { what, found, expected }) }
}

fn within(
    what: &'static str,
    values: &[f64],
    limits: impl Fn(usize) -> [f64; 2],
    unit: &'static str,
) -> Result<(), ActionError> {
    for (index, &found) in values.iter().enumerate() {
        let [low, high] = limits(index);
        if !(found >= low && found <= high) {
            return Err(ActionError::Range { what, index, found, low, high, unit });
        }
    }
    Ok(())
}
