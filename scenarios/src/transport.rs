//! Transports: several balls on a table, to be carried to one place in as few trips as the hand allows.
//!
//! A file lists the balls with their true sizes and places, the goal, the noise, and optionally a push on a ball while
//! the hand closes. Balls that overlap each other, or stand where the hand lets go, are refused.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml, read_text};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::noise::NoiseLevels;
use crate::scenario::VERSION;
use world::geometry::ObjectShape;
use world::objects::{ObjectModel, Symmetry};

/// A ball on the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransportBall {
    /// Unique name.
    pub name: String,
    /// Diameter, m.
    pub diameter: f64,
    /// Mass, kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand's elastomer.
    pub friction: f64,
    /// x in the world frame, m.
    pub x: f64,
    /// y in the world frame, m.
    pub y: f64,
}

impl TransportBall {
    /// Returns the volume, m3.
    pub fn volume(&self) -> f64 {
        std::f64::consts::PI / 6.0 * self.diameter.powi(3)
    }

    /// Returns the pose on the table, `world_from_object`.
    pub fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::new(self.x, self.y, 0.5 * self.diameter), UnitQuaternion::identity())
    }

    /// Returns the ball as an object model.
    pub fn model(&self) -> ObjectModel {
        // Larger balls are redder, so that they can be distinguished in a recording.
        let tone = (255.0 * (self.diameter / 0.12).min(1.0)) as u8;
        ObjectModel {
            name: self.name.clone(),
            shape: ObjectShape::Sphere { radius: 0.5 * self.diameter },
            mass: self.mass,
            friction: self.friction,
            color: [tone, 120, 255 - tone],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::Full,
        }
    }
}

/// Goal of a transport on the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransportGoal {
    /// x of the palm in the world frame when the hand lets go, m.
    pub x: f64,
    /// y of the palm in the world frame when the hand lets go, m.
    pub y: f64,
}

/// Heights and times of a transport.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransportProtocol {
    /// Height by which a ball is lifted, m.
    pub lift_height: f64,
    /// Time for which the carried balls are held over the goal, s.
    pub hold_time: f64,
    /// Greatest number of picks tried per ball of a transport.
    pub tries: usize,
}

/// Part of the first pick during which a ball is pushed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PushStage {
    /// The way to the first ball.
    Approach,
    /// The closing of the digits on it.
    Close,
    /// The lift.
    Lift,
}

/// A push on a ball, once, during the first pick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BallPush {
    /// Name of the ball.
    pub ball: String,
    /// Force in world axes, N.
    pub force: [f64; 3],
    /// Part of the first pick during which the push begins.
    pub stage: PushStage,
    /// Fraction of that part that has passed when the push begins, 0 to 1.
    pub at: f64,
    /// Duration, s.
    pub duration: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransportTask {
    /// Version of the file format, [`VERSION`].
    pub version: u32,
    /// Name for people.
    pub name: String,
    /// Balls to be carried.
    pub ball: Vec<TransportBall>,
    /// Place to which they are carried.
    pub goal: TransportGoal,
    /// Standard deviations of execution and perception errors.
    pub noise: NoiseLevels,
    /// Heights, times and number of tries.
    pub protocol: TransportProtocol,
    /// Push on a ball.
    pub push: Option<BallPush>,
}

/// Reach of the arm: lowest and highest x, then y, m.
const WORKSPACE: [[f64; 2]; 2] = [[0.45, 0.75], [-0.28, 0.28]];
/// Greatest number of balls.
const MAX_BALLS: usize = 8;

