//! The messages of a session's file and their conversion from and to the robot's types.
//!
//! [`command_bits`] is the comparison of commands that replays use.
//!
//! Protobuf omits a plain field that equals 0, including -0. Every number here is therefore optional or in a list, so
//! that all of its bits are written.

use hand_model::robot::{self, ArmState, Reading, ServoGoal, ServoState};

pub use crate::sizes::RobotSizes;

use crate::sizes::InvalidField;
use crate::tactile_frame::{LastImages, TactileFrame};

/// Message for [`robot::Readings`].
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct Observation {
    /// Time since the robot was started, s.
    #[prost(double, optional, tag = "1")]
    pub time: Option<f64>,
    /// Number of the tick.
    #[prost(uint64, optional, tag = "2")]
    pub sequence: Option<u64>,
    /// Servo angles, rad, in actuator order.
    #[prost(double, repeated, tag = "3")]
    pub servo_position: Vec<f64>,
    /// Servo speeds, rad/s.
    #[prost(double, repeated, tag = "4")]
    pub servo_velocity: Vec<f64>,
    /// Servo currents, A.
    #[prost(double, repeated, tag = "5")]
    pub servo_current: Vec<f64>,
    /// Servo temperatures, degrees Celsius.
    #[prost(double, repeated, tag = "6")]
    pub servo_temperature: Vec<f64>,
    /// Joint angles of the arm, rad; empty if the arm was never read.
    #[prost(double, repeated, tag = "7")]
    pub arm_position: Vec<f64>,
    /// Joint speeds of the arm, rad/s.
    #[prost(double, repeated, tag = "8")]
    pub arm_velocity: Vec<f64>,
    /// Joint torques of the arm, N m.
    #[prost(double, repeated, tag = "9")]
    pub arm_torque: Vec<f64>,
    /// Tactile images that arrived since the last observation.
    #[prost(message, repeated, tag = "10")]
    pub tactile: Vec<TactileFrame>,
    /// Time at which each servo was read, s; empty in older sessions, where `time` applies to all servos.
    #[prost(double, repeated, tag = "11")]
    pub servo_time: Vec<f64>,
    /// Indices of servos that were never read; their numbers have no meaning.
    #[prost(uint32, repeated, tag = "12")]
    pub servo_unread: Vec<u32>,
    /// Time at which the arm was read, s; if absent, `time` applies. An arm that was never read has neither time nor
    /// positions.
    #[prost(double, optional, tag = "13")]
    pub arm_time: Option<f64>,
}

/// Message for [`robot::RobotCommand`].
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct Command {
    /// Set-points of the arm's joints, rad.
    #[prost(double, repeated, tag = "1")]
    pub arm: Vec<f64>,
    /// Mode of each servo, in actuator order: 0 for current, 1 for position under a current limit.
    #[prost(uint32, repeated, tag = "2")]
    pub servo_mode: Vec<u32>,
    /// Goal angle of each servo, rad; 0 in current mode.
    #[prost(double, repeated, tag = "3")]
    pub servo_angle: Vec<f64>,
    /// Goal current or current limit of each servo, A.
    #[prost(double, repeated, tag = "4")]
    pub servo_current: Vec<f64>,
    /// True if images are requested.
    #[prost(bool, optional, tag = "5")]
    pub capture: Option<bool>,
}

/// Message for [`robot::Tick`].
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(crate) struct Tick {
    /// Time since the robot was started, s.
    #[prost(double, optional, tag = "1")]
    pub time: Option<f64>,
    /// Lateness of the tick, s.
    #[prost(double, optional, tag = "2")]
    pub lateness: Option<f64>,
}

/// Result of prior perception (a camera over the table, or the operator) for one object: an input of the controller
/// besides the robot's measurements.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct DetectedObject {
    /// Index of the object.
    #[prost(uint32, optional, tag = "1")]
    pub object: Option<u32>,
    /// Pose in the world frame: x, y, z in m, then the quaternion's i, j, k, w; empty if the object was not visible.
    #[prost(double, repeated, tag = "2")]
    pub pose: Vec<f64>,
    /// Standard deviation of each of x and y that perception states, m.
    #[prost(double, optional, tag = "3")]
    pub sigma: Option<f64>,
}

/// A pose (x, y, z in m, then the quaternion's i, j, k, w) and its stated standard deviation, m.
pub type DetectedPose = ([f64; 7], Option<f64>);

impl DetectedObject {
    /// Builds the message for the file.
    pub(crate) fn new(object: usize, seen: Option<&DetectedPose>) -> Self {
        Self {
            object: Some(object as u32),
            pose: seen.map_or_else(Vec::new, |(pose, _)| pose.to_vec()),
            sigma: seen.and_then(|(_, sigma)| *sigma),
        }
    }

