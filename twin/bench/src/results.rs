//! Tables, summary and report of the finished units of a run.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord, write_ablated, write_trials};
use scenarios::summary::{RunInfo, Summary, summarise};
use scenarios::tries::{TryRecord, write_tries};

use crate::journal::{JournalEntry, RunRequest, WorkUnit, work_units};
use crate::provenance::Provenance;
use crate::trial::profile::Activity;
use external_policy::SimulatedTimePassage;
use fault_detection::fault::write_table;

/// Number of combinations and of trials of the whole benchmark.
const FULL_BENCHMARK_SIZE: (usize, usize) = (60, 10);

/// Lists everything that distinguishes a run from the full benchmark.
fn warnings(done: &BTreeMap<WorkUnit, JournalEntry>, request: &RunRequest) -> Vec<String> {
    let mut warnings = Vec::new();
    let all = work_units(request);
    let missing = all.iter().filter(|unit| !done.contains_key(unit)).count();
    if missing > 0 {
        warnings.push(format!(
            "{missing} of {} units of work are missing: the run was not finished, or a shard is left out",
            all.len()
        ));
    }
    if let (shard, of @ 2..) = request.shard {
        warnings.push(format!("this is shard {shard} of {of}, not the whole run"));
    }
    let (combos, trials) = FULL_BENCHMARK_SIZE;
    if request.combos < combos || request.trials < trials {
        warnings.push(format!(
            "a part of the benchmark: {} of {combos} combinations, {} of {trials} trials each",
            request.combos, request.trials
        ));
    }
    if Condition::BUILT_IN.iter().any(|condition| !request.conditions.contains(condition)) {
        let names: Vec<&str> = request.conditions.iter().map(|condition| condition.name()).collect();
        warnings.push(format!("only these conditions were run: {}", names.join(", ")));
    }
    warnings.extend(noise_scale_warning(request));
    if request.policy.as_ref().is_some_and(|policy| policy.pace == SimulatedTimePassage::Wall) {
        warnings.push("time passed while the external policy computed: its results depend on the computer".to_owned());
    }
    if !request.without.is_empty() && !has_no_errors(request) {
        let names: Vec<String> = request.without.iter().map(ToString::to_string).collect();
        warnings.push(format!("disturbance effects that are off: {}", names.join(", ")));
    }
    if request.uncertainty.is_some() {
        warnings.push("the controller expects other errors than by default (--uncertainty)".to_owned());
    }
    if let Ok(Some(name)) = request.robot_name() {
        warnings.push(format!("the robot is {name}, not that of the benchmark (--robot-model)"));
    }
    if request.scenario != scenarios::scenario::BENCHMARK_TOML {
        warnings.push("the scenario is not that of the benchmark".to_owned());
    }
    warnings.extend(request.left_out.iter().chain(&request.notes).cloned());
    warnings
}

fn has_no_errors(request: &RunRequest) -> bool {
    request.scenario().is_ok_and(|scenario| scenario.is_ideal())
}

/// Describes the changes made by `--noise-scale`, and the errors that it leaves unscaled.
fn noise_scale_warning(request: &RunRequest) -> Option<String> {
    if has_no_errors(request) {
        let expects = if request.uncertainty.is_some() { "the errors of its file" } else { "none" };
        return Some(format!(
            "no errors are drawn and all disturbance effects are off; the controller expects {expects}"
        ));
    }
    if request.noise_scale == 1.0 {
        return None;
    }
    let stay = request.scenario().map(|scenario| scenario.effects.describe_unscaled()).unwrap_or_default();
    let stay = match stay.is_empty() {
        true => "there are no other errors".to_owned(),
        false => {
            format!("these effects are not: {} (--without switches them off, --no-errors all errors)", stay.join("; "))
        }
    };
    Some(format!("the random errors of arm and object detector are scaled by {}; {stay}", request.noise_scale))
}

