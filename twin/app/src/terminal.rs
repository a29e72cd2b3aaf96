//! What every command is told about its terminal, and what it comes to.

use std::io::{self, Write as _};
use std::sync::Mutex;

use clap::Args;
use indicatif::ProgressBar;

/// What a command came to: nothing to say, or in which respect its result falls short.
pub type Outcome = anyhow::Result<Option<String>>;

/// Why stdout could not be written to first.
static STDOUT_FAULT: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes to stdout; [`stdout_fault`] tells what went wrong. What comes after that is not written.
pub fn write_to_stdout(text: &str) {
    if let Ok(mut fault) = STDOUT_FAULT.lock()
        && fault.is_none()
    {
        *fault = io::stdout().write_all(text.as_bytes()).err();
    }
}

/// Writes text to stdout, made printable.
pub fn write_printable(text: &str) {
    write_to_stdout(&progress::printable(text));
}

/// Why stdout was not written to its end, with what is left of it written now. That nobody reads it any more is no fault: `ftac schema | head -1`.
pub fn stdout_fault() -> Option<io::Error> {
    let mut fault = STDOUT_FAULT.lock().ok()?;
    let fault = fault.take().or_else(|| io::stdout().flush().err());
    fault.filter(|fault| fault.kind() != io::ErrorKind::BrokenPipe)
}

/// A result as `--json` prints it and as people read it, and in which respect it falls short.
#[derive(Debug)]
pub struct Made<T> {
    pub json: T,
    /// Ends its own lines.
    pub text: String,
    pub shortfall: Option<String>,
}

/// Options that every command takes.
#[derive(Debug, Clone, Args)]
pub struct Terminal {
    /// Print one JSON object on stdout; everything else goes to stderr.
    #[arg(long, global = true)]
    pub json: bool,
    /// Seed of everything random.
    #[arg(long, global = true, default_value_t = 1)]
    pub seed: u64,
    /// Say more.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Say nothing but results; no progress bars.
    #[arg(short, long, global = true)]
    pub quiet: bool,
}

impl Terminal {
    /// A progress bar, whose length is not known yet; lines in a log, hidden where nothing but results is wanted.
    pub fn progress(&self) -> ProgressBar {
        progress::open(self.quiet || self.json)
    }

    /// Prints what was made.
    pub fn finish(&self, made: Made<impl serde::Serialize>) -> Outcome {
        self.print(&made.json, &made.text)?;
        Ok(made.shortfall)
    }

    /// Prints a result: `json` with `--json`, otherwise `text`, which ends its own lines.
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
    /// What `--json` prints is read as what it was, and holds no order to a terminal.
    #[test]
    fn json_with_escape_sequences_stays_json() {
        let value = serde_json::json!({ "reason": "\u{1b}[2J\u{9b}1m\u{7f}\u{202e}\r\"\\" });
        let text = value.to_string();
        let shown = progress::printable(&text);
        assert!(shown.is_ascii() && !shown.contains(|letter: char| letter.is_control()), "{shown:?}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).expect("JSON"), value);
    }
}
