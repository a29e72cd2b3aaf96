//! `ftac schema`: what `--json` prints, as JSON Schema.

use anyhow::{Context as _, bail};
use serde_json::{Value, json};

use fault_injection::table::FaultTable;
use proving::synthesis::evaluation::Evaluation;
use proving::synthesis::search::Report;
use scenarios::summary::Summary;
use sensor_calibration::reconstruction::output::ImageFigures;
use sensor_calibration::render::real_sensor::SensorRender;

use super::bridge;
use super::{combos, demo, export, grasps, hand, optics, replay, sweep, touch, transport, trial, twin};
use crate::json_schema::{self, Output, of};
use crate::terminal::{Outcome, Terminal};

/// Schemas of commands whose outputs are not of one type.
const KEPT: &str = include_str!("../../data/json-output.json");

/// What the commands of this program print.
const OUTPUTS: &[Output] = &[
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
    ("grasps show", of::<grasps::show::OwnGrasps>),
    ("grasps show", of::<grasps::show::OtherGrasps>),
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
    ("sweep makespan", of::<sweep::Replayed>),
    ("sweep merge", of::<sweep::Joined>),
    ("sweep plan", of::<sweep::Planned>),
    ("sweep run", of::<sweep::Played>),
    ("sweep status", of::<sweep::Standing>),
    ("sweep submit", of::<sweep::Handed>),
    ("touch train", of::<touch::Trained>),
    ("transport", of::<transport::Carried>),
    ("transport", of::<transport::Rehearsed>),
    ("trial", of::<trial::Played>),
    ("twin evaluate", of::<twin::evaluate::Evaluated>),
    ("twin excite", of::<twin::excite::Excited>),
    ("twin identify", of::<twin::identify::Identified>),
];

/// The schemas of all commands, and of what every command prints when it fails.
pub fn schemas() -> anyhow::Result<Value> {
    let mut all: Value = serde_json::from_str(KEPT).context("data/json-output.json")?;
    let derived = json_schema::all(OUTPUTS.iter().copied());
    for (name, schema) in derived["commands"].as_object().into_iter().flatten() {
        all["commands"][name] = schema.clone();
    }
    all["error"] = derived["error"].clone();
    Ok(all)
}

/// Prints the schema of a command's output, or those of all commands.
pub fn run(terminal: &Terminal, command: &[String]) -> Outcome {
    let all = schemas()?;
    let found = if command.is_empty() { all } else { of_command(&all, &command.join(" "))? };
    terminal.print(&found, &(serde_json::to_string_pretty(&found)? + "\n"))?;
    Ok(None)
}

/// A schema on its own: what the command prints when it is done, or when it fails.
fn of_command(all: &Value, name: &str) -> anyhow::Result<Value> {
    let commands = all["commands"].as_object().context("data/json-output.json: commands")?;
    let Some(schema) = commands.get(name) else {
        let known: Vec<&str> = commands.keys().map(String::as_str).collect();
        bail!("COMMAND: found `{name}`, expected one of {}", known.join(", "));
    };
    Ok(json!({ "$schema": all["$schema"], "title": format!("ftac {name} --json"), "anyOf": [schema, all["error"]] }))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Command;

    use super::*;
    use crate::cli::described;

    /// Commands that print no result of their own.
    const WITHOUT: [&str; 5] = ["completions", "help", "man", "schema", "view"];

    fn leaves(command: &Command, path: &str, into: &mut BTreeSet<String>) {
        let own: Vec<&Command> = command.get_subcommands().filter(|own| own.get_name() != "help").collect();
        if own.is_empty() {
            into.insert(path.to_owned());
        }
        for child in own {
            let path = format!("{path} {}", child.get_name());
            leaves(child, path.trim(), into);
        }
    }

    #[test]
    fn every_command_has_a_schema() {
        let mut expected = BTreeSet::new();
        leaves(&described(), "", &mut expected);
        expected.retain(|name| !WITHOUT.contains(&name.as_str()));
        let all = schemas().expect("JSON");
        let found: BTreeSet<String> = all["commands"].as_object().expect("commands").keys().cloned().collect();
        assert_eq!(found, expected);
        assert!(of_command(&all, "dance").is_err_and(|error| error.to_string().contains("expected one of arm check")));
    }
}
