//! `ftac schema`: JSON Schema of the `--json` output.

use std::collections::BTreeSet;

use ::sweep::page::Results;
use anyhow::{Context as _, bail};
use clap::Command;

use fault_injection::table::FaultTable;
use proving::synthesis::evaluation::Evaluation;
use proving::synthesis::report::Report;
use scenarios::summary::Summary;
use sensor_calibration::reconstruction::output::ImageFigures;
use sensor_calibration::render::real_sensor::SensorRender;
use serde_json::json;

use super::bridge;
use super::{combos, demo, export, grasps, hand, optics, replay, sweep, touch, transport, trial, twin};
use crate::json_schema::{self, Output, of};
use crate::lab::hand_over::Lab;
use crate::terminal::{Outcome, Terminal};

/// Outputs of the commands of this program, except those of `ftac-lab`.
pub const OUTPUTS: &[Output] = &[
    ("bench", of::<Summary>),
    ("bridge calibrate", of::<bridge::calibrate::Calibrated>),
    ("bridge clear-faults", of::<bridge::clear_faults::Cleared>),
    ("bridge doctor", of::<bridge::shared::Findings>),
    ("bridge emulate", of::<bridge::emulate::Answered>),
    ("bridge emulate", of::<bridge::emulate::Started>),
    ("bridge emulate", of::<bridge::emulate::Ended>),
    ("bridge exercise", of::<bridge::exercise::Exercised>),
    ("bridge faults", of::<FaultTable>),
    ("bridge install", of::<bridge::install::Installed>),
    ("bridge provision", of::<bridge::provision::Provisioned>),
    ("bridge reboot", of::<bridge::reboot::Rebooted>),
    ("bridge register", of::<bridge::register::Registered>),
    ("bridge register", of::<bridge::register::Planned>),
    ("bridge scan", of::<bridge::scan::Scanned>),
    ("bridge sheet", of::<bridge::sheet::Sheet>),
    ("bridge stop", of::<bridge::stop::Stopped>),
    ("combos", of::<combos::Combinations>),
    ("demo", of::<demo::Demo>),
    ("export lerobot", of::<export::DataSet>),
    ("export mcap", of::<export::Bags>),
    ("export ros2", of::<export::Bag>),
    ("export rrd", of::<export::Drawn>),
    ("grasps collection", of::<grasps::collection::Answer>),
    ("grasps eval", of::<Evaluation>),
    ("grasps export", of::<grasps::export::Exported>),
    ("grasps generate", of::<Report>),
    ("grasps pick-ups", of::<grasps::pick_ups::Proven>),
    ("grasps plan", of::<grasps::pick_ups::Planned>),
    ("grasps show", of::<grasps::show::Shown>),
    ("hand picture", of::<hand::picture::Pictured>),
    ("optics calibrate", of::<optics::calibrate::Calibrated>),
    ("optics eval", of::<optics::eval::Evaluation>),
    ("optics pads", of::<optics::pads::Written>),
    ("optics reconstruct", of::<optics::reconstruct::Reconstruction>),
    ("optics reconstruct", of::<ImageFigures>),
    ("optics render", of::<optics::render::PadRender>),
    ("optics render", of::<SensorRender>),
    ("optics shapes", of::<optics::render::Shapes>),
    ("replay", of::<replay::Replayed>),
    ("replay", of::<replay::Folder>),
    ("replay", of::<replay::Compared>),
    (SHARED, of::<Summary>),
    (SHARED, of::<Results>),
    ("sweep makespan", of::<sweep::output::Replayed>),
    ("sweep merge", of::<sweep::output::Joined>),
    ("sweep plan", of::<sweep::output::Planned>),
    ("sweep run", of::<sweep::output::Played>),
    ("sweep status", of::<sweep::output::Standing>),
    ("sweep submit", of::<sweep::output::Handed>),
    ("touch train", of::<touch::Trained>),
    ("transport", of::<transport::Carried>),
    ("transport", of::<transport::Rehearsed>),
    ("trial", of::<trial::Played>),
    ("twin evaluate", of::<twin::evaluate::Evaluated>),
    ("twin excite", of::<twin::excite::Excited>),
    ("twin identify", of::<twin::identify::Identified>),
];

/// Commands without a JSON result.
const WITHOUT: [&str; 5] = ["completions", "man", "reference", "schema", "view"];
/// Command with outputs of both programs.
const SHARED: &str = "report";

/// Returns the commands of `program` that print a result.
pub fn commands(program: &Command) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    add_leaves(program, "", &mut all);
    all.retain(|name| !WITHOUT.contains(&name.as_str()));
    all
}

fn add_leaves(command: &Command, path: &str, into: &mut BTreeSet<String>) {
    let own: Vec<&Command> = command.get_subcommands().filter(|own| own.get_name() != "help").collect();
    if own.is_empty() {
        into.insert(path.to_owned());
    }
    for child in own {
        add_leaves(child, format!("{path} {}", child.get_name()).trim(), into);
    }
}

/// Runs `ftac schema` for a command of `program`. The `lab` prints the schemas of its own commands, and those of all
/// commands together.
pub fn run(terminal: &Terminal, command: &[String], program: &Command, lab: &Lab<'_>) -> Outcome {
    let name = command.join(" ");
    if name != SHARED && OUTPUTS.iter().any(|(command, _)| *command == name) {
        return print(terminal, command, &[OUTPUTS]);
    }
    let known = commands(program);
    if !name.is_empty() && !known.contains(&name) {
        let known: Vec<String> = known.into_iter().collect();
        bail!("COMMAND: found `{name}`, expected one of {}", known.join(", "));
    }
    Err(lab.hand_over())
}

/// Prints the schema of one command, or of all in `outputs`.
pub fn print(terminal: &Terminal, command: &[String], outputs: &[&[Output]]) -> Outcome {
    let all = json_schema::all(outputs.concat());
    let found = match command {
        [] => all,
        words => {
            let name = words.join(" ");
            let schema = all["commands"]
                .get(&name)
                .with_context(|| format!("COMMAND: found `{name}`, expected one with a schema"))?;
            json!({ "$schema": all["$schema"], "title": format!("ftac {name} --json"), "anyOf": [schema, all["error"]] })
        }
    };
    terminal.print(&found, &(serde_json::to_string_pretty(&found)? + "\n"))?;
    Ok(None)
}
