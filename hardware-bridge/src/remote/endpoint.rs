//! The server of the stop sockets, in the running bridge.
//!
//! One thread serves all callers at once. A caller has [`LINE_TIMEOUT`] for its line, however slowly it sends, and is
//! answered on a separate thread. Neither a slow caller nor one that waits for a release delays a stop by another.

use std::fs::{DirBuilder, Permissions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::{RemoteCommand, RemoteError};

/// Time limit for a caller's whole line.
const LINE_TIMEOUT: Duration = Duration::from_millis(500);
/// Maximum length of a line, bytes.
const MAX_LINE_LENGTH: usize = 64;
/// Maximum number of callers that are waited for; the oldest is dropped for a new one.
const MAX_CALLERS: usize = 64;
/// Maximum number of requests in progress; those to hold are always accepted.
const MAX_REQUESTS: usize = 32;
/// Interval between checks whether the bridge has ended.
const POLL_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// Handler of a request: returns the result as read back, or the reason why it failed.
pub type RequestHandler = dyn Fn(RemoteCommand) -> Result<String, String> + Send + Sync;

/// An open stop socket; closed when dropped.
#[derive(Debug)]
pub struct RemoteEndpoint {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RemoteEndpoint {
    /// Listens at `path`, open to its owner and, if one is given, to `group`. Every request is passed to `fulfil`,
    /// whose answer goes back with the robot's name `of`.
    pub fn open(path: &Path, group: Option<u32>, of: &str, fulfil: Arc<RequestHandler>) -> Result<Self, RemoteError> {
        let failed = |source| RemoteError::Socket { path: path.to_owned(), source };
        if let Ok(found) = std::fs::symlink_metadata(path) {
            if !found.file_type().is_socket() {
                return Err(failed(io::Error::other("found another kind of file there, expected none or a socket")));
            }
            if UnixStream::connect(path).is_ok() {
                return Err(failed(io::Error::other("another bridge is running there")));
            }
            std::fs::remove_file(path).map_err(failed)?;
        }
        let listener = bind(path, group).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, of) = (stop.clone(), of.to_owned());
        let thread = std::thread::Builder::new()
            .name("remote".into())
            .spawn(move || serve(&listener, &of, &fulfil, &stopped))
            .map_err(failed)?;
        Ok(Self { path: path.to_owned(), stop, thread: Some(thread) })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for RemoteEndpoint {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Binds a socket that is open to its owner and `group` alone from the beginning, whatever the umask: it is created in
/// a folder that only the owner may enter.
fn bind(path: &Path, group: Option<u32>) -> io::Result<UnixListener> {
    let mut folder = path.as_os_str().to_owned();
    folder.push(format!(".{}", std::process::id()));
    let folder = PathBuf::from(folder);
    DirBuilder::new().mode(0o700).create(&folder)?;
    let inside = folder.join("s");
    let made = UnixListener::bind(&inside).and_then(|listener| {
        if let Some(group) = group.filter(|group| std::fs::metadata(&inside).is_ok_and(|made| made.gid() != *group)) {
            std::os::unix::fs::chown(&inside, None, Some(group))?;
        }
        std::fs::set_permissions(&inside, Permissions::from_mode(if group.is_some() { 0o660 } else { 0o600 }))?;
        std::fs::rename(&inside, path)?;
        Ok(listener)
    });
    // The folder is empty, or holds an unusable socket.
    let _ = std::fs::remove_dir_all(&folder);
    made
}

/// A client that has connected and has not sent a whole line yet.
struct Caller {
    stream: UnixStream,
    received: Vec<u8>,
    deadline: Instant,
}

/// Result of reading from a caller.
enum ReadOutcome {
    Line(String),
    Incomplete,
    /// The caller has gone, or its line is too long.
    Closed,
}

impl Caller {
    fn read_line(&mut self) -> ReadOutcome {
        let mut piece = [0; MAX_LINE_LENGTH];
        loop {
            match self.stream.read(&mut piece) {
                Ok(0) => return ReadOutcome::Closed,
                Ok(length) => self.received.extend_from_slice(&piece[..length]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return ReadOutcome::Incomplete,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return ReadOutcome::Closed,
            }
            if let Some(end) = self.received.iter().position(|byte| *byte == b'\n') {
                return ReadOutcome::Line(String::from_utf8_lossy(&self.received[..end]).trim().to_owned());
            }
            if self.received.len() > MAX_LINE_LENGTH {
                return ReadOutcome::Closed;
            }
        }
    }
}

/// Serves callers until `stopped`.
fn serve(listener: &UnixListener, of: &str, fulfil: &Arc<RequestHandler>, stopped: &AtomicBool) {
    let mut callers: Vec<Caller> = Vec::new();
    let under_way = Arc::new(AtomicUsize::new(0));
    while !stopped.load(Ordering::Relaxed) {
        let mut watched = vec![PollFd::new(listener, PollFlags::IN)];
        watched.extend(callers.iter().map(|caller| PollFd::new(&caller.stream, PollFlags::IN)));
        if poll(&mut watched, Some(&POLL_INTERVAL)).is_err() {
            // Interrupted by a signal, or out of memory.
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(watched);
        loop {
            match listener.accept() {
                Ok((stream, _)) if stream.set_nonblocking(true).is_ok() => {
                    callers.push(Caller { stream, received: Vec::new(), deadline: Instant::now() + LINE_TIMEOUT });
                }
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => {
                    // Out of file descriptors, for instance.
                    std::thread::sleep(Duration::from_millis(5));
                    break;
                }
            }
        }
        let now = Instant::now();
        let mut waiting = Vec::with_capacity(callers.len());
        for mut caller in callers.drain(..) {
            match caller.read_line() {
                ReadOutcome::Line(line) => answer(caller.stream, &line, of, fulfil, &under_way),
                ReadOutcome::Incomplete if now < caller.deadline => waiting.push(caller),
                ReadOutcome::Incomplete => {
                    let text = format!("found no whole line within {} ms", LINE_TIMEOUT.as_millis());
                    write_answer(&caller.stream, of, &Err(text));
                }
                ReadOutcome::Closed => {}
            }
        }
        let too_many = waiting.len().saturating_sub(MAX_CALLERS);
        callers = waiting.split_off(too_many);
    }
}

/// Answers a line on a separate thread.
fn answer(stream: UnixStream, line: &str, of: &str, fulfil: &Arc<RequestHandler>, under_way: &Arc<AtomicUsize>) {
    let Some(command) = RemoteCommand::from_keyword(line) else {
        return write_answer(&stream, of, &Err(format!("found {line:?}, expected hold, release or state")));
    };
    if command != RemoteCommand::Hold && under_way.load(Ordering::Relaxed) >= MAX_REQUESTS {
        return write_answer(&stream, of, &Err(format!("busy with {MAX_REQUESTS} requests; hold is always taken")));
    }
    under_way.fetch_add(1, Ordering::Relaxed);
    let (fulfil, of, count, stream) = (fulfil.clone(), of.to_owned(), under_way.clone(), Arc::new(stream));
    let work = move || {
        write_answer(&stream, &of, &fulfil(command));
        count.fetch_sub(1, Ordering::Relaxed);
    };
    // If no thread can be started, others wait.
    if std::thread::Builder::new().name("remote request".into()).spawn(work.clone()).is_err() {
        work();
    }
}

/// Writes an answer, which fits into the socket's buffer.
fn write_answer(mut stream: &UnixStream, of: &str, answer: &Result<String, String>) {
    let (word, text) = match answer {
        Ok(text) => ("ok", text),
        Err(text) => ("no", text),
    };
    let line = |text: &str| text.replace(['\n', '\r'], " ");
    // A caller that hangs up early gets no answer.
    let _ = stream.write_all(format!("{word}: {}\nof: {}\n", line(text), line(of)).as_bytes());
}

#[cfg(test)]
#[path = "door_tests.rs"]
mod tests;
