//! A small robot and a controller whose commands depend on everything it sees.

use std::path::Path;
use std::sync::Arc;

use hand_model::robot::{
    ArmState, Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, ServoState, TactileFrame,
    TactileImage, Tick,
};
use robot_session_log::{RobotSizes, SessionEvent, SessionHeader, SessionReader, SessionRecorder, SessionWriter};

/// Servos and joints that move a tenth of the way each tick; a camera takes a new image every third tick in which it is
/// asked.
pub struct ToyRobot {
    observation: Observation,
    goal: Option<RobotCommand>,
    captures: u64,
    image: Arc<TactileImage>,
    /// Ticks in which the robot can neither observe nor send.
    failing: std::ops::Range<u64>,
}

impl ToyRobot {
    pub fn new() -> Self {
        let image = Arc::new(TactileImage { rgb: vec![0; 48] });
        let (servos, arm) = ([ServoState::default(); 6].into(), ArmState::at_rest([0.0; 7].into()));
        let observation = Observation { servos, arm, ..Observation::default() };
        Self { observation, goal: None, captures: 0, image, failing: 0..0 }
    }

    /// Creates a robot that fails in these ticks.
    pub fn failing(ticks: std::ops::Range<u64>) -> Self {
        Self { failing: ticks, ..Self::new() }
    }
}

impl RobotBackend for ToyRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let observation = self.observation.clone();
        self.observation.tactile.clear();
        if self.failing.contains(&observation.sequence) {
            return Err(RobotError::ConnectionLost("nobody answers".to_owned()));
        }
        Ok(observation.into())
    }

    /// Limits the arm to 1 rad.
    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        if self.failing.contains(&self.observation.sequence) {
            return Err(RobotError::NotSent(0.05));
        }
        let sent = RobotCommand { arm: command.arm.iter().map(|angle| angle.clamp(-1.0, 1.0)).collect(), ..*command };
        self.goal = Some(sent);
        Ok(sent)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.observation.sequence += 1;
        self.observation.time = self.observation.sequence as f64 * self.tick_length();
        let time = self.observation.time;
        if let Some(goal) = self.goal {
            for i in 0..7 {
                self.observation.arm.position[i] += 0.1 * (goal.arm[i] - self.observation.arm.position[i]);
            }
            for (servo, goal) in self.observation.servos.iter_mut().zip(goal.servos) {
                let (angle, current) = match goal {
                    ServoGoal::Current(current) => (servo.position + current, current),
                    ServoGoal::Position { angle, current_limit } => (angle, current_limit),
                };
                *servo = ServoState { position: servo.position + 0.1 * (angle - servo.position), current, ..*servo };
            }
            if goal.capture {
                self.captures += 1;
                if self.captures.is_multiple_of(3) {
                    self.image = Arc::new(TactileImage { rgb: vec![self.captures as u8; 48] });
                }
                let image = Arc::clone(&self.image);
                self.observation.tactile.push(TactileFrame { camera: 4, time, sequence: self.captures, image });
            }
        }
        Tick { time, lateness: 1e-5 * (time * 1e3).sin() }
    }

    fn tick_length(&self) -> f64 {
        0.01
    }
}

/// Computes the next command of a controller that looks at every part of an observation.
pub fn decide(seen: &Observation) -> RobotCommand {
    let light: f64 =
        seen.tactile.iter().map(|frame| frame.image.rgb.iter().map(|byte| f64::from(*byte)).sum::<f64>()).sum();
    let wave = (seen.time * 3.0).sin() + light * 1e-4;
    let goal = |i: usize| match i % 2 {
        0 => ServoGoal::Position { angle: wave + seen.servos[i].position, current_limit: 0.5 },
        _ => ServoGoal::Current(0.1 * wave - seen.servos[i].position),
    };
    RobotCommand {
        arm: (0..7).map(|i| 1.3 * wave - seen.arm.position[i] / 3.0).collect(),
        servos: (0..6).map(goal).collect(),
        capture: seen.sequence.is_multiple_of(2),
    }
}

/// Drives the robot, repeating the last command while it cannot observe; returns the errors, in order.
pub fn drive(robot: &mut impl RobotBackend, ticks: usize) -> Vec<String> {
    let (mut errors, mut last) = (Vec::new(), None);
    for _ in 0..ticks {
        match robot.observe().and_then(Readings::into_observation) {
            Ok(seen) => last = Some(decide(&seen)),
            Err(error) => errors.push(error.to_string()),
        }
        if let Some(Err(error)) = last.as_ref().map(|command| robot.send(command)) {
            errors.push(error.to_string());
        }
        robot.wait_for_tick();
    }
    errors
}

pub fn session() -> SessionHeader {
    SessionHeader {
        robot: "emulated".to_owned(),
        program: "test 1.0".to_owned(),
        seed: 7,
        tick_length: 0.01,
        configuration: b"[arm]\nhost = \"192.168.1.10\"\n".to_vec(),
        calibration: vec![],
        task: b"{}".to_vec(),
    }
}

/// Records a session of `ticks` ticks.
pub fn record(path: &Path, ticks: usize) {
    let writer = SessionWriter::create(path, &session()).expect("a new file");
    let mut recorder = SessionRecorder::new(ToyRobot::new(), writer);
    drive(&mut recorder, ticks);
    recorder.finish().1.expect("written");
}

/// Reads everything in a file up to its end or its first error; also returns whether it was finished.
pub fn read(path: &Path) -> (Vec<SessionEvent>, Result<bool, robot_session_log::SessionLogError>) {
    let mut events = Vec::new();
    let mut reader = match SessionReader::open(path, RobotSizes::Any) {
        Ok(reader) => reader,
        Err(error) => return (events, Err(error)),
    };
    loop {
        match reader.next_event() {
            Ok(Some((_, event))) => events.push(event),
            Ok(None) => return (events, Ok(reader.is_finished())),
            Err(error) => return (events, Err(error)),
        }
    }
}

pub fn ticks(events: &[SessionEvent]) -> usize {
    events.iter().filter(|event| matches!(event, SessionEvent::Tick(_))).count()
}
