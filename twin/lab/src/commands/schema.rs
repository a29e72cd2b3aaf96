//! `ftac schema` of the commands that this program runs, and of all commands of both programs; `ftac reference`.

use std::path::Path;

use ftac::json_schema::{Output, of};
use ftac::terminal::{Outcome, Terminal};
use ftac::{reference, schema};
use lab::closing;
use lab::touch::evaluation;
use proving::synthesis::hands::Comparison;
use study::explanation::Explanation;
use study::{grasp_map, landscape, summary};

use super::rows::Checked;
use super::study::{annotate::Annotation, pick_ups::PickUpTypes, report::Study};
use super::touch::train_network::Trained;
use super::{hand, lab_book};

/// Outputs of the commands of this program.
const OUTPUTS: &[Output] = &[
    ("arm check", of::<Checked>),
    ("grasps annotate", of::<Annotation>),
    ("grasps classify", of::<summary::Figures>),
    ("grasps classify", of::<Explanation>),
    ("grasps classify", of::<PickUpTypes>),
    ("grasps hands", of::<Comparison>),
    ("grasps landscape", of::<landscape::basins::Figures>),
    ("grasps map", of::<grasp_map::Figures>),
    ("hand check", of::<Checked>),
    ("hand check", of::<hand::Engine>),
    ("hand check", of::<hand::GraspTypes>),
    ("hand check", of::<hand::inspect::Inspected>),
    ("hand check", of::<hand::inspect::Tree>),
    ("hand close", of::<closing::Figures>),
    ("hand export", of::<hand::Exported>),
    ("report", of::<Study>),
    ("report", of::<lab_book::LabBook>),
    ("study", of::<Study>),
    ("touch eval", of::<evaluation::figures::Figures>),
    ("touch train-network", of::<Trained>),
];

/// Prints the schema of a command's output, or those of all commands of both programs.
pub fn run(terminal: &Terminal, command: &[String]) -> Outcome {
    schema::print(terminal, command, &[schema::OUTPUTS, OUTPUTS])
}

/// Writes the reference pages of both programs' commands into `folder`.
pub fn reference(folder: &Path) -> Outcome {
    reference::write(folder, ftac::cli::described(), &[schema::OUTPUTS, OUTPUTS].concat())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_command_has_a_schema() {
        let found: BTreeSet<&str> = schema::OUTPUTS.iter().chain(OUTPUTS).map(|(command, _)| *command).collect();
        let expected = schema::commands(&ftac::cli::described());
        assert_eq!(found, expected.iter().map(String::as_str).collect());
    }
}
