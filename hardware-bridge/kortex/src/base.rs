//! The high-level interface of the arm, over TCP: modes, faults, measured angles, joint speeds, devices, notifications.

pub mod actions;
mod devices;

use std::net::SocketAddr;

pub use devices::Device;
use prost::Message;

use crate::call::{self, Call};
use crate::degrees;
use crate::error::{CommandError, KortexError};
use crate::joints::{JOINTS, ToolPose};
use crate::link::TcpLink;
use crate::message::action::{ActionEvent, ActionNotification};
use crate::message::base::{
    ActuatorInformation, ArmStateInformation, JointAngles, JointSpeed, JointSpeeds, Pose, ServoingMode,
    ServoingModeInformation,
};
use crate::message::device::{SafetyNotification, SafetyStatus};
use crate::message::{ArmState, Empty, NotificationHandle, NotificationOptions};
use crate::session::{Credentials, Session, Timeouts, decode};
use crate::tap::Tap;

/// A message that the arm sends unasked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notification {
    /// Its state changed.
    ArmState(ArmState),
    /// A session changed the servoing mode.
    ServoingMode(ServoingMode),
    /// A safety of a device was raised or cleared.
    Safety {
        /// Address of the device; 0 is the base.
        device: u8,
        /// Bit of the safety in the device's bank A.
        bit: u32,
        /// New status.
        status: SafetyStatus,
    },
    /// An action began, ended, paused or was aborted.
    Action {
        /// Identifier of the action; 0 for one that the arm does not store.
        id: u32,
        /// Progress that is reported.
        event: ActionEvent,
        /// For an abort, the arm's number for the reason ([`crate::refusal::Refusal::sub_code`]).
        why: u32,
    },
}

/// Topics that can be subscribed to.
const TOPICS: [Call; 3] = [call::ARM_STATE_TOPIC, call::SERVOING_MODE_TOPIC, call::SAFETY_TOPIC];

/// The arm's high-level interface.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// use kinova_kortex::message::ArmState;
/// use kinova_kortex::message::action::ActionType;
///
/// assert_eq!(arm.base.arm_state()?, ArmState::ServoingReady);
/// assert_eq!(arm.base.actuators()?.len(), 7);
/// for action in arm.base.actions(ActionType::ReachJointAngles)? {
///     println!("{}: {}", action.id, action.name);
/// }
/// // A motion that the arm carries out by itself, in 2 s.
/// let mut angles = arm.base.joint_angles()?;
/// angles[6] += 0.1;
/// arm.base.reach_joint_angles(&angles, Some(2.0))?;
/// arm.base.stop()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Base {
    session: Session<TcpLink>,
    /// Topic, device and handle of every subscription. Handles are counted per service and device.
    subscriptions: Vec<(Call, u8, u16)>,
}

impl Base {
    /// Connects and logs in.
    ///
    /// # Errors
    /// The link's and the login's.
    pub fn connect(address: SocketAddr, credentials: &Credentials, timeouts: Timeouts) -> Result<Self, KortexError> {
        let link = TcpLink::connect(address, timeouts.call)?;
        let session = Session::create(link, credentials, timeouts, call::GET_ARM_STATE)?;
        Ok(Self { session, subscriptions: Vec::new() })
    }

    /// Returns the session of this interface, for its number and timeouts.
    pub fn session(&self) -> &Session<TcpLink> {
        &self.session
    }

    /// Copies everything that crosses the connection from now on into `tap`.
    pub fn tap(&mut self, tap: Tap) {
        self.session.tap(tap);
    }

    /// Keeps the session alive without waiting; call it every few milliseconds.
    ///
    /// # Errors
    /// As [`Session::keep_up`].
    pub fn keep_up(&mut self) -> Result<(), KortexError> {
        self.session.keep_up()
    }

