//! Remote control of a running bridge: a Unix socket that accepts `hold`, `release` and `state`.
//!
//! A request is one line. The answer is two: `ok: <what was read back>` or `no: <reason>`, then `of: <which robot>`.
//! [`door`] is the server, [`ask`] the client, and [`places`] defines the location of the sockets. Write permission on
//! a socket is all that is needed to stop the robot.

pub mod door;
pub mod places;

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

pub use door::RemoteDoor;

/// Maximum length of an answer, bytes.
const ANSWER: usize = 4096;

/// A request from another terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Stop and hold.
    Hold,
    /// Release: the hand opens.
    Release,
    /// Report the state only.
    State,
}

impl Wish {
    const ALL: [(Self, &'static str); 3] = [(Self::Hold, "hold"), (Self::Release, "release"), (Self::State, "state")];

    fn word(self) -> &'static str {
        Self::ALL.iter().find(|(wish, _)| *wish == self).map_or("", |(_, word)| word)
    }

    fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == word).map(|(wish, _)| *wish)
    }

    /// Returns the time-out of an answer: a release is answered only when the torque has been read back.
    fn patience(self) -> Duration {
        match self {
            Self::Hold | Self::State => Duration::from_secs(5),
            Self::Release => Duration::from_secs(20),
        }
    }
}

/// Error of a remote request.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// The socket cannot be used.
    #[error("{path}: {source}")]
    Socket {
        /// The socket.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// No bridge is running.
    #[error("{path}: no bridge is running there")]
    Nobody {
        /// The socket.
        path: PathBuf,
    },
    /// The bridge refused the request, or could not confirm it.
    #[error("{of}: {reason}")]
    Refused {
        /// Name of the robot.
        of: String,
        reason: String,
    },
}

/// Answer of a bridge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// Result as read back.
    pub text: String,
    /// Name of the robot: its configuration and process.
    pub of: String,
}

/// Sends a request to the bridge that listens at `path`; returns its answer.
pub fn ask(path: &Path, wish: Wish) -> Result<Answer, RemoteError> {
    ask_all(&[path.to_owned()], wish).pop().map_or_else(|| Err(nobody(path)), |(_, answer)| answer)
}

/// Sends a request to several bridges at the same time: one that does not answer does not delay the others.
pub fn ask_all(paths: &[PathBuf], wish: Wish) -> Vec<(PathBuf, Result<Answer, RemoteError>)> {
    let deadline = Instant::now() + wish.patience();
    let asked = paths.iter().map(|path| {
        let (sender, answer) = mpsc::channel();
        let there = path.clone();
        // Connecting blocks if nobody accepts; this thread is then left behind.
        std::thread::spawn(move || sender.send(exchange(&there, wish, deadline)));
        (path, answer)
    });
    let asked: Vec<_> = asked.collect();
    let answers = asked.into_iter().map(|(path, answer)| {
        let left = deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(200);
        let late = || Err(ErrorKind::TimedOut.into());
        let result = answer.recv_timeout(left).unwrap_or_else(|_| late());
        let result = result.map_err(|source| match source.kind() {
            ErrorKind::NotFound | ErrorKind::ConnectionRefused => nobody(path),
            _ => RemoteError::Socket { path: path.clone(), source },
        });
        (path.clone(), result.and_then(|text| understood(&text)))
    });
    answers.collect()
}

fn nobody(path: &Path) -> RemoteError {
    RemoteError::Nobody { path: path.to_owned() }
}

/// Sends the request, and reads to the end of the answer, until `deadline`.
fn exchange(path: &Path, wish: Wish, deadline: Instant) -> io::Result<String> {
    let mut stream = UnixStream::connect(path)?;
    stream.set_write_timeout(Some(wish.patience()))?;
    writeln!(stream, "{}", wish.word())?;
    let mut answer = Vec::new();
    let mut piece = [0; 512];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut piece)? {
            0 => break,
            length => answer.extend_from_slice(&piece[..length]),
        }
        if answer.len() > ANSWER {
            return Err(io::Error::other(format!("found an answer of more than {ANSWER} bytes")));
        }
    }
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

fn understood(text: &str) -> Result<Answer, RemoteError> {
    // Whoever made the socket wrote this text, so it is escaped: it must not control a terminal.
    let plain = |text: &str| text.escape_debug().to_string().replace("\\'", "'").replace("\\\"", "\"");
    let mut lines = text.lines();
    let first = lines.next().unwrap_or_default();
    let of = plain(lines.next().and_then(|line| line.strip_prefix("of: ")).unwrap_or("unnamed robot"));
    match first.split_once(": ") {
        Some(("ok", text)) => Ok(Answer { text: plain(text), of }),
        Some(("no", text)) => Err(RemoteError::Refused { of, reason: plain(text) }),
        _ if text.is_empty() => {
            let reason = "it ended before it answered: what became of the wish is not known".to_owned();
            Err(RemoteError::Refused { of, reason })
        }
        _ => Err(RemoteError::Refused { of, reason: format!("found `{}`, expected ok or no", plain(first)) }),
    }
}
