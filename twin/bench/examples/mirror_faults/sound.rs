//! Sound trials with a mirror beside them: what it names that did not happen.

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use bench::builtin::{hide_plant, make_bench};
use bench::mirror::watch::Mirroring;
use bench::trial::filming::All;
use bench::trial::{Moment, Watcher};
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};

use crate::happened::Happened;

/// Looks at the truth while a mirror looks at measurements.
#[derive(Default)]
struct Truths {
    shared: Happened,
    branch: Option<Happened>,
    all: BTreeMap<Condition, Happened>,
    phases: Vec<(Option<Condition>, f64, &'static str)>,
    seconds: f64,
    last: f64,
}

impl Watcher for Truths {
    fn active(&self) -> bool {
        true
    }

    fn see(&mut self, moment: &Moment) -> Result<()> {
        let Some(truth) = moment.truth.filter(|_| moment.sent.is_some()) else { return Ok(()) };
        self.seconds += (moment.time - self.last).clamp(0.0, 0.1);
        self.last = moment.time;
        let happened = match moment.condition {
            None => &mut self.shared,
            Some(_) => self.branch.get_or_insert_with(|| self.shared.clone()),
        };
        happened.see(truth, moment.executive.phase());
        self.phases.push((moment.condition, moment.time, moment.executive.phase().name()));
        Ok(())
    }

    fn branch(&mut self, _: Condition) -> Result<()> {
        self.branch = None;
        Ok(())
    }

    fn outcome(&mut self, record: &TrialRecord) -> Result<()> {
        self.all.extend(self.branch.take().map(|happened| (record.condition, happened)));
        Ok(())
    }
}

/// `SEED FROM TO PLANT CONDITIONS`.
pub fn main(arguments: &[String]) -> Result<()> {
    let [seed, from, to, plant, conditions] = arguments else {
        bail!("expected sound SEED FROM TO PLANT CONDITIONS, found {} arguments after sound", arguments.len());
    };
    let (seed, plant): (u64, u64) = (seed.parse()?, plant.parse()?);
    let (from, to): (usize, usize) = (from.parse()?, to.parse()?);
    let conditions = conditions.split(',').map(str::parse).collect::<Result<Vec<Condition>, _>>()?;
    let mut bench = make_bench(Scenario::benchmark(), to, seed, true)?;
    if plant > 0 {
        hide_plant(&mut bench, plant);
    }
    let (mut seconds, mut wrongly) = (0.0, 0);
    for combination in from..to {
        let mut truths = Truths::default();
        let mut mirroring = Mirroring::new(&bench, None);
        bench.trial(combination, 0, &conditions, &[], &mut All(vec![&mut mirroring, &mut truths]))?;
        for named in mirroring.finish(Condition::Blind) {
            let right = truths.all.get(&named.condition).is_some_and(|happened| happened.justifies(&named.divergence));
            let rightly = if right { "rightly" } else { "wrongly" };
            let at = |(condition, time, _): &&(Option<Condition>, f64, &str)| {
                condition.is_none_or(|condition| condition == named.condition)
                    && (time - named.divergence.time).abs() < 1e-6
            };
            let phase = truths.phases.iter().rev().find(at).map_or("", |(.., phase)| phase);
            println!("{combination} {} ({phase}): {}, {rightly}", named.condition, named.divergence);
            wrongly += u32::from(!right);
        }
        seconds += truths.seconds;
    }
    println!("{seconds:.0} s simulated, {wrongly} named wrongly: {:.1} an hour", f64::from(wrongly) * 3600.0 / seconds);
    Ok(())
}