    /// Reads the message: index of the object, and its pose if it was visible.
    ///
    /// # Errors
    /// The invalid field.
    pub(crate) fn read(&self) -> Result<(usize, Option<DetectedPose>), InvalidField> {
        let pose = if self.pose.is_empty() { None } else { Some(list::<7, _>("pose", &self.pose)?) };
        Ok((required("object", self.object)? as usize, pose.map(|pose| (pose, self.sigma))))
    }
}

fn list<const N: usize, T: Copy>(field: &'static str, values: &[T]) -> Result<[T; N], InvalidField> {
    values.try_into().map_err(|_| (field, format!("{} numbers", values.len()), format!("{N} numbers")))
}

pub(crate) fn required<T>(field: &'static str, value: Option<T>) -> Result<T, InvalidField> {
    value.ok_or_else(|| (field, "missing".to_owned(), "a value".to_owned()))
}

impl Observation {
    /// Builds the message for the file. `last` holds the images written before and is updated.
    pub(crate) fn new(readings: &robot::Readings, last: &mut LastImages) -> Self {
        let none = Reading { value: ServoState::default(), time: readings.time };
        let read: Vec<Reading<ServoState>> = readings.servos.iter().map(|servo| servo.unwrap_or(none)).collect();
        let servos = |value: fn(&ServoState) -> f64| read.iter().map(|servo| value(&servo.value)).collect();
        let arm = |value: fn(&ArmState) -> &[f64]| readings.arm.map_or(Vec::new(), |arm| value(&arm.value).to_vec());
        Self {
            time: Some(readings.time),
            sequence: Some(readings.sequence),
            servo_position: servos(|servo| servo.position),
            servo_velocity: servos(|servo| servo.velocity),
            servo_current: servos(|servo| servo.current),
            servo_temperature: servos(|servo| servo.temperature),
            arm_position: arm(|arm| &arm.position),
            arm_velocity: arm(|arm| &arm.velocity),
            arm_torque: arm(|arm| &arm.torque),
            tactile: readings.tactile.iter().map(|frame| TactileFrame::new(frame, last)).collect(),
            servo_time: read.iter().map(|servo| servo.time).collect(),
            servo_unread: (0..).zip(&readings.servos).filter(|(_, servo)| servo.is_none()).map(|(n, _)| n).collect(),
            arm_time: readings.arm.map(|arm| arm.time),
        }
    }

    /// Reads the message, of a robot of these `sizes`. `last` holds the images read before and is updated.
    ///
    /// # Errors
    /// The invalid field.
    pub(crate) fn read(self, last: &mut LastImages, sizes: RobotSizes) -> Result<robot::Readings, InvalidField> {
        let time = required("time", self.time)?;
        let servos = sizes.servos(self.servo_position.len());
        let position = servos.list("servo_position", &self.servo_position)?;
        let velocity = servos.list("servo_velocity", &self.servo_velocity)?;
        let current = servos.list("servo_current", &self.servo_current)?;
        let temperature = servos.list("servo_temperature", &self.servo_temperature)?;
        let times = match self.servo_time.as_slice() {
            [] => position.iter().map(|_| time).collect(),
            times => servos.list("servo_time", times)?,
        };
        let servo = |i: usize| {
            let (position, velocity, current, temperature) = (position[i], velocity[i], current[i], temperature[i]);
            let value = ServoState { position, velocity, current, temperature };
            (!self.servo_unread.contains(&(i as u32))).then_some(Reading { value, time: times[i] })
        };
        // A robot without an arm has a time and no joints.
        let empty = [&self.arm_position, &self.arm_velocity, &self.arm_torque].iter().all(|joints| joints.is_empty());
        let arm = if empty && self.arm_time.is_none() {
            None
        } else {
            let position = sizes.arm("arm_position", &self.arm_position)?;
            let velocity = sizes.arm("arm_velocity", &self.arm_velocity)?;
            let torque = sizes.arm("arm_torque", &self.arm_torque)?;
            Some(Reading { value: ArmState { position, velocity, torque }, time: self.arm_time.unwrap_or(time) })
        };
        Ok(robot::Readings {
            time,
            sequence: required("sequence", self.sequence)?,
            servos: (0..position.len()).map(servo).collect(),
            arm,
            tactile: self.tactile.into_iter().map(|frame| frame.read(last, sizes)).collect::<Result<_, _>>()?,
        })
    }
}

impl From<&robot::RobotCommand> for Command {
    fn from(command: &robot::RobotCommand) -> Self {
        let goal = |goal: &ServoGoal| match *goal {
            ServoGoal::Current(current) => (0, 0.0, current),
            ServoGoal::Position { angle, current_limit } => (1, angle, current_limit),
        };
        let columns: Vec<(u32, f64, f64)> = command.servos.iter().map(goal).collect();
        Self {
            arm: command.arm.to_vec(),
            servo_mode: columns.iter().map(|column| column.0).collect(),
            servo_angle: columns.iter().map(|column| column.1).collect(),
            servo_current: columns.iter().map(|column| column.2).collect(),
            capture: Some(command.capture),
        }
    }
}

