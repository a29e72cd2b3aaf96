//! A driver's process as the devices of a robot.

use std::time::Duration;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{ArmState, ServoState, TactileImage};
use hardware_bridge::clock::Clock;
use hardware_bridge::delivered_images::DeliveredImages;
use hardware_bridge::robot_link::RobotLink;
use hardware_bridge::safety::checks::{ArmReading, Measurements, ServoReading};
use hardware_bridge::safety::limits::{SafeGoal, WatchdogTimeouts};
use hardware_bridge::safety::supervisor::SafeCommand;
use hardware_bridge::servo_cycle::CycleReport;
use python_process::{Answer, ProcessError};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::description::DriverDescription;
use super::{SharedProcess, describe_failure};

/// Time limit for a driver to close its devices.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(10);
/// Time beyond two answers from which on this program itself must have stood still, s.
const STANDSTILL_MARGIN: f64 = 0.1;

/// Devices behind a driver's process. Once the process has failed, nothing is asked of it any more.
pub(crate) struct DriverLink {
    process: SharedProcess,
    joints: usize,
    servos: usize,
    cameras: usize,
    images: DeliveredImages,
    senses_torque: bool,
    /// Longest time between two cycles of a working driver, s.
    longest_cycle: f64,
    failed: bool,
}

/// Measurements, with their ages at the end of the measurement, s.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    /// Of each servo: angle (rad), speed (rad/s), current (A), temperature (degrees Celsius).
    servos: Vec<[f64; 4]>,
    servo_ages: Vec<f64>,
    /// Of each joint: angle (rad), speed (rad/s), torque (N m).
    arm: Vec<[f64; 3]>,
    arm_age: f64,
    /// Camera and age of each image that accompanies the answer.
    #[serde(default)]
    images: Vec<(usize, f64)>,
}

/// The command that was really sent, where it is not the one that was asked for.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sent {
    /// Set-points of the joints, rad.
    arm: Option<Vec<f64>>,
    /// Of each servo: goal (rad) and current limit (A).
    servos: Option<Vec<[f64; 2]>>,
}

/// Answer to a request that returns nothing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Done {}

impl DriverLink {
    /// Joins the driver behind `process`, which describes itself so. Its images go to `images`.
    pub fn new(process: SharedProcess, description: &DriverDescription, images: DeliveredImages) -> Self {
        let longest_cycle = 2.0 * process.lock().timeout().as_secs_f64() + STANDSTILL_MARGIN;
        Self {
            process,
            joints: description.joints.len(),
            servos: description.servos.len(),
            cameras: description.cameras.len(),
            images,
            senses_torque: description.senses_torque,
            longest_cycle,
            failed: false,
        }
    }

    /// Asks the driver. The first failure is noted in `report`.
    fn ask<T>(
        &mut self,
        question: &Value,
        report: &mut CycleReport,
        read: impl FnOnce(&Self, Answer) -> Result<T, ProcessError>,
    ) -> Option<T> {
        if self.failed {
            return None;
        }
        let answered = self.process.lock().ask(question, &[]);
        let answered = answered.and_then(|answer| read(self, answer));
        answered
            .map_err(|error| {
                self.failed = true;
                report.driver_error = Some(format!("{}: {}", name_of(question), describe_failure(&error)));
            })
            .ok()
    }

    fn read_measurements(
        &self,
        answer: Answer,
        clock: &Clock,
        measured: &mut Measurements,
    ) -> Result<(), ProcessError> {
        let Measured { servos, servo_ages, arm, arm_age, images } = read(answer.value)?;
        check_count("servos", servos.len(), self.servos)?;
        check_count("servo_ages", servo_ages.len(), self.servos)?;
        check_count("arm", arm.len(), self.joints)?;
        check_count("images", images.len(), answer.arrays.len())?;
        let ages = servo_ages.iter().chain([&arm_age]).chain(images.iter().map(|(_, age)| age));
        if let Some(age) = ages.copied().find(|age| *age < 0.0) {
            return Err(invalid(format!("age: found {age} s, expected 0 or more")));
        }
        let now = clock.now();
        for ((newest, row), age) in measured.servos.iter_mut().zip(&servos).zip(servo_ages) {
            let [position, velocity, current, temperature] = *row;
            let state = ServoState { position, velocity, current, temperature };
            *newest = Some(ServoReading { received_at: now - age, state, voltage: None, alert: false });
        }
        let column = |n: usize| arm.iter().map(|row| row[n]).collect();
        let state = ArmState { position: column(0), velocity: column(1), torque: column(2) };
        measured.arm = Some(ArmReading { received_at: now - arm_age, state, fault: None });
        for ((camera, age), (shape, rgb)) in images.into_iter().zip(answer.arrays) {
            if camera >= self.cameras {
                return Err(invalid(format!("camera: found {camera}, expected less than {}", self.cameras)));
            }
            if shape != [IMAGE_SIZE, IMAGE_SIZE, 3] {
                let expected = [IMAGE_SIZE, IMAGE_SIZE, 3];
                return Err(invalid(format!("image of camera {camera}: found shape {shape:?}, expected {expected:?}")));
            }
            self.images.deliver(camera, now - age, TactileImage { rgb });
        }
        Ok(())
    }

