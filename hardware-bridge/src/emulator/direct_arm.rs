//! The arm of [`super::direct`]: the operations of the Gen3 client and the emulated Gen3 on set-points and
//! measurements, as arithmetic.

use hand_model::arm::Arm as ArmModel;
use hand_model::robot::ArmState;
use kinova_kortex::CommandError;
use kinova_kortex::degrees::{Turns, nearest_turn, to_degrees, to_radians, to_wire_angle};
use kinova_kortex::emulator::Settings;
use kinova_kortex::joints::JOINTS;
use kinova_kortex::servoing::Limits;

use super::lockstep_arm::{step_towards, whole_milliseconds};
use crate::kortex_link::{limits, of_gen3};
use crate::safety::state::ArmTrouble;

/// An arm that is commanded at 1 kHz, and its client.
pub(super) struct DirectArm {
    limits: Limits,
    following_error: f64,
    turns: Turns,
    /// Remainder of a millisecond, s.
    rest: f64,
    /// Newest command, rad, before its conversion to single-precision degrees.
    command: [f64; JOINTS],
    /// State of the plant's arm; `seen` is the client's measurement of it.
    real: ArmState,
    seen: ArmState,
    /// Goal of the arm's controller for the plant's joints, rad.
    pub goal: hand_model::ArmVector,
    /// Set-points from the supervisor, rad.
    pub target: Option<[f64; JOINTS]>,
    /// Trouble that has stopped the arm.
    pub fault: Option<ArmTrouble>,
}

impl DirectArm {
    /// Creates an engaged arm of this model in the state `real`.
    pub fn new(model: &ArmModel, real: ArmState) -> Self {
        let mut arm = Self {
            limits: limits(model),
            following_error: Settings::default().following_error,
            turns: Turns::near(of_gen3(&real.position)),
            rest: 0.0,
            command: of_gen3(&real.position),
            real,
            seen: real,
            goal: real.position,
            target: None,
            fault: None,
        };
        // The first command is the measured position.
        arm.command = of_gen3(&arm.look(real).position);
        arm
    }

    /// Updates the state of the plant's arm to `real`; returns the client's measurement of it.
    pub fn look(&mut self, real: ArmState) -> ArmState {
        self.real = real;
        self.seen = ArmState {
            position: self.turns.read(of_gen3(&real.position).map(to_wire_angle)).into(),
            velocity: real.velocity.iter().map(|&speed| to_radians(to_degrees(speed))).collect(),
            torque: real.torque.iter().map(|&torque| f64::from(torque as f32)).collect(),
        };
        self.seen
    }

    /// Runs the milliseconds of a tick of `seconds`: equal steps towards the target, each checked, rounded and
    /// followed.
    pub fn pass(&mut self, seconds: f64) {
        let milliseconds = whole_milliseconds(&mut self.rest, seconds);
        for n in 0..milliseconds {
            if self.fault.is_some() {
                return;
            }
            let target = self.target.unwrap_or(self.command);
            let next = step_towards(&target, &self.command, milliseconds - n, &self.limits.step);
            match self.limits.check(&next, &self.command, &of_gen3(&self.seen.position)) {
                Ok(()) => self.command = next,
                // The client waits for an arm that lags too far behind.
                Err(CommandError::Lead { .. }) => {}
                Err(_) => self.fault = Some(ArmTrouble::Refused),
            }
            let position = self.real.position;
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
        arm.pass(1.0 / 120.0);
        assert!((arm.goal[0] - 0.301).abs() < 3e-7 && arm.goal[0] != 0.301, "{}", arm.goal[0]);
        assert_eq!(arm.fault, None);
    }

    /// The client waits for an arm that lags by 3 degrees; an arm that is displaced by more than 5 degrees is in fault.
    #[test]
    fn an_arm_that_lags() {
        let mut arm = arm();
        arm.target = Some([0.5; JOINTS]);
        for _ in 0..100 {
            arm.pass(1.0 / 120.0);
        }
        let lead = arm.goal[2] - 0.3;
        assert!(lead > 2.9_f64.to_radians() && lead <= 3_f64.to_radians() + 1e-6, "{lead}");
        assert_eq!(arm.fault, None);
        arm.look(ArmState { position: [0.2; JOINTS].into(), ..ArmState::default() });
        arm.pass(1.0 / 120.0);
        assert_eq!(arm.fault, Some(ArmTrouble::Fault));
    }
}
