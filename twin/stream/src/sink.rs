//! Where a recording goes: files, viewers, servers.

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;

use rerun::log::ChunkBatcherConfig;
use rerun::sink::{FileSink, GrpcSink, LogSink, MultiSink};
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::error::StreamError;
use crate::release::APPLICATION;
use crate::viewer;

/// Where a recording goes. Any number of targets at once, at most one of which should be live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// A `.rrd` file; an existing one is replaced, its folder is made.
    File(PathBuf),
    /// A viewer that is started now, on this machine.
    Spawn,
    /// A viewer that already runs, `rerun+http://HOST:PORT/proxy`.
    Connect(String),
    /// A server that viewers connect to, at this address.
    Serve(SocketAddr),
}

/// A recording into all of `targets`, without the clocks that Rerun adds; without targets it takes nothing.
pub(crate) fn open(targets: &[Target], batches: ChunkBatcherConfig) -> Result<RecordingStream, StreamError> {
    let sinks: Vec<Box<dyn LogSink>> = targets.iter().map(sink).collect::<Result<_, _>>()?;
    let rec = RecordingStreamBuilder::new(APPLICATION).enabled(!sinks.is_empty()).batcher_config(batches).buffered()?;
    rec.set_log_time_enabled(false);
    rec.set_log_tick_enabled(false);
    rec.set_sink(Box::new(MultiSink::new(sinks)));
    Ok(rec)
}

fn sink(target: &Target) -> Result<Box<dyn LogSink>, StreamError> {
    let grpc = |address: &str| -> Result<Box<dyn LogSink>, StreamError> {
        let uri = address.parse().map_err(|_| StreamError::Address(address.to_owned()))?;
        Ok(Box::new(GrpcSink::new(uri)))
    };
    match target {
        Target::File(path) => {
            if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                std::fs::create_dir_all(folder)
                    .map_err(|source| StreamError::Unwritable { path: path.clone(), source })?;
            }
            let unwritable = |source| StreamError::Unwritable { path: path.clone(), source };
            match FileSink::new(path) {
                Ok(file) => Ok(Box::new(file)),
                Err(rerun::sink::FileSinkError::CreateFile { source, .. }) => Err(unwritable(source)),
                Err(error) => Err(unwritable(std::io::Error::other(error))),
            }
        }
        Target::Spawn => grpc(&viewer::spawn()?),
        Target::Connect(address) => grpc(address),
        Target::Serve(address) => {
            // The server reports a busy port only in its own thread; ask here.
            drop(TcpListener::bind(address).map_err(|error| StreamError::Address(format!("{address} ({error})")))?);
            let server = rerun::grpc_server::GrpcServerSink::new(
                &address.ip().to_string(),
                address.port(),
                rerun::ServerOptions::default(),
            )
            .map_err(|_| StreamError::Address(address.to_string()))?;
            Ok(Box::new(server))
        }
    }
}
