//! `ftac trial`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use scenarios::Scenario;
use scenarios::record::TrialRecord;

use super::Outcome;
use crate::body::Task;
use crate::body::choice::{check_body, venue};
use crate::builtin::make_bench;
use crate::cli::{Body, Cli, TrialArgs};
use crate::recording::Recording;
use crate::trial::NoWatcher;

/// Plays one trial and records it.
pub fn trial(cli: &Cli, args: &TrialArgs) -> Outcome {
    check_body(args.robot, args.config.as_deref())?;
    let scenario = Scenario::benchmark();
    let combos = (args.combination + 1).min(60);
    let mut bench = make_bench(scenario, combos, cli.seed, cli.quiet || cli.json)?;
    bench.board = args.tactile.board(bench.board);
    if args.combination >= bench.plans.plans.len() {
        bail!("COMBO: found {}, expected 0 to {}", args.combination, bench.plans.plans.len() - 1);
    }
    let condition = args.policy.condition();
    let place = venue(&bench.world, args.robot, args.config.as_deref(), args.session.clone())?;
    let task = Task {
        robot: args.robot.name().to_owned(),
        seed: cli.seed,
        combination: args.combination,
        trial: args.trial,
        condition,
        watched: args.robot != Body::Hardware,
        combos,
        scenario: scenarios::scenario::BENCHMARK.to_owned(),
    };
    if args.robot == Body::Hardware {
        let record = match place {
            Some(mut place) => bench.play(&task, place.as_mut(), &mut NoWatcher)?,
            None => bail!("--robot hardware: found no robot"),
        };
        tell_trial(cli, &record)?;
        return Ok(failure(&record));
    }
    let file = args.out.clone().unwrap_or_else(|| {
        PathBuf::from(format!("recordings/combination_{}_trial_{}_{}.rrd", args.combination, args.trial, condition))
    });
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let mut targets = vec![stream::Target::File(file.clone())];
    if args.live {
        targets.push(stream::Target::Spawn);
    }
    let mut recording = Recording::open(&targets, &bench, &task)?;
    let record = match (place, condition) {
        (Some(mut place), _) => bench.play(&task, place.as_mut(), &mut recording)?,
        (None, scenarios::Condition::Ideal) => bench.ideal(args.combination, &mut recording)?,
        (None, condition) => bench.trial(args.combination, args.trial, &[condition], &[], &mut recording)?.0.remove(0),
    };
    recording.finish()?;
    tell_trial(cli, &record)?;
    if !cli.json {
        println!("recorded in {0}; see it with `ftac view {0}`", file.display());
    }
    Ok(failure(&record))
}

/// Why the trial failed, if it did.
fn failure(record: &TrialRecord) -> Option<String> {
    let cause = record.cause.map_or_else(|| "cause unknown".to_owned(), |cause| cause.to_string());
    (!record.success).then(|| format!("the trial failed: {cause}"))
}

fn tell_trial(cli: &Cli, record: &TrialRecord) -> Result<()> {
    if cli.json {
        println!("{}", serde_json::to_string(record)?);
        return Ok(());
    }
    println!(
        "{} then {}, {}: success {}, collision {}",
        record.first, record.second, record.condition, record.success, record.collision
    );
    if !record.reason.is_empty() {
        println!("{}", record.reason);
    }
    Ok(())
}
