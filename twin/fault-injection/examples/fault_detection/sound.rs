//! False alarms of fault detection in sound trials.

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use bench::fault_watch::FaultDetectionWatcher;
use bench::trial::filming::Watchers;
use bench::trial::{TickView, Watcher};
use control::executor::Phase;
use scenarios::record::{Condition, TrialRecord};

use crate::event_times::FaultEventTimes;
use crate::prepare_bench;

/// Records the ground truth while fault detection receives measurements only.
struct TruthRecorder {
    shared: FaultEventTimes,
    branch: Option<FaultEventTimes>,
    all: BTreeMap<Condition, FaultEventTimes>,
    phases: Vec<(Option<Condition>, f64, Phase)>,
    seconds: f64,
    last: f64,
}

impl Watcher for TruthRecorder {
    fn is_active(&self) -> bool {
        true
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        let Some(truth) = moment.truth.filter(|_| moment.sent.is_some()) else { return Ok(()) };
        self.seconds += (moment.time - self.last).clamp(0.0, 0.1);
        self.last = moment.time;
        let happened = match moment.condition {
            None => &mut self.shared,
            Some(_) => self.branch.get_or_insert_with(|| self.shared.clone()),
        };
        happened.record(truth, moment.executor.phase());
        self.phases.push((moment.condition, moment.time, moment.executor.phase()));
        Ok(())
    }

    fn on_branch(&mut self, _: Condition) -> Result<()> {
        self.branch = None;
        Ok(())
    }

    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()> {
        self.all.extend(self.branch.take().map(|happened| (record.condition, happened)));
        Ok(())
    }
}

/// Runs the mode `sound` with arguments `SEED FROM TO PLANT CONDITIONS TRIALS [INSTANCE]`.
pub fn main(arguments: &[String]) -> Result<()> {
    let [seed, from, to, plant, conditions, trials, instance @ ..] = arguments else {
        bail!("expected sound SEED FROM TO PLANT CONDITIONS TRIALS [INSTANCE], found {} after sound", arguments.len());
    };
    let (from, to, trials): (usize, usize, usize) = (from.parse()?, to.parse()?, trials.parse()?);
    let conditions = conditions.split(',').map(str::parse).collect::<Result<Vec<Condition>, _>>()?;
    let bench = prepare_bench(to, seed.parse()?, plant.parse()?, instance.first())?;
    let (mut seconds, mut wrongly) = (0.0, 0);
    for (combination, trial) in (from..to).flat_map(|combination| (0..trials).map(move |trial| (combination, trial))) {
        let mut truths = TruthRecorder {
            shared: FaultEventTimes::default(),
            branch: None,
            all: BTreeMap::new(),
            phases: Vec::new(),
            seconds: 0.0,
            last: 0.0,
        };
        let mut mirroring = FaultDetectionWatcher::new(&bench, None);
        bench.run_each_condition(
            combination,
            trial,
            &conditions,
            &[],
            &mut Watchers(vec![&mut mirroring, &mut truths]),
        )?;
        for named in mirroring.finish(Condition::Blind) {
            let right = truths.all.get(&named.condition).is_some_and(|happened| happened.justifies(&named.fault));
            let rightly = if right { "rightly" } else { "wrongly" };
            let at = |(condition, time, _): &&(Option<Condition>, f64, Phase)| {
                condition.is_none_or(|condition| condition == named.condition) && (time - named.fault.time).abs() < 1e-6
            };
            let phase = truths.phases.iter().rev().find(at).map(|(.., phase)| phase.name()).unwrap_or_default();
            println!("{combination}/{trial} {} ({phase}): {}, {rightly}", named.condition, named.fault);
            wrongly += u32::from(!right);
        }
        seconds += truths.seconds;
    }
    println!("{seconds:.0} s simulated, {wrongly} false alarms: {:.1} an hour", f64::from(wrongly) * 3600.0 / seconds);
    Ok(())
}
