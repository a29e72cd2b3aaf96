//! Fault detection through all branches of a trial.

use std::time::Duration;
use std::time::Instant;

use anyhow::Result;
use scenarios::record::{Condition, TrialRecord};

use crate::recording::Recording;
use crate::trial::{Bench, NoWatcher, TickView, Watcher};
use fault_detection::FaultDetector;
use fault_detection::fault::FaultRow;
use fault_detection::measurements::TickMeasurements;

/// Runs a trial with `recording` as its watcher, if any, and with fault detection if `mirrors`. If `tells`, for a real
/// robot, each fault is printed at once. Returns the result of `run_trial` and the detected faults. Those of a trial
/// that stopped are listed under `condition`.
pub fn run_with_detector<T>(
    bench: &Bench,
    recording: Option<&mut Recording>,
    (mirrors, tells, condition): (bool, bool, Condition),
    run_trial: impl FnOnce(&mut dyn Watcher) -> Result<T>,
) -> (Result<T>, Option<Vec<FaultRow>>) {
    if mirrors {
        let mut mirroring = FaultDetectionWatcher::new(bench, recording).with_printing(tells);
        let finished = run_trial(&mut mirroring);
        return (finished, Some(mirroring.finish(condition)));
    }
    let finished = match recording {
        Some(recording) => run_trial(recording),
        None => run_trial(&mut NoWatcher),
    };
    (finished, None)
}

/// Fault detection in a trial: one detector for the part that conditions share, and one for each branch.
pub struct FaultDetectionWatcher<'a> {
    bench: &'a Bench,
    /// Recording that shows the reference model, if any.
    recording: Option<&'a mut Recording>,
    /// Fault detector of the part that conditions share, with the time of its last tick, s.
    shared: Option<(FaultDetector, f64)>,
    /// Fault detector of the present branch, with the time of its last tick, s.
    branch: Option<(FaultDetector, f64)>,
    /// Faults detected in finished branches.
    faults: Vec<FaultRow>,
    ticks: u32,
    computing_time: Duration,
    /// Number of gaps in the observations.
    gaps: u32,
    /// True if faults are printed to stderr at once, for the operator of a robot.
    prints_faults: bool,
}

impl<'a> FaultDetectionWatcher<'a> {
    /// Creates the fault detection of the trials of `bench`, shown in `recording`.
    pub fn new(bench: &'a Bench, recording: Option<&'a mut Recording>) -> Self {
        Self {
            bench,
            recording,
            shared: None,
            branch: None,
            faults: Vec::new(),
            ticks: 0,
            computing_time: Duration::ZERO,
            gaps: 0,
            prints_faults: false,
        }
    }

    /// Sets whether faults are printed at once, and the detector's pace at the end: for a real robot.
    #[must_use]
    pub fn with_printing(self, tells: bool) -> Self {
        Self { prints_faults: tells, ..self }
    }

    /// Returns the detected faults, branch by branch, including a branch that was stopped.
    pub fn finish(mut self, condition: Condition) -> Vec<FaultRow> {
        self.finish_branch(condition);
        if self.prints_faults {
            let ms = 1e3 * self.computing_time.as_secs_f64() / f64::from(self.ticks.max(1));
            eprintln!("fault detection: {} ticks observed, {} gaps; {ms:.2} ms a tick", self.ticks, self.gaps);
        }
        self.faults
    }

    /// Returns the number of gaps so far that invalidated the observations before them: see [`fault_detection::pace`].
    pub fn gaps(&self) -> u32 {
        self.gaps
    }

    /// Returns the number of observed ticks, and the computing time of the fault detector for them.
    pub fn effort(&self) -> (u32, Duration) {
        (self.ticks, self.computing_time)
    }

    fn finish_branch(&mut self, condition: Condition) {
        if let Some((fault_detector, _)) = self.branch.take() {
            let all = fault_detector.faults().iter().cloned();
            self.faults.extend(all.map(|divergence| FaultRow { condition, fault: divergence }));
        }
    }

    fn detect_in_tick(&mut self, moment: &TickView) -> Result<()> {
        let Some(sent) = moment.sent else { return Ok(()) };
        let seen = TickMeasurements::from_executor(moment.executor, moment.time, sent, moment.felt.first());
        let begun = Instant::now();
        // An earlier time means that another trial has started.
        let goes_on = |known: &(FaultDetector, f64)| moment.time > known.1;
        let known = match moment.condition {
            None => self.shared.take(),
            Some(_) => self.branch.take().or_else(|| self.shared.clone()),
        };
        let mut fault_detector = match known.filter(goes_on) {
            Some((fault_detector, _)) => fault_detector,
            None => FaultDetector::new(&self.bench.world, &seen.arm.position)?,
        };
        let gaps = fault_detector.gaps();
        let fresh: Vec<String> = fault_detector.update(&seen).iter().map(ToString::to_string).collect();
        self.ticks += 1;
        self.gaps += fault_detector.gaps() - gaps;
        self.computing_time += begun.elapsed();
        if self.prints_faults {
            fresh.iter().for_each(|named| eprintln!("fault detection: {named}"));
        }
        if let Some(recording) = &mut self.recording {
            recording.log_fault_detector(&fault_detector, &fresh)?;
        }
        let keep = if moment.condition.is_some() { &mut self.branch } else { &mut self.shared };
        *keep = Some((fault_detector, moment.time));
        Ok(())
    }
}

impl Watcher for FaultDetectionWatcher<'_> {
    /// Fault detection uses the images that arrive: requesting more would cost more than the trial.
    fn is_active(&self) -> bool {
        self.recording.as_ref().is_some_and(|recording| recording.is_active())
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        if let Some(recording) = &mut self.recording {
            recording.on_tick(moment)?;
        }
        self.detect_in_tick(moment)
    }

    fn on_branch(&mut self, condition: Condition) -> Result<()> {
        self.branch = None;
        self.recording.as_mut().map_or(Ok(()), |recording| recording.on_branch(condition))
    }

    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()> {
        self.finish_branch(record.condition);
        self.recording.as_mut().map_or(Ok(()), |recording| recording.on_outcome(record))
    }
}
