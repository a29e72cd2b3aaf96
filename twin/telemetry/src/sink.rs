//! Targets of a recording: files, viewers, servers.

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rerun::log::ChunkBatcherConfig;
use rerun::sink::{GrpcSink, LogSink, MultiSink};
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::error::TelemetryError;
use crate::live::LiveSink;
use crate::recording_file::{RecordingFile, UnfinishedFile};
use crate::release::APPLICATION;
use crate::viewer;

/// Target of a recording. Any number may be used at once; at most one of them should be live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RecordingTarget {
    /// A `.rrd` file; its folder is created. It is `NAME.partial.rrd` until the recording is closed, and then replaces an
    /// existing one.
    File(PathBuf),
    /// A viewer that is started now on this machine. One that does not start is left out, and [`viewer::loss_reason`]
    /// reports it.
    Spawn,
    /// A running viewer, `rerun+http://HOST:PORT/proxy`.
    Connect(String),
    /// A server at this address that viewers connect to.
    Serve(SocketAddr),
}

/// An open recording and its files.
pub(crate) struct OpenRecording {
    pub rec: RecordingStream,
    files: Vec<UnfinishedFile>,
}

impl OpenRecording {
    /// Opens a recording into all of `targets`, without the clocks that Rerun adds. Without targets it is disabled.
    pub fn new(targets: &[RecordingTarget], batches: ChunkBatcherConfig) -> Result<Self, TelemetryError> {
        let (mut sinks, mut files) = (Vec::new(), Vec::new());
        for target in targets {
            sinks.extend(sink(target, &mut files)?);
        }
        let rec =
            RecordingStreamBuilder::new(APPLICATION).enabled(!sinks.is_empty()).batcher_config(batches).buffered()?;
        rec.set_log_time_enabled(false);
        rec.set_log_tick_enabled(false);
        rec.set_sink(Box::new(MultiSink::new(sinks)));
        Ok(Self { rec, files })
    }

    /// Flushes everything and closes the recording, whose files get their names. `timeout` is the time limit for slow
    /// targets. An error names the file that could not be written.
    pub fn close(self, timeout: Duration) -> Result<(), TelemetryError> {
        let flushed = self.rec.flush_with_timeout(timeout);
        self.rec.finalize_deferred_sinks();
        self.files.iter().try_for_each(UnfinishedFile::complete)?;
        Ok(flushed?)
    }

    /// Closes the recording and removes its files.
    pub fn discard(self) -> Result<(), TelemetryError> {
        self.rec.finalize_deferred_sinks();
        self.files.iter().try_for_each(UnfinishedFile::remove)
    }
}

fn file(path: &Path) -> Result<(RecordingFile, UnfinishedFile), TelemetryError> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        let unwritable = |source| TelemetryError::Unwritable { path: path.to_owned(), source };
        std::fs::create_dir_all(folder).map_err(unwritable)?;
    }
    RecordingFile::create(path)
}

/// Opens the sink of a target; `None` for a viewer that was lost. Its file goes into `files`.
fn sink(target: &RecordingTarget, files: &mut Vec<UnfinishedFile>) -> Result<Option<Box<dyn LogSink>>, TelemetryError> {
    let grpc = |address: &str| -> Result<Option<Box<dyn LogSink>>, TelemetryError> {
        let uri = address.parse().map_err(|_| TelemetryError::Address(address.to_owned()))?;
        Ok(Some(Box::new(LiveSink::new(GrpcSink::new(uri), address))))
    };
    match target {
        RecordingTarget::File(path) => {
            let (file, unfinished) = file(path)?;
            files.push(unfinished);
            Ok(Some(Box::new(file)))
        }
        // A lost viewer is not started again for each trial.
        RecordingTarget::Spawn if viewer::loss_reason().is_some() => Ok(None),
        RecordingTarget::Spawn => match viewer::spawn() {
            Ok(address) => grpc(&address),
            Err(error @ (TelemetryError::Ended { .. } | TelemetryError::Start { .. })) => {
                viewer::mark_lost(&error.to_string());
                Ok(None)
            }
            Err(error) => Err(error),
        },
        RecordingTarget::Connect(address) => grpc(address),
        RecordingTarget::Serve(address) => {
            // The server reports a busy port only in its own thread, so the port is tested here.
            drop(TcpListener::bind(address).map_err(|error| TelemetryError::Address(format!("{address} ({error})")))?);
            let server = rerun::grpc_server::GrpcServerSink::new(
                &address.ip().to_string(),
                address.port(),
                rerun::ServerOptions::default(),
            );
            Ok(Some(Box::new(server.map_err(|_| TelemetryError::Address(address.to_string()))?)))
        }
    }
}
