//! Text about a trial: properties, phases, log and outcome.

use rerun::{AnyValues, RecordingStream, StateChange, TextDocument, TextLog};

use crate::entities;
use crate::error::TelemetryError;

/// Severity of a log line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogLevel {
    /// Detail for debugging.
    Debug,
    /// Normal event.
    Info,
    /// Unwanted event.
    Warn,
    /// Event that must not occur.
    Error,
}

impl LogLevel {
    fn name(self) -> &'static str {
        match self {
            Self::Debug => rerun::TextLogLevel::DEBUG,
            Self::Info => rerun::TextLogLevel::INFO,
            Self::Warn => rerun::TextLogLevel::WARN,
            Self::Error => rerun::TextLogLevel::ERROR,
        }
    }
}

/// Identification of a trial, stored as properties of the recording.
#[derive(Debug, Clone, Default)]
pub struct TrialProperties {
    /// Name of the combination of objects.
    pub combination: String,
    /// Number of the trial.
    pub trial: u64,
    /// Name of the benchmark condition, such as `ideal`, `blind` or `touch`.
    pub condition: String,
    /// Robot backend: `sim`, `hardware`, `emulated` or `replay`.
    pub robot: String,
    /// Seed of the session.
    pub seed: u64,
}

/// Logs the properties and names the recording after them.
pub fn log_properties(rec: &RecordingStream, p: &TrialProperties) -> Result<(), TelemetryError> {
    let text = |name: &str| [rerun::components::Text::from(name)];
    let values = AnyValues::default()
        .with_component::<rerun::components::Text>("combination", text(&p.combination))
        .with_component::<rerun::components::Text>("trial", text(&p.trial.to_string()))
        .with_component::<rerun::components::Text>("condition", text(&p.condition))
        .with_component::<rerun::components::Text>("robot", text(&p.robot))
        .with_component::<rerun::components::Text>("seed", text(&p.seed.to_string()));
    rec.send_property("trial", &values)?;
    Ok(rec.send_recording_name(format!("{} #{} {}", p.combination, p.trial, p.condition))?)
}

/// Logs a phase: a bar in the state view and a line in the log.
pub fn log_phase(rec: &RecordingStream, phase: &str) -> Result<(), TelemetryError> {
    rec.log(entities::PHASE, &StateChange::single(phase))?;
    log_text(rec, LogLevel::Info, &format!("phase: {phase}"))
}

/// Logs a line.
pub fn log_text(rec: &RecordingStream, level: LogLevel, text: &str) -> Result<(), TelemetryError> {
    Ok(rec.log(entities::LOG, &TextLog::new(text).with_level(level.name()))?)
}

/// Logs the outcome: in the log, as a document, and as a property.
pub fn log_outcome(rec: &RecordingStream, outcome: &str) -> Result<(), TelemetryError> {
    log_text(rec, LogLevel::Info, &format!("outcome: {outcome}"))?;
    rec.log(entities::OUTCOME, &TextDocument::new(outcome))?;
    let value = AnyValues::default()
        .with_component::<rerun::components::Text>("outcome", [rerun::components::Text::from(outcome)]);
    Ok(rec.send_property("result", &value)?)
}
