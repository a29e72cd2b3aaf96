//! The arm of [`super::direct`]: the operations of the Gen3 client and the emulated Gen3 on set-points and
//! measurements, as arithmetic.

use hand_model::arm::Arm as ArmModel;
use hand_model::robot::ArmState;
use kinova_kortex::CommandError;
use kinova_kortex::degrees::{Turns, nearest_turn, to_degrees, to_radians, to_wire_angle};
use kinova_kortex::emulator::Settings;
use kinova_kortex::joints::JOINTS;
use kinova_kortex::servoing::ServoingLimits;

use super::lockstep_arm::{step_towards, whole_milliseconds};
use crate::kortex_link::{limits, to_gen3};
use crate::safety::state::ArmTrouble;

/// An arm that is commanded at 1 kHz, and its client.
pub(super) struct DirectArm {
    limits: ServoingLimits,
    following_error: f64,
    turns: Turns,
    /// Remainder of a millisecond, s.
    remainder: f64,
    /// Newest command, rad, before its conversion to single-precision degrees.
    command: [f64; JOINTS],
    /// State of the plant's arm; `measured_state` is the client's measurement of it.
    true_state: ArmState,
    measured_state: ArmState,
    /// Goal of the arm's controller for the plant's joints, rad.
    pub goal: hand_model::ArmVector,
    /// Set-points from the supervisor, rad.
    pub target: Option<[f64; JOINTS]>,
    /// Fault that has stopped the arm.
    pub fault: Option<ArmTrouble>,
}

impl DirectArm {
    /// Creates an engaged arm of this model in the state `real`.
    pub fn new(model: &ArmModel, real: ArmState) -> Self {
        let mut arm = Self {
            limits: limits(model),
            following_error: Settings::default().following_error,
            turns: Turns::near(to_gen3(&real.position)),
            remainder: 0.0,
            command: to_gen3(&real.position),
            true_state: real,
            measured_state: real,
            goal: real.position,
            target: None,
            fault: None,
        };
        // The first command is the measured position.
        arm.command = to_gen3(&arm.measure(real).position);
        arm
    }

    /// Updates the state of the plant's arm to `real`; returns the client's measurement of it.
    pub fn measure(&mut self, real: ArmState) -> ArmState {
        self.true_state = real;
        self.measured_state = ArmState {
            position: self.turns.read(to_gen3(&real.position).map(to_wire_angle)).into(),
            velocity: real.velocity.iter().map(|&speed| to_radians(to_degrees(speed))).collect(),
            torque: real.torque.iter().map(|&torque| f64::from(torque as f32)).collect(),
        };
        self.measured_state
    }

    /// Runs the milliseconds of a tick of `seconds`: equal steps towards the target, each checked, rounded and
    /// followed.
    pub fn advance(&mut self, seconds: f64) {
        let milliseconds = whole_milliseconds(&mut self.remainder, seconds);
        for n in 0..milliseconds {
            if self.fault.is_some() {
                return;
            }
            let target = self.target.unwrap_or(self.command);
            let next = step_towards(&target, &self.command, milliseconds - n, &self.limits.step);
            match self.limits.check(&next, &self.command, &to_gen3(&self.measured_state.position)) {
                Ok(()) => self.command = next,
                // The client waits for an arm that lags too far behind.
                Err(CommandError::Lead { .. }) => {}
                Err(_) => self.fault = Some(ArmTrouble::Refused),
            }
            let position = self.true_state.position;
            let goal = |i: usize| nearest_turn(to_radians(to_wire_angle(self.command[i])), position[i]);
            self.goal = (0..JOINTS).map(goal).collect();
            if (0..JOINTS).any(|i| (self.goal[i] - position[i]).abs() > self.following_error) {
                self.fault.get_or_insert(ArmTrouble::Fault);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm() -> DirectArm {
        DirectArm::new(&ArmModel::gen3(), ArmState { position: [0.3; JOINTS].into(), ..ArmState::default() })
    }

    /// Ticks of 1/120 s are 8 or 9 ms, 25 of them in three ticks; the goal is the target to a float's resolution.
    #[test]
    fn a_target_is_reached_in_its_tick() {
        let mut arm = arm();
        arm.target = Some([0.301; JOINTS]);
        arm.advance(1.0 / 120.0);
        assert!((arm.goal[0] - 0.301).abs() < 3e-7 && arm.goal[0] != 0.301, "{}", arm.goal[0]);
        assert_eq!(arm.fault, None);
    }

    /// The client waits for an arm that lags by 3 degrees; an arm that is displaced by more than 5 degrees is in fault.
    #[test]
    fn an_arm_that_lags() {
        let mut arm = arm();
        arm.target = Some([0.5; JOINTS]);
        for _ in 0..100 {
            arm.advance(1.0 / 120.0);
        }
        let lead = arm.goal[2] - 0.3;
        assert!(lead > 2.9_f64.to_radians() && lead <= 3_f64.to_radians() + 1e-6, "{lead}");
        assert_eq!(arm.fault, None);
        arm.measure(ArmState { position: [0.2; JOINTS].into(), ..ArmState::default() });
        arm.advance(1.0 / 120.0);
        assert_eq!(arm.fault, Some(ArmTrouble::Fault));
    }
}
