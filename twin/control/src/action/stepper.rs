//! Actions turned into set-points, tick by tick.

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, DigitVector};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{Action, ActionError, ActionLimits, ArmAction, HandAction};
use crate::Twist;
use crate::inverse_kinematics::{ArmServo, IkError, Joints};
use crate::workcell::Workcell;

/// Ticks of the robot in a step: six of 1/120 s.
pub const TICKS: usize = 6;

/// What the arm follows.
#[derive(Debug, Clone)]
enum Reference {
    /// The palm's twist.
    Palm(Box<ArmServo>),
    /// Joint set-points as they were sent, rad.
    Joints(Joints),
}

/// What a tick asks of arm (rad) and servos.
pub type Goals = (Joints, ActuatorVector<ServoGoal>);

/// Carries actions out. A clone goes its own way from the same bits.
#[derive(Debug, Clone)]
pub struct Stepper {
    cell: Workcell,
    limits: ActionLimits,
    reference: Reference,
    tensions: DigitVector,
}

impl Stepper {
    /// Of a robot whose arm's set-points are `posture` (rad), and whose cables are pulled with `tensions` (N).
    pub fn new(cell: &Workcell, posture: Joints, tensions: DigitVector) -> Result<Self, IkError> {
        let reference = Reference::Palm(Box::new(cell.arm_servo(posture)?));
        Ok(Self { cell: cell.clone(), limits: ActionLimits::of(cell), reference, tensions })
    }

    /// Limits of the actions.
    pub fn limits(&self) -> &ActionLimits {
        &self.limits
    }

    /// All of a step in ticks of `tick` s, before any of it is carried out. An error leaves everything as it was.
    pub fn step(&mut self, action: &Action, tick: f64) -> Result<[Goals; TICKS], ActionError> {
        self.limits.check(action)?;
        let mut reference = match (action.arm, &self.reference) {
            (ArmAction::Twist(_), Reference::Palm(servo)) => Reference::Palm(servo.clone()),
            (ArmAction::Twist(_), Reference::Joints(sent)) => Reference::Palm(Box::new(self.cell.arm_servo(*sent)?)),
            (ArmAction::Joints(joints), _) => Reference::Joints(joints),
        };
        let mut wanted = [Joints::default(); TICKS];
        for joints in &mut wanted {
            *joints = match (&mut reference, action.arm) {
                (Reference::Palm(servo), ArmAction::Twist(twist)) => {
                    let target = moved(&servo.palm_pose(), &twist, tick);
                    servo.step(&target, &twist, tick)?.q
                }
                (Reference::Palm(servo), ArmAction::Joints(_)) => *servo.q(),
                (Reference::Joints(joints), _) => *joints,
            };
        }
        let before = self.tensions;
        if let HandAction::Tensions { tensions, .. } = action.hand {
            self.tensions = tensions;
        }
        self.reference = reference;
        Ok(std::array::from_fn(|n| (wanted[n], self.servo_goals(&action.hand, &before, (n + 1) as f64 / TICKS as f64))))
    }

    /// What was sent to the arm last, after limits: joint set-points go on from there.
    pub fn sent(&mut self, arm: Joints) {
        if let Reference::Joints(joints) = &mut self.reference {
            *joints = arm;
        }
    }

    /// Goals of a tick when `part` of the step is over and the tensions were `before` it, N.
    fn servo_goals(&self, action: &HandAction, before: &[f64], part: f64) -> ActuatorVector<ServoGoal> {
        match action {
            HandAction::Tensions { tensions, opposition } => {
                let now: DigitVector =
                    tensions.iter().zip(before).map(|(tension, before)| before + part * (tension - before)).collect();
                ActionLimits::tension_goals(&self.cell, &now, *opposition)
            }
            HandAction::Spools(angles) => self.limits.spool_goals(angles),
        }
    }
}

/// `pose` after `time` (s) with `twist`.
fn moved(pose: &Isometry3<f64>, twist: &Twist, time: f64) -> Isometry3<f64> {
    let (linear, angular): (Vector3<f64>, Vector3<f64>) =
        (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + linear * time),
        UnitQuaternion::from_scaled_axis(angular * time) * pose.rotation,
    )
}
