//! Questions to a policy, as JSON. They contain only measurements and estimates.

use control::action::{Action, ActionLimits, ArmAction, HandAction};
use control::policy::chooser::{AimOffset, ChooserDecision, ChooserSituation};
use control::score::GraspCandidate;
use hand_model::robot::{ArmState, ServoState};
use hand_model::{ActuatorVector, ArmVector, DigitVector, Hand};
use nalgebra::Isometry3;
use serde::Deserialize;
use serde_json::{Value, json};
use world::objects::ObjectModel;

use super::server::PolicyServerError;

/// Pose as x, y, z (m) and the quaternion's x, y, z, w. Its w is not negative, so that each pose has one
/// representation.
pub fn pose_row(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [t.x, t.y, t.z, sign * q.x, sign * q.y, sign * q.z, sign * q.w]
}

/// One row per servo: angle (rad), speed (rad/s), current (A).
pub fn servo_rows(servos: &[ServoState]) -> Vec<[f64; 3]> {
    servos.iter().map(|servo| [servo.position, servo.velocity, servo.current]).collect()
}

/// One row per joint: angle (rad), speed (rad/s), torque (N m).
pub fn arm_rows(arm: &ArmState) -> Vec<[f64; 3]> {
    (0..arm.position.len()).map(|n| [arm.position[n], arm.velocity[n], arm.torque[n]]).collect()
}

/// Information for a policy before a trial.
#[derive(Debug, Clone)]
pub struct TrialInfo<'a> {
    pub combination: usize,
    pub trial: usize,
    /// Seed for the random numbers of the policy. It reveals nothing about the random numbers of the trial.
    pub seed: u32,
    /// Objects as known to the controller, in order.
    pub objects: Vec<&'a ObjectModel>,
    /// Yaws of the objects from their rest poses, as detected, rad.
    pub yaws: Vec<f64>,
    pub limits: &'a ActionLimits,
}

/// Question at the beginning of a trial. For a policy that acts and wants images, an array with the images of the
/// untouched pads accompanies it.
pub fn reset_question(info: &TrialInfo) -> Value {
    json!({
        "ask": "reset",
        "info": {
            "combination": info.combination,
            "trial": info.trial,
            "seed": info.seed,
            "objects": info.objects.iter().map(|object| &object.name).collect::<Vec<_>>(),
            "yaws": info.yaws,
        },
        "object_features": info.objects.iter().map(|object| object.features()).collect::<Vec<_>>(),
        "limits": {
            "tension": info.limits.tension,
            "opposition": info.limits.opposition,
            "spools": &info.limits.spools[..],
            "joints": &info.limits.joints[..],
        },
    })
}

/// Question how to take the second object. Accompanying arrays: the images of the situation, then those of all
/// untouched pads, one per camera.
pub fn choose_question(hand: &Hand, situation: &ChooserSituation) -> Value {
    let camera = |camera: usize| hand.cameras.get(camera).map_or("", |camera| camera.name.as_str());
    let covariance = situation.felt.map(|felt| {
        let matrix = &felt.estimate.covariance;
        (0..6).map(|row| (0..6).map(|column| matrix[(row, column)]).collect()).collect::<Vec<Vec<f64>>>()
    });
    let candidate = |candidate: &GraspCandidate| json!({ "grasp": candidate.grasp, "score": candidate.score });
    json!({
        "ask": "choose",
        "cameras": situation.images.iter().map(|frame| camera(frame.camera)).collect::<Vec<_>>(),
        "untouched": hand.cameras.iter().map(|camera| &camera.name).collect::<Vec<_>>(),
        "situation": {
            "phase": if situation.phase.has_lifted(1) { "confirm" } else { "decide" },
            "time": situation.time,
            "time_left": situation.time_left,
            "tries": situation.tries,
            "servos": servo_rows(situation.servos),
            "arm": arm_rows(situation.arm),
            "palm": pose_row(&situation.palm),
            "objects": situation.objects,
            "detected": situation.detected.iter().map(|object| pose_row(&object.pose())).collect::<Vec<_>>(),
            "yaws": situation.detected.iter().map(|object| object.yaw).collect::<Vec<_>>(),
            "second_is_visible": situation.second_is_visible,
            "in_hand": situation.felt.map(|felt| pose_row(&felt.estimate.palm_from_object)),
            "in_hand_covariance": covariance,
            "holding": (0..situation.objects.len()).map(|object| situation.hold_state.holds(object)).collect::<Vec<_>>(),
            "first": situation.first,
            "candidates": situation.candidates.iter().map(candidate).collect::<Vec<_>>(),
        },
    })
}

/// Observation for a policy that acts.
pub struct PolicyObservation<'a> {
    /// Time since the robot was started, s.
    pub time: f64,
    /// Time left until the trial fails, s.
    pub time_left: f64,
    pub servos: &'a [ServoState],
    pub arm: &'a ArmState,
    /// `world_from_palm` from the arm's encoders.
    pub palm: Isometry3<f64>,
    /// `world_from_object` of each object, as detected at the start of the trial.
    pub detected_poses: Vec<Isometry3<f64>>,
}

