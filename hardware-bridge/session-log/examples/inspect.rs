//! Lists the contents of a session: its description, and the number and times of its events.
//!
//! `cargo run -p robot-session-log --example inspect -- SESSION.mcap`; without a file, a short session is recorded first.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use hand_model::robot::{Observation, RobotCommand, Tick};
use robot_session_log::{RobotSizes, SessionEvent, SessionHeader, SessionReader, SessionWriter};

fn record(path: &Path) -> Result<(), Box<dyn Error>> {
    let header = SessionHeader { robot: "nothing".to_owned(), tick_length: 0.01, ..SessionHeader::default() };
    let mut writer = SessionWriter::create(path, &header)?;
    for n in 0..100 {
        let time = 0.01 * f64::from(n);
        writer.observation(&Observation { time, ..Observation::default() }.into())?;
        writer.requested_command(&RobotCommand::default())?;
        writer.sent_command(&RobotCommand::default())?;
        writer.tick(Tick { time: time + 0.01, lateness: 0.0 })?;
    }
    Ok(writer.finish()?)
}

fn inspect(path: &Path) -> Result<(), Box<dyn Error>> {
    let mut reader = SessionReader::open(path, RobotSizes::Any)?;
    let session = reader.session();
    println!("{}: robot `{}`, program `{}`", path.display(), session.robot, session.program);
    println!("seed {}, ticks of {} s", session.seed, session.tick_length);
    for (name, bytes) in [("configuration", session.configuration.len()), ("task", session.task.len())] {
        println!("{name}: {bytes} bytes");
    }

    let (mut counts, mut images) = (BTreeMap::<String, u64>::new(), 0);
    let mut last = None;
    while let Some((times, event)) = reader.next_event()? {
        let name = match &event {
            SessionEvent::Observation(readings) => {
                images += readings.tactile.len();
                "observations".to_owned()
            }
            SessionEvent::ObservationFailed(_) => "failed observations".to_owned(),
            SessionEvent::RequestedCommand(_) => "requested commands".to_owned(),
            SessionEvent::SentCommand(_) => "sent commands".to_owned(),
            SessionEvent::SendFailed(_) => "commands that were not sent".to_owned(),
            SessionEvent::Tick(_) => "ticks".to_owned(),
            SessionEvent::Detection(..) => "detections".to_owned(),
            SessionEvent::DetectionFailed(_) => "failed detections".to_owned(),
            SessionEvent::Outcome(_) => "outcomes".to_owned(),
            SessionEvent::Raw { link, direction, .. } => format!("packets on {link}, {direction:?}"),
        };
        *counts.entry(name).or_default() += 1;
        last = Some(times);
    }
    for (name, count) in counts {
        println!("{count:8} {name}");
    }
    println!("{images:8} tactile images");
    if let Some(times) = last {
        println!("ends at {:.3?} on the host's clock, {:.3?} on the robot's", times.host, times.device);
    }
    println!("{}", if reader.is_finished() { "finished" } else { "cut short: its program was killed" });
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args().nth(1) {
        Some(path) => inspect(Path::new(&path)),
        None => {
            let folder = tempfile::tempdir()?;
            let path = folder.path().join("session.mcap");
            record(&path)?;
            inspect(&path)
        }
    }
}
