//! Faults of the plant itself: cables, servos, joints, objects, and the lighting of the cameras. They apply to a
//! simulated robot, and to the one behind running emulated devices.

use std::sync::{Arc, Mutex, PoisonError};

use hand_model::robot::{Observation, Plant, RobotCommand, Tick};
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Vector3};
use plant::CameraFailure;
use robot_backends::wire_emulation::SharedPlant;
use sim::SimulatedRobot;

/// Position of a snatched object, beside the middle of the table, m.
const SNATCHED_POSITION: [f64; 3] = [0.3, 0.6, 0.1];
/// Duration of a push given as text, s.
const PUSH_DURATION: f64 = 0.5;
/// Largest slip accepted as text, m.
const MAX_SLIP: f64 = 0.05;
/// Largest push accepted as text, N.
const MAX_PUSH_FORCE: f64 = 100.0;
/// Largest added mass accepted as text, kg.
const MAX_ADDED_MASS: f64 = 5.0;

/// Syntax of faults as text: the name of each, with its parameters.
pub const FAULT_SYNTAX: &str = "break=DIGIT, slip=DIGIT:MM, weak=DIGIT:SHARE of its torque, stick=JOINT, heavy=OBJECT:KG more, snatch=OBJECT, push=NEWTONS on the palm for half a second, dim=CAMERA:red|green|blue:SHARE of its light or blind=PAD:missing|black";

/// A plant fault that can be injected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlantFault {
    Break(usize),
    /// Digit, and length of the slip, m.
    Slip(usize, f64),
    /// Digit, and share of its torque that is left.
    Weak(usize, f64),
    Stick(usize),
    /// Object, and added mass, kg.
    Heavy(usize, f64),
    Snatch(usize),
    /// Force on the palm, N, for the duration of the push.
    Push(Vector3<f64>),
    Freeze(usize),
    Blind(usize, CameraFailure),
    /// Camera, colour channel, and share of the light that is left.
    Dim(usize, usize, f32),
}

/// Error for text that does not describe a fault, with the offending part.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("fault: {text}: found `{found}`, expected {expected}")]
pub struct PlantSyntaxError {
    text: String,
    found: String,
    expected: String,
}

impl PlantFault {
    /// Parses a fault such as `slip=ring:3`. Returns `None` if its name is not in [`FAULT_SYNTAX`].
    pub fn parse(text: &str, hand: &Hand) -> Result<Option<Self>, PlantSyntaxError> {
        let Some((name, value)) = text.split_once('=') else { return Ok(None) };
        let (first, rest) = value.split_once(':').map_or((value, None), |(first, rest)| (first, Some(rest)));
        let wrong = |found: &str, expected: &str| PlantSyntaxError {
            text: text.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
        };
        let alone = |fault: Self| match rest {
            Some(rest) => Err(wrong(rest, &format!("nothing after {name}={first}"))),
            None => Ok(fault),
        };
        let number = |text: Option<&str>, least: f64, most: f64, what: &str| {
            let found = text.unwrap_or_default();
            let inside = |value: &f64| (least..=most).contains(value);
            let expected = || wrong(found, &format!("{what}, {least} to {most}"));
            found.parse().ok().filter(inside).ok_or_else(expected)
        };
        let named = |found: &str, mut names: Vec<&str>, what: &str| {
            let at = names.iter().position(|name| *name == found);
            names.sort_unstable();
            at.ok_or_else(|| wrong(found, &format!("{what}: {}", names.join(", "))))
        };
        let digit = || named(first, Digit::ALL.map(Digit::name).to_vec(), "a digit");
        let object = || match first {
            "1" => Ok(0),
            "2" => Ok(1),
            _ => Err(wrong(first, "an object, 1 or 2 in their order on the table")),
        };
        let fault = match name {
            "break" => alone(Self::Break(digit()?))?,
            "slip" => Self::Slip(digit()?, 1e-3 * number(rest, 0.1, 1e3 * MAX_SLIP, "mm")?),
            "weak" => Self::Weak(digit()?, number(rest, 0.0, 1.0, "a share of the torque")?),
            "stick" => {
                let joints = hand.tree.joints.iter().map(|joint| joint.name.as_str()).collect();
                alone(Self::Stick(named(first, joints, "a joint")?))?
            }
            "heavy" => Self::Heavy(object()?, number(rest, 0.0, MAX_ADDED_MASS, "kg")?),
            "snatch" => alone(Self::Snatch(object()?))?,
            "push" => {
                alone(Self::Push(Vector3::new(0.0, number(Some(first), -MAX_PUSH_FORCE, MAX_PUSH_FORCE, "N")?, 0.0)))?
            }
            "dim" => {
                let (colour, share) =
                    rest.unwrap_or_default().split_once(':').unwrap_or((rest.unwrap_or_default(), ""));
                let channel = named(colour, vec!["red", "green", "blue"], "a colour")?;
                let share = number(Some(share), 0.0, 1.0, "a share of the light")?;
                Self::Dim(camera(first, hand).ok_or_else(|| wrong(first, &cameras(hand)))?, channel, share as f32)
            }
            "blind" => {
                let pad = named(first, hand.pads.iter().map(|pad| pad.name.as_str()).collect(), "a pad")?;
                let how = match rest {
                    Some("missing") => CameraFailure::Missing,
                    Some("black") => CameraFailure::Black,
                    other => return Err(wrong(other.unwrap_or_default(), "missing or black")),
                };
                Self::Blind(pad, how)
            }
            _ => return Ok(None),
        };
        Ok(Some(fault))
    }

