//! `ftac schema`: JSON Schema of the `--json` output.

use std::collections::BTreeSet;

use ::sweep::page::Results;
use anyhow::{Context as _, bail};
use clap::Command;

use fault_injection::table::FaultTable;
use grasp_verification::synthesis::evaluation::Evaluation;
use grasp_verification::synthesis::report::SynthesisReport;
use scenarios::summary::Summary;
use sensor_calibration::reconstruction::output::ImageFigures;
use sensor_calibration::render::real_sensor::SensorRender;
use serde_json::json;

use super::{board, bridge};
use super::{
    combos, demo, demonstrations, export, grasps, hand, optics, replay, ros2, sweep, sysid, touch, transport, trial,
};
use crate::json_schema::{self, OutputSchema, schema_of};
use crate::lab::hand_over::LabProgram;
use crate::terminal::{Outcome, Terminal};

/// Outputs of the commands of this program, except those of `ftac-lab`.
pub const OUTPUTS: &[OutputSchema] = &[
    ("bench", schema_of::<Summary>),
    ("board add", schema_of::<board::BoardAddOutput>),
    ("board check", schema_of::<board::BoardCheckOutput>),
    ("board list", schema_of::<board::BoardListOutput>),
    ("board page", schema_of::<board::BoardPageOutput>),
    ("bridge calibrate", schema_of::<bridge::calibrate::CalibrateOutput>),
    ("bridge clear-faults", schema_of::<bridge::clear_faults::ClearFaultsOutput>),
    ("bridge doctor", schema_of::<bridge::shared::FindingsOutput>),
    ("bridge emulate", schema_of::<bridge::emulate::RequestOutput>),
    ("bridge emulate", schema_of::<bridge::emulate::EmulatorStartOutput>),
    ("bridge emulate", schema_of::<bridge::emulate::EmulatorEndOutput>),
    ("bridge exercise", schema_of::<bridge::exercise::ExerciseOutput>),
    ("bridge faults", schema_of::<FaultTable>),
    ("bridge install", schema_of::<bridge::install::InstallOutput>),
    ("bridge provision", schema_of::<bridge::provision::ProvisionOutput>),
    ("bridge reboot", schema_of::<bridge::reboot::RebootOutput>),
    ("bridge register", schema_of::<bridge::register::RegisterOutput>),
    ("bridge register", schema_of::<bridge::register::RegisterPlanOutput>),
    ("bridge scan", schema_of::<bridge::scan::ScanOutput>),
    ("bridge sheet", schema_of::<bridge::sheet::SheetOutput>),
    ("bridge stop", schema_of::<bridge::stop::StopReport>),
    ("combos", schema_of::<combos::CombosOutput>),
    ("demo", schema_of::<demo::DemoOutput>),
    ("export lerobot", schema_of::<export::LerobotOutput>),
    ("demonstrations", schema_of::<demonstrations::DemonstrationsOutput>),
    ("export mcap", schema_of::<export::BagsOutput>),
    ("export ros2", schema_of::<export::BagOutput>),
    ("export rrd", schema_of::<export::RrdOutput>),
    ("grasps collection", schema_of::<grasps::collection::CollectionOutput>),
    ("grasps eval", schema_of::<Evaluation>),
    ("grasps export", schema_of::<grasps::export::GraspExportOutput>),
    ("grasps generate", schema_of::<SynthesisReport>),
    ("grasps repertoire", schema_of::<grasps::repertoire::RepertoireOutput>),
    ("grasps pairs", schema_of::<grasps::repertoire::PairsOutput>),
    ("grasps show", schema_of::<grasps::show::ShowOutput>),
    ("hand picture", schema_of::<hand::picture::PictureOutput>),
    ("optics calibrate", schema_of::<optics::calibrate::CalibrateOutput>),
    ("optics eval", schema_of::<optics::eval::OpticsEvalOutput>),
    ("optics pads", schema_of::<optics::pads::PadsOutput>),
    ("optics reconstruct", schema_of::<optics::reconstruct::ReconstructOutput>),
    ("optics reconstruct", schema_of::<ImageFigures>),
    ("optics render", schema_of::<optics::render::PadRenderOutput>),
    ("optics render", schema_of::<SensorRender>),
    ("optics shapes", schema_of::<optics::render::ShapesOutput>),
    ("replay", schema_of::<replay::ReplayOutput>),
    ("replay", schema_of::<replay::FolderReplayOutput>),
    ("replay", schema_of::<replay::ComparisonOutput>),
    ("ros2 publish", schema_of::<ros2::PublishOutput>),
    (SHARED_COMMAND, schema_of::<Summary>),
    (SHARED_COMMAND, schema_of::<Results>),
    ("sweep makespan", schema_of::<sweep::output::MakespanOutput>),
    ("sweep merge", schema_of::<sweep::output::MergeOutput>),
    ("sweep plan", schema_of::<sweep::output::SweepPlanOutput>),
    ("sweep run", schema_of::<sweep::output::SweepRunOutput>),
    ("sweep status", schema_of::<sweep::output::StatusOutput>),
    ("sweep submit", schema_of::<sweep::output::SubmitOutput>),
    ("touch train", schema_of::<touch::TrainOutput>),
    ("transport", schema_of::<transport::TransportOutput>),
    ("transport", schema_of::<transport::SkillSearchOutput>),
    ("trial", schema_of::<trial::TrialOutput>),
    ("sysid evaluate", schema_of::<sysid::evaluate::EvaluateOutput>),
    ("sysid excite", schema_of::<sysid::excite::ExciteOutput>),
    ("sysid identify", schema_of::<sysid::identify::IdentifyOutput>),
];

/// Commands without a JSON result.
const COMMANDS_WITHOUT_OUTPUT: [&str; 5] = ["completions", "man", "reference", "schema", "view"];
/// Command with outputs of both programs.
const SHARED_COMMAND: &str = "report";

/// Returns the commands of `program` that print a result.
pub fn commands_with_output(program: &Command) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    add_leaves(program, "", &mut all);
    all.retain(|name| !COMMANDS_WITHOUT_OUTPUT.contains(&name.as_str()));
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
pub fn run(terminal: &Terminal, command: &[String], program: &Command, lab: &LabProgram<'_>) -> Outcome {
    let name = command.join(" ");
    if name != SHARED_COMMAND && OUTPUTS.iter().any(|(command, _)| *command == name) {
        return print_schemas(terminal, command, &[OUTPUTS]);
    }
    let known = commands_with_output(program);
    if !name.is_empty() && !known.contains(&name) {
        let known: Vec<String> = known.into_iter().collect();
        bail!("COMMAND: found `{name}`, expected one of {}", known.join(", "));
    }
    Err(lab.exec_lab())
}

/// Prints the schema of one command, or of all in `outputs`.
pub fn print_schemas(terminal: &Terminal, command: &[String], outputs: &[&[OutputSchema]]) -> Outcome {
    let all = json_schema::all_schemas(outputs.concat());
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
