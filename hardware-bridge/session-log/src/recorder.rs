//! Recorder: a wrapper that records a robot's session.

use std::sync::mpsc::Receiver;

use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, Tick};

use crate::error::SessionLogError;
use crate::message::DetectedPose;
use crate::tap::LinkPacket;
use crate::writer::SessionWriter;

/// Records the session of `R` while it is driven. A write error does not stop the robot: the first one is kept and
/// returned by [`SessionRecorder::finish`].
///
/// The crate's first example records with it.
pub struct SessionRecorder<R> {
    robot: R,
    writer: SessionWriter,
    packets: Option<Receiver<LinkPacket>>,
    error: Option<SessionLogError>,
}

impl<R: RobotBackend> SessionRecorder<R> {
    /// Wraps `robot` and records into `writer`.
    pub fn new(robot: R, writer: SessionWriter) -> Self {
        Self { robot, writer, packets: None, error: None }
    }

    /// Also records the packets of tapped links.
    pub fn with_packets(self, packets: Receiver<LinkPacket>) -> Self {
        Self { packets: Some(packets), ..self }
    }

    /// Returns the wrapped robot.
    pub fn robot(&mut self) -> &mut R {
        &mut self.robot
    }

    /// Records an object's perceived pose; `None` if it was not visible.
    pub fn detection(&mut self, object: usize, seen: Option<&DetectedPose>) {
        self.write(|writer| writer.detection(object, seen));
    }

    /// Records the reason why prior perception failed.
    pub fn detection_failed(&mut self, why: &str) {
        self.write(|writer| writer.detection_failed(why));
    }

    /// Records the robot's own statistics, as JSON.
    pub fn statistics(&mut self, json: &[u8]) {
        self.write(|writer| writer.statistics(json));
    }

    /// Records the outcome, in the controller's own format.
    pub fn outcome(&mut self, text: &[u8]) {
        self.write(|writer| writer.outcome(text));
    }

    /// Returns the error that ended the recording, if any.
    pub fn error(&self) -> Option<&SessionLogError> {
        self.error.as_ref()
    }

    /// Finishes the file and returns the robot.
    ///
    /// # Errors
    /// The first write error; the robot is returned all the same.
    pub fn finish(mut self) -> (R, Result<(), SessionLogError>) {
        self.write_packets();
        let finished = match self.error {
            Some(error) => Err(error),
            None => self.writer.finish(),
        };
        (self.robot, finished)
    }

    fn write_packets(&mut self) {
        while let Some(packet) = self.packets.as_ref().and_then(|packets| packets.try_recv().ok()) {
            self.write(|writer| writer.packet(&packet));
        }
    }

    fn write(&mut self, write: impl FnOnce(&mut SessionWriter) -> Result<(), SessionLogError>) {
        if self.error.is_none() {
            self.error = write(&mut self.writer).err();
        }
    }
}

impl<R: RobotBackend> RobotBackend for SessionRecorder<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let readings = self.robot.observe();
        self.write(|writer| match &readings {
            Ok(readings) => writer.observation(readings),
            Err(error) => writer.observation_failed(&error.to_string()),
        });
        readings
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.write(|writer| writer.requested_command(command));
        let sent = self.robot.send(command);
        self.write(|writer| match &sent {
            Ok(sent) => writer.sent_command(sent),
            Err(error) => writer.command_failed(&error.to_string()),
        });
        sent
    }

    fn wait_for_tick(&mut self) -> Tick {
        let tick = self.robot.wait_for_tick();
        self.write_packets();
        self.write(|writer| writer.tick(tick));
        tick
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}