/// Writes `trials.csv`, `tries.csv`, `ablations.csv` if there are any, `faults.csv` if fault detection ran,
/// `summary.json` and `report.html`, each whole or not at all. `spent` is the computing time by activity, if known.
pub fn write_results(
    done: &BTreeMap<WorkUnit, JournalEntry>,
    request: &RunRequest,
    folder: &Path,
    wall_s: f64,
    spent: Option<&[(Activity, f64)]>,
) -> Result<Summary> {
    let records: Vec<TrialRecord> = done.values().flat_map(|entry| entry.records.iter().cloned()).collect();
    if records.is_empty() {
        bail!("{}: no trial is finished", folder.display());
    }
    let ablated: Vec<AblatedTrial> = done.values().flat_map(|entry| entry.ablated.iter().cloned()).collect();
    let decision_budget = request.scenario()?.effects.time.map(|time| time.decision);
    let info = RunInfo { seed: request.seed, robot: request.robot.clone(), wall_s, decision_budget };
    let summary = Summary {
        robot_model: request.robot_name()?,
        left_out: request.left_out.clone(),
        notes: request.notes.clone(),
        ..summarise(&records, &ablated, &info)
    };
    let mut table = Vec::new();
    write_trials(&records, &mut table)?;
    ftac_platform::data::write_atomically(&folder.join("trials.csv"), &table)?;
    let tries: Vec<TryRecord> = done.values().flat_map(|entry| entry.tries.iter().cloned()).collect();
    let mut table = Vec::new();
    write_tries(&tries, &mut table)?;
    ftac_platform::data::write_atomically(&folder.join("tries.csv"), &table)?;
    if request.detects_faults {
        let named = done.values().flat_map(|entry| entry.faults.iter().map(move |named| (entry.unit, named)));
        let rows = named.map(|(WorkUnit { combination, trial }, named)| {
            (TrialId { combination, trial: trial.unwrap_or(0), condition: named.condition }, &named.fault)
        });
        ftac_platform::data::write_atomically(&folder.join("faults.csv"), write_table(rows).as_bytes())?;
    }
    if !ablated.is_empty() {
        let mut table = Vec::new();
        write_ablated(&ablated, &mut table)?;
        ftac_platform::data::write_atomically(&folder.join("ablations.csv"), &table)?;
    }
    ftac_platform::data::write_atomically(&folder.join("summary.json"), &serde_json::to_vec_pretty(&summary)?)?;
    let mut run = serde_json::json!({ "seed": request.seed, "robot": request.robot, "wall_s": summary.wall_s });
    add_provenance(&mut run, &request.provenance);
    if let Some(own) = &request.policy {
        run["external_policy"] = own.python_class().describe().into();
    }
    if let Some(driver) = &request.driver {
        run["driver of the robot"] = driver.class.describe().into();
    }
    run["warnings"] = warnings(done, request).into();
    let noise = request.scenario()?.noise;
    run["errors drawn (s.d.)"] = serde_json::json!({
        "arm, position": format!("{:.1} mm", 1e3 * noise.execution.position_sigma),
        "arm, rotation": format!("{:.3} rad", noise.execution.rotation_sigma),
        "detector, in the plane": format!("{:.1} mm", 1e3 * noise.perception.xy_sigma),
        "detector, vertically": format!("{:.1} mm", 1e3 * noise.perception.z_sigma),
        "detector, yaw": format!("{:.3} rad", noise.perception.yaw_sigma),
    });
    for (part, seconds) in spent.into_iter().flatten() {
        run["threads' time on"][format!("{}_s", part.name())] = (*seconds).into();
    }
    report::write_report(folder, &summary, &records, &run)?;
    Ok(summary)
}

/// Returns the wall time (s) in the results of `folder`, if it has any.
pub fn earlier_wall_time(folder: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(folder.join("summary.json")).ok()?;
    serde_json::from_str::<serde_json::Value>(&text).ok()?["wall_s"].as_f64()
}

/// Adds the provenance of the data, and the command that made the page if it is another one.
fn add_provenance(run: &mut serde_json::Value, made: &[Provenance]) {
    match made {
        [] => run["command of the data"] = "unknown: the run was made by an older program".into(),
        [first, others @ ..] => {
            run["command"] = first.command.clone().into();
            run["version"] = first.version.clone().into();
            run["machine"] = first.machine.clone().into();
            if let Some(commit) = &first.commit {
                run["source tree"] = commit.clone().into();
            }
            if !others.is_empty() {
                let commands: Vec<String> = others.iter().map(Provenance::command_line).collect();
                run["further commands"] = commands.join("\n").into();
            }
        }
    }
    let now = Provenance::now();
    if made.iter().all(|made| made.command != now.command) {
        run["page made by"] = format!("{} ({})", now.command_line(), now.version).into();
    }
}
