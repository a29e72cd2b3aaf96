//! What a policy is asked, as JSON: from measurements and estimates alone.

use control::action::{Action, ActionLimits, ArmAction, HandAction};
use control::policy::chosen::{Aim, Answer, Situation};
use control::worth::Candidate;
use hand_model::robot::{ArmState, ServoState};
use hand_model::{DigitVector, Hand};
use nalgebra::Isometry3;
use serde::Deserialize;
use serde_json::{Value, json};

use super::host::HostError;

/// x, y, z (m) and the quaternion's x, y, z, w, whose w is not negative: one pose has one row.
pub fn pose_row(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [t.x, t.y, t.z, sign * q.x, sign * q.y, sign * q.z, sign * q.w]
}

/// A row a servo: angle (rad), speed (rad/s), current (A).
pub fn servo_rows(servos: &[ServoState]) -> Vec<[f64; 3]> {
    servos.iter().map(|servo| [servo.position, servo.velocity, servo.current]).collect()
}

/// A row a joint: angle (rad), speed (rad/s), torque (N m).
pub fn arm_rows(arm: &ArmState) -> Vec<[f64; 3]> {
    (0..arm.position.len()).map(|n| [arm.position[n], arm.velocity[n], arm.torque[n]]).collect()
}

/// What a policy is told before a trial.
#[derive(Debug, Clone)]
pub struct Info<'a> {
    pub combination: usize,
    pub trial: usize,
    /// For what is random in the policy; it says nothing of what is random in the trial.
    pub seed: u32,
    pub objects: Vec<&'a str>,
    /// Turns about the vertical from the rest pose, as seen, rad.
    pub yaws: Vec<f64>,
    pub limits: &'a ActionLimits,
}

/// A trial begins. To a policy that acts and wants images belongs an array: pictures of the untouched pads.
pub fn reset(info: &Info) -> Value {
    json!({
        "ask": "reset",
        "info": {
            "combination": info.combination, "trial": info.trial, "seed": info.seed, "objects": info.objects, "yaws": info.yaws,
        },
        "opposition": info.limits.opposition,
    })
}

/// How the second object is to be taken. Arrays that belong to it: the situation's images, then those of all untouched pads, one a camera.
pub fn choose(hand: &Hand, situation: &Situation) -> Value {
    let camera = |camera: usize| hand.cameras.get(camera).map_or("", |camera| camera.name.as_str());
    let covariance = situation.felt.map(|felt| {
        let matrix = &felt.estimate.covariance;
        (0..6).map(|row| (0..6).map(|column| matrix[(row, column)]).collect()).collect::<Vec<Vec<f64>>>()
    });
    let candidate = |candidate: &Candidate| json!({ "grasp": candidate.grasp, "worth": candidate.worth });
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
            "seen": situation.seen.iter().map(|seen| pose_row(&seen.pose())).collect::<Vec<_>>(),
            "yaws": situation.seen.iter().map(|seen| seen.yaw).collect::<Vec<_>>(),
            "sees_second": situation.sees_second,
            "held": situation.felt.map(|felt| pose_row(&felt.estimate.palm_from_object)),
            "held_covariance": covariance,
            "grip": (0..situation.objects.len()).map(|object| situation.grip.holds(object)).collect::<Vec<_>>(),
            "first": situation.first,
            "candidates": situation.candidates.iter().map(candidate).collect::<Vec<_>>(),
        },
    })
}

/// What a policy that acts is told.
pub struct Observed<'a> {
    /// s since the robot was started.
    pub time: f64,
    /// Until the trial has failed, s.
    pub time_left: f64,
    pub servos: &'a [ServoState],
    pub arm: &'a ArmState,
    /// `world_from_palm` by the arm's encoders.
    pub palm: Isometry3<f64>,
    /// `world_from_object` as vision reported it when the trial began.
    pub seen: Vec<Isometry3<f64>>,
}

/// What is to be done in the coming step.
pub fn act(observed: &Observed) -> Value {
    json!({
        "ask": "act",
        "observation": {
            "time": observed.time,
            "time_left": observed.time_left,
            "servos": servo_rows(observed.servos),
            "arm": arm_rows(observed.arm),
            "palm": pose_row(&observed.palm),
            "seen": observed.seen.iter().map(pose_row).collect::<Vec<_>>(),
        },
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Chosen {
    /// Place among the candidates, x and y (m) and turn (rad) of the aim.
    choice: Option<(usize, f64, f64, f64)>,
}

/// The answer to [`choose`].
pub fn chosen(answer: Value) -> Result<Answer, HostError> {
    let Chosen { choice } = read(answer)?;
    Ok(choice.map_or(Answer::Keep, |(candidate, x, y, yaw)| Answer::Take { candidate, aim: Aim { x, y, yaw } }))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Acted {
    action: Option<Asked>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    twist: [f64; 6],
    tensions: DigitVector,
    opposition: f64,
}

/// The answer to [`act`]; `None`: the policy has finished.
pub fn acted(answer: Value) -> Result<Option<Action>, HostError> {
    let Acted { action } = read(answer)?;
    Ok(action.map(|Asked { twist, tensions, opposition }| Action {
        arm: ArmAction::Twist(twist.into()),
        hand: HandAction::Tensions { tensions, opposition },
    }))
}

fn read<T: serde::de::DeserializeOwned>(answer: Value) -> Result<T, HostError> {
    serde_json::from_value(answer).map_err(|error| HostError::Answer(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_read_and_others_are_refused_in_words() {
        let aim = Aim { x: 0.01, y: -0.02, yaw: 0.5 };
        assert_eq!(chosen(json!({ "choice": [3, 0.01, -0.02, 0.5] })).unwrap(), Answer::Take { candidate: 3, aim });
        assert_eq!(chosen(json!({ "choice": null })).unwrap(), Answer::Keep);
        assert!(acted(json!({ "action": null })).unwrap().is_none());
        let row = json!({ "twist": [0, 0, 0.1, 0, 0, 0], "tensions": [1, 2, 3, 4, 5], "opposition": 0.3 });
        let action = acted(json!({ "action": row })).unwrap().unwrap();
        assert_eq!(action.hand, HandAction::Tensions { tensions: [1.0, 2.0, 3.0, 4.0, 5.0].into(), opposition: 0.3 });
        for (answer, words) in [
            (json!({ "choice": [-1, 0, 0, 0] }), "invalid value"),
            (json!({ "choice": "left" }), "invalid type"),
            (json!({ "answer": null }), "unknown field `answer`"),
        ] {
            let error = chosen(answer).unwrap_err().to_string();
            assert!(error.starts_with("the policy's answer: ") && error.contains(words), "{error}");
        }
        let short = json!({ "action": { "twist": [0, 0], "tensions": [1, 2, 3, 4, 5], "opposition": 0 } });
        assert!(acted(short).unwrap_err().to_string().contains("invalid length 2"));
    }

    #[test]
    fn a_pose_has_one_row() {
        let pose = Isometry3::new(nalgebra::Vector3::new(0.1, 0.2, 0.3), nalgebra::Vector3::new(0.0, 0.0, 4.0));
        let row = pose_row(&pose);
        assert!(row[6] >= 0.0 && (row[..3] == [0.1, 0.2, 0.3]), "{row:?}");
    }
}
