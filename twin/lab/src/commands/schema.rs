//! `ftac schema` of the commands that this program runs, and of all commands of both programs; `ftac reference`.

use std::path::Path;

use ftac::json_schema::{OutputSchema, schema_of};
use ftac::terminal::{Outcome, Terminal};
use ftac::{reference, schema};
use grasp_analysis::explanation::Explanation;
use grasp_analysis::{grasp_map, landscape, summary};
use grasp_verification::synthesis::hands::HandComparison;
use lab::closing;
use lab::touch::evaluation;

use super::rows::CheckOutput;
use super::study::{annotate::Annotation, pick_ups::RepertoireTypes, report::StudyOutput};
use super::touch::train_network::TrainingOutput;
use super::{hand, lab_book};

/// Outputs of the commands of this program.
const OUTPUTS: &[OutputSchema] = &[
    ("arm check", schema_of::<CheckOutput>),
    ("grasps annotate", schema_of::<Annotation>),
    ("grasps classify", schema_of::<summary::ClassificationFigures>),
    ("grasps classify", schema_of::<Explanation>),
    ("grasps classify", schema_of::<RepertoireTypes>),
    ("grasps hands", schema_of::<HandComparison>),
    ("grasps landscape", schema_of::<landscape::basins::LandscapeFigures>),
    ("grasps map", schema_of::<grasp_map::MapFigures>),
    ("hand check", schema_of::<CheckOutput>),
    ("hand check", schema_of::<hand::EngineSweepOutput>),
    ("hand check", schema_of::<hand::GraspTypesOutput>),
    ("hand check", schema_of::<hand::inspect::InspectionOutput>),
    ("hand check", schema_of::<hand::inspect::TreeOutput>),
    ("hand close", schema_of::<closing::BallGripFigures>),
    ("hand export", schema_of::<hand::ExportOutput>),
    ("report", schema_of::<StudyOutput>),
    ("report", schema_of::<lab_book::LabBook>),
    ("study", schema_of::<StudyOutput>),
    ("touch eval", schema_of::<evaluation::figures::TouchEvaluationFigures>),
    ("touch train-network", schema_of::<TrainingOutput>),
];

/// Prints the schema of a command's output, or those of all commands of both programs.
pub fn run(terminal: &Terminal, command: &[String]) -> Outcome {
    schema::print_schemas(terminal, command, &[schema::OUTPUTS, OUTPUTS])
}

/// Writes the reference pages of both programs' commands into `folder`.
pub fn reference(folder: &Path) -> Outcome {
    reference::write(folder, ftac::cli::command_definition(), &[schema::OUTPUTS, OUTPUTS].concat())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_command_has_a_schema() {
        let found: BTreeSet<&str> = schema::OUTPUTS.iter().chain(OUTPUTS).map(|(command, _)| *command).collect();
        let expected = schema::commands_with_output(&ftac::cli::command_definition());
        assert_eq!(found, expected.iter().map(String::as_str).collect());
    }
}
