//! A mirror that observes a trial through all of its branches.

use std::time::Duration;
use std::time::Instant;

use anyhow::Result;
use scenarios::record::{Condition, TrialRecord};

use crate::recording::Recording;
use crate::trial::{Bench, Moment, NoWatcher, Watcher};
use fault_detection::Mirror;
use fault_detection::divergence::Named;
use fault_detection::seen::Seen;

/// Plays a trial with `recording` as its watcher, if there is one, and with a mirror beside it if `mirrors`. If
/// `tells`, which is meant for a real robot, each diagnosis is printed at once. Returns the result of `play` and the
/// diagnoses of the mirror. Those of a trial that stopped are listed under `condition`.
pub fn beside<T>(
    bench: &Bench,
    recording: Option<&mut Recording>,
    (mirrors, tells, condition): (bool, bool, Condition),
    play: impl FnOnce(&mut dyn Watcher) -> Result<T>,
) -> (Result<T>, Option<Vec<Named>>) {
    if mirrors {
        let mut mirroring = Mirroring::new(bench, recording).telling(tells);
        let played = play(&mut mirroring);
        return (played, Some(mirroring.finish(condition)));
    }
    let played = match recording {
        Some(recording) => play(recording),
        None => play(&mut NoWatcher),
    };
    (played, None)
}

/// A mirror beside a trial: one for the part that conditions share, and one for each branch.
pub struct Mirroring<'a> {
    bench: &'a Bench,
    /// Recording that shows the mirror, if any.
    recording: Option<&'a mut Recording>,
    /// Mirror of the part that conditions share, with the time of its last tick, s.
    shared: Option<(Mirror, f64)>,
    /// Mirror of the present branch, with the time of its last tick, s.
    branch: Option<(Mirror, f64)>,
    /// Diagnoses of the branches that are over.
    named: Vec<Named>,
    ticks: u32,
    spent: Duration,
    /// Number of gaps in the observations.
    gaps: u32,
    /// True if diagnoses are printed to stderr at once, for people beside a robot.
    tells: bool,
}

impl<'a> Mirroring<'a> {
    /// Creates the mirror of the trials of `bench`, shown in `recording`.
    pub fn new(bench: &'a Bench, recording: Option<&'a mut Recording>) -> Self {
        Self {
            bench,
            recording,
            shared: None,
            branch: None,
            named: Vec::new(),
            ticks: 0,
            spent: Duration::ZERO,
            gaps: 0,
            tells: false,
        }
    }

    /// Sets whether diagnoses are printed at once, and at the end how well the mirror kept up: for a real robot.
    #[must_use]
    pub fn telling(self, tells: bool) -> Self {
        Self { tells, ..self }
    }

    /// Returns the diagnoses, branch by branch, including a branch that was stopped.
    pub fn finish(mut self, condition: Condition) -> Vec<Named> {
        self.close(condition);
        if self.tells {
            let ms = 1e3 * self.spent.as_secs_f64() / f64::from(self.ticks.max(1));
            eprintln!("mirror: {} ticks seen, {} gaps; {ms:.2} ms a tick", self.ticks, self.gaps);
        }
        self.named
    }

    /// Returns the number of gaps so far that made the observations before them worthless: see
    /// [`fault_detection::pace`].
    pub fn gaps(&self) -> u32 {
        self.gaps
    }

    /// Returns the number of ticks seen, and the computing time of the mirror for them.
    pub fn effort(&self) -> (u32, Duration) {
        (self.ticks, self.spent)
    }

    fn close(&mut self, condition: Condition) {
        if let Some((mirror, _)) = self.branch.take() {
            let all = mirror.named().iter().cloned();
            self.named.extend(all.map(|divergence| Named { condition, divergence }));
        }
    }

    fn tick(&mut self, moment: &Moment) -> Result<()> {
        let Some(sent) = moment.sent else { return Ok(()) };
        let seen = Seen::of(moment.executor, moment.time, sent, moment.felt.first());
        let begun = Instant::now();
        // An earlier time means that another trial has begun.
        let goes_on = |known: &(Mirror, f64)| moment.time > known.1;
        let known = match moment.condition {
            None => self.shared.take(),
            Some(_) => self.branch.take().or_else(|| self.shared.clone()),
        };
        let mut mirror = match known.filter(goes_on) {
            Some((mirror, _)) => mirror,
            None => Mirror::new(&self.bench.world, &seen.arm.position)?,
        };
        let gaps = mirror.gaps();
        let fresh: Vec<String> = mirror.see(&seen).iter().map(ToString::to_string).collect();
        self.ticks += 1;
        self.gaps += mirror.gaps() - gaps;
        self.spent += begun.elapsed();
        if self.tells {
            fresh.iter().for_each(|named| eprintln!("mirror: {named}"));
        }
        if let Some(recording) = &mut self.recording {
            recording.log_mirror(&mirror, &fresh)?;
        }
        let keep = if moment.condition.is_some() { &mut self.branch } else { &mut self.shared };
        *keep = Some((mirror, moment.time));
        Ok(())
    }
}

impl Watcher for Mirroring<'_> {
    /// The mirror uses the images that come: requesting more would cost more than the trial.
    fn active(&self) -> bool {
        self.recording.as_ref().is_some_and(|recording| recording.active())
    }

    fn see(&mut self, moment: &Moment) -> Result<()> {
        if let Some(recording) = &mut self.recording {
            recording.see(moment)?;
        }
        self.tick(moment)
    }

    fn branch(&mut self, condition: Condition) -> Result<()> {
        self.branch = None;
        self.recording.as_mut().map_or(Ok(()), |recording| recording.branch(condition))
    }

    fn outcome(&mut self, record: &TrialRecord) -> Result<()> {
        self.close(record.condition);
        self.recording.as_mut().map_or(Ok(()), |recording| recording.outcome(record))
    }
}
