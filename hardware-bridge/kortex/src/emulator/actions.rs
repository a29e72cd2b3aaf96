//! Actions of the emulated arm: the stored ones, and the one in progress.

use prost::Message;

use super::controller::Controller;
use super::path::{Haste, Path, TOP_SPEED, soonest};
use super::plant::Drive;
use super::playing::Playing;
use super::refusals::{
    CANNOT_REACH_SO_SOON, COUNT_MISMATCH, ENTITY_NOT_FOUND, IN_LOW_LEVEL, INVALID_PARAMETER, JOINT_LIMIT, MANUAL_STOP,
    NEGATIVE_SPEED, NO_ACTION, NOT_MOVING, No, SPEED_TOO_HIGH, TOO_LONG, UNSUPPORTED_ACTION, argument,
};
use crate::call::{self, Call};
use crate::degrees;
use crate::frame::Frame;
use crate::joints::JOINTS;
use crate::message::action::{
    Action, ActionEvent, ActionHandle, ActionList, ActionNotification, ActionType, ConstrainedJointAngles,
    JointConstraintType, RequestedActionType,
};
use crate::message::base::{JointAngle, JointAngles, ServoingMode};

/// Actions stored in the arm as delivered, degrees. The maker's examples find home under 2. The other numbers are our
/// reading.
const STORED: [(u32, &str, [f32; JOINTS]); 3] = [
    (1, "Retract", [0.0, 340.0, 180.0, 214.0, 0.0, 310.0, 90.0]),
    (2, "Home", [0.0, 15.0, 180.0, 230.0, 0.0, 55.0, 90.0]),
    (4, "Zero", [0.0; JOINTS]),
];
/// Joints 2, 4 and 6 have end stops, rad to either side (published: 128.9, 147.8 and 120.3 degrees).
const RANGE: [Option<f64>; JOINTS] = [None, Some(2.25), None, Some(2.58), None, Some(2.10), None];
/// Longest duration that the maker permits, s.
const LONGEST: f64 = 100.0;
/// Speed below which a joint may begin a path, rad/s.
const NEARLY_STILL: f64 = 0.01;
/// Time for which an action waits for the joints after the end of its path, ms.
const SETTLING: u64 = 1000;

impl Controller {
    /// Answers calls about actions; `None` for another call.
    pub(super) fn action_call(&mut self, session: u16, call: Call, request: &Frame) -> Option<Result<Vec<u8>, No>> {
        let done = |result: Result<(), No>| result.map(|()| Vec::new());
        Some(match call {
            call::READ_ALL_ACTIONS => argument::<RequestedActionType>(request).map(|wanted| {
                let fits = [ActionType::Unspecified, ActionType::ReachJointAngles]
                    .map(|fitting| fitting as i32)
                    .contains(&wanted.action_type);
                let actions = STORED.iter().filter(|_| fits).map(stored).collect();
                ActionList { actions }.encode_to_vec()
            }),
            call::READ_ACTION => look_up(request).map(|action| action.encode_to_vec()),
            call::EXECUTE_ACTION_FROM_REFERENCE => {
                done(look_up(request).and_then(|action| self.execute(session, &action)))
            }
            call::EXECUTE_ACTION => done(argument(request).and_then(|action| self.execute(session, &action))),
            call::STOP_ACTION => done(self.stop()),
            call::PAUSE_ACTION => done(self.pause()),
            call::RESUME_ACTION => done(self.resume()),
            _ => return None,
        })
    }

    /// Stops motion that the base itself drives. An action is aborted.
    pub(super) fn stop(&mut self) -> Result<(), No> {
        if self.mode == ServoingMode::LowLevel {
            return Err(IN_LOW_LEVEL);
        }
        self.abort_action(MANUAL_STOP);
        self.drive = Drive::Hold;
        Ok(())
    }

