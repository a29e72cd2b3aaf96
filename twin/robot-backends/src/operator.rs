//! Questions to the operator at the terminal.

use std::fs::File;
use std::io::{self, IsTerminal as _, Read as _, Write as _};
use std::os::fd::AsFd as _;

use anyhow::{Result, bail};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Interval between checks for an interrupt while an answer is awaited.
const POLL_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// Operator who answers questions, one line each.
pub struct Operator {
    input: File,
}

impl Operator {
    /// Takes the answers from this program's own input, typed or piped in.
    pub fn from_stdin() -> io::Result<Self> {
        // Unbuffered: later readers of the input must find what is left.
        Ok(Self::from_file(File::from(io::stdin().as_fd().try_clone_to_owned()?)))
    }

    /// Takes the answers from this file.
    pub fn from_file(input: File) -> Self {
        Self { input }
    }

    /// Returns the operator's answer without surrounding spaces, or none if `over` returned true first. `over` is
    /// called several times a second.
    pub fn ask_until(&self, question: &str, mut over: impl FnMut() -> Result<bool>) -> Result<Option<String>> {
        eprint!("{question} ");
        io::stderr().flush()?;
        let mut line = Vec::new();
        loop {
            if over()? {
                eprintln!();
                return Ok(None);
            }
            let ready = poll(&mut [PollFd::new(&self.input, PollFlags::IN)], Some(&POLL_INTERVAL));
            match ready {
                Ok(0) | Err(rustix::io::Errno::INTR) => continue,
                Ok(_) => {}
                Err(error) => return Err(io::Error::from(error).into()),
            }
            let mut byte = [0];
            match (&self.input).read(&mut byte)? {
                0 if line.is_empty() => bail!("the operator is gone: found the end of the input, expected an answer"),
                0 => break,
                _ if byte == *b"\n" => break,
                _ => line.extend(byte),
            }
        }
        let answer = String::from_utf8_lossy(&line).trim().to_owned();
        // A terminal has shown the answer already. With it, a log of answers from a script reads the same.
        if !self.input.is_terminal() {
            eprintln!("{answer}");
        }
        Ok(Some(answer))
    }
}

/// Calls [`Operator::ask_until`] at the terminal.
pub fn ask_until(question: &str, over: impl FnMut() -> Result<bool>) -> Result<Option<String>> {
    Operator::from_stdin()?.ask_until(question, over)
}

/// Returns the operator's answer. Ctrl-C ends the program unless it is caught elsewhere.
pub fn ask(question: &str) -> Result<String> {
    Ok(ask_until(question, || Ok(false))?.unwrap_or_default())
}

/// True only if the operator answers yes.
pub fn operator_agrees(question: &str) -> Result<bool> {
    operator_agrees_while(question, || Ok(()))
}

/// As [`operator_agrees`], and calls `attend` several times a second so that devices are attended during the question.
/// Its error ends the question.
pub fn operator_agrees_while(question: &str, mut attend: impl FnMut() -> Result<()>) -> Result<bool> {
    let answer = ask_until(&format!("{question} [yes/no]"), || attend().map(|()| false))?;
    Ok(answer.is_some_and(|answer| answer == "yes"))
}
