//! File of a recording. It gets its name when the recording is closed; until then it is `NAME.partial.rrd`, so that an
//! interrupted recording replaces no complete one. It is locked meanwhile: of two programs that would write the same
//! recording, the second is refused. The first failed write, that of the footer included, is kept for the
//! code that closes the recording: Rerun's own sink only writes it to an unread log.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ftac_platform::journal::try_lock;
use rerun::external::re_log_encoding::{Encoder, rrd::EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};

use crate::error::TelemetryError;

/// File that is being written, shared by the writer and the code that closes the recording.
#[derive(Debug, Clone)]
pub(crate) struct UnfinishedFile {
    path: PathBuf,
    /// Name until the recording is closed. `None` for a device, which keeps its own.
    partial: Option<PathBuf>,
    fault: Arc<Mutex<Option<io::Error>>>,
}

impl UnfinishedFile {
    fn note(&self, error: io::Error) {
        if let Ok(mut fault) = self.fault.lock() {
            fault.get_or_insert(error);
        }
    }

    /// Returns the first failed write as an error, if there is one.
    fn check(&self) -> Result<(), TelemetryError> {
        let fault = self.fault.lock().ok().and_then(|mut fault| fault.take());
        fault.map_or(Ok(()), |source| Err(self.unwritable(source)))
    }

    fn unwritable(&self, source: io::Error) -> TelemetryError {
        TelemetryError::Unwritable { path: self.path.clone(), source }
    }

    /// Gives the file its name once everything is written. After a failed write it keeps its partial name.
    pub fn complete(&self) -> Result<(), TelemetryError> {
        self.check()?;
        let renamed = self.partial.as_ref().map_or(Ok(()), |partial| std::fs::rename(partial, &self.path));
        renamed.map_err(|source| self.unwritable(source))
    }

    /// Removes the file. An earlier recording of this name stays.
    pub fn remove(&self) -> Result<(), TelemetryError> {
        let removed = self.partial.as_ref().map_or(Ok(()), std::fs::remove_file);
        removed.map_err(|source| self.unwritable(source))
    }
}

/// Returns the name of the recording `path` until it is complete. `None` if there is something else than a file, such as
/// a device.
fn partial_name(path: &Path) -> Option<PathBuf> {
    let other = std::fs::metadata(path).is_ok_and(|found| !found.is_file());
    (!other).then(|| path.with_extension("partial.rrd"))
}

/// Opens the file `partial` empty, and locks it. Returns an error if another program is writing it.
fn create_locked(partial: &Path) -> io::Result<File> {
    let busy = || io::Error::other("found another program that writes this recording, expected another name");
    if std::fs::symlink_metadata(partial).is_ok_and(|found| !found.is_file()) {
        // It may be a link to somewhere else: it is not written to.
        drop(std::fs::remove_file(partial));
    }
    let file = File::options().write(true).create(true).truncate(false).open(partial)?;
    let file = try_lock(file)?.ok_or_else(busy)?;
    // Another program may have completed its recording, and so renamed the file, before this one got the lock.
    let same = same_file::Handle::from_path(partial)
        .and_then(|there| Ok(there == same_file::Handle::from_file(file.try_clone()?)?));
    if !same.unwrap_or(false) {
        return Err(busy());
    }
    file.set_len(0)?;
    Ok(file)
}

/// A file that remembers its first error.
struct ErrorTrackingFile {
    file: File,
    unfinished: UnfinishedFile,
}

impl Write for ErrorTrackingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes);
        // The caller gets an error of the same kind and may or may not pass it on.
        written.map_err(|error| {
            let kind = error.kind();
            if kind != io::ErrorKind::Interrupted {
                self.unfinished.note(error);
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
    unfinished: UnfinishedFile,
}

impl RecordingFile {
    /// Creates the file of the recording `path`.
    pub fn create(path: &Path) -> Result<(Self, UnfinishedFile), TelemetryError> {
        let unfinished = UnfinishedFile { path: path.to_owned(), partial: partial_name(path), fault: Arc::default() };
        let file = unfinished.partial.as_deref().map_or_else(|| File::create(path), create_locked);
        let file = file.map_err(|source| unfinished.unwritable(source))?;
        let tracking = ErrorTrackingFile { file, unfinished: unfinished.clone() };
        let version = rerun::build_info().version;
        let encoder = Encoder::new_eager(version, EncodingOptions::PROTOBUF_COMPRESSED, tracking);
        let encoder = encoder.map_err(|error| match unfinished.check() {
            Err(named) => named,
            Ok(()) => unfinished.unwritable(io::Error::other(error)),
        })?;
        Ok((Self { encoder: Mutex::new(encoder), unfinished: unfinished.clone() }, unfinished))
    }
}

impl LogSink for RecordingFile {
    fn send(&self, message: LogMsg) {
        if let Ok(mut encoder) = self.encoder.lock()
            && let Err(error) = encoder.append(&message)
        {
            self.unfinished.note(io::Error::other(error));
        }
    }

    fn flush_blocking(&self, _: Duration) -> Result<(), SinkFlushError> {
        // A failed write is reported through [`UnfinishedFile::complete`].
        Ok(())
    }

    fn defers_finalization_to_shutdown(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of two that write the same recording, the second is refused; what an interrupted one left is replaced.
    #[test]
    fn a_recording_has_one_writer() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("trial.rrd");
        std::fs::write(partial_name(&path).expect("a file"), "cut off").expect("written");
        let (first, unfinished) = RecordingFile::create(&path).expect("a file that is left over is replaced");
        let refused = RecordingFile::create(&path).err().expect("another writer").to_string();
        assert!(refused.contains("found another program that writes this recording"), "{refused}");
        unfinished.complete().expect("the first one is whole");
        drop(first);
        let (_second, unfinished) = RecordingFile::create(&path).expect("nobody writes it now");
        unfinished.remove().expect("removed");
        assert!(path.exists(), "the earlier recording stays");
    }
}
