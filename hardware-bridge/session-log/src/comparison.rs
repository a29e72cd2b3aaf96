//! Comparison of two sessions: the first bit in which they differ.
//!
//! Observations with their images, requested and sent commands, perceived poses and tick times are compared. Raw bytes
//! are not compared, because two robots may have different links. Also left out are lateness, the outcome (it contains
//! decision times), and the capture times of images: a camera board's clock is known only to some microseconds, and no
//! decision depends on it.

use hand_model::robot::{ArmState, Readings, ServoState};

use crate::error::SessionLogError;
use crate::message::command_bits;
use crate::reader::{SessionEvent, SessionReader};

/// Result of a comparison.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionComparison {
    /// Number of whole ticks that are equal in both.
    pub ticks: u64,
    /// Number of values that are equal in both.
    pub values: u64,
    /// Number of images that are equal in both.
    pub images: u64,
    /// First difference, if any.
    pub difference: Option<SessionDifference>,
}

/// The first difference between two sessions.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("tick {tick}, {field}: found {found}, expected {expected}")]
pub struct SessionDifference {
    /// Number of the tick, from 0.
    pub tick: u64,
    /// Name of the value that differs.
    pub field: String,
    /// Value in the second session.
    pub found: String,
    /// Value in the first session.
    pub expected: String,
}

/// Compares event by event until the sessions differ or end. A session that ends earlier differs.
///
/// # Errors
/// A damaged file.
///
/// ```
/// use hand_model::robot::{Observation, Tick};
/// use robot_session_log::comparison::compare;
/// use robot_session_log::{RobotSizes, SessionHeader, SessionLogError, SessionReader, SessionWriter};
///
/// # let folder = tempfile::tempdir()?;
/// let session = |name: &str, time: f64| -> Result<SessionReader, SessionLogError> {
///     let path = folder.path().join(name);
///     let mut writer = SessionWriter::create(&path, &SessionHeader::default())?;
///     writer.observation(&Observation { time, ..Observation::default() }.into())?;
///     writer.tick(Tick { time: 0.01, lateness: 0.0 })?;
///     writer.finish()?;
///     SessionReader::open(&path, RobotSizes::Any)
/// };
/// let result = compare(&mut session("one.mcap", 0.1)?, &mut session("two.mcap", 0.1 + f64::EPSILON)?)?;
/// assert_eq!(result.difference.map(|difference| difference.field), Some("observation time".to_owned()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compare(expected: &mut SessionReader, found: &mut SessionReader) -> Result<SessionComparison, SessionLogError> {
    let mut comparison = SessionComparison::default();
    loop {
        let (first, second) = (next_compared_event(expected)?, next_compared_event(found)?);
        let differ = |field: &str, found: &str, expected: &str| SessionDifference {
            tick: comparison.ticks,
            field: field.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
        };
        let (first, second) = match (first, second) {
            (None, None) => return Ok(comparison),
            (Some(first), Some(second)) => (first, second),
            (first, second) => {
                let word = |event: &Option<SessionEvent>| event.as_ref().map_or("the end", event_name).to_owned();
                comparison.difference = Some(differ("session", &word(&second), &word(&first)));
                return Ok(comparison);
            }
        };
        if event_name(&first) != event_name(&second) {
            comparison.difference = Some(differ("event", event_name(&second), event_name(&first)));
            return Ok(comparison);
        }
        let (ours, theirs) = (event_values(&first), event_values(&second));
        let unlike = ours.iter().zip(&theirs).find(|(a, b)| a != b);
        if let Some(((field, a), (other, b))) = unlike {
            let show = |field: &str, bits: &u64| format!("{field} = {:?}", f64::from_bits(*bits));
            comparison.difference =
                Some(differ(&format!("{} {field}", event_name(&first)), &show(other, b), &show(field, a)));
            return Ok(comparison);
        }
        if let (SessionEvent::Observation(a), SessionEvent::Observation(b)) = (&first, &second)
            && let Some((field, found, expected)) = differing_image(a, b)
        {
            comparison.difference = Some(differ(&field, &found, &expected));
            return Ok(comparison);
        }
        comparison.values += ours.len() as u64;
        match first {
            SessionEvent::Observation(readings) => comparison.images += readings.tactile.len() as u64,
            SessionEvent::Tick(_) => comparison.ticks += 1,
            _ => {}
        }
    }
}

/// Returns the next event that is compared.
fn next_compared_event(reader: &mut SessionReader) -> Result<Option<SessionEvent>, SessionLogError> {
    while let Some((_, event)) = reader.next_event()? {
        if !matches!(event, SessionEvent::Raw { .. } | SessionEvent::Outcome(_)) {
            return Ok(Some(event));
        }
    }
    Ok(None)
}

fn event_name(event: &SessionEvent) -> &'static str {
    match event {
        SessionEvent::Observation(_) => "observation",
        SessionEvent::ObservationFailed(_) => "failed observation",
        SessionEvent::RequestedCommand(_) => "command requested",
        SessionEvent::SentCommand(_) => "command sent",
        SessionEvent::SendFailed(_) => "command not sent",
        SessionEvent::Tick(_) => "tick",
        SessionEvent::Detection(..) => "detection",
        SessionEvent::DetectionFailed(_) => "failed detection",
        SessionEvent::Outcome(_) => "outcome",
        SessionEvent::Raw { .. } => "raw",
    }
}

