//! Parsing and validation of a measurement of a vision system.

use control::detection::PoseDetection;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use world::physics::Physics;

/// Tolerance of a time stamp in the future, s.
const FUTURE_TOLERANCE: f64 = 0.1;
/// Lowest and highest position of an object's origin above the table, m.
const HEIGHT_RANGE: (f64, f64) = (-0.02, 0.5);
/// Smallest and largest accepted standard deviation, m: smaller ones are not credible, larger ones not useful.
const SIGMA_RANGE: (f64, f64) = (1e-5, 0.1);

/// A line as it is sent.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeasurementLine {
    /// Name as in the scenario.
    object: String,
    /// Time of the measurement: Unix time, s.
    time: f64,
    /// Frame of the pose.
    #[serde(default)]
    frame: PoseFrame,
    /// Position of the object's origin, m.
    position: Option<[f64; 3]>,
    /// Rotation of the object as a quaternion, x, y, z, w.
    quaternion: Option<[f64; 4]>,
    /// Covariance of x, y, z (m) and the rotation vector (rad) along the frame's axes, row-major: 36 numbers.
    covariance: Option<Vec<f64>>,
    /// True if the object is searched for but hidden; pose and covariance are then left out.
    #[serde(default)]
    hidden: bool,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum PoseFrame {
    #[default]
    Table,
    ArmBase,
}

/// Conditions that a line must satisfy.
#[derive(Debug, Clone)]
pub struct MeasurementChecks {
    /// Names of all possible objects.
    known_objects: Vec<String>,
    /// Pose of the arm's base, for poses in its frame.
    world_from_base: Isometry3<f64>,
    /// Lowest and highest x and y of the table, m.
    table: [(f64, f64); 2],
}

impl MeasurementChecks {
    /// Creates the checks for objects of these names on the standard table.
    pub fn new(known: Vec<String>, world_from_base: Isometry3<f64>) -> Self {
        let table = Physics::standard().table;
        let table = [0, 1].map(|n| (table.center[n] - table.half[n], table.center[n] + table.half[n]));
        Self { known_objects: known, world_from_base, table }
    }
}

/// A refused line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {what}")]
pub struct RefusedLine {
    /// Number of the line since the connection.
    pub line: u64,
    /// The field, the value found and the values expected.
    pub what: String,
}

/// A valid measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    pub object: String,
    /// Unix time, s.
    pub time: f64,
    /// Detected pose of the object; none if it is hidden.
    pub detection: Option<PoseDetection>,
}

/// Reads the measurement on a line at `now` (Unix time, s). `number` is that of the line, for errors.
pub fn parse_line(line: &[u8], number: u64, checks: &MeasurementChecks, now: f64) -> Result<Measurement, RefusedLine> {
    let refused = |what: String| RefusedLine { line: number, what };
    let line: MeasurementLine = serde_json::from_slice(line).map_err(|error| refused(error.to_string()))?;
    let field = |name: &str, found: String, expected: &str| {
        Err(refused(format!("{}: {name}: found {found}, expected {expected}", line.object)))
    };
    if !checks.known_objects.contains(&line.object) {
        return Err(refused(format!(
            "object: found {}, expected one of {}",
            line.object,
            checks.known_objects.join(", ")
        )));
    }
    if !line.time.is_finite() || line.time > now + FUTURE_TOLERANCE {
        return field("time", format!("{} ({:.2} s ahead)", line.time, line.time - now), "a Unix time in the past");
    }
    let MeasurementLine { object, time, frame, .. } = &line;
    if line.hidden {
        return match (line.position, line.quaternion) {
            (None, None) => Ok(Measurement { object: object.clone(), time: *time, detection: None }),
            _ => field("hidden", "a pose too".to_owned(), "either"),
        };
    }
    let (Some(position), Some(quaternion)) = (line.position, line.quaternion) else {
        return field("position and quaternion", "one or none".to_owned(), "both, or `hidden`: true");
    };
    let Some(covariance) = &line.covariance else { return field("covariance", "none".to_owned(), "36 numbers") };
    if covariance.len() != 36 || !covariance.iter().all(|value| value.is_finite()) {
        return field("covariance", format!("{} numbers", covariance.len()), "36 finite numbers");
    }
    let [x, y, z, w] = quaternion;
    let turn = Quaternion::new(w, x, y, z);
    if !(0.999..1.001).contains(&turn.norm()) {
        return field("quaternion", format!("norm {}", turn.norm()), "norm 1");
    }
    let covariance = Matrix6::from_row_slice(covariance);
    let sound = (covariance - covariance.transpose()).norm() <= 1e-6 * covariance.norm();
    if !sound || covariance.symmetric_eigenvalues().min() < -1e-9 * covariance.norm() {
        return field("covariance", "one that is not symmetric or has a negative variance".to_owned(), "a covariance");
    }
    let measured = Isometry3::from_parts(Translation3::from(position), UnitQuaternion::from_quaternion(turn));
    let world = match frame {
        PoseFrame::Table => Isometry3::identity(),
        PoseFrame::ArmBase => checks.world_from_base,
    };
    let pose = world * measured;
    let at = Point3::from(pose.translation.vector);
    let over = checks.table.iter().zip([at.x, at.y]).all(|((low, high), value)| (*low..=*high).contains(&value));
    if !over || !(HEIGHT_RANGE.0..=HEIGHT_RANGE.1).contains(&at.z) {
        return field(
            "position",
            format!("({:.3}, {:.3}, {:.3}) m", at.x, at.y, at.z),
            &format!("a place on the table, x {:?}, y {:?}, z {HEIGHT_RANGE:?} m", checks.table[0], checks.table[1]),
        );
    }
    let turn = world.rotation.to_rotation_matrix().into_inner();
    let place: Matrix3<f64> = turn * covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
    let sigma = horizontal_sigma(&place.diagonal());
    if !(SIGMA_RANGE.0..=SIGMA_RANGE.1).contains(&sigma) {
        return field("covariance", format!("a standard deviation of {sigma:e} m"), "0.00001 to 0.1 m");
    }
    Ok(Measurement { object: object.clone(), time: *time, detection: Some(PoseDetection { pose, sigma: Some(sigma) }) })
}

