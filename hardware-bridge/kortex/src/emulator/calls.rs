//! The calls that the emulated arm answers.

use prost::Message;

use super::controller::{Commands, Controller, EventKind};
use super::devices::device_call;
use super::peer::Peer;
use super::plant::Drive;
use super::refusals::{
    COUNT_MISMATCH, IN_EMERGENCY_STOP, IN_FAULT, IN_LOW_LEVEL, INVALID_PARAMETER, INVALID_SESSION, MANUAL_STOP, No,
    UNKNOWN_USER, UNSUPPORTED_METHOD, WRONG_MODE, WRONG_PASSWORD, argument,
};
use super::subscription::Subscription;
use crate::call::{self, Call};
use crate::degrees;
use crate::frame::is_younger;
use crate::frame::{Frame, FrameKind, Header};
use crate::joints::JOINTS;
use crate::message::base::{
    ActuatorInformation, ArmStateInformation, JointAngle, JointAngles, JointSpeeds, Pose, ServoingMode,
    ServoingModeInformation,
};
use crate::message::cyclic::{ActuatorFeedback, BaseFeedback, Command, Feedback, SERVO_ENABLE};
use crate::message::device::ControlModeInformation;
use crate::message::session::CreateSessionInfo;
use crate::message::{ErrorMessage, NotificationHandle};

impl Controller {
    /// Returns the answer to a request.
    pub(super) fn answer(&mut self, peer: Peer, request: &Frame) -> Frame {
        let header = Header { kind: FrameKind::Response, ..request.header };
        match self.perform(peer, request) {
            Ok((session, payload)) => Frame { header: Header { session, ..header }, payload },
            Err((error, sub_error, text)) => {
                let (code, sub_code) = (u32::from(error), u32::from(sub_error));
                let payload = ErrorMessage { code, sub_code, text: text.to_owned() }.encode_to_vec();
                Frame { header: Header { error, sub_error, ..header }, payload }
            }
        }
    }

    /// Carries out a request. Returns the session and the payload of the answer.
    fn perform(&mut self, peer: Peer, request: &Frame) -> Result<(u16, Vec<u8>), No> {
        let Header { call, session, device, .. } = request.header;
        if call == call::CREATE_SESSION {
            return Ok((self.log_in(peer, request)?, Vec::new()));
        }
        if !self.sessions.hear(session, peer, call != call::KEEP_ALIVE, self.time) {
            return Err(INVALID_SESSION);
        }
        let payload = match call {
            call::REFRESH => self.refresh(request)?,
            call::REFRESH_FEEDBACK => self.feedback(0).encode_to_vec(),
            call::ARM_STATE_TOPIC | call::SERVOING_MODE_TOPIC | call::SAFETY_TOPIC | call::ACTION_TOPIC => {
                self.subscribe(peer, session, call, device)?
            }
            call::UNSUBSCRIBE => {
                let handle = argument::<NotificationHandle>(request)?.identifier as u16;
                self.subscriptions.retain(|known| (known.session, known.handle) != (session, handle));
                Vec::new()
            }
            call::SET_SERVOING_MODE => self.change_mode(session, request)?,
            call::SEND_JOINT_SPEEDS => self.follow_speeds(session, request)?,
            _ => match self.action_call(session, call, request).or_else(|| device_call(call, device)) {
                Some(result) => result?,
                None => self.simple(session, call, device)?,
            },
        };
        Ok((session, payload))
    }

    fn log_in(&mut self, peer: Peer, request: &Frame) -> Result<u16, No> {
        let login: CreateSessionInfo = argument(request)?;
        if login.user != self.settings.credentials.user {
            return Err(UNKNOWN_USER);
        }
        if login.password != self.settings.credentials.password {
            return Err(WRONG_PASSWORD);
        }
        let session = self.sessions.open(peer, &login, self.time);
        self.log(EventKind::SessionOpened(session));
        Ok(session)
    }

    /// Carries out calls without an argument.
    fn simple(&mut self, session: u16, call: Call, device: u8) -> Result<Vec<u8>, No> {
        Ok(match call {
            call::KEEP_ALIVE => Vec::new(),
            call::CLOSE_SESSION => {
                self.sessions.close(session);
                self.log(EventKind::SessionClosed(session));
                self.session_ended(session);
                Vec::new()
            }
            call::CLEAR_FAULTS => {
                if self.emergency_stop_pressed {
                    return Err(IN_EMERGENCY_STOP);
                }
                self.clear_faults();
                Vec::new()
            }
            call::STOP => {
                self.stop()?;
                Vec::new()
            }
            call::APPLY_EMERGENCY_STOP => {
                self.emergency_stop();
                Vec::new()
            }
            call::GET_ARM_STATE => ArmStateInformation { active_state: self.state() as i32 }.encode_to_vec(),
            call::GET_SERVOING_MODE => ServoingModeInformation { mode: self.mode as i32 }.encode_to_vec(),
            call::GET_ACTUATOR_COUNT => ActuatorInformation { count: JOINTS as u32 }.encode_to_vec(),
            call::GET_JOINT_ANGLES => {
                let angle = |(joint, angle): (u32, f64)| JointAngle { joint, value: degrees::to_wire_angle(angle) };
                JointAngles { joints: (0..).zip(self.motion().position).map(angle).collect() }.encode_to_vec()
            }
            call::GET_TOOL_POSE => {
                let pose = self.plant.tool_pose().ok_or(UNSUPPORTED_METHOD)?;
                let ([x, y, z], angles) = (pose.position.map(|metres| metres as f32), pose.angles);
                let [theta_x, theta_y, theta_z] = angles.map(degrees::to_degrees);
                Pose { x, y, z, theta_x, theta_y, theta_z }.encode_to_vec()
            }
            call::GET_CONTROL_MODE => {
                let mode = usize::from(device).checked_sub(1).and_then(|joint| self.control_modes.get(joint));
                ControlModeInformation { mode: *mode.ok_or(INVALID_PARAMETER)? }.encode_to_vec()
            }
            _ => return Err(UNSUPPORTED_METHOD),
        })
    }