/// Question for the action of the coming step.
pub fn act_question(observed: &PolicyObservation) -> Value {
    json!({
        "ask": "act",
        "observation": {
            "time": observed.time,
            "time_left": observed.time_left,
            "servos": servo_rows(observed.servos),
            "arm": arm_rows(observed.arm),
            "palm": pose_row(&observed.palm),
            "detected": observed.detected_poses.iter().map(pose_row).collect::<Vec<_>>(),
        },
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChoiceAnswer {
    /// Index of the candidate, and x and y (m) and yaw (rad) of the aim's offset; `None` to keep the contents of the
    /// hand.
    choice: Option<(usize, f64, f64, f64)>,
}

/// Reads the answer to [`choose_question`].
pub fn parse_choice(answer: Value) -> Result<ChooserDecision, PolicyServerError> {
    let ChoiceAnswer { choice } = read(answer)?;
    Ok(choice.map_or(ChooserDecision::Keep, |(candidate, x, y, yaw)| ChooserDecision::Take {
        candidate,
        aim: AimOffset { x, y, yaw },
    }))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActionAnswer {
    action: Option<RequestedAction>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RequestedAction {
    arm: RequestedArm,
    hand: RequestedHand,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum RequestedArm {
    Twist([f64; 6]),
    Joints(ArmVector<f64>),
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum RequestedHand {
    Tensions { tensions: DigitVector, opposition: f64 },
    Spools(ActuatorVector<f64>),
}

/// Reads the answer to [`act_question`]; `None` if the policy has finished.
pub fn parse_action(answer: Value) -> Result<Option<Action>, PolicyServerError> {
    let ActionAnswer { action } = read(answer)?;
    Ok(action.map(|RequestedAction { arm, hand }| Action {
        arm: match arm {
            RequestedArm::Twist(twist) => ArmAction::Twist(twist.into()),
            RequestedArm::Joints(joints) => ArmAction::Joints(joints),
        },
        hand: match hand {
            RequestedHand::Tensions { tensions, opposition } => HandAction::Tensions { tensions, opposition },
            RequestedHand::Spools(spools) => HandAction::Spools(spools),
        },
    }))
}

fn read<T: serde::de::DeserializeOwned>(answer: Value) -> Result<T, PolicyServerError> {
    serde_json::from_value(answer).map_err(|error| PolicyServerError::InvalidAnswer(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_read_and_others_are_refused_in_words() {
        let aim = AimOffset { x: 0.01, y: -0.02, yaw: 0.5 };
        assert_eq!(
            parse_choice(json!({ "choice": [3, 0.01, -0.02, 0.5] })).unwrap(),
            ChooserDecision::Take { candidate: 3, aim }
        );
        assert_eq!(parse_choice(json!({ "choice": null })).unwrap(), ChooserDecision::Keep);
        assert!(parse_action(json!({ "action": null })).unwrap().is_none());
        let hand = json!({ "tensions": { "tensions": [1, 2, 3, 4, 5], "opposition": 0.3 } });
        let row = json!({ "arm": { "twist": [0, 0, 0.1, 0, 0, 0] }, "hand": hand });
        let action = parse_action(json!({ "action": row })).unwrap().unwrap();
        assert_eq!(action.hand, HandAction::Tensions { tensions: [1.0, 2.0, 3.0, 4.0, 5.0].into(), opposition: 0.3 });
        for (answer, words) in [
            (json!({ "choice": [-1, 0, 0, 0] }), "invalid value"),
            (json!({ "choice": "left" }), "invalid type"),
            (json!({ "answer": null }), "unknown field `answer`"),
        ] {
            let error = parse_choice(answer).unwrap_err().to_string();
            assert!(error.starts_with("the policy's answer: ") && error.contains(words), "{error}");
        }
        let joints = json!({ "arm": { "joints": [0, 1, 2, 3, 4, 5, 6] }, "hand": { "spools": [1, 2, 3, 4, 5, 6] } });
        let action = parse_action(json!({ "action": joints })).unwrap().unwrap();
        assert!(matches!(action.hand, HandAction::Spools(spools) if spools[5] == 6.0), "{action:?}");
        assert!(matches!(action.arm, ArmAction::Joints(joints) if joints[6] == 6.0), "{action:?}");
        let short = json!({ "action": { "arm": { "twist": [0, 0] }, "hand": hand } });
        assert!(parse_action(short).unwrap_err().to_string().contains("invalid length 2"));
    }

    #[test]
    fn a_pose_has_one_row() {
        let pose = Isometry3::new(nalgebra::Vector3::new(0.1, 0.2, 0.3), nalgebra::Vector3::new(0.0, 0.0, 4.0));
        let row = pose_row(&pose);
        assert!(row[6] >= 0.0 && (row[..3] == [0.1, 0.2, 0.3]), "{row:?}");
    }
}
