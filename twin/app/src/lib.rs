//! `ftac`: the program people run. Commands, sessions, results, reports.
//!
//! It is a library so that the Python package brings the same program.
//!
//! Exit codes: 0 done and good, 1 ran but the result falls short (named on stderr), 2 bad usage or bad input, 130 interrupted with Ctrl-C:
//! what is finished is kept.

// What is printed may hold text of others: `eprintln!` of this crate and the macros below make it printable.
#[macro_use]
extern crate progress;

/// The standard library's `print` and `println` end the program with a panic where stdout is gone: these do not.
macro_rules! print {
    ($($text:tt)*) => { $crate::terminal::write_to_stdout(&progress::printable(&format!($($text)*))) };
}
macro_rules! println {
    () => { $crate::terminal::write_to_stdout("\n") };
    ($($text:tt)*) => { $crate::terminal::write_to_stdout(&progress::printable(&format!("{}\n", format_args!($($text)*)))) };
}

mod cli;
mod commands;
mod log_file;
mod options;
mod terminal;

use std::ffi::OsString;
use std::io::{IsTerminal as _, Write as _};

/// Runs the command line `arguments`, of which the first is the program's name, and returns the exit code.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let code = match cli::parse(&arguments) {
        Ok(cli) => obey(&cli),
        Err(error) => misunderstood(&error, cli::wants_json(&arguments)),
    };
    match terminal::stdout_fault() {
        None => code,
        Some(fault) => {
            eprintln!("ftac: stdout: {fault}");
            USAGE
        }
    }
}

/// Exit code of bad usage and bad input.
const USAGE: u8 = 2;

/// Prints what the command line's error, or its help, says.
fn misunderstood(error: &clap::Error, json: bool) -> u8 {
    // In colour where somebody looks.
    let text = |coloured: bool| {
        let text = error.render();
        if coloured { text.ansi().to_string() } else { text.to_string() }
    };
    if !error.use_stderr() {
        // The program's own words, and its colours.
        terminal::write_to_stdout(&text(std::io::stdout().is_terminal()));
        return 0;
    }
    if std::io::stderr().is_terminal() {
        let _ = writeln!(std::io::stderr(), "{}", text(true).trim_end());
    } else {
        eprintln!("{}", text(false).trim_end());
    }
    if json {
        println!("{}", serde_json::json!({ "error": cli::first_words(error), "code": USAGE }));
    }
    USAGE
}

fn obey(cli: &cli::Cli) -> u8 {
    let log = cli::moves_devices(cli).then(log_file::Entry::begin).flatten();
    let end = |code: u8, message: &str| log.map(|entry| entry.end(code, message));
    let (code, message) = match cli::run(cli) {
        Ok(shortfall) => {
            let unseen = || stream::viewer::lost().map(|why| format!("the viewer was lost: {why}"));
            let Some(shortfall) = shortfall.or_else(unseen) else {
                end(0, "");
                return 0;
            };
            // The result has been printed.
            eprintln!("ftac: falls short: {shortfall}");
            end(1, &shortfall);
            return 1;
        }
        // The robot stopped in mid-trial, or nothing of one's own can be played: it ran, and fell short.
        Err(error)
            if caused_by::<bench::body::Stopped>(&error) || caused_by::<proving::preparation::NotPlayable>(&error) =>
        {
            (1, format!("falls short: {}", words(&error)))
        }
        Err(error)
            if caused_by::<bench::run::Interrupted>(&error)
                || caused_by::<bench::own::Interrupted>(&error)
                || caused_by::<fault_injection::Interrupted>(&error)
                || caused_by::<sweep::work::Interrupted>(&error)
                || caused_by::<commands::twin::excite::Interrupted>(&error) =>
        {
            (130, words(&error))
        }
        Err(error) => (USAGE, words(&error)),
    };
    eprintln!("ftac: {message}");
    end(code, &message);
    if cli.terminal.json {
        println!("{}", serde_json::json!({ "error": message, "code": code }));
    }
    code
}

/// The error and its causes, each once: many errors have their cause in their own words.
fn words(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |said, cause| {
        let cause = cause.to_string();
        match (said.is_empty(), said.contains(&cause)) {
            (true, _) => cause,
            (false, true) => said,
            (false, false) => said + ": " + &cause,
        }
    })
}

fn caused_by<E: std::error::Error + Send + Sync + 'static>(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<E>())
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    #[test]
    fn causes_are_said_once() {
        let cause = std::io::Error::other("no such file");
        let error = anyhow::Error::from(cause).context("/dev/nope: no such file");
        assert_eq!(super::words(&error), "/dev/nope: no such file");
        let error = Err::<(), _>(std::io::Error::other("no such file")).context("--config").expect_err("an error");
        assert_eq!(super::words(&error), "--config: no such file");
    }
}
