//! `ftac report`: rebuilds tables, figures and pages of finished runs.

use crate::commands::{bench, sweep};
use crate::lab::arguments::report::ReportArgs;
use crate::lab::hand_over::LabProgram;
use crate::terminal::{Outcome, Terminal};

/// Runs `ftac report`; the grasp study and the lab book are handed over to the `lab`.
pub fn run(terminal: &Terminal, args: &ReportArgs, lab: &LabProgram<'_>) -> Outcome {
    if args.study || args.lab_book.is_some() {
        return Err(lab.exec_lab());
    }
    let out = args.out.as_deref();
    match &args.folders[..] {
        [folder] if ::sweep::folder::SweepFolder::is_at(folder) => sweep::report(terminal, folder, out),
        folders => bench::report(terminal, folders, out),
    }
}
