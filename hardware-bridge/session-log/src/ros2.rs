//! A session as a ROS 2 bag: an MCAP file with the profile `ros2`, whose messages are CDR and described in the file.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/arm/joint_states` | `sensor_msgs/msg/JointState` | measured angles (rad), speeds (rad/s), torques (N m) |
//! | `/arm/joint_commands` | the same | set-points as they were sent |
//! | `/hand/servo_states` | the same | angles and speeds of the servo horns, torques from the servos' input current |
//! | `/hand/servo_commands` | the same | goal angles, NaN for a servo in current mode; torques from the goal current or the current limit |
//! | `/tactile/<camera>/image_raw` | `sensor_msgs/msg/Image` | `rgb8`, 240 x 240 pixels, whenever a new image arrived |
//! | `/outcome` | `std_msgs/msg/String` | outcome of the session |
//!
//! Stamps and log times are the session's wall clock. The messages are those of [`robot_ros2_messages`].

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Duration;

use hand_model::robot;
use mcap::WriteOptions;
use mcap::records::MessageHeader;
use robot_ros2_messages::robot::tactile_image;
use robot_ros2_messages::{Message, Text};

use crate::error::SessionLogError;
use crate::reader::{SessionEvent, SessionReader};

pub use robot_ros2_messages::robot::RobotNames;

/// A bag being written.
struct Bag<'a> {
    mcap: mcap::Writer<BufWriter<File>>,
    path: &'a Path,
    channels: BTreeMap<String, (u16, u32)>,
    messages: u64,
}

impl Bag<'_> {
    fn add<M: Message>(&mut self, topic: &str, at: Duration, message: &M) -> Result<(), SessionLogError> {
        let fault = SessionLogError::mcap(self.path);
        let (channel_id, sequence) = match self.channels.get(topic) {
            Some(known) => *known,
            None => {
                let mut add = || {
                    let schema = self.mcap.add_schema(M::NAME, "ros2msg", M::DEFINITION.as_bytes())?;
                    self.mcap.add_channel(schema, topic, "cdr", &BTreeMap::new())
                };
                (add().map_err(SessionLogError::mcap(self.path))?, 0)
            }
        };
        self.channels.insert(topic.to_owned(), (channel_id, sequence + 1));
        self.messages += 1;
        let time = at.as_nanos() as u64;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.mcap.write_to_known_channel(&header, &message.to_cdr()).map_err(fault)
    }
}

/// Exports the session of `reader` as a bag at `out`, which must not exist. Returns the number of messages in the bag.
///
/// # Errors
/// [`SessionLogError`] of the session or of the bag, and for an image of another size than
/// [`IMAGE_SIZE`](hand_model::pads::IMAGE_SIZE) squared.
pub fn export(reader: &mut SessionReader, names: &RobotNames, out: &Path) -> Result<u64, SessionLogError> {
    let file = File::create_new(out).map_err(SessionLogError::io(out))?;
    let options = WriteOptions::new().compression(None).profile("ros2").library("robot-session-log");
    let mcap = options.create(BufWriter::new(file)).map_err(SessionLogError::mcap(out))?;
    let mut bag = Bag { mcap, path: out, channels: BTreeMap::new(), messages: 0 };
    while let Some((times, event)) = reader.next_event()? {
        let at = reader.start_time() + times.host;
        match event {
            SessionEvent::Observation(readings) => write_observation(&mut bag, names, at, &readings)?,
            SessionEvent::SentCommand(command) => write_command(&mut bag, names, at, &command)?,
            SessionEvent::Outcome(words) => {
                bag.add("/outcome", at, &Text { data: String::from_utf8_lossy(&words).into_owned() })?;
            }
            _ => {}
        }
    }
    bag.mcap.finish().map_err(SessionLogError::mcap(out))?;
    Ok(bag.messages)
}

fn write_observation(
    bag: &mut Bag<'_>,
    names: &RobotNames,
    at: Duration,
    readings: &robot::Readings,
) -> Result<(), SessionLogError> {
    if let Some(arm) = readings.arm.map(|arm| arm.value) {
        bag.add("/arm/joint_states", at, &names.arm_state(at, &arm))?;
    }
    bag.add("/hand/servo_states", at, &names.servo_states(at, &readings.servos))?;
    for frame in &readings.tactile {
        let camera = names.camera(frame.camera);
        let image = tactile_image(at, &camera, frame).map_err(|error| {
            SessionLogError::field(bag.path, &format!("image of {camera}"), error.to_string(), "a tactile image")
        })?;
        bag.add(&format!("/tactile/{camera}/image_raw"), at, &image)?;
    }
    Ok(())
}

fn write_command(
    bag: &mut Bag<'_>,
    names: &RobotNames,
    at: Duration,
    command: &robot::RobotCommand,
) -> Result<(), SessionLogError> {
    bag.add("/arm/joint_commands", at, &names.arm_command(at, command))?;
    bag.add("/hand/servo_commands", at, &names.servo_command(at, command))
}
