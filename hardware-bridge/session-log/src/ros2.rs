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
//! Stamps and log times are the session's wall clock. CDR is little-endian XCDR1: a header of four bytes, then every
//! number aligned to its size, counted from the end of the header.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Duration;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{self, ServoGoal};
use mcap::WriteOptions;
use mcap::records::MessageHeader;

use crate::error::SessionLogError;
use crate::reader::{SessionEvent, SessionReader};

/// Names of joints, actuators and cameras, and the servos' torque constant.
///
/// ```
/// use robot_session_log::ros2::RobotNames;
///
/// let names = RobotNames {
///     arm: (1..=6).map(|joint| format!("joint_{joint}")).collect(),
///     servos: vec!["left_finger".to_owned(), "right_finger".to_owned()],
///     cameras: vec!["left_digit".to_owned(), "right_digit".to_owned()],
///     torque_constant: 1.0,
/// };
/// // `robot_session_log::ros2::export(reader, &names, Path::new("session.ros2.mcap"))`
/// # assert_eq!(names.arm.len(), 6);
/// ```
#[derive(Debug, Clone)]
pub struct RobotNames {
    /// Names of the arm's joints, from the base outwards.
    pub arm: Vec<String>,
    /// Names of the actuators, in their order.
    pub servos: Vec<String>,
    /// Names of the cameras, by index.
    pub cameras: Vec<String>,
    /// Torque constant of a servo: output torque per input current, N m/A.
    pub torque_constant: f64,
}

const HEADER_FIELD: &str = "std_msgs/Header header\n";
const JOINT_STATE: &str = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
const IMAGE: &str = "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n";
/// Definitions of the nested types of a message with a header, in the format of a bag.
const NESTED_DEFINITIONS: &str = "================================================================================\nMSG: std_msgs/Header\n\
                     builtin_interfaces/Time stamp\nstring frame_id\n\
                     ================================================================================\nMSG: builtin_interfaces/Time\n\
                     int32 sec\nuint32 nanosec\n";
/// Bytes per pixel.
const BYTES_PER_PIXEL: u32 = 3;
/// Bytes of an image.
const IMAGE_BYTES: usize = IMAGE_SIZE * IMAGE_SIZE * BYTES_PER_PIXEL as usize;

/// A CDR message being encoded.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(&mut self, size: usize) {
        while !(self.0.len() - 4).is_multiple_of(size) {
            self.0.push(0);
        }
    }

    fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    fn string(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
        self
    }

    fn strings(&mut self, all: &[String]) -> &mut Self {
        self.u32(all.len() as u32);
        for text in all {
            self.string(text);
        }
        self
    }

    fn numbers(&mut self, all: &[f64]) -> &mut Self {
        self.u32(all.len() as u32);
        for value in all {
            self.align(8);
            self.0.extend(value.to_le_bytes());
        }
        self
    }

    fn bytes(&mut self, all: &[u8]) -> &mut Self {
        self.u32(all.len() as u32);
        self.0.extend(all);
        self
    }

    fn header(&mut self, at: Duration, frame: &str) -> &mut Self {
        self.u32(at.as_secs() as u32).u32(at.subsec_nanos()).string(frame)
    }
}

fn joint_state(at: Duration, names: &[String], position: &[f64], velocity: &[f64], effort: &[f64]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.header(at, "").strings(names).numbers(position).numbers(velocity).numbers(effort);
    cdr.0
}

fn image(at: Duration, frame: &str, rgb: &[u8]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    let side = IMAGE_SIZE as u32;
    cdr.header(at, frame).u32(side).u32(side).string("rgb8");
    cdr.0.push(0);
    cdr.u32(side * BYTES_PER_PIXEL).bytes(rgb);
    cdr.0
}

/// A bag being written.
struct Bag<'a> {
    mcap: mcap::Writer<BufWriter<File>>,
    path: &'a Path,
    channels: BTreeMap<String, (u16, u32)>,
    messages: u64,
}

impl Bag<'_> {
    fn add(&mut self, topic: &str, kind: &str, body: &str, at: Duration, data: &[u8]) -> Result<(), SessionLogError> {
        let fault = SessionLogError::mcap(self.path);
        let (channel_id, sequence) = match self.channels.get(topic) {
            Some(known) => *known,
            None => {
                let mut add = || {
                    let schema = self.mcap.add_schema(kind, "ros2msg", body.as_bytes())?;
                    self.mcap.add_channel(schema, topic, "cdr", &BTreeMap::new())
                };
                (add().map_err(SessionLogError::mcap(self.path))?, 0)
            }
        };
        self.channels.insert(topic.to_owned(), (channel_id, sequence + 1));
        self.messages += 1;
        let time = at.as_nanos() as u64;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.mcap.write_to_known_channel(&header, data).map_err(fault)
    }

    fn joints(&mut self, topic: &str, at: Duration, data: &[u8]) -> Result<(), SessionLogError> {
        self.add(
            topic,
            "sensor_msgs/msg/JointState",
            &format!("{HEADER_FIELD}{JOINT_STATE}{NESTED_DEFINITIONS}"),
            at,
            data,
        )
    }
}

