//! Checks of scenarios: values with which no trial can be run are refused.

use std::path::Path;

use ftac_platform::data::DataError;

use super::definition::{Scenario, VERSION};
use world::geometry::ObjectShape;
use world::objects::ObjectSet;

/// Greatest number of names in a list.
const MAX_NAMES: usize = 1000;
/// Greatest number of combinations.
const MAX_COMBINATIONS: usize = 1_000_000;
/// Greatest effort of the verification of pairs: at 1 it takes minutes a pair.
pub const MAX_EFFORT: u32 = 9;

impl Scenario {
    /// Checks that `set` contains every object named and that the objects stand clear of each other; `path` is named in
    /// errors.
    pub fn check_objects(&self, set: &ObjectSet, path: &Path) -> Result<(), DataError> {
        let reach = |field: &str, names: &[String]| {
            let mut widest = 0.0_f64;
            for name in names {
                let object = set.get(name).ok_or_else(|| {
                    let expected = format!("one of {}", set.names().join(", "));
                    DataError::field(path, field, format!("{name:?}"), expected)
                })?;
                widest = widest.max(object.shape.bounding_radius());
            }
            Ok::<_, DataError>(widest)
        };
        let reaches =
            self.object_lists().into_iter().map(|(field, names)| reach(field, names)).collect::<Result<Vec<_>, _>>()?;
        self.check_sweep(set, path)?;
        let places = self.layout.places();
        let standing: Vec<_> = reaches.iter().zip(&places).collect();
        for (n, (one, here)) in standing.iter().enumerate() {
            for (other, there) in &standing[..n] {
                let (needed, apart) = (*one + *other, self.layout.min_distance(here, there));
                if apart < needed {
                    let found = format!("places that may be {apart:.3} m apart");
                    let expected = format!("at least {needed:.3} m for the largest objects");
                    return Err(DataError::field(path, "layout", found, expected));
                }
            }
        }
        Ok(())
    }

    /// Checks that a size sweep applies to balls only: no other shape can have any diameter.
    fn check_sweep(&self, set: &ObjectSet, path: &Path) -> Result<(), DataError> {
        let Some(sweep) = &self.disturbance.size_sweep else { return Ok(()) };
        let Some((field, names)) = self.object_lists().into_iter().nth(sweep.object.index()) else { return Ok(()) };
        let ball =
            |name: &&String| set.get(name).is_some_and(|object| matches!(object.shape, ObjectShape::Sphere { .. }));
        match names.iter().find(|name| !ball(name)) {
            None => Ok(()),
            Some(name) => {
                let expected = "balls only, because disturbance.size_sweep changes their diameter";
                Err(DataError::field(path, field, format!("{name:?}"), expected))
            }
        }
    }

    /// Checks every value; `path` is named in errors.
    pub(super) fn check(&self, path: &Path) -> Result<(), DataError> {
        if self.version != VERSION {
            return Err(DataError::field(path, "version", self.version, VERSION.to_string()));
        }
        if let Err((field, found, expected)) = self.disturbance.check() {
            return Err(DataError::field(path, field, found, expected));
        }
        if let Err((field, found, expected)) = self.effects.check() {
            return Err(DataError::field(path, field, found, expected));
        }
        if self.second.is_empty() && !self.third.is_empty() {
            return Err(DataError::field(path, "second", "no object", "at least one, because third names some"));
        }
        if !self.third.is_empty() && self.layout.third.is_none() {
            return Err(DataError::field(path, "layout.third", "none", "the place of the third object"));
        }
        let objects = self.object_lists().len();
        if let Some((field, index)) = self.disturbance.objects().into_iter().find(|(_, index)| *index >= objects) {
            let found = ["first", "second"][index];
            let expected = format!("an object of the trial, which has {objects}");
            return Err(DataError::field(path, format!("disturbance.{field}"), found, expected));
        }
        for (field, names) in self.object_lists() {
            if names.is_empty() {
                return Err(DataError::field(path, field, "no object", "at least one"));
            }
            if names.len() > MAX_NAMES {
                return Err(DataError::field(
                    path,
                    field,
                    format!("{} names", names.len()),
                    format!("at most {MAX_NAMES}"),
                ));
            }
            if let Some(n) = (1..names.len()).find(|&n| names[..n].contains(&names[n])) {
                return Err(DataError::field(path, field, format!("{:?} twice", names[n]), "every name once"));
            }
        }
        if self.combination_count() > MAX_COMBINATIONS {
            let found = format!("{} combinations", self.combination_count());
            return Err(DataError::field(path, "first, second, third", found, format!("at most {MAX_COMBINATIONS}")));
        }
        if self.effort > MAX_EFFORT {
            return Err(DataError::field(path, "effort", self.effort, format!("0 to {MAX_EFFORT}")));
        }
        self.check_numbers(path)?;
        self.layout.check(path)?;
        let set = self.object_set_at(path)?;
        self.check_objects(&set, path)
    }

    fn check_numbers(&self, path: &Path) -> Result<(), DataError> {
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
                return Err(DataError::field(path, field, value, "0 to 1 (SI units: m, rad)"));
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
                let expected = format!("more than 0 and at most {most} (SI units: m, s)");
                return Err(DataError::field(path, field, value, expected));
            }
        }
        let [x, y, z] = self.start.palm;
        for (field, value, [low, high]) in
            [("start.palm[0]", x, [0.2, 0.8]), ("start.palm[1]", y, [-0.5, 0.5]), ("start.palm[2]", z, [0.1, 0.6])]
        {
            if !(low..=high).contains(&value) {
                return Err(DataError::field(path, field, value, format!("{low} to {high} m, within the arm's reach")));
            }
        }
        Ok(())
    }
}
