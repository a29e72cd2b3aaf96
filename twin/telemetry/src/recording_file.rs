//! File of a recording. The first failed write, that of the footer included, is kept for the code that closes the
//! recording: Rerun's own sink only writes it to an unread log.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rerun::external::re_log_encoding::{Encoder, rrd::EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};

use crate::error::TelemetryError;

/// First error of a file, shared by the writer and the code that closes the recording.
#[derive(Debug, Clone)]
pub(crate) struct FileError {
    path: PathBuf,
    first: Arc<Mutex<Option<io::Error>>>,
}

impl FileError {
    fn note(&self, error: io::Error) {
        if let Ok(mut first) = self.first.lock() {
            first.get_or_insert(error);
        }
    }

    /// Takes the error, if there is one.
    pub fn take(&self) -> Result<(), TelemetryError> {
        match self.first.lock().ok().and_then(|mut first| first.take()) {
            Some(source) => Err(TelemetryError::Unwritable { path: self.path.clone(), source }),
            None => Ok(()),
        }
    }
}

/// A file that remembers its first error.
struct ErrorTrackingFile {
    file: File,
    fault: FileError,
}

impl Write for ErrorTrackingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes);
        // The caller gets an error of the same kind and may or may not pass it on.
        written.map_err(|error| {
            let kind = error.kind();
            if kind != io::ErrorKind::Interrupted {
                self.fault.note(error);
            }
            kind.into()
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Sink that writes into a file for as long as this works.
pub(crate) struct RecordingFile {
    encoder: Mutex<Encoder<ErrorTrackingFile>>,
    fault: FileError,
}

impl RecordingFile {
    /// Creates the file at `path`, replacing an existing one.
    pub fn create(path: &Path) -> Result<(Self, FileError), TelemetryError> {
        let unwritable = |source| TelemetryError::Unwritable { path: path.to_owned(), source };
        let file = File::create(path).map_err(unwritable)?;
        let fault = FileError { path: path.to_owned(), first: Arc::default() };
        let noting = ErrorTrackingFile { file, fault: fault.clone() };
        let version = rerun::build_info().version;
        let encoder = Encoder::new_eager(version, EncodingOptions::PROTOBUF_COMPRESSED, noting);
        let encoder = encoder.map_err(|error| match fault.take() {
            Err(named) => named,
            Ok(()) => unwritable(io::Error::other(error)),
        })?;
        Ok((Self { encoder: Mutex::new(encoder), fault: fault.clone() }, fault))
    }
}

impl LogSink for RecordingFile {
    fn send(&self, message: LogMsg) {
        if let Ok(mut encoder) = self.encoder.lock()
            && let Err(error) = encoder.append(&message)
        {
            self.fault.note(io::Error::other(error));
        }
    }

    fn flush_blocking(&self, _: Duration) -> Result<(), SinkFlushError> {
        // A failed write is reported through [`FileError::take`].
        Ok(())
    }

    fn defers_finalization_to_shutdown(&self) -> bool {
        true
    }
}