impl Command {
    /// Reads the message, of a robot of these `sizes`.
    ///
    /// # Errors
    /// The invalid field.
    pub(crate) fn read(&self, sizes: RobotSizes) -> Result<robot::RobotCommand, InvalidField> {
        let servos = sizes.servos(self.servo_mode.len());
        let mode = servos.list("servo_mode", &self.servo_mode)?;
        let angle = servos.list("servo_angle", &self.servo_angle)?;
        let current = servos.list("servo_current", &self.servo_current)?;
        let goal = |i: usize| match mode[i] {
            0 => Ok(ServoGoal::Current(current[i])),
            1 => Ok(ServoGoal::Position { angle: angle[i], current_limit: current[i] }),
            found => Err(("servo_mode", found.to_string(), "0 or 1".to_owned())),
        };
        let servos = (0..mode.len()).map(goal).collect::<Result<_, _>>()?;
        let arm = sizes.arm("arm", &self.arm)?;
        Ok(robot::RobotCommand { arm, servos, capture: required("capture", self.capture)? })
    }
}

impl From<robot::Tick> for Tick {
    fn from(tick: robot::Tick) -> Self {
        Self { time: Some(tick.time), lateness: Some(tick.lateness) }
    }
}

impl Tick {
    /// Reads the message.
    ///
    /// # Errors
    /// The missing field.
    pub(crate) fn read(self) -> Result<robot::Tick, InvalidField> {
        Ok(robot::Tick { time: required("time", self.time)?, lateness: required("lateness", self.lateness)? })
    }
}

