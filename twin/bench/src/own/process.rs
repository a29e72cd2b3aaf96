//! A policy in a process of its own: `python3 -m ftac.policy_host FILE:CLASS`.
//!
//! Questions go to its standard input: a line of JSON, whose `shapes` say which arrays of bytes follow. Answers come from its standard output, a
//! line of JSON each: `{"error": ...}` is a policy that failed. Its first line introduces it. What the policy prints goes to standard error.

use std::io::{BufRead as _, BufReader, BufWriter, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

use super::host::{Array, Guest, Host, HostError};
use super::pool::Source;
use super::python;

/// How long a process may take to end once nobody asks it any more.
const PATIENCE: Duration = Duration::from_millis(500);

/// A policy's process.
pub struct Process {
    child: Child,
    questions: Option<BufWriter<ChildStdin>>,
    answers: BufReader<ChildStdout>,
    /// Whether every question was answered.
    well: bool,
}

impl Process {
    /// Starts the process of a policy, and waits until it introduces itself.
    pub fn start(source: &Source) -> Result<(Self, Guest)> {
        let asked = format!("{}:{}", source.file.display(), source.class);
        let mut command = python::module("ftac.policy_host");
        command.arg(&asked).stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is for this program, which finishes the trials in progress.
        let mut child = command.process_group(0).spawn().with_context(|| python::missing("--policy"))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            bail!("--policy: `{}` has no pipes", python::name());
        };
        let questions = Some(BufWriter::new(input));
        let mut process = Self { child, questions, answers: BufReader::new(output), well: true };
        match process.answer() {
            Ok(guest) => {
                let guest = serde_json::from_value(guest).context("--policy: its introduction")?;
                Ok((process, guest))
            }
            Err(HostError::Failed(why)) => bail!("--policy {asked}: {why}"),
            Err(error) => bail!(
                "--policy {asked}: `{} -m ftac.policy_host` does not answer: {error}; {}",
                python::name(),
                python::EXPECTED
            ),
        }
    }

    /// Whether it can be asked more.
    pub fn is_well(&self) -> bool {
        self.well
    }

    fn answer(&mut self) -> Result<Value, HostError> {
        let mut line = String::new();
        if self.answers.read_line(&mut line)? == 0 {
            return Err(HostError::Ended(self.child.wait()?.to_string()));
        }
        match serde_json::from_str::<Value>(&line) {
            Ok(mut answer) => match answer.get_mut("error").map(Value::take) {
                Some(Value::String(why)) => Err(HostError::Failed(why)),
                Some(other) => Err(HostError::Failed(other.to_string())),
                None => Ok(answer),
            },
            Err(error) => Err(HostError::Answer(format!("found {:.80}: {error}", line.trim_end()))),
        }
    }

    fn put(&mut self, question: &Value, arrays: &[Array]) -> Result<(), HostError> {
        let mut question = question.clone();
        question["shapes"] = arrays.iter().map(|array| array.shape.clone()).collect::<Vec<_>>().into();
        let Some(to) = &mut self.questions else { return Err(HostError::Ended("it was told to".to_owned())) };
        let mut put = || {
            writeln!(to, "{question}")?;
            arrays.iter().try_for_each(|array| to.write_all(array.bytes))?;
            to.flush()
        };
        match put() {
            // Nobody reads any more: how it ended says more.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
                Err(HostError::Ended(self.child.wait()?.to_string()))
            }
            other => Ok(other?),
        }
    }
}

impl Host for Process {
    fn ask(&mut self, question: &Value, arrays: &[Array]) -> Result<Value, HostError> {
        let answer = self.put(question, arrays).and_then(|()| self.answer());
        self.well &= answer.is_ok();
        answer
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The end of its input is its end.
        drop(self.questions.take());
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        // It is our own child, and was not waited for: it ends now.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
