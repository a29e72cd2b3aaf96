//! Terminal options common to all commands, their output, and their outcome.

use std::io::{self, Write as _};
use std::sync::Mutex;

use clap::Args;
use indicatif::ProgressBar;

/// Outcome of a command: none if it succeeded, or the respect in which its result falls short.
pub type Outcome = anyhow::Result<Option<String>>;

/// First error of a write to stdout.
static STDOUT_ERROR: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes to stdout. [`stdout_error`] returns an error; text after it is not written.
pub fn write_to_stdout(text: &str) {
    if let Ok(mut fault) = STDOUT_ERROR.lock()
        && fault.is_none()
    {
        *fault = io::stdout().write_all(text.as_bytes()).err();
    }
}

/// Writes text to stdout, made printable (no control characters).
pub fn write_printable(text: &str) {
    write_to_stdout(&progress::printable(text));
}

/// Flushes stdout and returns the first write error. A closed pipe is no error: `ftac schema | head -1`.
pub fn stdout_error() -> Option<io::Error> {
    let mut fault = STDOUT_ERROR.lock().ok()?;
    let fault = fault.take().or_else(|| io::stdout().flush().err());
    fault.filter(|fault| fault.kind() != io::ErrorKind::BrokenPipe)
}

/// A result as JSON and as text, and the respect in which it falls short.
#[derive(Debug)]
pub struct CommandOutput<T> {
    pub json: T,
    /// Text with its own line ends.
    pub text: String,
    pub shortfall: Option<String>,
}

/// Options common to all commands.
#[derive(Debug, Clone, Args)]
pub struct Terminal {
    /// Print one JSON object on stdout; everything else goes to stderr.
    #[arg(long, global = true)]
    pub json: bool,
    /// Seed of all random draws.
    #[arg(long, global = true, default_value_t = 1)]
    pub seed: u64,
    /// Print more.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Print only results; no progress bars.
    #[arg(short, long, global = true)]
    pub quiet: bool,
}

impl Terminal {
    /// Opens a progress bar of unknown length. In a log it prints lines; it is hidden with --quiet and --json.
    pub fn progress(&self) -> ProgressBar {
        progress::open_ended_bar(self.quiet || self.json)
    }

    /// Prints the result and returns its shortfall.
    pub fn print_result(&self, made: CommandOutput<impl serde::Serialize>) -> Outcome {
        self.print(&made.json, &made.text)?;
        Ok(made.shortfall)
    }

    /// Prints a result: `json` with `--json`, otherwise `text`, which has its own line ends.
    pub fn print(&self, json: &impl serde::Serialize, text: &str) -> anyhow::Result<()> {
        if self.json {
            println!("{}", serde_json::to_string(json)?);
        } else {
            print!("{text}");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    /// JSON output parses to the original value, and holds no escape sequence for a terminal.
    #[test]
    fn json_with_escape_sequences_stays_json() {
        let value = serde_json::json!({ "reason": "\u{1b}[2J\u{9b}1m\u{7f}\u{202e}\r\"\\" });
        let text = value.to_string();
        let shown = progress::printable(&text);
        assert!(shown.is_ascii() && !shown.contains(|letter: char| letter.is_control()), "{shown:?}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).expect("JSON"), value);
    }
}
