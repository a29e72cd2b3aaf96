//! Front end of both programs: from the command line to the exit code.
//!
//! Exit codes: 0 success, 1 the command ran but its result falls short (reason on stderr), 2 bad usage or bad input,
//! 130 interrupted with Ctrl-C (finished work is kept).

use std::ffi::OsString;
use std::io::{IsTerminal as _, Write as _};

use clap::FromArgMatches;
use clap::error::ErrorKind;

use crate::json_schema::FailureOutput;
use crate::terminal::{Outcome, Terminal};
use crate::{former_names, log_file, terminal};

/// Command line of a program.
pub trait CommandLine: FromArgMatches {
    /// Returns the program's commands and options.
    fn definition() -> clap::Command;
    /// Returns the options common to all commands.
    fn terminal(&self) -> &Terminal;
    /// True for commands that use real or emulated devices: these are logged.
    fn moves_devices(&self) -> bool;
    /// Runs the command; `arguments` are those of the process, its name first.
    fn execute(&self, arguments: &[OsString]) -> Outcome;
}

/// Runs the command line `arguments`, the first of which is the program's name, and returns the exit code.
pub fn run<C: CommandLine>(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let (arguments, notices) = former_names::with_current_names(arguments.into_iter().collect());
    let parsed = C::definition().try_get_matches_from(&arguments).and_then(|matches| C::from_arg_matches(&matches));
    let code = match parsed {
        Ok(command_line) => {
            notices.iter().filter(|_| !command_line.terminal().quiet).for_each(|notice| eprintln!("ftac: {notice}"));
            run_and_log(&command_line, &arguments)
        }
        Err(error) => report_usage_error(&error, wants_json(&arguments)),
    };
    match terminal::stdout_error() {
        None => code,
        Some(fault) => {
            eprintln!("ftac: stdout: {fault}");
            USAGE_EXIT_CODE
        }
    }
}

/// Exit code for bad usage and bad input.
const USAGE_EXIT_CODE: u8 = 2;

/// Prints the command line's error, or its help.
fn report_usage_error(error: &clap::Error, json: bool) -> u8 {
    // In colour on a terminal.
    let text = |coloured: bool| {
        let text = error.render();
        if coloured { text.ansi().to_string() } else { text.to_string() }
    };
    if !error.use_stderr() {
        // This is the program's own text, with its colours.
        terminal::write_to_stdout(&text(std::io::stdout().is_terminal()));
        return 0;
    }
    if std::io::stderr().is_terminal() {
        let _ = writeln!(std::io::stderr(), "{}", text(true).trim_end());
    } else {
        eprintln!("{}", text(false).trim_end());
    }
    if json {
        print_failure(usage_error_summary(error), USAGE_EXIT_CODE);
    }
    USAGE_EXIT_CODE
}

fn print_failure(error: String, code: u8) {
    let failure = FailureOutput { error, code };
    println!("{}", serde_json::json!(failure));
}

/// True if `arguments` that cannot be understood ask for JSON.
fn wants_json(arguments: &[OsString]) -> bool {
    arguments.iter().take_while(|argument| *argument != "--").any(|argument| argument == "--json")
}

/// Returns the error message without the usage text.
fn usage_error_summary(error: &clap::Error) -> String {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "found no command, expected one; see --help".to_owned();
    }
    let text = error.render().to_string();
    let lines = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let words: Vec<&str> = lines.map(str::trim).filter(|line| !line.is_empty()).collect();
    words.join("; ").replace(":; ", ": ").trim_start_matches("error: ").to_owned()
}

fn run_and_log(command_line: &impl CommandLine, arguments: &[OsString]) -> u8 {
    let log = command_line.moves_devices().then(log_file::LogEntry::begin).flatten();
    let end = |code: u8, message: &str| log.map(|entry| entry.end(code, message));
    let (code, message) = match command_line.execute(arguments) {
        Ok(shortfall) => {
            let unseen = || telemetry::viewer::loss_reason().map(|why| format!("the viewer was lost: {why}"));
            let Some(shortfall) = shortfall.or_else(unseen) else {
                end(0, "");
                return 0;
            };
            // The result has been printed.
            eprintln!("ftac: falls short: {shortfall}");
            end(1, &shortfall);
            return 1;
        }
        // The robot stopped in mid-trial, or none of the user's objects can be grasped: the command ran, and falls
        // short.
        Err(error)
            if caused_by::<robot_backends::TrialStopped>(&error)
                || caused_by::<grasp_verification::preparation::NotPlayable>(&error) =>
        {
            (1, format!("falls short: {}", error_text(&error)))
        }
        Err(error)
            if caused_by::<progress::interrupt::Interrupted>(&error)
                || caused_by::<external_policy::PolicyInterrupted>(&error) =>
        {
            (130, error_text(&error))
        }
        Err(error) => (USAGE_EXIT_CODE, error_text(&error)),
    };
    eprintln!("ftac: {message}");
    end(code, &message);
    if command_line.terminal().json {
        print_failure(message, code);
    }
    code
}

/// Formats the error and its causes, each once: many errors already include their cause.
pub fn error_text(error: &anyhow::Error) -> String {
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
        assert_eq!(super::error_text(&error), "/dev/nope: no such file");
        let error = Err::<(), _>(std::io::Error::other("no such file")).context("--config").expect_err("an error");
        assert_eq!(super::error_text(&error), "--config: no such file");
    }
}
