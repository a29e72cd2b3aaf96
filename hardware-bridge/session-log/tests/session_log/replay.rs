//! A replay returns what was recorded, and holds a controller to it.

use hand_model::robot::{Readings, RobotBackend, ServoGoal};
use robot_session_log::message::command_bits;
use robot_session_log::replay::{ReplayDifference, ReplayProgress};
use robot_session_log::{
    Replay, RobotSizes, SessionEvent, SessionLogError, SessionReader, SessionRecorder, SessionWriter,
};

use crate::support::*;

const TICKS: usize = 200;

fn recording() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    record(&path, TICKS);
    (folder, path)
}

fn replay(path: &std::path::Path) -> Replay {
    Replay::new(SessionReader::open(path, RobotSizes::Any).expect("opens")).expect("reads")
}

#[test]
fn a_session_is_what_it_was() {
    let (_folder, path) = recording();
    let mut reader = SessionReader::open(&path, RobotSizes::Any).expect("opens");
    assert_eq!(*reader.session(), session());
    let mut times = Vec::new();
    while let Some((time, _)) = reader.next_event().expect("reads") {
        times.push(time.host);
    }
    assert!(reader.is_finished());
    assert_eq!(times.len(), 4 * TICKS);
    assert!(times.is_sorted(), "the host's clock is monotonic");
    // Asked and sent differ where the robot limited.
    let (events, _) = read(&path);
    let limited = events.windows(2).filter(|pair| match pair {
        [SessionEvent::RequestedCommand(asked), SessionEvent::SentCommand(sent)] => asked != sent,
        _ => false,
    });
    assert!(limited.count() > 10);
}

/// The same controller asks for the same bits, every tick, images included.
#[test]
fn the_same_controller_replays_identically() {
    let (_folder, path) = recording();
    let mut replay = replay(&path);
    drive(&mut replay, TICKS);
    assert!(replay.has_ended());
    let (progress, fault) = replay.finish().expect("read to its end");
    assert_eq!(fault, None);
    assert_eq!(progress, ReplayProgress { ticks: TICKS as u64, commands: TICKS as u64 });
}

/// A robot that could neither observe nor send fails in the replay as it did, and the controller goes on as it did.
#[test]
fn failures_are_replayed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    let mut recorder =
        SessionRecorder::new(ToyRobot::failing(20..23), SessionWriter::create(&path, &session()).expect("a new file"));
    let failed = drive(&mut recorder, 60);
    assert_eq!(failed.len(), 6);
    assert_eq!(failed[..2], ["nobody answers", "the command was not sent within 0.050 s"]);
    recorder.finish().1.expect("written");
    let mut replay = replay(&path);
    assert_eq!(drive(&mut replay, 60), failed);
    let (progress, fault) = replay.finish().expect("read to its end");
    assert_eq!((progress, fault), (ReplayProgress { ticks: 60, commands: 60 }, None));
}

/// A replay recorded in turn is the same session, event by event, bit by bit.
#[test]
fn a_replay_recorded_is_the_recording() {
    let (folder, path) = recording();
    let again = folder.path().join("again.mcap");
    let mut recorder =
        SessionRecorder::new(replay(&path), SessionWriter::create(&again, &session()).expect("a new file"));
    drive(&mut recorder, TICKS);
    recorder.finish().1.expect("written");
    let (first, second) = (read(&path).0, read(&again).0);
    assert_eq!(first.len(), second.len());
    for (first, second) in first.iter().zip(&second) {
        match (first, second) {
            (SessionEvent::RequestedCommand(a), SessionEvent::RequestedCommand(b))
            | (SessionEvent::SentCommand(a), SessionEvent::SentCommand(b)) => {
                assert_eq!(command_bits(a), command_bits(b))
            }
            (SessionEvent::Observation(a), SessionEvent::Observation(b)) => {
                assert_eq!(format!("{a:?}"), format!("{b:?}"));
            }
            (SessionEvent::Tick(a), SessionEvent::Tick(b)) => assert_eq!(a.time.to_bits(), b.time.to_bits()),
            _ => panic!("{first:?} became {second:?}"),
        }
    }
}

/// A change of the last bit of one number, at tick 37, is noticed.
#[test]
fn the_last_bit_is_noticed() {
    let (_folder, path) = recording();
    let mut replay = replay(&path);
    for tick in 0..TICKS {
        let seen = replay.observe().and_then(Readings::into_observation).expect("recorded");
        let mut command = decide(&seen);
        if tick == 37 {
            command.arm[2] = f64::from_bits(command.arm[2].to_bits() ^ 1);
        }
        replay.send(&command).expect("recorded");
        replay.wait_for_tick();
    }
    let (progress, fault) = replay.finish().expect("readable");
    assert_eq!(progress.commands, 37);
    match fault {
        Some(ReplayDifference::Command { tick: 37, field, .. }) => assert_eq!(field, "arm joint 3"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn another_kind_of_goal_is_noticed() {
    let (_folder, path) = recording();
    let mut replay = replay(&path);
    let mut command = decide(&replay.observe().and_then(Readings::into_observation).expect("recorded"));
    command.servos[1] = ServoGoal::Position { angle: 0.0, current_limit: 0.0 };
    replay.send(&command).expect("recorded");
    let fault = replay.difference().expect("noticed").to_string();
    assert_eq!(fault, "tick 0: kind of goal is servo 2 angle, recorded as servo 2 current");
}

#[test]
fn another_order_is_noticed() {
    let (_folder, path) = recording();
    let mut replay = replay(&path);
    drive(&mut replay, 5);
    replay.wait_for_tick();
    let expected = ReplayDifference::Order { tick: 5, recorded: "an observation", found: "a tick" };
    assert_eq!(replay.difference(), Some(&expected));
}

/// A controller that waits for something beyond the end of the recording sees time go on.
#[test]
fn time_goes_on_after_the_end() {
    let (_folder, path) = recording();
    let mut replay = replay(&path);
    drive(&mut replay, TICKS);
    let end = replay.observe().expect("repeated").time;
    replay.wait_for_tick();
    let later = replay.observe().expect("repeated");
    assert!((later.time - end - 0.01).abs() < 1e-12 && later.tactile.is_empty());
    assert!(replay.has_ended() && replay.difference().is_none());
}

/// An existing file is somebody's recording.
#[test]
fn a_session_is_never_written_over() {
    let (_folder, path) = recording();
    let before = std::fs::read(&path).expect("readable");
    let error = SessionWriter::create(&path, &session()).err().expect("exists");
    assert!(matches!(error, SessionLogError::Io { .. }), "{error}");
    assert_eq!(std::fs::read(&path).expect("readable"), before);
}
