//! Requests to a running emulator: lines on its standard input, or over its socket.

use std::io::{self, BufRead, BufReader, IsTerminal as _, Read as _, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};

/// Time limit for a line or an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// Maximum length of a line, bytes.
const MAX_LINE_LENGTH: u64 = 1000;

/// A request line, and the client that waits for an answer.
pub struct TableRequest {
    pub line: String,
    client: Option<UnixStream>,
}

impl TableRequest {
    /// Sends the outcome to the client, or prints it.
    pub fn answer(self, outcome: Result<String>) {
        match (self.client, outcome) {
            (Some(mut stream), outcome) => {
                let text = outcome.unwrap_or_else(|error| format!("error: {error:#}"));
                // The client may have disconnected.
                let _ = writeln!(stream, "{text}");
            }
            (None, Ok(text)) if io::stdin().is_terminal() => eprintln!("{text}"),
            (None, Ok(_)) => {}
            (None, Err(error)) => eprintln!("{error:#}"),
        }
    }
}

/// Receiver of requests.
pub struct TableEndpoint {
    requests: Receiver<TableRequest>,
    path: PathBuf,
}

impl TableEndpoint {
    /// Opens a socket at `path` for its owner alone. Also reads standard input if it is no terminal, or in any case
    /// with `keys`: reading from a terminal would stop a background job.
    pub fn open(path: &Path, keys: bool) -> Result<Self> {
        if UnixStream::connect(path).is_ok() {
            bail!("{}: an emulator runs in this folder already, expected none", path.display());
        }
        // Left behind by an emulator that was killed.
        let _ = std::fs::remove_file(path);
        let listener = UnixListener::bind(path).with_context(|| path.display().to_string())?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))
            .with_context(|| path.display().to_string())?;
        let (sender, requests) = mpsc::channel();
        let from_socket = sender.clone();
        // Both threads end with the program; nothing joins them.
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let to = from_socket.clone();
                // A slow client does not block others.
                std::thread::spawn(move || read_request(stream, &to));
            }
        });
        std::thread::spawn(move || {
            let lines = (keys || !io::stdin().is_terminal()).then(|| io::stdin().lines());
            for line in lines.into_iter().flatten().map_while(Result::ok) {
                let line = if line.trim().is_empty() { "objects=back" } else { line.trim() }.to_owned();
                if sender.send(TableRequest { line, client: None }).is_err() {
                    return;
                }
            }
        });
        Ok(Self { requests, path: path.to_owned() })
    }

    /// Returns the requests that have arrived.
    pub fn requests(&self) -> impl Iterator<Item = TableRequest> {
        self.requests.try_iter()
    }
}

impl Drop for TableEndpoint {
    fn drop(&mut self) {
        // The socket may be gone already.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Reads one line from a client.
fn read_request(stream: UnixStream, to: &Sender<TableRequest>) {
    let read = || -> io::Result<TableRequest> {
        stream.set_read_timeout(Some(ANSWER_TIMEOUT))?;
        stream.set_write_timeout(Some(ANSWER_TIMEOUT))?;
        let mut line = String::new();
        BufReader::new((&stream).take(MAX_LINE_LENGTH)).read_line(&mut line)?;
        Ok(TableRequest { line: line.trim().to_owned(), client: Some(stream.try_clone()?) })
    };
    // A client that sends nothing, or not in time, is dropped.
    if let Ok(request) = read()
        && !request.line.is_empty()
    {
        let _ = to.send(request);
    }
}

/// Sends a line to the emulator at `path` and returns its answer.
pub fn send_line(path: &Path, line: &str) -> Result<String> {
    let shown = || format!("{}: found no listener, expected a running emulator", path.display());
    let mut stream = UnixStream::connect(path).with_context(shown)?;
    stream.set_read_timeout(Some(ANSWER_TIMEOUT))?;
    writeln!(stream, "{line}")?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).context("the emulator does not answer")?;
    match answer.trim().strip_prefix("error: ") {
        Some(error) => bail!("{error}"),
        None if answer.is_empty() => bail!("the emulator ended before it answered"),
        None => Ok(answer.trim().to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_that_says_nothing_does_not_block_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("emulator");
        let endpoint = TableEndpoint::open(&path, false).expect("open");
        let _silent = UnixStream::connect(&path).expect("connects");
        let asked = std::thread::spawn(move || send_line(&path, "objects=back"));
        let request = loop {
            if let Some(request) = endpoint.requests.try_iter().find(|request| request.client.is_some()) {
                break request;
            }
        };
        request.answer(Ok("done".to_owned()));
        assert_eq!(asked.join().expect("no panic").expect("in time"), "done");
    }

    #[test]
    fn a_line_is_told_and_answered() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("emulator");
        assert!(
            send_line(&path, "objects=back").expect_err("nobody").to_string().contains("expected a running emulator")
        );
        let endpoint = TableEndpoint::open(&path, false).expect("open");
        assert_eq!(std::fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
        assert!(
            TableEndpoint::open(&path, false).err().expect("taken").to_string().contains("runs in this folder already")
        );
        let there = path.clone();
        let asked = std::thread::spawn(move || [send_line(&there, "objects=back"), send_line(&there, "nonsense")]);
        for _ in 0..2 {
            let request = loop {
                let mut asked = endpoint.requests.try_iter().filter(|request| request.client.is_some());
                if let Some(request) = asked.next() {
                    break request;
                }
            };
            let known = request.line == "objects=back";
            request.answer(if known { Ok("done".to_owned()) } else { Err(anyhow::anyhow!("not understood")) });
        }
        let [good, bad] = asked.join().expect("no panic");
        assert_eq!(good.expect("answered"), "done");
        assert_eq!(bad.expect_err("refused").to_string(), "not understood");
        drop(endpoint);
        assert!(!path.exists());
    }
}
