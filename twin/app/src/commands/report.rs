//! `ftac report`: tables, figures and pages of finished runs, made again.

use std::ffi::OsString;

use crate::commands::{bench, sweep};
use crate::lab::arguments::report::ReportArgs;
use crate::lab::hand_over::hand_over;
use crate::terminal::{Outcome, Terminal};

/// Makes a report, one of `ftac-lab` with the process's `arguments`.
pub fn run(terminal: &Terminal, args: &ReportArgs, arguments: &[OsString]) -> Outcome {
    if args.study || args.lab_book.is_some() {
        return Err(hand_over(arguments));
    }
    let out = args.out.as_deref();
    match &args.folders[..] {
        [folder] if ::sweep::folder::Folder::is_at(folder) => sweep::report(terminal, folder, out),
        folders => bench::report(terminal, folders, out),
    }
}