    fn execute(&mut self, session: u16, action: &Action) -> Result<(), No> {
        self.refuse_in_fault()?;
        if self.mode == ServoingMode::LowLevel {
            return Err(IN_LOW_LEVEL);
        }
        let wanted = action.reach_joint_angles.as_ref().ok_or(UNSUPPORTED_ACTION)?;
        let position = self.motion().position;
        let target = target(wanted, &position)?;
        let haste = haste(wanted)?;
        if let Haste::Duration(seconds) = haste
            && seconds < soonest(&position, &target)
        {
            return Err(CANNOT_REACH_SO_SOON);
        }
        self.abort_action(MANUAL_STOP);
        self.in_control = Some(session);
        self.drive = Drive::Hold;
        let stored = action.handle.unwrap_or_default();
        let handle = ActionHandle { action_type: ActionType::ReachJointAngles as i32, ..stored };
        self.playing = Some(Playing { handle, target, haste, path: None, paused: false });
        self.tell(ActionEvent::Start, handle, 0);
        Ok(())
    }

    fn pause(&mut self) -> Result<(), No> {
        let playing = self.playing.as_mut().filter(|playing| !playing.paused).ok_or(NOT_MOVING)?;
        (playing.path, playing.paused) = (None, true);
        let handle = playing.handle;
        self.drive = Drive::Hold;
        self.tell(ActionEvent::Pause, handle, 0);
        Ok(())
    }

    fn resume(&mut self) -> Result<(), No> {
        let playing = self.playing.as_mut().filter(|playing| playing.paused).ok_or(NO_ACTION)?;
        playing.paused = false;
        let handle = playing.handle;
        self.tell(ActionEvent::Start, handle, 0);
        Ok(())
    }

    /// Ends the action, if there is one, before it is done. `why` is the reason in its notification.
    pub(super) fn abort_action(&mut self, why: No) {
        if let Some(playing) = self.playing.take() {
            self.tell(ActionEvent::Abort, playing.handle, why.1);
        }
    }

    /// Advances the action by a millisecond. The joints brake before a path begins.
    pub(super) fn play(&mut self) {
        let (motion, now) = (self.motion(), self.time);
        let still = motion.velocity.iter().all(|speed| speed.abs() < NEARLY_STILL);
        let Some(playing) = self.playing.as_mut().filter(|playing| !playing.paused) else { return };
        if playing.path.is_none() && still {
            playing.path = Some(Path::new(motion.position, playing.target, playing.haste, now));
        }
        let Some(path) = &playing.path else { return };
        self.drive = Drive::Position(path.at(now));
        if now >= path.end() && (still || now >= path.end().saturating_add(SETTLING)) {
            let handle = playing.handle;
            self.playing = None;
            self.tell(ActionEvent::End, handle, 0);
        }
    }

    fn tell(&mut self, event: ActionEvent, handle: ActionHandle, abort_details: u16) {
        let abort_details = abort_details.into();
        self.action_events.push(ActionNotification { event: event as i32, handle: Some(handle), abort_details });
    }
}

fn stored(&(identifier, name, angles): &(u32, &str, [f32; JOINTS])) -> Action {
    let joints = (0..).zip(angles).map(|(joint, value)| JointAngle { joint, value }).collect();
    Action {
        handle: Some(ActionHandle { identifier, action_type: ActionType::ReachJointAngles as i32, permission: 1 }),
        name: name.to_owned(),
        reach_joint_angles: Some(ConstrainedJointAngles { angles: Some(JointAngles { joints }), constraint: None }),
    }
}

fn look_up(request: &Frame) -> Result<Action, No> {
    let wanted = argument::<ActionHandle>(request)?.identifier;
    STORED.iter().find(|(identifier, ..)| *identifier == wanted).map(stored).ok_or(ENTITY_NOT_FOUND)
}

/// Returns the target of an action, rad. Joints without end stops take the shorter way from `position`.
fn target(wanted: &ConstrainedJointAngles, position: &[f64; JOINTS]) -> Result<[f64; JOINTS], No> {
    let angles = wanted.angles.as_ref().map_or(&[][..], |angles| &angles.joints);
    if angles.len() != JOINTS {
        return Err(COUNT_MISMATCH);
    }
    let mut target = [f64::NAN; JOINTS];
    for angle in angles {
        let i = angle.joint as usize;
        let place = target.get_mut(i).ok_or(INVALID_PARAMETER)?;
        if !angle.value.is_finite() || place.is_finite() {
            return Err(INVALID_PARAMETER);
        }
        let value = degrees::to_radians(angle.value);
        *place = match RANGE[i] {
            None => degrees::nearest_turn(value, position[i]),
            Some(range) => {
                let value = degrees::nearest_turn(value, 0.0);
                if value.abs() > range {
                    return Err(JOINT_LIMIT);
                }
                value
            }
        };
    }
    Ok(target)
}

