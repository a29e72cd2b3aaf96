//! Remote control of a running bridge: a Unix socket that accepts `hold`, `release` and `state`.
//!
//! A request is one line. The answer is two: `ok: RESULT` as read back or `no: REASON`, then `of: ROBOT`. [`endpoint`]
//! is the server, [`ask`] the client, and [`socket_paths`] defines the location of the sockets. Write permission on a
//! socket suffices to stop the robot.

pub mod endpoint;
pub mod socket_paths;

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

pub use endpoint::RemoteEndpoint;

/// Maximum length of an answer, bytes.
const MAX_ANSWER_LENGTH: usize = 4096;

/// A request from another terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemoteCommand {
    /// Stop and hold.
    Hold,
    /// Release: the hand opens.
    Release,
    /// Report the state only.
    State,
}

impl RemoteCommand {
    const KEYWORDS: [(Self, &'static str); 3] =
        [(Self::Hold, "hold"), (Self::Release, "release"), (Self::State, "state")];

    fn keyword(self) -> &'static str {
        Self::KEYWORDS.iter().find(|(command, _)| *command == self).map_or("", |(_, word)| word)
    }

    fn from_keyword(word: &str) -> Option<Self> {
        Self::KEYWORDS.iter().find(|(_, known)| *known == word).map(|(command, _)| *command)
    }

    /// Returns the time-out of an answer: a release is answered only when the torque has been read back.
    fn timeout(self) -> Duration {
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
    NoBridge {
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
pub struct RemoteAnswer {
    /// Result as read back.
    pub text: String,
    /// Name of the robot: its configuration and process.
    pub robot: String,
}

/// Sends a request to the bridge that listens at `path`; returns its answer.
pub fn ask(path: &Path, command: RemoteCommand) -> Result<RemoteAnswer, RemoteError> {
    ask_all(&[path.to_owned()], command).pop().map_or_else(|| Err(no_bridge_error(path)), |(_, answer)| answer)
}

/// Sends a request to several bridges at the same time: one that does not answer does not delay the others.
pub fn ask_all(paths: &[PathBuf], command: RemoteCommand) -> Vec<(PathBuf, Result<RemoteAnswer, RemoteError>)> {
    let deadline = Instant::now() + command.timeout();
    let asked = paths.iter().map(|path| {
        let (sender, answer) = mpsc::channel();
        let there = path.clone();
        // Connecting blocks if the server does not accept; this thread is then left behind.
        std::thread::spawn(move || sender.send(exchange(&there, command, deadline)));
        (path, answer)
    });
    let asked: Vec<_> = asked.collect();
    let answers = asked.into_iter().map(|(path, answer)| {
        let left = deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(200);
        let late = || Err(ErrorKind::TimedOut.into());
        let result = answer.recv_timeout(left).unwrap_or_else(|_| late());
        let result = result.map_err(|source| match source.kind() {
            ErrorKind::NotFound | ErrorKind::ConnectionRefused => no_bridge_error(path),
            _ => RemoteError::Socket { path: path.clone(), source },
        });
        (path.clone(), result.and_then(|text| parse_answer(&text)))
    });
    answers.collect()
}

fn no_bridge_error(path: &Path) -> RemoteError {
    RemoteError::NoBridge { path: path.to_owned() }
}

/// Sends the request, and reads to the end of the answer, until `deadline`.
fn exchange(path: &Path, command: RemoteCommand, deadline: Instant) -> io::Result<String> {
    let mut stream = UnixStream::connect(path)?;
    stream.set_write_timeout(Some(command.timeout()))?;
    writeln!(stream, "{}", command.keyword())?;
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
        if answer.len() > MAX_ANSWER_LENGTH {
            return Err(io::Error::other(format!("found an answer of more than {MAX_ANSWER_LENGTH} bytes")));
        }
    }
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

fn parse_answer(text: &str) -> Result<RemoteAnswer, RemoteError> {
    // This text comes from the creator of the socket, so it is escaped: it must not control a terminal.
    let plain = |text: &str| text.escape_debug().to_string().replace("\\'", "'").replace("\\\"", "\"");
    let mut lines = text.lines();
    let first = lines.next().unwrap_or_default();
    let of = plain(lines.next().and_then(|line| line.strip_prefix("of: ")).unwrap_or("unnamed robot"));
    match first.split_once(": ") {
        Some(("ok", text)) => Ok(RemoteAnswer { text: plain(text), robot: of }),
        Some(("no", text)) => Err(RemoteError::Refused { of, reason: plain(text) }),
        _ if text.is_empty() => {
            let reason = "it ended before it answered: the outcome of the request is unknown".to_owned();
            Err(RemoteError::Refused { of, reason })
        }
        _ => Err(RemoteError::Refused { of, reason: format!("found `{}`, expected ok or no", plain(first)) }),
    }
}
