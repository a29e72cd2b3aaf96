//! Converts actions into set-points, tick by tick.

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, DigitVector};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{Action, ActionError, ActionLimits, ArmAction, HandAction};
use crate::Twist;
use crate::inverse_kinematics::{ArmServo, IkError, Joints};
use crate::workcell::Workcell;

/// Ticks per step: six of 1/120 s.
pub const TICKS_PER_STEP: usize = 6;

/// Reference that the arm follows.
#[derive(Debug, Clone)]
enum Reference {
    /// A palm twist, tracked by the arm servo.
    Palm(Box<ArmServo>),
    /// Joint set-points as they were sent, rad.
    Joints(Joints),
}

/// Set-points of one tick: arm joints (rad) and servo goals.
pub type TickSetPoints = (Joints, ActuatorVector<ServoGoal>);

/// Carries out actions. A clone continues independently from an identical state.
#[derive(Debug, Clone)]
pub struct Stepper {
    cell: Workcell,
    limits: ActionLimits,
    reference: Reference,
    tensions: DigitVector,
}

impl Stepper {
    /// A stepper for a robot whose arm is at the set-points `posture` (rad) and whose cables are pulled with `tensions`
    /// (N).
    pub fn new(cell: &Workcell, posture: Joints, tensions: DigitVector) -> Result<Self, IkError> {
        let reference = Reference::Palm(Box::new(cell.arm_servo(posture)?));
        Ok(Self { cell: cell.clone(), limits: ActionLimits::for_workcell(cell), reference, tensions })
    }

    /// Limits of the actions.
    pub fn limits(&self) -> &ActionLimits {
        &self.limits
    }

    /// Computes all ticks of a step, of `tick` s each, before any of them is carried out. On an error the state is
    /// unchanged.
    pub fn step(&mut self, action: &Action, tick: f64) -> Result<[TickSetPoints; TICKS_PER_STEP], ActionError> {
        self.limits.check(action)?;
        let mut reference = match (action.arm, &self.reference) {
            (ArmAction::Twist(_), Reference::Palm(servo)) => Reference::Palm(servo.clone()),
            (ArmAction::Twist(_), Reference::Joints(sent)) => Reference::Palm(Box::new(self.cell.arm_servo(*sent)?)),
            (ArmAction::Joints(joints), _) => Reference::Joints(joints),
        };
        let mut wanted = [Joints::default(); TICKS_PER_STEP];
        for joints in &mut wanted {
            *joints = match (&mut reference, action.arm) {
                (Reference::Palm(servo), ArmAction::Twist(twist)) => {
                    let target = integrate_twist(&servo.palm_pose(), &twist, tick);
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
        Ok(std::array::from_fn(|n| {
            (wanted[n], self.servo_goals(&action.hand, &before, (n + 1) as f64 / TICKS_PER_STEP as f64))
        }))
    }

    /// Takes over the set-points that were last sent to the arm after limiting. Joint set-points continue from there.
    pub fn adopt_sent(&mut self, arm: Joints) {
        if let Reference::Joints(joints) = &mut self.reference {
            *joints = arm;
        }
    }

    /// Servo goals of a tick after the fraction `part` of the step; `before` are the tensions (N) at its start.
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

/// Pose reached from `pose` after `time` (s) of motion with `twist`.
fn integrate_twist(pose: &Isometry3<f64>, twist: &Twist, time: f64) -> Isometry3<f64> {
    let (linear, angular): (Vector3<f64>, Vector3<f64>) =
        (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + linear * time),
        UnitQuaternion::from_scaled_axis(angular * time) * pose.rotation,
    )
}
