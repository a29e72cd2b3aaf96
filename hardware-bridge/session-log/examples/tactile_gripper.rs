//! Records a gripper with two tactile cameras and the bytes of its servo bus, replays its controller, and exports the
//! session as a ROS 2 bag.
//!
//! `cargo run -p robot-session-log --example tactile_gripper` writes into a temporary folder, and with `-- FOLDER` into
//! that folder. In the place of `ToyGripper` stands your driver, for example of two DIGIT or GelSight sensors.

use std::error::Error;
use std::path::Path;
use std::sync::{Arc, mpsc};

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{
    Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, ServoState, TactileFrame, TactileImage,
    Tick,
};
use robot_session_log::ros2::{self, RobotNames};
use robot_session_log::{
    Direction, LinkTap, Replay, RobotSizes, SessionHeader, SessionReader, SessionRecorder, SessionWriter,
};

/// Length of a tick, s.
const TICK: f64 = 0.02;
/// Brightness of an image from which a pad is in contact.
const CONTACT_BRIGHTNESS: u8 = 130;

/// One servo and two cameras whose images become brighter beyond 0.5 rad, where an object is.
struct ToyGripper {
    sequence: u64,
    position: f64,
    goal: f64,
    captures: u64,
    tactile: Vec<TactileFrame>,
    bus: LinkTap,
}

impl ToyGripper {
    fn new(bus: LinkTap) -> Self {
        Self { sequence: 0, position: 0.0, goal: 0.0, captures: 0, tactile: Vec::new(), bus }
    }

    fn time(&self) -> f64 {
        self.sequence as f64 * TICK
    }
}

impl RobotBackend for ToyGripper {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let servo = ServoState { position: self.position, current: self.goal - self.position, ..ServoState::default() };
        let (servos, tactile) = ([servo].into_iter().collect(), std::mem::take(&mut self.tactile));
        Ok(Observation { time: self.time(), sequence: self.sequence, servos, tactile, ..Observation::default() }.into())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        if let Some(ServoGoal::Position { angle, .. }) = command.servos.first() {
            self.goal = *angle;
            self.bus.copy_packet(Direction::Sent, &angle.to_le_bytes());
        }
        if command.capture {
            self.captures += 1;
            let brightness = 100 + (100.0 * (self.position - 0.5).max(0.0)) as u8;
            let image = Arc::new(TactileImage { rgb: vec![brightness; IMAGE_SIZE * IMAGE_SIZE * 3] });
            let frame =
                |camera| TactileFrame { camera, time: self.time(), sequence: self.captures, image: Arc::clone(&image) };
            self.tactile = vec![frame(0), frame(1)];
        }
        Ok(*command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.sequence += 1;
        self.position += 0.3 * (self.goal - self.position);
        Tick { time: self.time(), lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        TICK
    }
}

/// Closes until the images show a contact, asking for images every fifth tick; returns the angle at the end, rad.
fn close(robot: &mut impl RobotBackend, speed: f64) -> Result<f64, RobotError> {
    let (mut goal, mut in_contact) = (0.0, false);
    let mut position = 0.0;
    for tick in 0..150 {
        let seen = robot.observe()?.into_observation()?;
        position = seen.servos.first().map_or(0.0, |servo| servo.position);
        in_contact |= seen.tactile.iter().any(|frame| frame.image.rgb.iter().any(|byte| *byte >= CONTACT_BRIGHTNESS));
        if !in_contact {
            goal += speed * robot.tick_length();
        }
        let servo = ServoGoal::Position { angle: goal, current_limit: 0.5 };
        let servos = [servo].into_iter().collect();
        robot.send(&RobotCommand { servos, capture: tick % 5 == 0, ..RobotCommand::default() })?;
        robot.wait_for_tick();
    }
    Ok(position)
}

fn run(folder: &Path) -> Result<(), Box<dyn Error>> {
    let path = folder.join("gripper.mcap");
    let header = SessionHeader {
        robot: "toy gripper".to_owned(),
        program: format!("tactile_gripper {}", env!("CARGO_PKG_VERSION")),
        tick_length: TICK,
        ..SessionHeader::default()
    };
    let (sender, packets) = mpsc::channel();
    let gripper = ToyGripper::new(LinkTap::new("servos", sender));
    let mut recorder = SessionRecorder::new(gripper, SessionWriter::create(&path, &header)?).with_packets(packets);
    let position = close(&mut recorder, 0.5)?;
    recorder.outcome(format!("{{\"position\": {position}}}").as_bytes());
    recorder.finish().1?;
    println!("recorded {}, closed to {position:.3} rad", path.display());

    for speed in [0.5, 0.51] {
        let mut replay = Replay::new(SessionReader::open(&path, RobotSizes::Any)?)?;
        close(&mut replay, speed)?;
        match replay.finish()? {
            (progress, None) => println!("replayed at {speed} rad/s: {} commands identical", progress.commands),
            (_, Some(difference)) => println!("replayed at {speed} rad/s: {difference}"),
        }
    }

    let names = RobotNames {
        arm: Vec::new(),
        servos: vec!["gripper".to_owned()],
        cameras: vec!["left".to_owned(), "right".to_owned()],
        torque_constant: 1.0,
    };
    let bag = folder.join("gripper.ros2.mcap");
    let messages = ros2::export(&mut SessionReader::open(&path, RobotSizes::Any)?, &names, &bag)?;
    println!("exported {messages} messages to {}", bag.display());
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args().nth(1) {
        Some(folder) => run(Path::new(&folder)),
        None => {
            let folder = tempfile::tempdir()?;
            run(folder.path())
        }
    }
}