    /// Injects the fault into `robot`. A push does not act until [`PlantFault::apply_push`].
    pub fn inject(&self, robot: &mut SimulatedRobot, hand: &Hand) {
        match *self {
            Self::Break(n) => robot.break_cable(n),
            Self::Slip(n, length) => robot.slip_cable(n, length),
            Self::Weak(n, share) => robot.weaken_servo(n, share),
            Self::Stick(joint) => robot.stick_joint(joint),
            Self::Heavy(object, more) => robot.add_mass(object, more),
            Self::Snatch(object) => robot.set_object_pose(
                object,
                &Isometry3::translation(SNATCHED_POSITION[0], SNATCHED_POSITION[1], SNATCHED_POSITION[2]),
            ),
            Self::Push(_) => {}
            Self::Freeze(camera) => robot.freeze_camera(camera),
            Self::Blind(pad, how) => {
                let name = hand.pads.get(pad).map(|pad| pad.name.clone());
                robot.fail_cameras(name.as_slice(), how);
            }
            Self::Dim(camera, channel, left) => robot.dim_lamp(camera, channel, left),
        }
    }

    /// Applies the part of a fault that acts in every tick, such as a push.
    pub fn apply_push(&self, robot: &mut SimulatedRobot) {
        if let Self::Push(force) = self {
            robot.apply_force(None, *force);
        }
    }
}

/// Returns the camera with this name or number.
fn camera(text: &str, hand: &Hand) -> Option<usize> {
    let number = text.parse().ok().filter(|number| *number < hand.cameras.len());
    number.or_else(|| hand.cameras.iter().position(|camera| camera.name == text))
}

fn cameras(hand: &Hand) -> String {
    let names: Vec<&str> = hand.cameras.iter().map(|camera| camera.name.as_str()).collect();
    format!("a camera, 0 to {} or {}", hand.cameras.len() - 1, names.join(", "))
}

/// A plant into which faults can be injected while it runs.
#[derive(Clone)]
pub struct FaultyPlant {
    plant: SharedPlant,
    /// The present push, and its remaining time, s.
    push: Arc<Mutex<Option<(PlantFault, f64)>>>,
}

impl FaultyPlant {
    pub fn new(plant: SharedPlant) -> Self {
        Self { plant, push: Arc::default() }
    }

    /// Injects `fault` now.
    pub fn inject_now(&self, fault: &PlantFault, hand: &Hand) {
        fault.inject(&mut self.plant.lock(), hand);
        if matches!(fault, PlantFault::Push(_)) {
            *self.push.lock().unwrap_or_else(PoisonError::into_inner) = Some((*fault, PUSH_DURATION));
        }
    }
}

impl Plant for FaultyPlant {
    fn observe(&mut self) -> Observation {
        self.plant.observe()
    }

    fn send(&mut self, command: &RobotCommand) -> RobotCommand {
        self.plant.send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        let mut push = self.push.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((fault, left)) = push.as_mut().filter(|(_, left)| *left > 0.0) {
            fault.apply_push(&mut self.plant.lock());
            *left -= self.plant.tick_length();
        }
        drop(push);
        self.plant.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.plant.tick_length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_and_what_is_wrong_is_named() {
        let hand = Hand::ftac();
        let read = |text: &str| PlantFault::parse(text, &hand).expect("good").expect("a fault");
        assert_eq!(read("break=ring"), PlantFault::Break(3));
        assert_eq!(read("slip=index:3"), PlantFault::Slip(1, 0.003));
        assert_eq!(read("weak=thumb:0.6"), PlantFault::Weak(0, 0.6));
        assert_eq!(read(&format!("stick={}", hand.tree.joints[4].name)), PlantFault::Stick(4));
        assert_eq!(read("heavy=1:0.3"), PlantFault::Heavy(0, 0.3));
        assert_eq!(read("snatch=2"), PlantFault::Snatch(1));
        assert_eq!(read("push=12"), PlantFault::Push(Vector3::new(0.0, 12.0, 0.0)));
        assert_eq!(read("dim=3:green:0.5"), PlantFault::Dim(3, 1, 0.5));
        assert_eq!(read(&format!("dim={}:red:0.5", hand.cameras[7].name)), PlantFault::Dim(7, 0, 0.5));
        assert_eq!(read(&format!("blind={}:black", hand.pads[2].name)), PlantFault::Blind(2, CameraFailure::Black));
        for (text, words) in [
            ("break=toe", "found `toe`, expected a digit: index, little"),
            ("break=ring:3", "found `3`, expected nothing after break=ring"),
            ("slip=ring", "expected mm, 0.1 to 50"),
            ("slip=ring:900", "found `900`"),
            ("weak=ring:nan", "found `nan`"),
            ("stick=nose", "expected a joint: "),
            ("heavy=3:1", "an object, 1 or 2"),
            ("push=hard", "found `hard`, expected N"),
            ("dim=99:red:0.5", "a camera, 0 to 17"),
            ("dim=1:pink:0.5", "a colour: blue, green, red"),
            ("blind=palm", "a pad: "),
        ] {
            let error = PlantFault::parse(text, &hand).expect_err("bad").to_string();
            assert!(error.contains(words) && error.contains(text), "{error}");
        }
        assert_eq!(PlantFault::parse("dance=1", &hand), Ok(None));
        assert_eq!(PlantFault::parse("freeze=7", &hand), Ok(None), "the board's");
    }
}
