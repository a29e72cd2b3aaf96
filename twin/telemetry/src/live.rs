//! Sink to a live viewer that never blocks the recorder. A viewer that does not answer, ends or hangs loses only its
//! own picture.
//!
//! Rerun's own sink blocks once a hundred messages wait for an absent viewer. Here they are queued to a separate
//! thread.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, GrpcSinkConnectionState, LogSink, SinkFlushError};

use crate::viewer;

/// Time limit for the answer of a viewer.
const VIEWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Polling interval for a viewer that has not answered yet.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

enum Message {
    Log(Vec<LogMsg>),
    /// Answered when everything before it has been sent or dropped.
    Flush(Sender<()>),
}

/// Non-blocking sink to a viewer. A lost viewer is reported by [`viewer::loss_reason`].
pub struct LiveSink {
    to: Sender<Message>,
}

impl LiveSink {
    /// Starts a sink to the viewer at `address`.
    pub fn new(sink: GrpcSink, address: &str) -> Self {
        let (to, from) = mpsc::channel();
        let address = address.to_owned();
        std::thread::spawn(move || forward_messages(sink, &from, &address));
        Self { to }
    }
}

impl LogSink for LiveSink {
    fn send(&self, message: LogMsg) {
        self.send_all(vec![message]);
    }

    fn send_all(&self, messages: Vec<LogMsg>) {
        // If the thread has ended, the viewer has been lost already.
        let _ = self.to.send(Message::Log(messages));
    }

    fn flush_blocking(&self, timeout: Duration) -> Result<(), SinkFlushError> {
        let (done, over) = mpsc::channel();
        if self.to.send(Message::Flush(done)).is_ok() && over.recv_timeout(timeout) == Err(RecvTimeoutError::Timeout) {
            viewer::mark_lost("it stopped receiving");
        }
        Ok(())
    }
}

impl Drop for LiveSink {
    fn drop(&mut self) {
        let _ = self.flush_blocking(VIEWER_TIMEOUT);
    }
}

/// Forwards messages to the viewer from its start to its end.
fn forward_messages(sink: GrpcSink, from: &Receiver<Message>, address: &str) {
    let begun = Instant::now();
    let (mut waiting, mut asking) = (Vec::new(), Vec::new());
    loop {
        match from.recv_timeout(POLL_INTERVAL) {
            Ok(Message::Log(messages)) => waiting.extend(messages),
            Ok(Message::Flush(done)) => asking.push(done),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        match sink.status() {
            GrpcSinkConnectionState::Connecting { .. } if begun.elapsed() < VIEWER_TIMEOUT => {}
            GrpcSinkConnectionState::Connecting { .. } => {
                return viewer::mark_lost(&format!("it does not answer at {address}"));
            }
            GrpcSinkConnectionState::Connected => {
                sink.send_all(std::mem::take(&mut waiting));
                // The caller of a flush waits no longer than its own timeout.
                if !asking.is_empty() && sink.flush_blocking(Duration::MAX).is_ok() {
                    asking.clear();
                }
            }
            GrpcSinkConnectionState::Disconnected(_) => return viewer::mark_lost("it ended"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// Three hundred messages without a receiver: Rerun's sink takes a hundred and then blocks for ever.
    #[test]
    fn a_viewer_that_never_comes_holds_nothing_up() {
        // A port without a listener.
        let port = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).expect("a port").port();
        let address = format!("rerun+http://127.0.0.1:{port}/proxy");
        let sink = LiveSink::new(GrpcSink::new(address.parse().expect("an address")), &address);
        let (stream, storage) = rerun::RecordingStreamBuilder::new("test").memory().expect("a stream");
        for n in 0..300 {
            stream.log("here", &rerun::TextLog::new(n.to_string())).expect("logged");
            stream.flush_blocking().expect("in memory");
        }
        let messages = storage.take();
        assert!(messages.len() >= 300, "{}", messages.len());
        messages.into_iter().for_each(|message| sink.send(message));
        sink.flush_blocking(4 * VIEWER_TIMEOUT).expect("given up");
        let lost = viewer::loss_reason().expect("noticed");
        assert!(lost.contains("does not answer"), "{lost}");
    }
}
