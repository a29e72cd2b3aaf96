//! Targets of a recording: files, viewers, servers.

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rerun::log::ChunkBatcherConfig;
use rerun::sink::{GrpcSink, LogSink, MultiSink};
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::error::StreamError;
use crate::live::LiveSink;
use crate::recording_file::{Fault, RecordingFile};
use crate::release::APPLICATION;
use crate::viewer;

/// Target of a recording. Any number may be used at once; at most one of them should be live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// A `.rrd` file. An existing one is replaced, and its folder is created.
    File(PathBuf),
    /// A viewer that is started now on this machine. One that does not start is left out, and [`viewer::lost`] reports
    /// it.
    Spawn,
    /// A running viewer, `rerun+http://HOST:PORT/proxy`.
    Connect(String),
    /// A server at this address that viewers connect to.
    Serve(SocketAddr),
}

/// An open recording and the faults of its files.
pub(crate) struct Opened {
    pub rec: RecordingStream,
    faults: Vec<Fault>,
}

impl Opened {
    /// Opens a recording into all of `targets`, without the clocks that Rerun adds. Without targets it is disabled.
    pub fn new(targets: &[Target], batches: ChunkBatcherConfig) -> Result<Self, StreamError> {
        let (mut sinks, mut faults) = (Vec::new(), Vec::new());
        for target in targets {
            sinks.extend(sink(target, &mut faults)?);
        }
        let rec =
            RecordingStreamBuilder::new(APPLICATION).enabled(!sinks.is_empty()).batcher_config(batches).buffered()?;
        rec.set_log_time_enabled(false);
        rec.set_log_tick_enabled(false);
        rec.set_sink(Box::new(MultiSink::new(sinks)));
        Ok(Self { rec, faults })
    }

    /// Flushes everything and closes the recording. `patience` is the time limit for slow targets. An error names the
    /// file that could not be written.
    pub fn close(self, patience: Duration) -> Result<(), StreamError> {
        let flushed = self.rec.flush_with_timeout(patience);
        self.rec.finalize_deferred_sinks();
        self.faults.iter().try_for_each(Fault::take)?;
        Ok(flushed?)
    }
}

fn file(path: &Path) -> Result<(RecordingFile, Fault), StreamError> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        let unwritable = |source| StreamError::Unwritable { path: path.to_owned(), source };
        std::fs::create_dir_all(folder).map_err(unwritable)?;
    }
    RecordingFile::create(path)
}

/// Opens the sink of a target; `None` for a viewer that was lost. The fault of a file goes into `faults`.
fn sink(target: &Target, faults: &mut Vec<Fault>) -> Result<Option<Box<dyn LogSink>>, StreamError> {
    let grpc = |address: &str| -> Result<Option<Box<dyn LogSink>>, StreamError> {
        let uri = address.parse().map_err(|_| StreamError::Address(address.to_owned()))?;
        Ok(Some(Box::new(LiveSink::new(GrpcSink::new(uri), address))))
    };
    match target {
        Target::File(path) => {
            let (file, fault) = file(path)?;
            faults.push(fault);
            Ok(Some(Box::new(file)))
        }
        // A lost viewer is not started again for each trial.
        Target::Spawn if viewer::lost().is_some() => Ok(None),
        Target::Spawn => match viewer::spawn() {
            Ok(address) => grpc(&address),
            Err(error @ (StreamError::Ended { .. } | StreamError::Start { .. })) => {
                viewer::lose(&error.to_string());
                Ok(None)
            }
            Err(error) => Err(error),
        },
        Target::Connect(address) => grpc(address),
        Target::Serve(address) => {
            // The server reports a busy port only in its own thread, so the port is tested here.
            drop(TcpListener::bind(address).map_err(|error| StreamError::Address(format!("{address} ({error})")))?);
            let server = rerun::grpc_server::GrpcServerSink::new(
                &address.ip().to_string(),
                address.port(),
                rerun::ServerOptions::default(),
            );
            Ok(Some(Box::new(server.map_err(|_| StreamError::Address(address.to_string()))?)))
        }
    }
}