    /// Logs out.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn close(self) -> Result<(), KortexError> {
        self.session.close()
    }

    fn ask<A: Message + Default>(&mut self, call: Call) -> Result<A, KortexError> {
        self.session.call(call, 0, &Empty {})
    }

    /// Clears every fault whose cause is gone.
    ///
    /// # Errors
    /// As [`Session::call`]; refused while the emergency stop is pressed.
    pub fn clear_faults(&mut self) -> Result<(), KortexError> {
        self.ask::<Empty>(call::CLEAR_FAULTS).map(|_| ())
    }

    /// Stops all motion, high-level mode only.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn stop(&mut self) -> Result<(), KortexError> {
        self.ask::<Empty>(call::STOP).map(|_| ())
    }

    /// Stops the arm and leaves it in fault, in any mode. Sends the call twice, as the maker's ROS 2 driver does,
    /// because single calls have been seen to have no effect. The second call is made even if the first fails.
    ///
    /// # Errors
    /// The second call's.
    pub fn emergency_stop(&mut self) -> Result<(), KortexError> {
        drop(self.ask::<Empty>(call::APPLY_EMERGENCY_STOP));
        self.ask::<Empty>(call::APPLY_EMERGENCY_STOP).map(|_| ())
    }

    /// Returns the state of the arm.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn arm_state(&mut self) -> Result<ArmState, KortexError> {
        Ok(self.ask::<ArmStateInformation>(call::GET_ARM_STATE)?.active_state())
    }

    /// Returns the servoing mode, which says who moves the joints.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn servoing_mode(&mut self) -> Result<ServoingMode, KortexError> {
        Ok(self.ask::<ServoingModeInformation>(call::GET_SERVOING_MODE)?.mode())
    }

    /// Sets the servoing mode.
    ///
    /// # Errors
    /// As [`Session::call`]; refused in fault.
    pub fn set_servoing_mode(&mut self, mode: ServoingMode) -> Result<(), KortexError> {
        let argument = ServoingModeInformation { mode: mode as i32 };
        self.session.call::<Empty>(call::SET_SERVOING_MODE, 0, &argument).map(|_| ())
    }

    /// Returns the number of joints of the arm.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn actuator_count(&mut self) -> Result<u32, KortexError> {
        Ok(self.ask::<ActuatorInformation>(call::GET_ACTUATOR_COUNT)?.count)
    }

    /// Returns the measured pose of the tool in the arm's base frame, with the tool as configured on its web page.
    ///
    /// # Errors
    /// As [`Session::call`]; [`KortexError::Answer`] for a pose that is not finite.
    pub fn tool_pose(&mut self) -> Result<ToolPose, KortexError> {
        let call = call::GET_TOOL_POSE;
        let Pose { x, y, z, theta_x, theta_y, theta_z } = self.ask(call)?;
        if ![x, y, z, theta_x, theta_y, theta_z].iter().all(|value| value.is_finite()) {
            let found = format!("{:?}", [x, y, z, theta_x, theta_y, theta_z]);
            return Err(KortexError::Answer { call, field: "pose", found, expected: "finite numbers".to_owned() });
        }
        let angles = [theta_x, theta_y, theta_z].map(degrees::to_radians);
        Ok(ToolPose { position: [x, y, z].map(f64::from), angles })
    }

    /// Returns the measured joint angles, rad, each within half a turn of 0.
    ///
    /// # Errors
    /// As [`Session::call`]; [`KortexError::Answer`] unless there is one angle for each of the seven joints.
    pub fn joint_angles(&mut self) -> Result<[f64; JOINTS], KortexError> {
        let call = call::GET_JOINT_ANGLES;
        let answer: JointAngles = self.ask(call)?;
        let mut angles = [f64::NAN; JOINTS];
        for angle in &answer.joints {
            if let Some(place) = angles.get_mut(angle.joint as usize) {
                *place = degrees::nearest_turn(degrees::to_radians(angle.value), 0.0);
            }
        }
        if answer.joints.len() == JOINTS && angles.iter().all(|angle| angle.is_finite()) {
            return Ok(angles);
        }
        let found = format!("{:?}", answer.joints.iter().map(|angle| (angle.joint, angle.value)).collect::<Vec<_>>());
        let expected = format!("one angle for each of joints 0 to {}", JOINTS - 1);
        Err(KortexError::Answer { call, field: "joint angles", found, expected })
    }

    /// Moves the joints with `speeds`, rad/s, **until the next command**: if the host dies, the arm keeps moving
    /// until the session times out. For motion that must stop with its host use [`crate::servoing`].
    ///
    /// # Errors
    /// [`CommandError`] before anything is sent; as [`Session::call`].
    pub fn send_joint_speeds(&mut self, speeds: &[f64; JOINTS], allowed: &[f64; JOINTS]) -> Result<(), KortexError> {
        for (i, (&found, &allowed)) in speeds.iter().zip(allowed).enumerate() {
            if !found.is_finite() {
                return Err(CommandError::NotFinite { joint: i + 1, found }.into());
            }
            if found.abs() > allowed {
                return Err(CommandError::Speed { joint: i + 1, found, allowed }.into());
            }
        }
        let joint = |(i, speed): (usize, &f64)| JointSpeed { joint: i as u32, value: degrees::to_degrees(*speed) };
        let argument = JointSpeeds { joints: speeds.iter().enumerate().map(joint).collect() };
        self.session.call::<Empty>(call::SEND_JOINT_SPEEDS, 0, &argument).map(|_| ())
    }

    /// Subscribes to changes of the arm's state and servoing mode, and of every safety of the base and of the devices
    /// `actuators`.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn subscribe(&mut self, actuators: &[u8]) -> Result<(), KortexError> {
        let [arm_state, servoing_mode, safety] = TOPICS;
        let joints = actuators.iter().map(|address| (safety, *address));
        for (topic, device) in [(arm_state, 0), (servoing_mode, 0), (safety, 0)].into_iter().chain(joints) {
            let handle: NotificationHandle = self.session.call(topic, device, &NotificationOptions::EVENTS)?;
            self.subscriptions.push((topic, device, handle.identifier as u16));
        }
        Ok(())
    }

    /// Returns the oldest notification not yet taken. Notifications come in with any call and with [`Base::keep_up`].
    ///
    /// # Errors
    /// [`KortexError::Answer`] for one that cannot be read.
    pub fn next_notification(&mut self) -> Result<Option<Notification>, KortexError> {
        while let Some(frame) = self.session.next_notification() {
            let subscription = self.subscriptions.iter().find(|(topic, device, handle)| {
                let header = &frame.header;
                (topic.service, *device, *handle) == (header.call.service, header.device, header.message)
            });
            // A notification that matches no subscription is left over from an earlier client.
            let Some((topic, device, _)) = subscription else { continue };
            return Ok(Some(match *topic {
                call::ARM_STATE_TOPIC => Notification::ArmState(decode::<ArmStateInformation>(&frame)?.active_state()),
                call::SERVOING_MODE_TOPIC => {
                    Notification::ServoingMode(decode::<ServoingModeInformation>(&frame)?.mode())
                }
                call::ACTION_TOPIC => {
                    let action: ActionNotification = decode(&frame)?;
                    let id = action.handle.map_or(0, |handle| handle.identifier);
                    Notification::Action { id, event: action.event(), why: action.abort_details }
                }
                _ => {
                    let safety: SafetyNotification = decode(&frame)?;
                    let bit = safety.safety.map_or(0, |safety| safety.identifier);
                    Notification::Safety { device: *device, bit, status: safety.status() }
                }
            }));
        }
        Ok(None)
    }
}
