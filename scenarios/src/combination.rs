//! Which objects, in which order, and where they stand: the scenario file and the combinations drawn from it.
//!
//! # Layout rule
//! The first object's centre stands at `layout.first`, the second's at `layout.second` (world x, y; m). Each is turned from
//! its rest pose by `yaw` about the vertical and touches the table with its lowest point. A combination may shift both by an
//! even draw within `spread_xy` and `spread_yaw`; all its trials and conditions share that draw. Everything must stay within
//! `reach_x` and `reach_y`, and the two objects must stand clear of each other.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::disturbance::Disturbances;
use crate::geometry::Shape;
use crate::noise::{NoiseLevels, split_mix, trial_rng, uniform};
use crate::objects::{ObjectModel, ObjectSet};
use crate::referee::RefereeRules;

mod file;

/// The version of scenario files this crate reads.
pub const VERSION: u32 = 1;

/// What can be wrong with a scenario file.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is not well-formed, has an unknown or lacks a needed field, or a value of the wrong kind.
    #[error("{path}:{line}: `{found}`: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The line.
        found: String,
        /// What was found and what was expected, in the parser's words.
        message: String,
    },
    /// A value no trial can be run with.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    Field {
        /// The file.
        path: PathBuf,
        /// Field, such as `layout.first.x`.
        field: String,
        /// What the file says.
        found: String,
        /// What would be right.
        expected: String,
    },
}

/// Where an object stands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// m, world.
    pub x: f64,
    /// m, world.
    pub y: f64,
    /// rad, about the vertical.
    pub yaw: f64,
}

impl Place {
    /// `world_from_object` of an object that rests here.
    pub fn pose(&self, object: &ObjectModel) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x, self.y, object.rest_height()),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw) * object.rest,
        )
    }
}

/// Where both stand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// The first object.
    pub first: Place,
    /// The second object.
    pub second: Place,
    /// Largest shift along x and y, m.
    pub spread_xy: f64,
    /// Largest turn, rad.
    pub spread_yaw: f64,
    /// Lowest and highest x, m.
    pub reach_x: [f64; 2],
    /// Lowest and highest y, m.
    pub reach_y: [f64; 2],
}

/// Heights, distances and times of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protocol {
    /// How far an object is lifted, m.
    pub lift_height: f64,
    /// How far both are carried, m.
    pub carry_distance: f64,
    /// How long both are held at the end, s.
    pub hold_time: f64,
    /// How long a trial may take, s.
    pub time_limit: f64,
}

/// The text of the built-in benchmark, which is also its documentation.
pub const BENCHMARK: &str = include_str!("../data/benchmark.toml");

/// A benchmark: objects, layout, noise, protocol, rules, disturbances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scenario {
    /// [`VERSION`].
    pub version: u32,
    /// For people.
    pub name: String,
    /// Objects that may come first.
    pub first: Vec<String>,
    /// Objects that may come second.
    pub second: Vec<String>,
    /// Where they stand.
    pub layout: Layout,
    /// What goes wrong.
    pub noise: NoiseLevels,
    /// Heights, distances and times.
    pub protocol: Protocol,
    /// How it is judged.
    pub referee: RefereeRules,
    /// What happens beside noise.
    pub disturbance: Disturbances,
}

/// Two objects in the order in which they are to be picked up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Combination {
    /// Position in the draw, from 0.
    pub id: usize,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object.
    pub second: String,
}

/// The value of a TOML text; `path` is used in errors, which name line and field.
pub(crate) fn parse_toml<T: serde::de::DeserializeOwned>(text: &str, path: &Path) -> Result<T, ScenarioError> {
    toml::from_str(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start).min(text.len());
        let line = text.get(..at).unwrap_or_default().matches('\n').count();
        ScenarioError::Syntax {
            path: path.into(),
            line: line + 1,
            found: text.lines().nth(line).unwrap_or_default().trim().into(),
            message: error.message().into(),
        }
    })
}

