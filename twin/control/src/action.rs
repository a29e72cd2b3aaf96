//! Actions of a policy that drives the robot step by step, and their limits.
//!
//! A step lasts a twentieth of a second. An action beyond its limits is refused rather than clamped; the error names
//! the value and its limits. [`Stepper`] turns an action into the set-points of arm and servos for every tick.

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, ArmVector, DigitVector};

use crate::Twist;
use crate::inverse_kinematics::{IkError, Joints};
use crate::slip::max_tension;
use crate::trajectory::PathLimits;
use crate::workcell::Workcell;

pub use self::stepper::{Stepper, TICKS_PER_STEP};

mod stepper;

/// Current limit of the opposition servo while it holds its angle, A.
const OPPOSITION_CURRENT: f64 = 0.6;

/// Substitute for the limits of a continuous joint, rad.
const CONTINUOUS_JOINT_LIMIT: f64 = 100.0;

/// Command to the arm for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmAction {
    /// Move the palm with this twist: linear velocity of its origin (m/s) and angular velocity (rad/s), world axes.
    Twist(Twist),
    /// Move to these joint set-points, rad.
    Joints(Joints),
}

/// Command to the servos of the hand for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HandAction {
    /// Pull the cables with given tensions, and turn the opposition joint of the thumb.
    Tensions {
        /// Tensions at the spools, N: thumb, index, middle, ring, little. They change linearly over the step.
        tensions: DigitVector,
        /// Angle of the opposition joint, rad.
        opposition: f64,
    },
    /// Turn the servos to these output angles, rad. A larger angle winds up more cable.
    Spools(ActuatorVector),
}

/// Command to the robot for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Action {
    pub arm: ArmAction,
    pub hand: HandAction,
}

/// Error of a refused action. The scene stays as it was.
#[derive(Debug, thiserror::Error)]
pub enum ActionError {
    /// A value is not a number or lies outside its limits.
    #[error("{what}[{index}]: found {found}, expected {low} to {high} {unit}")]
    Range { what: &'static str, index: usize, found: f64, low: f64, high: f64, unit: &'static str },
    /// The number of values differs from the number of joints, cables or servos of the robot.
    #[error("{what}: found {found} values, expected {expected}")]
    Count { what: &'static str, found: usize, expected: usize },
    /// The arm's reference cannot be moved.
    #[error(transparent)]
    Arm(#[from] IkError),
}

/// Limits of actions.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionLimits {
    /// Limit of each component of the palm's linear velocity, m/s.
    pub speed: f64,
    /// Limit of each component of the palm's angular velocity, rad/s.
    pub turn_speed: f64,
    /// Position limits of the arm's joints, rad; wide for a continuous joint.
    pub joints: ArmVector<[f64; 2]>,
    /// Largest tension of a cable, N.
    pub tension: f64,
    /// Position limits of the opposition joint, rad.
    pub opposition: [f64; 2],
    /// Limits of the servos' output angles, rad.
    pub spools: ActuatorVector<[f64; 2]>,
    /// Current limit of a cable servo, A.
    current: f64,
    /// Number of digits that are driven by a cable.
    pub digits: usize,
}

impl ActionLimits {
    /// Limits of the robot in `cell`.
    pub fn for_workcell(cell: &Workcell) -> Self {
        let (hand, PathLimits { speed, turn_speed, .. }) = (&cell.robot.hand, PathLimits::default());
        let opposition = hand.transmission.opposition.map_or([0.0; 2], |joint| {
            let thumb = &hand.tree.joints[joint];
            [thumb.lower, thumb.upper]
        });
        let tension = max_tension(hand);
        Self {
            speed,
            turn_speed,
            joints: cell.robot.arm.each(|n| {
                let joint = &cell.robot.arm.tree.joints[n];
                [joint.lower.max(-CONTINUOUS_JOINT_LIMIT), joint.upper.min(CONTINUOUS_JOINT_LIMIT)]
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

    /// Checks an action against the limits.
    pub fn check(&self, action: &Action) -> Result<(), ActionError> {
        match action.arm {
            ArmAction::Twist(twist) => {
                let (linear, angular) = twist.as_slice().split_at(3);
                check_range("palm velocity", linear, |_| [-self.speed, self.speed], "m/s")?;
                check_range("palm angular velocity", angular, |_| [-self.turn_speed, self.turn_speed], "rad/s")?;
            }
            ArmAction::Joints(joints) => {
                check_count("arm joints", joints.len(), self.joints.len())?;
                check_range("arm joints", &joints, |n| self.joints[n], "rad")?;
            }
        }
        match action.hand {
            HandAction::Tensions { tensions, opposition } => {
                check_count("tensions", tensions.len(), self.digits)?;
                check_range("tensions", &tensions, |_| [0.0, self.tension], "N")?;
                check_range("opposition", &[opposition], |_| self.opposition, "rad")
            }
            HandAction::Spools(angles) => {
                check_count("spools", angles.len(), self.spools.len())?;
                check_range("spools", &angles, |n| self.spools[n], "rad")
            }
        }
    }

    /// Servo goals for spool angles (rad).
    fn spool_goals(&self, angles: &[f64]) -> ActuatorVector<ServoGoal> {
        let goal = |(n, angle): (usize, &f64)| {
            let current_limit = if n + 1 == self.spools.len() { OPPOSITION_CURRENT } else { self.current };
            ServoGoal::Position { angle: *angle, current_limit }
        };
        angles.iter().enumerate().map(goal).collect()
    }

    /// Servo goals for cable tensions (N) and the angle of the opposition joint (rad).
    fn tension_goals(cell: &Workcell, tensions: &[f64], opposition: f64) -> ActuatorVector<ServoGoal> {
        cell.robot.hand.servo_goals(tensions, opposition, OPPOSITION_CURRENT)
    }
}

fn check_count(what: &'static str, found: usize, expected: usize) -> Result<(), ActionError> {
    if found == expected { Ok(()) } else { Err(ActionError::Count { what, found, expected }) }
}

fn check_range(
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