impl TransportTask {
    /// Returns the built-in transport of small balls, `scenarios/data/transport/small_balls.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn small_balls() -> Self {
        let text = include_str!("../data/transport/small_balls.toml");
        Self::parse(text, Path::new("small_balls.toml")).expect("the built-in transport is valid")
    }

    /// Reads and checks a file's text; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let transport: Self = parse_toml(text, path)?;
        match transport.first_invalid_value() {
            None => Ok(transport),
            Some((field, found, expected)) => Err(DataError::field(path, field, found, expected)),
        }
    }

    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        Self::parse(&read_text(path)?, path)
    }

    /// Returns the first invalid value: field, found, expected.
    fn first_invalid_value(&self) -> Option<(String, String, String)> {
        let between = |field: String, value: f64, [low, high]: [f64; 2], unit: &str| {
            let good = (low..=high).contains(&value);
            (!good).then(|| (field, value.to_string(), format!("{low} to {high} {unit}")))
        };
        if self.version != VERSION {
            return Some(("version".into(), self.version.to_string(), VERSION.to_string()));
        }
        if self.ball.is_empty() || self.ball.len() > MAX_BALLS {
            return Some(("ball".into(), format!("{} balls", self.ball.len()), format!("1 to {MAX_BALLS}")));
        }
        let NoiseLevels { execution, perception } = &self.noise;
        let mut checks = vec![
            between("goal.x".into(), self.goal.x, WORKSPACE[0], "m"),
            between("goal.y".into(), self.goal.y, WORKSPACE[1], "m"),
            between("noise.execution.position_sigma".into(), execution.position_sigma, [0.0, 1.0], "m"),
            between("noise.execution.rotation_sigma".into(), execution.rotation_sigma, [0.0, 1.0], "rad"),
            between("noise.perception.xy_sigma".into(), perception.xy_sigma, [0.0, 1.0], "m"),
            between("noise.perception.z_sigma".into(), perception.z_sigma, [0.0, 1.0], "m"),
            between("noise.perception.yaw_sigma".into(), perception.yaw_sigma, [0.0, 1.0], "rad"),
            between("protocol.lift_height".into(), self.protocol.lift_height, [0.1, 0.3], "m"),
            between("protocol.hold_time".into(), self.protocol.hold_time, [0.1, 60.0], "s"),
            between("protocol.tries".into(), self.protocol.tries as f64, [1.0, 10.0], "picks a ball"),
        ];
        for (n, ball) in self.ball.iter().enumerate() {
            let field = |name: &str| format!("ball[{n}].{name}");
            checks.push(between(field("diameter"), ball.diameter, [0.02, 0.12], "m"));
            checks.push(between(field("mass"), ball.mass, [0.001, 0.5], "kg"));
            checks.push(between(field("friction"), ball.friction, [0.0, 2.0], ""));
            checks.push(between(field("x"), ball.x, WORKSPACE[0], "m"));
            checks.push(between(field("y"), ball.y, WORKSPACE[1], "m"));
            if let Some(other) = self.ball[..n].iter().find(|other| other.name == ball.name) {
                checks.push(Some((field("name"), format!("{:?} twice", other.name), "every name once".into())));
            }
            let overlap = |other: &&TransportBall| {
                (other.x - ball.x).hypot(other.y - ball.y) < 0.5 * (other.diameter + ball.diameter) + 0.005
            };
            if let Some(other) = self.ball[..n].iter().find(overlap) {
                let found = format!("({}, {}) beside {} at ({}, {})", ball.x, ball.y, other.name, other.x, other.y);
                checks.push(Some((field("x"), found, "a place 5 mm clear of every other ball".into())));
            }
        }
        if let Some(push) = &self.push {
            if !self.ball.iter().any(|ball| ball.name == push.ball) {
                let names: Vec<&str> = self.ball.iter().map(|ball| ball.name.as_str()).collect();
                checks.push(Some((
                    "push.ball".into(),
                    format!("{:?}", push.ball),
                    format!("one of {}", names.join(", ")),
                )));
            }
            checks.push(between("push.force".into(), Vector3::from(push.force).norm(), [0.001, 100.0], "N"));
            checks.push(between("push.at".into(), push.at, [0.0, 1.0], ""));
            checks.push(between("push.duration".into(), push.duration, [0.01, 5.0], "s"));
        }
        checks.into_iter().flatten().next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = include_str!("../data/transport/small_balls.toml");
    const FOUR: &str = include_str!("../data/transport/four_balls.toml");

    fn refused(text: &str) -> String {
        TransportTask::parse(text, Path::new("mine.toml")).expect_err("refused").to_string()
    }

    #[test]
    fn the_files_are_good() {
        assert_eq!(TransportTask::small_balls().ball.len(), 4);
        let four = TransportTask::parse(FOUR, Path::new("four_balls.toml")).unwrap();
        let names: Vec<&str> = four.ball.iter().map(|ball| ball.name.as_str()).collect();
        assert_eq!(names, ["golf_ball", "softball", "yoga_ball", "tennis_ball"]);
        assert_eq!(four.push.unwrap().ball, "golf_ball");
    }

    #[test]
    fn what_cannot_be_run_is_refused_by_field() {
        let far = SMALL.replace("\ny = 0.20", "\ny = 3.0");
        assert!(refused(&far).contains("ball[0].y: found 3, expected -0.28 to 0.28 m"), "{}", refused(&far));
        let unknown = refused(&SMALL.replace("hold_time", "hold_tme"));
        assert!(unknown.starts_with("mine.toml:") && unknown.contains("hold_tme"), "{unknown}");
        assert!(refused(&FOUR.replace("ball = \"golf_ball\"", "ball = \"bowl\"")).contains("push.ball"));
        let twice = refused(&FOUR.replace("name = \"yoga_ball\"", "name = \"golf_ball\""));
        assert!(twice.contains("ball[2].name"), "{twice}");
    }

    #[test]
    fn a_ball_rests_on_the_table() {
        for ball in TransportTask::small_balls().ball {
            assert!((ball.pose().translation.z - ball.model().rest_height()).abs() < 1e-12);
            assert!((ball.volume() - ball.model().shape.volume()).abs() < 1e-12);
        }
    }
}