    fn subscribe(&mut self, peer: Peer, session: u16, topic: Call, device: u8) -> Result<Vec<u8>, No> {
        if usize::from(device) > JOINTS {
            return Err(INVALID_PARAMETER);
        }
        let same = |known: &&Subscription| (known.topic.service, known.device) == (topic.service, device);
        let handle = self.subscriptions.iter().filter(same).map(|known| known.handle).max().unwrap_or(0) + 1;
        self.subscriptions.push(Subscription { topic, device, handle, peer, session });
        Ok(NotificationHandle { identifier: u32::from(handle) }.encode_to_vec())
    }

    pub(super) fn refuse_in_fault(&self) -> Result<(), No> {
        match (self.faults.is_emergency_stop(), self.faults.is_empty()) {
            (true, _) => Err(IN_EMERGENCY_STOP),
            (false, false) => Err(IN_FAULT),
            (false, true) => Ok(()),
        }
    }

    fn change_mode(&mut self, session: u16, request: &Frame) -> Result<Vec<u8>, No> {
        let mode = argument::<ServoingModeInformation>(request)?.mode();
        match mode {
            ServoingMode::LowLevel => {
                self.refuse_in_fault()?;
                self.in_control = Some(session);
            }
            ServoingMode::SingleLevel => {}
            _ => return Err(INVALID_PARAMETER),
        }
        self.set_mode(mode);
        Ok(Vec::new())
    }

    fn follow_speeds(&mut self, session: u16, request: &Frame) -> Result<Vec<u8>, No> {
        let speeds: JointSpeeds = argument(request)?;
        self.refuse_in_fault()?;
        if self.mode == ServoingMode::LowLevel {
            return Err(IN_LOW_LEVEL);
        }
        let mut wanted = [0.0; JOINTS];
        for speed in &speeds.joints {
            if !speed.value.is_finite() {
                return Err(INVALID_PARAMETER);
            }
            *wanted.get_mut(speed.joint as usize).ok_or(COUNT_MISMATCH)? = degrees::to_radians(speed.value);
        }
        self.abort_action(MANUAL_STOP);
        self.in_control = Some(session);
        self.drive = if wanted == [0.0; JOINTS] { Drive::Hold } else { Drive::Velocity(wanted) };
        Ok(Vec::new())
    }

    fn refresh(&mut self, request: &Frame) -> Result<Vec<u8>, No> {
        if self.mode != ServoingMode::LowLevel {
            return Err(WRONG_MODE);
        }
        let command: Command = argument(request)?;
        if command.actuators.len() != JOINTS {
            return Err(COUNT_MISMATCH);
        }
        if command.actuators.iter().any(|actuator| !actuator.position.is_finite()) {
            return Err(INVALID_PARAMETER);
        }
        if self.faults.is_empty() {
            self.follow(&command);
        }
        Ok(self.feedback(command.frame_id).encode_to_vec())
    }

    /// Follows a cyclic command, unless a younger one has arrived before it.
    fn follow(&mut self, command: &Command) {
        let number = command.frame_id as u16;
        if self.last_command.is_some_and(|(last, _)| !is_younger(number, last)) {
            return;
        }
        let position = self.motion().position;
        let wanted: [f64; JOINTS] = std::array::from_fn(|i| {
            let actuator = command.actuators[i];
            let enabled = actuator.flags & SERVO_ENABLE != 0;
            let angle = degrees::to_radians(actuator.position);
            if enabled { degrees::nearest_turn(angle, position[i]) } else { position[i] }
        });
        let Commands { followed, last, seed_error, largest_step } = &mut self.commands;
        (*followed, *last) = (*followed + 1, self.time);
        match self.last_command {
            None => *seed_error = (0..JOINTS).map(|i| (wanted[i] - position[i]).abs()).fold(0.0, f64::max),
            Some((before, angles)) => {
                let cycles = f64::from(number.wrapping_sub(before));
                for (i, largest) in largest_step.iter_mut().enumerate() {
                    *largest = largest.max(degrees::difference(wanted[i], angles[i]).abs() / cycles);
                }
            }
        }
        self.last_command = Some((number, wanted));
        self.drive = Drive::Position(wanted);
    }

    fn feedback(&self, frame_id: u32) -> Feedback {
        let motion = self.motion();
        let base = BaseFeedback {
            active_state: self.state() as i32,
            arm_voltage: 24.0,
            fault_bank_a: self.faults.base.a,
            fault_bank_b: self.faults.base.b,
            ..BaseFeedback::default()
        };
        let actuator = |i: usize| ActuatorFeedback {
            command_id: frame_id,
            position: degrees::to_wire_angle(motion.position[i]),
            velocity: degrees::to_degrees(motion.velocity[i]),
            torque: motion.torque[i] as f32,
            voltage: 24.0,
            motor_temperature: 30.0,
            core_temperature: 30.0,
            fault_bank_a: self.faults.joints[i].a,
            fault_bank_b: self.faults.joints[i].b,
            ..ActuatorFeedback::default()
        };
        Feedback { frame_id, base: Some(base), actuators: (0..JOINTS).map(actuator).collect() }
    }
}