    /// Reads the command that was sent when `asked` was asked for.
    fn read_sent(&self, value: Value, asked: &SafeCommand) -> Result<SafeCommand, ProcessError> {
        let (Sent { arm, servos }, mut sent) = (read(value)?, *asked);
        if let Some(arm) = arm {
            check_count("arm", arm.len(), self.joints)?;
            sent.arm = arm.into_iter().collect();
        }
        if let Some(servos) = servos {
            check_count("servos", servos.len(), self.servos)?;
            sent.servos = servos.iter().map(|&[angle, current]| SafeGoal { angle, current }).collect();
        }
        Ok(sent)
    }

    /// Makes a request that returns nothing. Returns false if the driver has failed.
    fn request(&mut self, name: &str, report: &mut CycleReport) -> bool {
        self.ask(&json!({ "ask": name }), report, |_, answer| read::<Done>(answer.value)).is_some()
    }
}

impl RobotLink for DriverLink {
    fn measure(&mut self, clock: &Clock, measured: &mut Measurements, report: &mut CycleReport) {
        let seen = self.ask(&json!({ "ask": "observe" }), report, |own, answer| {
            let mut new = *measured;
            own.read_measurements(answer, clock, &mut new).map(|()| new)
        });
        *measured = seen.unwrap_or(*measured);
        measured.driver = !self.failed;
    }

    fn send(&mut self, command: &SafeCommand, report: &mut CycleReport) -> SafeCommand {
        let servos: Vec<[f64; 2]> = command.servos.iter().map(|goal| [goal.angle, goal.current]).collect();
        let capture = self.images.take_request();
        let question = json!({ "ask": "send", "arm": command.arm.as_slice(), "servos": servos, "capture": capture });
        self.ask(&question, report, |own, answer| own.read_sent(answer.value, command)).unwrap_or(*command)
    }

    fn engage(&mut self, _: &SafeCommand, _: f64) -> Result<(), String> {
        let mut report = CycleReport::default();
        self.request("start", &mut report);
        report.driver_error.map_or(Ok(()), Err)
    }

    fn torque_off(&mut self, report: &mut CycleReport) -> Vec<String> {
        match self.request("stop", report) {
            true => Vec::new(),
            false => (1..=self.servos).map(|n| format!("servo {n}: the driver has failed")).collect(),
        }
    }

    fn park(&mut self, report: &mut CycleReport) {
        self.request("stop", report);
    }

    fn step(&mut self, report: &mut CycleReport) {
        self.request("step", report);
    }

    fn standstill_limit(&self, _: &WatchdogTimeouts) -> f64 {
        self.longest_cycle
    }

    fn senses_torque(&self) -> bool {
        self.senses_torque
    }
}

impl Drop for DriverLink {
    fn drop(&mut self) {
        let mut process = self.process.lock();
        if process.is_healthy() {
            // The process ends in any case.
            let _ = process.ask_within(CLOSE_TIMEOUT, &json!({ "ask": "close" }), &[]);
        }
    }
}

fn name_of(question: &Value) -> &str {
    question["ask"].as_str().unwrap_or_default()
}

fn invalid(words: String) -> ProcessError {
    ProcessError::InvalidAnswer(words)
}

/// Reads the value of an answer.
pub(super) fn read<T: DeserializeOwned>(value: Value) -> Result<T, ProcessError> {
    serde_json::from_value(value).map_err(|error| invalid(error.to_string()))
}

fn check_count(name: &str, found: usize, expected: usize) -> Result<(), ProcessError> {
    match found == expected {
        true => Ok(()),
        false => Err(invalid(format!("{name}: found {found}, expected {expected}"))),
    }
}
