use hand_model::transmission::friction::CableFriction;
use std::path::Path;
use tactile_perception::PhotometricCalibration;

use hand_model::robot::{Observation, Readings, ServoState, Tick};
use hand_model::{Arm, RobotModel};

use super::*;

/// An arm that follows its commands, except for one joint that is not sent beyond a limit.
#[derive(Default)]
struct LimitedArm {
    time: f64,
    sent: ArmVector,
    /// Index of the joint, and its greatest angle (rad).
    limit: Option<(usize, f64)>,
    /// Interval in which it cannot be observed, s.
    silent: std::ops::Range<f64>,
}

impl LimitedArm {
    fn new(limit: Option<(usize, f64)>) -> Self {
        Self { sent: Arm::gen3().home, limit, ..Self::default() }
    }
}

impl RobotBackend for LimitedArm {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        if self.silent.contains(&self.time) {
            return Err(RobotError::ConnectionLost("no answer".to_owned()));
        }
        let arm = ArmState { position: self.sent, ..ArmState::default() };
        let servos = [ServoState::default(); 6].into();
        Ok(Observation { time: self.time, servos, arm, ..Observation::default() }.into())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.sent = command.arm;
        if let Some((joint, most)) = self.limit {
            self.sent[joint] = self.sent[joint].min(most);
        }
        Ok(RobotCommand { arm: self.sent, ..*command })
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.time += self.tick_length();
        Tick { time: self.time, lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        1.0 / 120.0
    }
}

/// Returns a script with one motion in the ready posture, and one with joint 6 turned by 0.9 rad.
fn script() -> ExcitationScript {
    let mut script = ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid");
    script.posture.retain(|posture| ["ready", "fingers up"].contains(&posture.name.as_str()));
    script.motion.truncate(1);
    (script.ball, script.payload) = (None, None);
    script
}

/// Returns the result of an excitation of `robot`, and the completed steps.
fn finished(mut robot: LimitedArm) -> (Result<bool, ExcitationError>, Vec<usize>) {
    let (model, script) = (RobotModel::ftac_gen3(), script());
    let text = include_str!("../../../bench/data/calibration.json");
    let pads = PhotometricCalibration::parse(text, Path::new("calibration.json")).expect("a calibration");
    let friction = CableFriction::NONE;
    let means =
        ExcitationSetup { robot: &model, pads: &pads, script: &script, grasps: &[], friction, ready: Arm::gen3().home };
    let mut done = Vec::new();
    let heard = |progress| {
        if let ExcitationProgress::Done(step) = progress {
            done.push(step);
        }
        Ok(())
    };
    (run_script(&mut robot, &means, 0, heard, |_| true), done)
}

#[test]
fn an_arm_that_goes_where_it_is_asked_is_played_on() {
    assert_eq!(finished(LimitedArm::new(None)), (Ok(true), vec![0, 1]));
}

/// The excitation waits for a robot that cannot be observed for a while. If the robot stays silent, the excitation ends
/// with the robot's own error.
#[test]
fn a_silent_robot_is_borne_for_a_while() {
    let (ended, done) = finished(LimitedArm { silent: 1.0..1.3, ..LimitedArm::new(None) });
    assert_eq!((ended, done), (Ok(true), vec![0, 1]));
    let (ended, _) = finished(LimitedArm { silent: 1.0..f64::INFINITY, ..LimitedArm::new(None) });
    assert_eq!(ended, Err(ExcitationError::Robot(RobotError::ConnectionLost("no answer".to_owned()))));
}

/// If the robot does not send the arm further, the error names the joint, and completed steps remain done.
#[test]
fn an_arm_that_is_held_stops_the_excitation() {
    let most = Arm::gen3().home[5] + 0.4;
    let (ended, done) = finished(LimitedArm::new(Some((5, most))));
    let Err(ExcitationError::Held(held)) = ended else { panic!("{ended:?}") };
    assert_eq!((held.joint, held.sent, done.as_slice()), (6, most, &[0][..]), "{held}");
    assert!(held.requested > most + 0.02 && held.since > 1.0, "{held}");
    assert!(held.to_string().contains("joint 6 of the arm is held by the robot: asked for"), "{held}");
}
