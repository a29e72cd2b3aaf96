//! A session resampled for learning: every n-th tick, the measurements and the command sent in answer.

use hand_model::ActuatorVector;
use hand_model::robot::{ArmState, RobotCommand, ServoGoal, ServoState, TactileFrame};

use crate::error::SessionLogError;
use crate::reader::{SessionEvent, SessionReader};

/// One frame: a measurement and the command sent in answer.
#[derive(Debug, Clone)]
pub struct SessionFrame {
    /// Time since the robot was started, s.
    pub time: f64,
    /// State of each servo.
    pub servos: ActuatorVector<ServoState>,
    /// State of the arm.
    pub arm: ArmState,
    /// Command sent in answer to the measurement.
    pub sent: RobotCommand,
    /// Commands sent in the ticks from this frame to the next one; the first is [`SessionFrame::sent`].
    pub commands: Vec<RobotCommand>,
    /// Images that have arrived since the previous frame.
    pub tactile: Vec<TactileFrame>,
}

impl SessionFrame {
    /// Returns the goal of each servo as one number: the output angle (rad) in position mode, the current (A) in
    /// current mode.
    pub fn servo_goals(&self) -> ActuatorVector {
        let goal = |goal: &ServoGoal| match *goal {
            ServoGoal::Current(current) => current,
            ServoGoal::Position { angle, .. } => angle,
        };
        self.sent.servos.iter().map(goal).collect()
    }
}

/// Reads a frame every `ticks` ticks, and the outcome, if there is one. If the session breaks off, its last frame is
/// one that was answered.
///
/// # Errors
/// [`SessionLogError`] of the file.
///
/// ```
/// use robot_session_log::frames::read_frames;
/// # use hand_model::robot::{Observation, RobotCommand};
/// use robot_session_log::{RobotSizes, SessionReader};
/// # use robot_session_log::{SessionHeader, SessionWriter};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("session.mcap");
/// # let mut writer = SessionWriter::create(&path, &SessionHeader::default())?;
/// # let arm = hand_model::robot::ArmState::at_rest([0.0; 7].into());
/// # for n in 0..25 {
/// #     writer.observation(&Observation { time: 0.01 * f64::from(n), arm, ..Observation::default() }.into())?;
/// #     writer.sent_command(&RobotCommand { arm: arm.position, ..RobotCommand::default() })?;
/// # }
/// # writer.finish()?;
///
/// // A session of 25 ticks of 10 ms, as frames at 10 Hz.
/// let (frames, _outcome) = read_frames(&mut SessionReader::open(&path, RobotSizes::Any)?, 10)?;
/// assert_eq!(frames.iter().map(|frame| frame.time).collect::<Vec<_>>(), [0.0, 0.1, 0.2]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn read_frames(
    reader: &mut SessionReader,
    ticks: usize,
) -> Result<(Vec<SessionFrame>, Option<Vec<u8>>), SessionLogError> {
    let (mut frames, mut outcome, mut count): (Vec<SessionFrame>, _, _) = (Vec::new(), None, 0);
    let (mut latest, mut tactile) = (None, Vec::new());
    while let Some((_, event)) = reader.next_event()? {
        match event {
            SessionEvent::Observation(mut readings) => {
                tactile.append(&mut readings.tactile);
                // Incomplete readings are of no use for learning.
                latest = readings.into_observation().ok();
            }
            SessionEvent::SentCommand(sent) => {
                let Some(observation) = latest.take() else { continue };
                if count % ticks.max(1) == 0 {
                    let (time, servos, arm) = (observation.time, observation.servos, observation.arm);
                    let (tactile, commands) = (std::mem::take(&mut tactile), Vec::with_capacity(ticks));
                    frames.push(SessionFrame { time, servos, arm, sent, commands, tactile });
                }
                if let Some(frame) = frames.last_mut() {
                    frame.commands.push(sent);
                }
                count += 1;
            }
            SessionEvent::Outcome(text) => outcome = Some(text),
            _ => {}
        }
    }
    Ok((frames, outcome))
}

#[cfg(test)]
mod tests {
    use hand_model::robot::{Observation, Readings, RobotBackend, RobotError, Tick};

    use super::*;
    use crate::{RobotSizes, SessionHeader, SessionRecorder, SessionWriter};

    /// A robot of which only the clock moves.
    struct Clock(f64);

    impl RobotBackend for Clock {
        fn observe(&mut self) -> Result<Readings, RobotError> {
            Ok(Observation { time: self.0, arm: ArmState::at_rest([0.0; 7].into()), ..Observation::default() }.into())
        }

        fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
            Ok(*command)
        }

        fn wait_for_tick(&mut self) -> Tick {
            self.0 += 0.01;
            Tick { time: self.0, lateness: 0.0 }
        }

        fn tick_length(&self) -> f64 {
            0.01
        }
    }

    #[test]
    fn every_few_ticks_what_was_measured_and_what_was_sent_then() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.mcap");
        let writer =
            SessionWriter::create(&path, &SessionHeader { tick_length: 0.01, ..SessionHeader::default() }).unwrap();
        let mut recorder = SessionRecorder::new(Clock(0.0), writer);
        let mut servos = ActuatorVector::from([ServoGoal::Current(0.25); 6]);
        servos[5] = ServoGoal::Position { angle: 0.5, current_limit: 0.1 };
        for n in 0..20 {
            recorder.observe().unwrap();
            recorder.send(&RobotCommand { arm: [f64::from(n); 7].into(), servos, capture: false }).unwrap();
            recorder.wait_for_tick();
        }
        recorder.outcome(b"{}");
        recorder.finish().1.unwrap();
        let (frames, outcome) = read_frames(&mut SessionReader::open(&path, RobotSizes::Any).unwrap(), 6).unwrap();
        assert_eq!(outcome.as_deref(), Some(b"{}".as_slice()));
        assert_eq!(frames.iter().map(|frame| frame.sent.arm[0]).collect::<Vec<_>>(), [0.0, 6.0, 12.0, 18.0]);
        assert!((frames[3].time - 0.18).abs() < 1e-9);
        assert_eq!(
            frames[1].commands.iter().map(|sent| sent.arm[0]).collect::<Vec<_>>(),
            [6.0, 7.0, 8.0, 9.0, 10.0, 11.0]
        );
        assert_eq!(frames[0].servo_goals()[..], [0.25, 0.25, 0.25, 0.25, 0.25, 0.5]);
    }
}
