//! For any request, the emulated arm answers, does not panic, and keeps a finite posture.

use kinova_kortex::emulator::{Controller, FirstOrderJoints, Peer, Settings};
use kinova_kortex::frame::{Frame, FrameKind, Header};
use kinova_kortex::message::action::{Action, ActionHandle, ConstrainedJointAngles, JointConstraint};
use kinova_kortex::message::base::{
    JointAngle, JointAngles, JointSpeed, JointSpeeds, ServoingMode, ServoingModeInformation,
};
use kinova_kortex::message::cyclic::{ActuatorCommand, Command};
use kinova_kortex::message::session::CreateSessionInfo;
use kinova_kortex::{JOINTS, call};
use proptest::prelude::*;
use prost::Message;

const PEER: Peer = Peer::Tcp(1);

fn request(call: call::Call, session: u16, payload: Vec<u8>) -> Frame {
    let kind = FrameKind::Request;
    Frame { header: Header { kind, device: 0, error: 0, sub_error: 0, session, message: 1, call }, payload }
}

fn angle() -> impl Strategy<Value = f32> {
    prop_oneof![3 => -400.0..800.0_f32, 1 => prop::num::f32::ANY]
}

fn payload() -> impl Strategy<Value = Vec<u8>> {
    let angles = prop::collection::vec(angle(), JOINTS - 1..=JOINTS + 1);
    let constraint = prop::option::of((0..4_i32, angle()).prop_map(|(kind, value)| JointConstraint { kind, value }));
    let known = (angles, constraint).prop_map(|(angles, constraint)| {
        let joints = (0..).zip(angles).map(|(joint, value)| JointAngle { joint, value }).collect();
        let angles = Some(JointAngles { joints });
        let reach_joint_angles = Some(ConstrainedJointAngles { angles, constraint });
        Action { handle: None, name: String::new(), reach_joint_angles }.encode_to_vec()
    });
    let reference =
        (0..6_u32).prop_map(|identifier| ActionHandle { identifier, ..ActionHandle::default() }.encode_to_vec());
    let speeds = prop::collection::vec((0..9_u32, angle()), 0..9).prop_map(|speeds| {
        let joints = speeds.into_iter().map(|(joint, value)| JointSpeed { joint, value }).collect();
        JointSpeeds { joints }.encode_to_vec()
    });
    let mode = prop::sample::select(&[ServoingMode::SingleLevel, ServoingMode::LowLevel][..])
        .prop_map(|mode| ServoingModeInformation { mode: mode as i32 }.encode_to_vec());
    let cyclic = (any::<u32>(), prop::collection::vec(angle(), JOINTS)).prop_map(|(frame_id, angles)| {
        let actuators = angles.iter().map(|position| ActuatorCommand { command_id: 1, flags: 1, position: *position });
        Command { frame_id, actuators: actuators.collect() }.encode_to_vec()
    });
    prop_oneof![4 => known, 2 => speeds, 1 => mode, 2 => cyclic, 2 => reference, 1 => prop::collection::vec(any::<u8>(), 0..40)]
}

proptest! {
    #[test]
    fn answered(asked in prop::collection::vec((0..15_usize, payload(), 0..400_u32), 1..12)) {
        let plant = FirstOrderJoints::new([0.0; JOINTS], 0.02, [1.3; JOINTS]);
        let settings = Settings::default();
        let (user, password) = (settings.credentials.user.clone(), settings.credentials.password.clone());
        let mut arm = Controller::new(settings, Box::new(plant));
        let login = CreateSessionInfo { user, password, ..CreateSessionInfo::default() };
        let answers = arm.receive(PEER, &request(call::CREATE_SESSION, 0, login.encode_to_vec()));
        let session = answers[0].1.header.session;
        let calls = [
            call::EXECUTE_ACTION, call::EXECUTE_ACTION, call::EXECUTE_ACTION_FROM_REFERENCE, call::PAUSE_ACTION,
            call::RESUME_ACTION, call::STOP_ACTION, call::STOP, call::READ_ACTION, call::READ_ALL_ACTIONS,
            call::ACTION_TOPIC, call::SET_SERVOING_MODE, call::SEND_JOINT_SPEEDS, call::GET_TOOL_POSE,
            call::CLEAR_FAULTS, call::REFRESH,
        ];
        for (place, payload, milliseconds) in asked {
            let answers = arm.receive(PEER, &request(calls[place], session, payload));
            prop_assert_eq!(answers.iter().filter(|(_, frame)| frame.header.kind == FrameKind::Response).count(), 1);
            for _ in 0..milliseconds {
                arm.tick();
            }
            prop_assert!(arm.status().motion.position.iter().all(|angle| angle.is_finite()));
        }
    }
}
