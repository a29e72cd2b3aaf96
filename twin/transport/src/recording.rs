//! Rerun recording of a transport: robot, balls, contacts, tactile images, and the decisions as text.

use std::path::Path;

use anyhow::Result;
use control::executor::{Executor, Phase};
use control::policy::pick_sequence::PickMode;
use sim::robot::GroundTruth;
use telemetry::recorder::{Recorder, RecorderSettings, RecordingTarget};
use telemetry::{DrawnObject, LogLevel, TrialProperties};

use super::trial::{TransportRecord, TransportSite};
use bench::recording::{RecordedImages, drawn_object, log_scene, log_signals};

/// Recorder of one transport.
pub struct TransportRecording {
    recorder: Recorder,
    names: Vec<String>,
    phase: Option<Phase>,
    recorded_images: RecordedImages,
}

impl TransportRecording {
    /// Opens `file` for transport `trial` under `policy`.
    pub fn open(file: &Path, site: &TransportSite, trial: usize, policy: PickMode) -> Result<Self> {
        let drawn: Vec<DrawnObject> =
            site.transport.ball.iter().map(|ball| drawn_object(&ball.model(), &ball.name)).collect();
        let targets = [RecordingTarget::File(file.to_owned())];
        let mut recorder = Recorder::open(&targets, RecorderSettings::default(), &site.world.cell.robot, &drawn)?;
        recorder.log_properties(&TrialProperties {
            combination: site.transport.name.clone(),
            trial: trial as u64,
            condition: policy.name().to_owned(),
            robot: "sim".to_owned(),
            seed: site.seed,
        })?;
        let names = site.transport.ball.iter().map(|ball| ball.name.clone()).collect();
        Ok(Self { recorder, names, phase: None, recorded_images: RecordedImages::default() })
    }

    /// Writes the outcome and flushes the recording.
    pub fn finish(mut self, record: &TransportRecord) -> Result<()> {
        let last = record.events.last().map_or("nothing was carried", String::as_str);
        self.recorder.log_outcome(&format!("{}: {:?} objects a trip; {last}", record.policy.name(), record.carried))?;
        self.recorder.finish()?;
        Ok(())
    }

    /// Records a tick; `note` is the latest decision or event as text.
    pub fn record_tick(&mut self, truth: &GroundTruth, executor: &Executor, note: Option<&str>) -> Result<()> {
        let recorder = &mut self.recorder;
        log_scene(recorder, truth, &self.names)?;
        if self.phase != Some(executor.phase()) {
            self.phase = Some(executor.phase());
            recorder.log_phase(&executor.phase().name())?;
        }
        if let Some(note) = note {
            recorder.log_text(LogLevel::Info, note)?;
        }
        let motion = executor.motion();
        self.recorded_images.log(recorder, motion.newest_images())?;
        log_signals(recorder, truth, motion.servos(), motion.posture(), Vec::new())
    }
}
