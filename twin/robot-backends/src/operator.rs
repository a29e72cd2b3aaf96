//! The operator at the terminal answers questions.

use std::fs::File;
use std::io::{self, IsTerminal as _, Read as _, Write as _};
use std::os::fd::AsFd as _;

use anyhow::{Result, bail};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Between two looks at whether Ctrl-C was pressed while an answer is awaited.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// Who answers questions, a line each.
pub struct Operator {
    input: File,
}

impl Operator {
    /// Whoever types, or is piped in, at this program's own input.
    pub fn at_the_terminal() -> io::Result<Self> {
        // Unbuffered: whoever asks next, and whoever waits for input, must find what is left.
        Ok(Self::at(File::from(io::stdin().as_fd().try_clone_to_owned()?)))
    }

    /// Whoever writes into this.
    pub fn at(input: File) -> Self {
        Self { input }
    }

    /// What the operator answers, without the spaces around it; none where `over` said so first, which is asked several times a second.
    pub fn ask_until(&self, question: &str, mut over: impl FnMut() -> Result<bool>) -> Result<Option<String>> {
        eprint!("{question} ");
        io::stderr().flush()?;
        let mut line = Vec::new();
        loop {
            if over()? {
                eprintln!();
                return Ok(None);
            }
            let ready = poll(&mut [PollFd::new(&self.input, PollFlags::IN)], Some(&LOOK));
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
        // A terminal has shown it; a log of answers from a script reads the same.
        if !self.input.is_terminal() {
            eprintln!("{answer}");
        }
        Ok(Some(answer))
    }
}

/// [`Operator::ask_until`] at the terminal.
pub fn ask_until(question: &str, over: impl FnMut() -> Result<bool>) -> Result<Option<String>> {
    Operator::at_the_terminal()?.ask_until(question, over)
}

/// What the operator answers; Ctrl-C ends the program unless somebody else catches it.
pub fn ask(question: &str) -> Result<String> {
    Ok(ask_until(question, || Ok(false))?.unwrap_or_default())
}

/// Whether the operator says yes, and nothing else.
pub fn agreed(question: &str) -> Result<bool> {
    agreed_while(question, || Ok(()))
}

/// The same, while `attend` is called several times a second: devices are not left alone with a question. Its error ends
/// the question.
pub fn agreed_while(question: &str, mut attend: impl FnMut() -> Result<()>) -> Result<bool> {
    let answer = ask_until(&format!("{question} [yes/no]"), || attend().map(|()| false))?;
    Ok(answer.is_some_and(|answer| answer == "yes"))
}
