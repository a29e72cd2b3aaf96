//! Remote control of a running bridge: a Unix socket that accepts `hold`, `release` and `state`.
//!
//! One line per request and answer: `ok: <state>` or `no: <reason>`. The socket lives as long as the bridge; a stale one is replaced.

use std::fs::{DirBuilder, Permissions};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// What another terminal may want.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Stop and keep hold.
    Hold,
    /// Let go.
    Release,
    /// Only report the state.
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
}

/// Why a wish did not come through.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// The socket cannot be used.
    #[error("{path}: {source}")]
    Socket {
        /// The socket.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// No bridge is running.
    #[error("{path}: no bridge is running there")]
    Nobody {
        /// The socket.
        path: PathBuf,
    },
    /// The bridge would not.
    #[error("the bridge refused: {0}")]
    Refused(String),
}

/// The open door; closes when dropped.
#[derive(Debug)]
pub struct RemoteDoor {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RemoteDoor {
    /// Listens at `path`; every wish is handed to `fulfil`, whose answer goes back.
    pub fn open(
        path: &Path,
        fulfil: impl Fn(Wish) -> Result<String, String> + Send + 'static,
    ) -> Result<Self, RemoteError> {
        let failed = |source| RemoteError::Socket { path: path.to_owned(), source };
        if let Ok(found) = std::fs::symlink_metadata(path) {
            if !found.file_type().is_socket() {
                return Err(failed(std::io::Error::other(
                    "found another kind of file there, expected none or a socket",
                )));
            }
            if UnixStream::connect(path).is_ok() {
                return Err(failed(std::io::Error::other("another bridge is running there")));
            }
            std::fs::remove_file(path).map_err(failed)?;
        }
        let listener = bind_private(path).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::Builder::new()
            .name("remote".into())
            .spawn(move || {
                while !stopped.load(Ordering::Relaxed) {
                    match listener.accept() {
                        // A caller that hangs up early gets no answer, and needs none.
                        Ok((stream, _)) => drop(serve(stream, &fulfil)),
                        Err(_) => std::thread::sleep(Duration::from_millis(5)),
                    }
                }
            })
            .map_err(failed)?;
        Ok(Self { path: path.to_owned(), stop, thread: Some(thread) })
    }
}

/// A socket for its owner alone from the beginning, whatever the umask: it is made in a folder that only the owner may enter.
fn bind_private(path: &Path) -> std::io::Result<UnixListener> {
    let mut folder = path.as_os_str().to_owned();
    folder.push(format!(".{}", std::process::id()));
    let folder = PathBuf::from(folder);
    DirBuilder::new().mode(0o700).create(&folder)?;
    let inside = folder.join("s");
    let made = UnixListener::bind(&inside).and_then(|listener| {
        std::fs::set_permissions(&inside, Permissions::from_mode(0o600))?;
        std::fs::rename(&inside, path)?;
        Ok(listener)
    });
    // Empty, or with a socket that is of no use.
    let _ = std::fs::remove_dir_all(&folder);
    made
}

impl Drop for RemoteDoor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so itself.
            let _ = thread.join();
        }
        let _ = std::fs::remove_file(&self.path);
    }
}

fn serve(stream: UnixStream, fulfil: &impl Fn(Wish) -> Result<String, String>) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(Duration::from_millis(500)))?;
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line)?;
    let answer = match Wish::from_word(line.trim()) {
        Some(wish) => fulfil(wish),
        None => Err(format!("found `{}`, expected hold, release or state", line.trim())),
    };
    let (word, text) = match answer {
        Ok(text) => ("ok", text),
        Err(text) => ("no", text),
    };
    writeln!(&stream, "{word}: {}", text.replace('\n', " "))
}

/// Brings a wish to the bridge that listens at `path`; gives back what it says.
pub fn ask(path: &Path, wish: Wish) -> Result<String, RemoteError> {
    let failed = |source: std::io::Error| match source.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => RemoteError::Nobody { path: path.to_owned() },
        _ => RemoteError::Socket { path: path.to_owned(), source },
    };
    let stream = UnixStream::connect(path).map_err(failed)?;
    stream.set_read_timeout(Some(Duration::from_secs(3))).map_err(failed)?;
    writeln!(&stream, "{}", wish.word()).map_err(failed)?;
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line).map_err(failed)?;
    match line.trim().split_once(": ") {
        Some(("ok", text)) => Ok(text.to_owned()),
        Some(("no", text)) => Err(RemoteError::Refused(text.to_owned())),
        _ => Err(RemoteError::Refused(format!("found `{}`, expected ok or no", line.trim()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asks_and_answers() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("stop");
        assert!(matches!(ask(&path, Wish::Hold), Err(RemoteError::Nobody { .. })));
        let door = RemoteDoor::open(&path, |wish| match wish {
            Wish::Hold => Ok("held".into()),
            other => Err(format!("not {other:?}")),
        })
        .expect("opens");
        assert_eq!(ask(&path, Wish::Hold).expect("answered"), "held");
        let mode = std::fs::metadata(&path).expect("there").permissions().mode() & 0o777;
        assert_eq!(mode, 0o600, "{mode:o}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing but the socket");
        assert!(matches!(ask(&path, Wish::Release), Err(RemoteError::Refused(text)) if text == "not Release"));
        assert!(RemoteDoor::open(&path, |_| Ok(String::new())).is_err(), "one bridge at a time");
        drop(door);
        assert!(!path.exists());
        let _stale = UnixListener::bind(&path).expect("bound");
        drop(_stale);
        drop(RemoteDoor::open(&path, |_| Ok(String::new())).expect("a stale socket is replaced"));
        std::fs::write(&path, "somebody's file").expect("written");
        assert!(RemoteDoor::open(&path, |_| Ok(String::new())).is_err());
        assert_eq!(std::fs::read_to_string(&path).expect("still there"), "somebody's file");
    }
}
