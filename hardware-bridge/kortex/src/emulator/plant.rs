//! The joints of an emulated arm.

use crate::gen3;
use crate::joints::{JOINTS, JointMotion, ToolPose};

/// The controller's command to the joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// Stop and hold the position.
    Hold,
    /// Move to these angles, rad, unwrapped as the joints' own.
    Position([f64; JOINTS]),
    /// Move at these speeds, rad/s.
    Velocity([f64; JOINTS]),
}

/// The seven joints of an arm: [`FirstOrderJoints`], or those of a simulator.
///
/// # Example
/// ```
/// use kinova_kortex::JointMotion;
/// use kinova_kortex::emulator::{Drive, Emulator, Pace, Plant, Settings};
///
/// /// Joints that are at once where they are commanded to be.
/// #[derive(Default)]
/// struct Ideal(JointMotion);
///
/// impl Plant for Ideal {
///     fn advance(&mut self, drive: &Drive, seconds: f64) {
///         let before = self.0.position;
///         match drive {
///             Drive::Hold => {}
///             Drive::Position(angles) => self.0.position = *angles,
///             Drive::Velocity(speeds) => {
///                 for (angle, speed) in self.0.position.iter_mut().zip(speeds) {
///                     *angle += speed * seconds;
///                 }
///             }
///         }
///         self.0.velocity = std::array::from_fn(|i| (self.0.position[i] - before[i]) / seconds);
///     }
///
///     fn state(&self) -> JointMotion {
///         self.0
///     }
/// }
///
/// let emulator = Emulator::start(Settings::default(), Box::new(Ideal::default()), Pace::Stepped)?;
/// assert_eq!(emulator.status().motion.position, [0.0; 7]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Plant: Send {
    /// Advances the joints by `seconds` under `drive`.
    fn advance(&mut self, drive: &Drive, seconds: f64);
    /// Returns angles (rad, not wrapped), speeds and torques.
    fn state(&self) -> JointMotion;
    /// Returns the pose of the tool; `None` for joints without links.
    fn tool_pose(&self) -> Option<ToolPose> {
        None
    }
}

/// Joints with first-order lag and a top speed, without load.
///
/// Under a position command the angle closes the gap as `exp(-t / lag)`. A sine of angular frequency `w` and amplitude
/// `A` is therefore followed with an error of amplitude `A w lag / sqrt(1 + (w lag)^2)`. Under a speed command, and
/// when stopping, the speed does the same.
///
/// # Example
/// ```
/// use kinova_kortex::emulator::{Drive, FirstOrderJoints, Plant};
///
/// // One time constant closes the gap of 0.01 rad to 1/e.
/// let mut joints = FirstOrderJoints::new([0.0; 7], 0.02, [1.0; 7]);
/// joints.advance(&Drive::Position([0.01; 7]), 0.02);
/// assert!((joints.state().position[0] - 0.01 * (1.0 - (-1_f64).exp())).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct FirstOrderJoints {
    state: JointMotion,
    lag: f64,
    top_speed: [f64; JOINTS],
}

impl FirstOrderJoints {
    /// Creates joints at rest at `posture` (rad), with `lag` in s and `top_speed` in rad/s.
    pub fn new(posture: [f64; JOINTS], lag: f64, top_speed: [f64; JOINTS]) -> Self {
        let state = JointMotion { position: posture, ..JointMotion::default() };
        Self { state, lag, top_speed }
    }

    /// Creates the joints of a Gen3 at rest in its home posture, with its top speeds and a lag of 20 ms (a guess).
    pub fn gen3() -> Self {
        Self::new(gen3::HOME, 0.02, gen3::TOP_SPEED)
    }
}

impl Plant for FirstOrderJoints {
    fn advance(&mut self, drive: &Drive, seconds: f64) {
        let share = 1.0 - (-seconds / self.lag).exp();
        for i in 0..JOINTS {
            let (position, speed) = (self.state.position[i], self.state.velocity[i]);
            let wanted = match drive {
                Drive::Position(target) => (target[i] - position) * share / seconds,
                Drive::Velocity(target) => speed + (target[i] - speed) * share,
                Drive::Hold => speed * (1.0 - share),
            };
            let speed = wanted.clamp(-self.top_speed[i], self.top_speed[i]);
            self.state.velocity[i] = speed;
            self.state.position[i] = position + speed * seconds;
        }
    }

    fn state(&self) -> JointMotion {
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joints() -> FirstOrderJoints {
        FirstOrderJoints::new([0.0; JOINTS], 0.02, [1.0; JOINTS])
    }

    /// After one lag the gap is 1/e of its initial size, whatever the step length.
    #[test]
    fn closes_the_gap_exponentially() {
        for steps in [1, 10, 20] {
            let mut joints = joints();
            for _ in 0..steps {
                joints.advance(&Drive::Position([0.01; JOINTS]), 0.02 / f64::from(steps));
            }
            let gap = 0.01 - joints.state().position[0];
            assert!((gap - 0.01 * (-1_f64).exp()).abs() < 1e-12, "{steps} steps: {gap}");
        }
    }

    #[test]
    fn top_speed_holds() {
        let mut joints = joints();
        joints.advance(&Drive::Position([9.0; JOINTS]), 0.001);
        assert_eq!(joints.state().velocity, [1.0; JOINTS]);
    }

    #[test]
    fn hold_brakes() {
        let mut joints = joints();
        for _ in 0..200 {
            joints.advance(&Drive::Velocity([0.5; JOINTS]), 0.001);
        }
        assert!((joints.state().velocity[3] - 0.5).abs() < 1e-4);
        let before = joints.state().position[3];
        for _ in 0..200 {
            joints.advance(&Drive::Hold, 0.001);
        }
        let after = joints.state();
        assert!(after.velocity[3].abs() < 1e-4);
        // The stopping distance of an exponential stop is speed * lag.
        assert!((after.position[3] - before - 0.5 * 0.02).abs() < 1e-3);
    }
}