/// Returns the root mean square of the standard deviations of x and y, m.
fn horizontal_sigma(variances: &Vector3<f64>) -> f64 {
    (0.5 * (variances.x + variances.y)).sqrt()
}

/// Formats a line as a vision system sends it: `object` at `pose` on the table, with standard deviations of x, y, z (m)
/// and of the rotation (rad).
pub fn format_line(object: &str, time: f64, pose: &Isometry3<f64>, (place, turn): (f64, f64)) -> String {
    let sigma = [place, place, place, turn, turn, turn];
    let covariance: Vec<f64> = (0..36).map(|n| if n % 7 == 0 { sigma[n / 7].powi(2) } else { 0.0 }).collect();
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    serde_json::json!({
        "object": object, "time": time, "frame": "table",
        "position": [t.x, t.y, t.z], "quaternion": [q.x, q.y, q.z, q.w], "covariance": covariance,
    })
    .to_string()
        + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checks() -> MeasurementChecks {
        MeasurementChecks::new(vec!["pear".to_owned()], Isometry3::translation(0.0, 0.0, 0.01))
    }

    fn refusal(from: &str, to: &str) -> String {
        let good = format_line("pear", 100.0, &Isometry3::translation(0.62, 0.25, 0.03), (0.003, 0.02));
        assert!(good.contains(from), "{good}");
        parse_line(good.replacen(from, to, 1).as_bytes(), 3, &checks(), 100.0).expect_err("bad").to_string()
    }

    #[test]
    fn a_line_is_read_as_it_was_written() {
        let pose = Isometry3::new(Vector3::new(0.62, -0.14, 0.03), Vector3::new(0.0, 0.0, 0.4));
        let text = format_line("pear", 100.0, &pose, (0.003, 0.02));
        let seen = parse_line(text.as_bytes(), 1, &checks(), 100.0).expect("good");
        let sighted = seen.detection.expect("seen");
        assert_eq!((seen.object.as_str(), seen.time), ("pear", 100.0));
        assert!((sighted.sigma.expect("stated") - 0.003).abs() < 1e-12);
        assert!((sighted.pose.inverse() * pose).translation.vector.norm() < 1e-12);
        // The arm's base stands 10 mm above the table.
        let based = text.replace("\"table\"", "\"arm_base\"");
        let sighted = parse_line(based.as_bytes(), 1, &checks(), 100.0).expect("good").detection.expect("seen");
        assert!((sighted.pose.translation.z - 0.04).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_is_refused_in_words() {
        for (from, to, words) in [
            ("pear", "plum", "line 3: object: found plum, expected one of pear"),
            ("0.62", "NaN", "line 3: expected value"),
            ("0.62", "1e999", "out of range"),
            ("0.62", "6.2", "expected a place on the table"),
            ("0.03]", "-0.3]", "expected a place on the table"),
            ("100.0", "101.0", "time: found 101"),
            ("table", "camera", "camera"),
            ("\"quaternion\":[0.0", "\"quaternion\":[0.5", "expected norm 1"),
            ("\"position\"", "\"positions\"", "positions"),
            ("\"covariance\":[", "\"covariance\":[1.0,", "36 finite numbers"),
            ("\"covariance\":[9e-6,0.0", "\"covariance\":[9e-6,1.0", "not symmetric"),
            ("\"covariance\":[9e-6", "\"covariance\":[-9e-6", "negative variance"),
            ("\"object\"", "\"hidden\": true, \"object\"", "hidden: found a pose too"),
            ("{", "[", "line 3"),
        ] {
            let message = refusal(from, to);
            assert!(message.contains(words), "{to}: {message}");
        }
        let exact = format_line("pear", 100.0, &Isometry3::translation(0.62, 0.25, 0.03), (0.0, 0.0));
        let message = parse_line(exact.as_bytes(), 1, &checks(), 100.0).expect_err("error of 0").to_string();
        assert!(message.contains("0.00001 to 0.1 m"), "{message}");
    }
}
