//! The true scene of an emulated robot, for the viewer. The controlling program's own recording has no access to it.

use std::path::{Path, PathBuf};

use super::emulated_table::EmulatedTable;
use anyhow::Result;
use bench::recording::{drawn_object, log_scene};
use telemetry::recorder::{Recorder, RecorderSettings, RecordingTarget};

/// Recorder of the true scene; one recording for each set of objects on the table.
pub struct TruthRecorder {
    file: Option<PathBuf>,
    live: bool,
    /// Version of the objects on the table, their recorder and their names.
    open: Option<(u64, Recorder, Vec<String>)>,
    count: usize,
}

impl TruthRecorder {
    /// Records into `file`, and streams to a viewer if `live`.
    pub fn new(file: Option<PathBuf>, live: bool) -> Self {
        Self { file, live, open: None, count: 0 }
    }

    /// Records the present state.
    pub fn record(&mut self, table: &EmulatedTable) -> Result<()> {
        let (names, version) = table.placed_objects();
        let truth = table.plant().lock().truth();
        if truth.objects.len() != names.len() {
            // The objects were replaced between the two reads.
            return Ok(());
        }
        if self.open.as_ref().is_none_or(|(open, ..)| *open != version) {
            self.begin(table, &names, version)?;
        }
        let Some((_, recorder, names)) = &mut self.open else { return Ok(()) };
        log_scene(recorder, &truth, names)
    }

    fn begin(&mut self, table: &EmulatedTable, standing: &[String], version: u64) -> Result<()> {
        self.close()?;
        self.count += 1;
        let world = &table.bench().world;
        let names: Vec<String> = (1..).zip(standing).map(|(n, name)| format!("{n}_{name}")).collect();
        let objects = standing.iter().zip(&names).map(|(model, name)| Ok(drawn_object(&*world.object(model)?, name)));
        let objects = objects.collect::<Result<Vec<_>>>()?;
        let file = self.file.as_deref().map(|file| RecordingTarget::File(numbered_path(file, self.count)));
        let targets: Vec<RecordingTarget> =
            file.into_iter().chain(self.live.then_some(RecordingTarget::Spawn)).collect();
        let settings = RecorderSettings { truth: true, ..RecorderSettings::default() };
        let recorder = Recorder::open(&targets, settings, &world.cell.robot, &objects)?;
        self.open = Some((version, recorder, names));
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        self.open.take().map_or(Ok(()), |(_, recorder, _)| Ok(recorder.finish()?))
    }

    /// Flushes and closes the recording.
    pub fn finish(mut self) -> Result<()> {
        self.close()
    }
}

/// Returns the file of recording number `count`: `file` itself, then `NAME-2`.
fn numbered_path(file: &Path, count: usize) -> PathBuf {
    if count < 2 {
        return file.to_owned();
    }
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let extension = file.extension().map_or(String::new(), |extension| format!(".{}", extension.to_string_lossy()));
    file.with_file_name(format!("{stem}-{count}{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_recordings_have_numbers() {
        assert_eq!(numbered_path(Path::new("a/truth.rrd"), 1), Path::new("a/truth.rrd"));
        assert_eq!(numbered_path(Path::new("a/truth.rrd"), 2), Path::new("a/truth-2.rrd"));
        assert_eq!(numbered_path(Path::new("truth"), 3), Path::new("truth-3"));
    }
}