/// Returns all numbers of an event as their bits, with their names.
fn event_values(event: &SessionEvent) -> Vec<(String, u64)> {
    match event {
        SessionEvent::Observation(readings) => reading_values(readings),
        SessionEvent::RequestedCommand(command) | SessionEvent::SentCommand(command) => command_bits(command),
        SessionEvent::Tick(tick) => vec![("time".to_owned(), tick.time.to_bits())],
        SessionEvent::Detection(object, pose) => {
            let flags = [("object".to_owned(), *object as u64), ("detected".to_owned(), u64::from(pose.is_some()))];
            let numbers = pose.iter().flat_map(|(pose, _)| pose).map(|value| ("pose".to_owned(), value.to_bits()));
            let sigma = pose.and_then(|(_, sigma)| sigma).map(|sigma| ("sigma".to_owned(), sigma.to_bits()));
            flags.into_iter().chain(numbers).chain(sigma).collect()
        }
        SessionEvent::ObservationFailed(_)
        | SessionEvent::SendFailed(_)
        | SessionEvent::DetectionFailed(_)
        | SessionEvent::Outcome(_)
        | SessionEvent::Raw { .. } => Vec::new(),
    }
}

/// Returns all numbers of the readings, without the times at which the parts were read: these differ from robot to
/// robot.
fn reading_values(readings: &Readings) -> Vec<(String, u64)> {
    let Readings { time, sequence, servos, arm, tactile } = readings;
    let joints = arm.iter().flat_map(|arm| {
        let ArmState { position, velocity, torque } = arm.value;
        [("angle", position), ("speed", velocity), ("torque", torque)].into_iter().flat_map(|(what, values)| {
            (1..).zip(values).map(move |(n, value)| (format!("arm joint {n} {what}"), value.to_bits()))
        })
    });
    let read = (1..).zip(servos).filter_map(|(n, servo)| servo.map(|servo| (n, servo.value)));
    let servos = read.flat_map(|(n, servo)| {
        let ServoState { position, velocity, current, temperature } = servo;
        [("angle", position), ("speed", velocity), ("current", current), ("temperature", temperature)]
            .map(|(what, value)| (format!("servo {n} {what}"), value.to_bits()))
    });
    let head = [("time", time.to_bits()), ("sequence", *sequence), ("images", tactile.len() as u64)];
    head.map(|(what, value)| (what.to_owned(), value)).into_iter().chain(servos).chain(joints).collect()
}

/// Returns the first image that differs: name, found, expected.
fn differing_image(expected: &Readings, found: &Readings) -> Option<(String, String, String)> {
    expected.tactile.iter().zip(&found.tactile).find_map(|(a, b)| {
        if a.camera != b.camera {
            return Some(("camera".to_owned(), b.camera.to_string(), a.camera.to_string()));
        }
        let (found, expected) = (b.image.rgb.len(), a.image.rgb.len());
        if found != expected {
            return Some((
                format!("image of camera {}", a.camera),
                format!("{found} bytes"),
                format!("{expected} bytes"),
            ));
        }
        let unlike = a.image.rgb.iter().zip(&b.image.rgb).filter(|(a, b)| a != b).count();
        (unlike > 0).then(|| {
            let pixels = format!("{unlike} of {} values unlike", a.image.rgb.len());
            (format!("image of camera {}", a.camera), pixels, "none".to_owned())
        })
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use hand_model::robot::{Observation, RobotCommand, Tick};

    use super::*;
    use crate::message::RobotSizes;
    use crate::writer::{SessionHeader, SessionWriter};

    /// Records a session of `ticks` ticks, with this angle in the second.
    fn session(path: &Path, angle: f64, ticks: u64) -> SessionReader {
        let mut writer = SessionWriter::create(path, &SessionHeader::default()).expect("a file");
        for n in 0..ticks {
            let mut observation = Observation {
                time: n as f64,
                sequence: n,
                arm: ArmState::at_rest([0.0; 7].into()),
                ..Observation::default()
            };
            if n == 1 {
                observation.arm.position[3] = angle;
            }
            writer.observation(&observation.into()).expect("written");
            let command = RobotCommand {
                arm: [0.0; 7].into(),
                servos: [hand_model::robot::ServoGoal::Current(0.1); 6].into(),
                capture: false,
            };
            writer.requested_command(&command).expect("written");
            writer.sent_command(&command).expect("written");
            writer.tick(Tick { time: n as f64 + 1.0, lateness: 0.0 }).expect("written");
        }
        writer.finish().expect("finished");
        SessionReader::open(path, RobotSizes::Any).expect("readable")
    }

    #[test]
    fn the_first_bit_that_differs() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name);
        let same = compare(&mut session(&file("a"), 0.5, 3), &mut session(&file("b"), 0.5, 3)).expect("whole");
        assert_eq!((same.ticks, same.difference), (3, None));
        let other = 0.5 + f64::EPSILON;
        let unlike = compare(&mut session(&file("c"), 0.5, 3), &mut session(&file("d"), other, 3)).expect("whole");
        let difference = unlike.difference.expect("a bit");
        assert_eq!((difference.tick, difference.field.as_str()), (1, "observation arm joint 4 angle"));
        let short = compare(&mut session(&file("e"), 0.5, 3), &mut session(&file("f"), 0.5, 2)).expect("whole");
        let difference = short.difference.expect("an end");
        assert_eq!((difference.tick, difference.found.as_str()), (2, "the end"));
        // Here -0 and 0 are different numbers.
        let zero = compare(&mut session(&file("g"), 0.0, 2), &mut session(&file("h"), -0.0, 2)).expect("whole");
        assert!(zero.difference.is_some());
    }
}