/// Exports the session of `reader` as a bag at `out`, which must not exist. Returns the number of messages in the bag.
///
/// # Errors
/// [`SessionLogError`] of the session or of the bag, and for an image of another size than
/// [`IMAGE_SIZE`] squared.
pub fn export(mut reader: SessionReader, names: &RobotNames, out: &Path) -> Result<u64, SessionLogError> {
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
                let mut cdr = Cdr::new();
                cdr.string(&String::from_utf8_lossy(&words));
                bag.add("/outcome", "std_msgs/msg/String", "string data\n", at, &cdr.0)?;
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
        bag.joints("/arm/joint_states", at, &joint_state(at, &names.arm, &arm.position, &arm.velocity, &arm.torque))?;
    }
    // In ROS, NaN stands for an unknown value.
    let of = |value: fn(&robot::ServoState) -> f64| {
        let values = readings.servos.iter().map(|servo| servo.map_or(f64::NAN, |servo| value(&servo.value)));
        values.collect::<Vec<f64>>()
    };
    let torque: Vec<f64> =
        of(|servo| servo.current).into_iter().map(|current| current * names.torque_constant).collect();
    let state = joint_state(at, &names.servos, &of(|servo| servo.position), &of(|servo| servo.velocity), &torque);
    bag.joints("/hand/servo_states", at, &state)?;
    for frame in &readings.tactile {
        let camera = names.cameras.get(frame.camera).cloned().unwrap_or_else(|| format!("camera_{}", frame.camera));
        if frame.image.rgb.len() != IMAGE_BYTES {
            let (field, found) = (format!("image of {camera}"), format!("{} bytes", frame.image.rgb.len()));
            return Err(SessionLogError::field(bag.path, &field, found, format!("{IMAGE_BYTES} bytes")));
        }
        let body = format!("{HEADER_FIELD}{IMAGE}{NESTED_DEFINITIONS}");
        let data = image(at, &camera, &frame.image.rgb);
        bag.add(&format!("/tactile/{camera}/image_raw"), "sensor_msgs/msg/Image", &body, at, &data)?;
    }
    Ok(())
}

fn write_command(
    bag: &mut Bag<'_>,
    names: &RobotNames,
    at: Duration,
    command: &robot::RobotCommand,
) -> Result<(), SessionLogError> {
    bag.joints("/arm/joint_commands", at, &joint_state(at, &names.arm, &command.arm, &[], &[]))?;
    let angle = |goal: &ServoGoal| match *goal {
        ServoGoal::Position { angle, .. } => angle,
        ServoGoal::Current(_) => f64::NAN,
    };
    let current = |goal: &ServoGoal| match *goal {
        ServoGoal::Position { current_limit, .. } => current_limit,
        ServoGoal::Current(current) => current,
    };
    let torque: Vec<f64> = command.servos.iter().map(|goal| current(goal) * names.torque_constant).collect();
    let angles: Vec<f64> = command.servos.iter().map(angle).collect();
    let goals = joint_state(at, &names.servos, &angles, &[], &torque);
    bag.joints("/hand/servo_commands", at, &goals)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with a layout worked out by hand: numbers aligned to their size after the header, strings with a
    /// terminating zero.
    #[test]
    fn a_joint_state_is_laid_out_as_cdr() {
        let bytes = joint_state(Duration::new(7, 9), &["ab".into()], &[1.0], &[], &[2.0]);
        let mut expected = vec![0, 1, 0, 0];
        expected.extend([7, 0, 0, 0, 9, 0, 0, 0]);
        // An empty frame: length 1, its zero, then padding.
        expected.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        expected.extend([1, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0]);
        // One number at 32.
        expected.extend([1, 0, 0, 0]);
        expected.extend(1.0_f64.to_le_bytes());
        expected.extend([0, 0, 0, 0, 1, 0, 0, 0]);
        expected.extend(2.0_f64.to_le_bytes());
        assert_eq!(bytes, expected);
    }

    #[test]
    fn an_image_ends_with_its_pixels() {
        let bytes = image(Duration::ZERO, "pad", &[5; 6]);
        assert!(bytes.ends_with(&[6, 0, 0, 0, 5, 5, 5, 5, 5, 5]));
        assert_eq!((bytes.len() - 6) % 4, 0);
    }
}