impl Scenario {
    /// The built-in benchmark, `scenarios/data/benchmark.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn benchmark() -> Self {
        Self::parse(BENCHMARK, Path::new("benchmark.toml")).expect("the built-in scenario is valid")
    }

    /// Reads and checks a scenario file's text; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ScenarioError> {
        let file: file::ScenarioFile = parse_toml(text, path)?;
        let scenario = file.complete(path)?;
        scenario.check(path)?;
        Ok(scenario)
    }

    /// Reads and checks a scenario file.
    pub fn read(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path).map_err(|source| ScenarioError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Checks that `set` has every object named and that all of them stand clear of each other; `path` is used in errors.
    pub fn check_objects(&self, set: &ObjectSet, path: &Path) -> Result<(), ScenarioError> {
        let reach = |field: &str, names: &[String]| {
            let mut widest = 0.0_f64;
            for name in names {
                let object = set.get(name).ok_or_else(|| ScenarioError::Field {
                    path: path.into(),
                    field: field.into(),
                    found: format!("{name:?}"),
                    expected: format!("one of {}", set.names().join(", ")),
                })?;
                widest = widest.max(object.shape.bounding_radius());
            }
            Ok(widest)
        };
        let needed = reach("first", &self.first)? + reach("second", &self.second)?;
        let layout = &self.layout;
        let apart = (layout.first.x - layout.second.x).hypot(layout.first.y - layout.second.y)
            - 2.0 * std::f64::consts::SQRT_2 * layout.spread_xy;
        self.check_sweep(set, path)?;
        if apart < needed {
            return Err(ScenarioError::Field {
                path: path.into(),
                field: "layout".into(),
                found: format!("places that may be {apart:.3} m apart"),
                expected: format!("at least {needed:.3} m for the largest objects"),
            });
        }
        Ok(())
    }

    /// Only balls can have any diameter.
    fn check_sweep(&self, set: &ObjectSet, path: &Path) -> Result<(), ScenarioError> {
        let Some(sweep) = &self.disturbance.size_sweep else { return Ok(()) };
        let (field, names) = [("first", &self.first), ("second", &self.second)][sweep.object.index()];
        let ball = |name: &&String| set.get(name).is_some_and(|object| matches!(object.shape, Shape::Sphere { .. }));
        match names.iter().find(|name| !ball(name)) {
            None => Ok(()),
            Some(name) => Err(ScenarioError::Field {
                path: path.into(),
                field: field.into(),
                found: format!("{name:?}"),
                expected: "balls only, because disturbance.size_sweep changes their diameter".into(),
            }),
        }
    }

    /// Names of all objects, first and second, each once, in alphabetical order.
    pub fn objects(&self) -> Vec<String> {
        let names: std::collections::BTreeSet<&String> = self.first.iter().chain(&self.second).collect();
        names.into_iter().cloned().collect()
    }

    /// How many different combinations there are.
    pub fn combinations(&self) -> usize {
        self.first.len() * self.second.len()
    }

    /// `world_from_object` of both objects of a combination at the start of each of its trials, given the benchmark's seed.
    pub fn place(&self, combination: &Combination, objects: [&ObjectModel; 2], seed: u64) -> [Isometry3<f64>; 2] {
        // No trial has this number: the draw is the combination's own.
        let mut rng = trial_rng(seed, combination.id, usize::MAX);
        let mut even = |spread: f64| spread * (2.0 * uniform(&mut rng) - 1.0);
        let Layout { first, second, spread_xy, spread_yaw, .. } = self.layout;
        let places = [first, second].map(|place| Place {
            x: place.x + even(spread_xy),
            y: place.y + even(spread_xy),
            yaw: place.yaw + even(spread_yaw),
        });
        [places[0].pose(objects[0]), places[1].pose(objects[1])]
    }

    fn check(&self, path: &Path) -> Result<(), ScenarioError> {
        let fault = |field: &str, found: String, expected: &str| {
            Err(ScenarioError::Field { path: path.into(), field: field.into(), found, expected: expected.into() })
        };
        if self.version != VERSION {
            return fault("version", self.version.to_string(), "1");
        }
        if let Err((field, found, expected)) = self.disturbance.check() {
            return fault(&field, found, &expected);
        }
        for (field, names) in [("first", &self.first), ("second", &self.second)] {
            if names.is_empty() {
                return fault(field, "no object".into(), "at least one");
            }
            if let Some(n) = (1..names.len()).find(|&n| names[..n].contains(&names[n])) {
                return fault(field, format!("{:?} twice", names[n]), "every name once");
            }
        }
        let (execution, perception) = (&self.noise.execution, &self.noise.perception);
        let not_negative = [
            ("layout.spread_xy", self.layout.spread_xy),
            ("layout.spread_yaw", self.layout.spread_yaw),
            ("noise.execution.position_sigma", execution.position_sigma),
            ("noise.execution.rotation_sigma", execution.rotation_sigma),
            ("noise.perception.xy_sigma", perception.xy_sigma),
            ("noise.perception.z_sigma", perception.z_sigma),
            ("noise.perception.yaw_sigma", perception.yaw_sigma),
            ("protocol.carry_distance", self.protocol.carry_distance),
        ];
        for (field, value) in not_negative {
            if !(value.is_finite() && (0.0..=1.0).contains(&value)) {
                return fault(field, value.to_string(), "0 to 1 (SI units: m, rad)");
            }
        }
        let positive = [
            ("protocol.lift_height", self.protocol.lift_height, 1.0),
            ("protocol.hold_time", self.protocol.hold_time, 600.0),
            ("protocol.time_limit", self.protocol.time_limit, 3600.0),
            ("referee.palm_distance", self.referee.palm_distance, 1.0),
            ("referee.slip", self.referee.slip, 1.0),
            ("referee.knock_distance", self.referee.knock_distance, 1.0),
        ];
        for (field, value, most) in positive {
            if !(value > 0.0 && value <= most) {
                return fault(field, value.to_string(), &format!("more than 0 and at most {most} (SI units: m, s)"));
            }
        }
        let layout = &self.layout;
        for (which, place) in [("first", layout.first), ("second", layout.second)] {
            for (axis, value, [low, high]) in [("x", place.x, layout.reach_x), ("y", place.y, layout.reach_y)] {
                if !(value - layout.spread_xy >= low && value + layout.spread_xy <= high) {
                    let expected =
                        format!("within reach, {low} to {high} m, with the spread of {} m", layout.spread_xy);
                    return fault(&format!("layout.{which}.{axis}"), value.to_string(), &expected);
                }
            }
            if !place.yaw.is_finite() {
                return fault(&format!("layout.{which}.yaw"), place.yaw.to_string(), "a finite angle in rad");
            }
        }
        Ok(())
    }
}

/// The first `n` combinations of all ordered pairs (first, second), shuffled by `seed`: fewer pairs end the draw early, and a
/// shorter draw is the beginning of a longer one.
pub fn draw_combinations(scenario: &Scenario, n: usize, seed: u64) -> impl Iterator<Item = Combination> {
    let mut pairs: Vec<(String, String)> = scenario
        .first
        .iter()
        .flat_map(|first| scenario.second.iter().map(move |second| (first.clone(), second.clone())))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(split_mix(seed));
    for last in (1..pairs.len()).rev() {
        let other = ((u128::from(rng.next_u64()) * (last as u128 + 1)) >> 64) as usize;
        pairs.swap(last, other);
    }
    pairs.into_iter().take(n).enumerate().map(|(id, (first, second))| Combination { id, first, second })
}

#[cfg(test)]
mod tests;