fn haste(wanted: &ConstrainedJointAngles) -> Result<Haste, No> {
    let Some(constraint) = wanted.constraint else { return Ok(Haste::Modest) };
    let value = f64::from(constraint.value);
    match constraint.kind() {
        JointConstraintType::Unspecified => Ok(Haste::Modest),
        _ if !value.is_finite() => Err(INVALID_PARAMETER),
        // 0 means no constraint.
        _ if value == 0.0 => Ok(Haste::Modest),
        JointConstraintType::Duration if value < 0.0 => Err(INVALID_PARAMETER),
        JointConstraintType::Duration if value > LONGEST => Err(TOO_LONG),
        JointConstraintType::Duration => Ok(Haste::Duration(value)),
        JointConstraintType::Speed if value < 0.0 => Err(NEGATIVE_SPEED),
        JointConstraintType::Speed if value.to_radians() > TOP_SPEED => Err(SPEED_TOO_HIGH),
        JointConstraintType::Speed => Ok(Haste::Speed(value.to_radians())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted(angles: [f32; JOINTS]) -> ConstrainedJointAngles {
        let joints = (0..).zip(angles).map(|(joint, value)| JointAngle { joint, value }).collect();
        ConstrainedJointAngles { angles: Some(JointAngles { joints }), constraint: None }
    }

    /// Joint 1 continues past half a turn, and joint 2 comes back from its far side. A target beyond an end stop is
    /// refused.
    #[test]
    fn turns_and_end_stops() {
        let mut position = [0.0; JOINTS];
        (position[0], position[1]) = (3.0, -2.2);
        let found = target(&wanted([190.0, 120.0, 0.0, 0.0, 0.0, 240.0, 0.0]), &position).expect("reachable");
        let degrees = found.map(|angle| angle.to_degrees().round());
        assert_eq!(degrees, [190.0, 120.0, 0.0, 0.0, 0.0, -120.0, 0.0]);
        let beyond = wanted([0.0, 0.0, 0.0, 150.0, 0.0, 0.0, 0.0]);
        assert_eq!(target(&beyond, &position), Err(JOINT_LIMIT));
    }

    #[test]
    fn angles_that_are_no_posture() {
        let here = [0.0; JOINTS];
        let mut short = wanted([0.0; JOINTS]);
        short.angles.as_mut().expect("angles").joints.pop();
        assert_eq!(target(&short, &here), Err(COUNT_MISMATCH));
        assert_eq!(target(&ConstrainedJointAngles::default(), &here), Err(COUNT_MISMATCH));
        let mut twice = wanted([0.0; JOINTS]);
        twice.angles.as_mut().expect("angles").joints[3].joint = 2;
        assert_eq!(target(&twice, &here), Err(INVALID_PARAMETER));
        assert_eq!(target(&wanted([f32::NAN; JOINTS]), &here), Err(INVALID_PARAMETER));
    }

    #[test]
    fn constraints() {
        let with = |kind: JointConstraintType, value| {
            let constraint = Some(crate::message::action::JointConstraint { kind: kind as i32, value });
            haste(&ConstrainedJointAngles { angles: None, constraint })
        };
        assert_eq!(with(JointConstraintType::Duration, 5.0), Ok(Haste::Duration(5.0)));
        assert_eq!(with(JointConstraintType::Duration, 101.0), Err(TOO_LONG));
        assert_eq!(with(JointConstraintType::Speed, -1.0), Err(NEGATIVE_SPEED));
        assert_eq!(with(JointConstraintType::Speed, 90.0), Err(SPEED_TOO_HIGH));
        assert_eq!(with(JointConstraintType::Speed, f32::NAN), Err(INVALID_PARAMETER));
    }
}
