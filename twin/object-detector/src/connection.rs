//! A connection that is read continuously: unread messages never block the sender and take bounded memory.

use std::collections::VecDeque;
use std::io::{self, Read as _, Write as _};
use std::net::Shutdown;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::stream::DetectorStream;
use super::{Address, MAX_LINE_LENGTH, is_pending};

/// Time limit for a connection, and for resolving the name of its host.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Time limit for writing a request.
const WRITE_TIMEOUT: Duration = Duration::from_secs(1);
/// Buffer size for unread lines, bytes; the newest are kept.
const BUFFER_SIZE: usize = 1 << 20;

/// Reason for which a connection ended.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConnectionEnd {
    #[error("the other side closed it")]
    Closed,
    #[error("{0}")]
    Failed(String),
    /// No line ends within [`MAX_LINE_LENGTH`].
    #[error("found a line of more than {MAX_LINE_LENGTH} bytes, expected one JSON object a line")]
    LineTooLong,
}

/// State of the reader.
#[derive(Debug, Default)]
struct LineBuffer {
    /// Unread lines, with their numbers from 1.
    lines: VecDeque<(u64, Vec<u8>)>,
    /// Total size of the unread lines, bytes.
    bytes: usize,
    count: u64,
    ended: Option<ConnectionEnd>,
}

impl LineBuffer {
    fn push(&mut self, line: Vec<u8>) {
        self.count += 1;
        self.bytes += line.len();
        self.lines.push_back((self.count, line));
        while self.bytes > BUFFER_SIZE {
            let oldest = self.lines.pop_front();
            self.bytes -= oldest.map_or(self.bytes, |(_, line)| line.len());
        }
    }

    fn pop(&mut self) -> Option<(u64, Vec<u8>)> {
        let (number, line) = self.lines.pop_front()?;
        self.bytes -= line.len();
        Some((number, line))
    }
}

#[derive(Debug, Default)]
struct Shared {
    buffer: Mutex<LineBuffer>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, LineBuffer> {
        // A panic of another holder has been reported already.
        self.buffer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An open connection with its reader, which ends with it.
pub struct Connection {
    stream: DetectorStream,
    shared: Arc<Shared>,
    reader: Option<JoinHandle<()>>,
}

impl Connection {
    /// Connects to `address` within [`CONNECT_TIMEOUT`].
    pub fn open(address: &Address) -> io::Result<Self> {
        let stream = DetectorStream::connect(address, CONNECT_TIMEOUT)?;
        stream.set_write_timeout(WRITE_TIMEOUT)?;
        let (theirs, shared) = (stream.try_clone()?, Arc::new(Shared::default()));
        let to = shared.clone();
        let reader = std::thread::Builder::new().name("detector".into()).spawn(move || read(theirs, &to))?;
        Ok(Self { stream, shared, reader: Some(reader) })
    }

    /// Returns the reason for which the connection has ended, if it has.
    pub fn end_reason(&self) -> Option<ConnectionEnd> {
        self.shared.lock().ended.clone()
    }

    pub fn write(&mut self, text: &str) -> io::Result<()> {
        self.stream.write_all(text.as_bytes())
    }

    /// Returns the oldest kept line with its number, or `None` if there is none within `wait`.
    pub fn next_line(&self, wait: Duration) -> Result<Option<(u64, Vec<u8>)>, ConnectionEnd> {
        let heard = self.shared.lock();
        let silent = |heard: &mut LineBuffer| heard.lines.is_empty() && heard.ended.is_none();
        let waited = self.shared.changed.wait_timeout_while(heard, wait, silent);
        let mut heard = waited.unwrap_or_else(PoisonError::into_inner).0;
        match (heard.pop(), &heard.ended) {
            (None, Some(ended)) => Err(ended.clone()),
            (line, _) => Ok(line),
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        // If the connection is already gone, the reader has been woken.
        let _ = self.stream.shutdown(Shutdown::Both);
        if let Some(reader) = self.reader.take() {
            // A panic is reported by the thread's own panic message.
            let _ = reader.join();
        }
    }
}

fn read(mut stream: DetectorStream, shared: &Shared) {
    let (mut pending, mut buffer) = (Vec::new(), [0; 4096]);
    let ended = loop {
        match stream.read(&mut buffer) {
            Ok(0) => break ConnectionEnd::Closed,
            Ok(count) => pending.extend(&buffer[..count]),
            Err(error) if is_pending(&error) => continue,
            Err(error) => break ConnectionEnd::Failed(error.to_string()),
        }
        let mut heard = shared.lock();
        while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
            heard.push(pending.drain(..=end).collect());
        }
        drop(heard);
        shared.changed.notify_all();
        if pending.len() > MAX_LINE_LENGTH {
            break ConnectionEnd::LineTooLong;
        }
    };
    shared.lock().ended = Some(ended);
    shared.changed.notify_all();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kept lines are bounded in size and are the newest, however many stay unread.
    #[test]
    fn lines_that_nobody_takes_are_bounded() {
        let mut heard = LineBuffer::default();
        for n in 0..5000 {
            heard.push(format!("{n:1000}\n").into_bytes());
        }
        assert!(heard.bytes <= BUFFER_SIZE && heard.lines.len() > 1000, "{}", heard.lines.len());
        let newest = heard.lines.back().expect("kept").clone();
        assert_eq!((newest.0, newest.1), (5000, format!("{:1000}\n", 4999).into_bytes()));
        while heard.pop().is_some() {}
        assert_eq!(heard.bytes, 0);
    }
}
