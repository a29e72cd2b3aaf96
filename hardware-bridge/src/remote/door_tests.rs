use std::sync::mpsc;

use super::super::{RemoteAnswer, ask, ask_all};
use super::*;

fn door(
    path: &Path,
    fulfil: impl Fn(RemoteCommand) -> Result<String, String> + Send + Sync + 'static,
) -> RemoteEndpoint {
    RemoteEndpoint::open(path, None, "the robot of a test", Arc::new(fulfil)).expect("opens")
}

#[test]
fn asks_and_answers() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("stop");
    assert!(matches!(ask(&path, RemoteCommand::Hold), Err(RemoteError::NoBridge { .. })));
    let open = door(&path, |command| match command {
        RemoteCommand::Hold => Ok("held".into()),
        other => Err(format!("not\n{other:?}\u{1b}[2J")),
    });
    let held = RemoteAnswer { text: "held".into(), robot: "the robot of a test".into() };
    assert_eq!(ask(&path, RemoteCommand::Hold).expect("answered"), held);
    let mode = std::fs::metadata(&path).expect("there").permissions().mode() & 0o777;
    assert_eq!(mode, 0o600, "{mode:o}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing but the socket");
    let refused = ask(&path, RemoteCommand::Release).expect_err("refused").to_string();
    assert_eq!(refused, "the robot of a test: not Release\\u{1b}[2J", "no escape sequence gets through");
    let second = RemoteEndpoint::open(&path, None, "", Arc::new(|_| Ok(String::new())));
    assert!(second.is_err(), "one bridge at a time");
    drop(open);
    assert!(!path.exists());
    let _stale = UnixListener::bind(&path).expect("bound");
    drop(_stale);
    drop(door(&path, |_| Ok(String::new())));
    std::fs::write(&path, "somebody's file").expect("written");
    assert!(RemoteEndpoint::open(&path, None, "", Arc::new(|_| Ok(String::new()))).is_err());
    assert_eq!(std::fs::read_to_string(&path).expect("still there"), "somebody's file");
}

/// A group's socket is accessible to that group only.
#[test]
fn a_socket_of_the_operators_is_open_to_their_group_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let group = std::fs::metadata(folder.path()).expect("there").gid();
    let path = folder.path().join("stop");
    let _open = RemoteEndpoint::open(&path, Some(group), "", Arc::new(|_| Ok(String::new()))).expect("opens");
    let found = std::fs::metadata(&path).expect("there");
    assert_eq!((found.mode() & 0o777, found.gid()), (0o660, group));
}

/// Callers that send a byte now and then, send nothing, or wait for a release do not prevent others from stopping the
/// robot.
#[test]
fn a_stop_client_that_drips_bytes_does_not_block_others() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("stop");
    let (done, over) = mpsc::channel::<()>();
    let over = std::sync::Mutex::new(over);
    let _open = door(&path, move |command| {
        if command == RemoteCommand::Release {
            let _ = over.lock().expect("whole").recv();
        }
        Ok(format!("{command:?}"))
    });
    let silent: Vec<UnixStream> = (0..2 * MAX_CALLERS).map(|_| UnixStream::connect(&path).expect("connects")).collect();
    let dripping = UnixStream::connect(&path).expect("connects");
    let mut drip = dripping.try_clone().expect("cloned");
    let dripper = std::thread::spawn(move || {
        // Until the endpoint closes the connection.
        while drip.write_all(b"h").is_ok() {
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    let (there, sender) = (path.clone(), done);
    let releasing = std::thread::spawn(move || ask(&there, RemoteCommand::Release));
    for _ in 0..20 {
        assert_eq!(ask(&path, RemoteCommand::Hold).expect("answered").text, "Hold");
    }
    dripper.join().expect("it was sent away");
    drop((sender, silent));
    assert_eq!(releasing.join().expect("no panic").expect("answered").text, "Release");
}

/// A socket that never answers does not delay the requests to the others.
#[test]
fn all_robots_are_told_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let [dead, live] = ["a", "b"].map(|name| folder.path().join(name));
    let _nobody_accepts = UnixListener::bind(&dead).expect("bound");
    let (told, heard) = mpsc::channel();
    let _open =
        door(&live, move |command| told.send(command).map(|()| "held".to_owned()).map_err(|error| error.to_string()));
    let paths = [dead.clone(), live.clone()];
    let asking = std::thread::spawn(move || ask_all(&paths, RemoteCommand::Hold));
    assert_eq!(heard.recv(), Ok(RemoteCommand::Hold));
    let answers = asking.join().expect("no panic");
    assert!(matches!(&answers[0], (path, Err(RemoteError::Socket { .. })) if *path == dead), "{answers:?}");
    assert!(matches!(&answers[1], (path, Ok(_)) if *path == live), "{answers:?}");
}
