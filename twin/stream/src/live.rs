//! A sink to a viewer that never holds up what is recorded: a viewer that does not answer, ends or stands still costs its own picture and
//! nothing else.
//!
//! Rerun's own sink blocks once a hundred messages wait for a viewer that never comes. Here they wait in a thread of their own.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, GrpcSinkConnectionState, LogSink, SinkFlushError};

use crate::viewer;

/// A viewer that has not answered for so long is given up.
const PATIENCE: Duration = Duration::from_secs(5);
/// Interval at which a viewer that has not answered yet is looked at again.
const LOOK: Duration = Duration::from_millis(50);

enum Message {
    Log(Vec<LogMsg>),
    /// Answered when all before it has been handed over, or given up.
    Flush(Sender<()>),
}

/// The sink; [`viewer::lost`] knows of a viewer that was lost.
pub struct LiveSink {
    to: Sender<Message>,
}

impl LiveSink {
    /// To the viewer at `address`.
    pub fn new(sink: GrpcSink, address: &str) -> Self {
        let (to, from) = mpsc::channel();
        let address = address.to_owned();
        std::thread::spawn(move || hand_over(sink, &from, &address));
        Self { to }
    }
}

impl LogSink for LiveSink {
    fn send(&self, message: LogMsg) {
        self.send_all(vec![message]);
    }

    fn send_all(&self, messages: Vec<LogMsg>) {
        // Without a thread the viewer has been lost.
        let _ = self.to.send(Message::Log(messages));
    }

    fn flush_blocking(&self, timeout: Duration) -> Result<(), SinkFlushError> {
        let (done, over) = mpsc::channel();
        if self.to.send(Message::Flush(done)).is_ok() && over.recv_timeout(timeout) == Err(RecvTimeoutError::Timeout) {
            viewer::lose("it stopped taking what it is sent");
        }
        Ok(())
    }
}

impl Drop for LiveSink {
    fn drop(&mut self) {
        let _ = self.flush_blocking(PATIENCE);
    }
}

/// Hands what comes to the viewer over to it, as soon and as long as it is there.
fn hand_over(sink: GrpcSink, from: &Receiver<Message>, address: &str) {
    let begun = Instant::now();
    let (mut waiting, mut asking) = (Vec::new(), Vec::new());
    loop {
        match from.recv_timeout(LOOK) {
            Ok(Message::Log(messages)) => waiting.extend(messages),
            Ok(Message::Flush(done)) => asking.push(done),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        match sink.status() {
            GrpcSinkConnectionState::Connecting { .. } if begun.elapsed() < PATIENCE => {}
            GrpcSinkConnectionState::Connecting { .. } => {
                return viewer::lose(&format!("it does not answer at {address}"));
            }
            GrpcSinkConnectionState::Connected => {
                sink.send_all(std::mem::take(&mut waiting));
                // Who asks waits no longer than it likes.
                if !asking.is_empty() && sink.flush_blocking(Duration::MAX).is_ok() {
                    asking.clear();
                }
            }
            GrpcSinkConnectionState::Disconnected(_) => return viewer::lose("it ended"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// Three hundred messages into nothing: Rerun's sink takes a hundred and then blocks for ever.
    #[test]
    fn a_viewer_that_never_comes_holds_nothing_up() {
        // A port of which nobody listens.
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
        sink.flush_blocking(4 * PATIENCE).expect("given up");
        let lost = viewer::lost().expect("noticed");
        assert!(lost.contains("does not answer"), "{lost}");
    }
}