/// Returns every number of `command` as its bits, with its name. Equal lists mean equal commands, NaN and -0 included.
///
/// ```
/// use hand_model::robot::{RobotCommand, ServoGoal};
/// use robot_session_log::message::command_bits;
///
/// let servos = [ServoGoal::Current(0.5)].into_iter().collect();
/// let command = RobotCommand { servos, ..RobotCommand::default() };
/// assert_eq!(command_bits(&command)[0], ("servo 1 current".to_owned(), 0.5_f64.to_bits()));
/// ```
pub fn command_bits(command: &robot::RobotCommand) -> Vec<(String, u64)> {
    let arm = (1..).zip(&command.arm).map(|(n, angle)| (format!("arm joint {n}"), angle.to_bits()));
    let servos = (1..).zip(&command.servos).flat_map(|(n, goal)| match *goal {
        ServoGoal::Current(current) => vec![(format!("servo {n} current"), current.to_bits())],
        ServoGoal::Position { angle, current_limit } => vec![
            (format!("servo {n} angle"), angle.to_bits()),
            (format!("servo {n} current limit"), current_limit.to_bits()),
        ],
    });
    arm.chain(servos).chain([("capture".to_owned(), u64::from(command.capture))]).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use hand_model::RobotModel;
    use hand_model::robot::TactileImage;

    use super::*;
    use proptest::prelude::*;
    use prost::Message;

    fn any_bits() -> impl Strategy<Value = f64> {
        prop_oneof![
            4 => any::<u64>().prop_map(f64::from_bits),
            1 => prop_oneof![Just(0.0), Just(-0.0), Just(f64::NAN), Just(f64::INFINITY)],
        ]
    }

    pub(crate) fn command() -> impl Strategy<Value = robot::RobotCommand> {
        let goal = prop_oneof![
            any_bits().prop_map(ServoGoal::Current),
            (any_bits(), any_bits()).prop_map(|(angle, current_limit)| ServoGoal::Position { angle, current_limit }),
        ];
        (prop::array::uniform7(any_bits()), prop::array::uniform6(goal), any::<bool>())
            .prop_map(|(arm, servos, capture)| robot::RobotCommand { arm: arm.into(), servos: servos.into(), capture })
    }

    proptest! {
        #[test]
        fn commands_keep_every_bit(command in command()) {
            let bytes = Command::from(&command).encode_to_vec();
            let back = Command::decode(bytes.as_slice())?.read(RobotSizes::Any).expect("readable");
            prop_assert_eq!(command_bits(&back), command_bits(&command));
        }

        #[test]
        fn observations_keep_every_bit(
            values in prop::collection::vec(any_bits(), 53),
            sequence: u64,
            unread in prop::array::uniform6(any::<bool>()),
        ) {
            let mut values = values.into_iter();
            let mut next = || values.next().expect("enough");
            let servos = unread.map(|unread| {
                let (position, velocity, current, temperature) = (next(), next(), next(), next());
                let value = ServoState { position, velocity, current, temperature };
                let time = next();
                (!unread).then_some(Reading { value, time })
            });
            let mut joints = || (0..7).map(|_| next()).collect();
            let value = ArmState { position: joints(), velocity: joints(), torque: joints() };
            let arm = Some(Reading { value, time: next() });
            let observation = robot::Readings { time: next(), sequence, servos: servos.into(), arm, tactile: vec![] };
            let written = Observation::new(&observation, &mut LastImages::new());
            let back = Observation::decode(written.encode_to_vec().as_slice())?;
            let back = back.read(&mut LastImages::new(), RobotSizes::Any).expect("readable");
            // Written again, equal numbers give equal bytes.
            let again = Observation::new(&back, &mut LastImages::new());
            prop_assert_eq!(again.encode_to_vec(), written.encode_to_vec());
            prop_assert_eq!(back.time.to_bits(), observation.time.to_bits());
            let temperature = |readings: &robot::Readings| {
                readings.servos[5].map(|servo| [servo.value.temperature, servo.time].map(f64::to_bits))
            };
            prop_assert_eq!(temperature(&back), temperature(&observation));
            let torque = |readings: &robot::Readings| readings.arm.map(|arm| arm.value.torque[6].to_bits());
            prop_assert_eq!(torque(&back), torque(&observation));
        }
    }

    /// Older sessions have no separate times for servos and arm.
    #[test]
    fn without_times_all_is_of_the_observations_time() {
        let whole = robot::Readings::from(robot::Observation {
            time: 2.5,
            servos: [ServoState::default(); 6].into(),
            arm: ArmState::at_rest([0.0; 7].into()),
            ..Default::default()
        });
        let written = Observation::new(&whole, &mut LastImages::new());
        let former = Observation { servo_time: vec![], arm_time: None, ..written };
        let back = former.read(&mut LastImages::new(), RobotSizes::Any).expect("readable");
        assert!(back.servos.iter().all(|servo| servo.map(|servo| servo.time) == Some(2.5)));
        assert_eq!(back.arm.map(|arm| arm.time), Some(2.5));
    }

    /// A hand without an arm is read as it was written, and an arm that was never read stays unread.
    #[test]
    fn no_arm_is_not_an_unread_arm() {
        let without = robot::Readings::from(robot::Observation::default());
        let unread = robot::Readings { arm: None, ..without.clone() };
        for readings in [without, unread] {
            let written = Observation::new(&readings, &mut LastImages::new());
            let back = written.read(&mut LastImages::new(), RobotSizes::Any).expect("readable");
            assert_eq!(back.arm, readings.arm);
        }
        let command = Command::from(&robot::RobotCommand::default());
        assert_eq!(command.read(RobotSizes::Any), Ok(robot::RobotCommand::default()));
    }

    #[test]
    fn what_is_missing_is_named() {
        let full =
            robot::RobotCommand { arm: [0.0; 7].into(), servos: [ServoGoal::Current(0.0); 6].into(), capture: false };
        let command = Command { servo_angle: vec![0.0; 5], ..Command::from(&full) };
        assert_eq!(command.read(RobotSizes::Any), Err(("servo_angle", "5 numbers".to_owned(), "6 numbers".to_owned())));
        let frame = TactileFrame { camera: Some(3), ..Default::default() };
        let observation =
            Observation { tactile: vec![frame], ..Observation::new(&Default::default(), &mut LastImages::new()) };
        let wrong = observation.clone().read(&mut LastImages::new(), RobotSizes::Any).expect_err("no image yet");
        assert_eq!(wrong.0, "tactile.rgb");
        let change = TactileFrame { rgb_change: Some(vec![0; 3]), ..observation.tactile[0].clone() };
        let observation = Observation { tactile: vec![change], ..observation };
        let mut last = LastImages::from([(3, Arc::new(TactileImage { rgb: vec![7; 12] }))]);
        let wrong = observation.read(&mut last, RobotSizes::Any).expect_err("too short");
        assert_eq!(wrong, ("tactile.rgb_change", "3 bytes".to_owned(), "12 bytes".to_owned()));
    }

    /// A robot with an arm cannot have one without joints.
    #[test]
    fn a_missing_arm_is_refused() {
        let servos = [ServoState::default(); 6].into();
        let readings = robot::Readings::from(robot::Observation { servos, ..Default::default() });
        let written = Observation::new(&readings, &mut LastImages::new());
        let sizes = RobotSizes::from_robot(&RobotModel::ftac_gen3());
        let error = written.read(&mut LastImages::new(), sizes).expect_err("no joints");
        assert_eq!(error, ("arm_position", "0 numbers".to_owned(), "7 numbers".to_owned()));
    }
}
