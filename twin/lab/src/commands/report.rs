//! `ftac report --study` and `--lab-book`: the page of the grasp study, and the lab book.

use anyhow::bail;
use ftac::cli::parse_arguments;
use ftac::lab::arguments::report::ReportArgs;
use ftac::terminal::{Outcome, Terminal};

use super::{lab_book, study};

/// Makes the page.
pub fn run(terminal: &Terminal, args: &ReportArgs) -> Outcome {
    match &args.lab_book {
        Some(figures) => lab_book::run(terminal, figures, args.out.as_deref(), &parse_arguments),
        None if args.study => study::report::report_folders(terminal, &args.folders),
        None => {
            bail!("found neither --study nor --lab-book, expected one of them: `ftac report` makes all other pages")
        }
    }
}
