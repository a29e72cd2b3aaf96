//! A policy in a process of its own: `python3 -m ftac.policy_host FILE:CLASS ARGUMENTS`, with the arguments as a JSON
//! object.
//!
//! Questions go to its standard input: a line of JSON, whose `shapes` describe the arrays of bytes that follow. Answers
//! come from its standard output, one line of JSON each; `{"error": ...}` means that the policy failed. Its first line
//! introduces the policy. The output that the policy prints goes to standard error.

use std::io::{BufRead as _, BufReader, BufWriter, Read as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

use super::deadline::{Deadline, Ended};
use super::host::{Array, Guest, Host, HostError};
use super::python;
use super::source::Source;

/// Time limit for a process to end by itself once it is no longer needed.
const PATIENCE: Duration = Duration::from_millis(500);
/// Time limit for the introduction of a policy, which includes loading large libraries and weights.
const START: Duration = Duration::from_secs(300);

/// Largest answer, bytes.
const LONGEST: u64 = 1 << 24;

/// The process of a policy.
pub struct Process {
    pipes: Pipes,
    deadline: Deadline,
    /// Time limit of an answer.
    limit: Duration,
    /// True if every question was answered.
    well: bool,
    interrupted: bool,
}

/// The child process and its pipes.
struct Pipes {
    child: Child,
    questions: Option<BufWriter<ChildStdin>>,
    answers: BufReader<ChildStdout>,
}

impl Process {
    /// Starts the process of a policy and waits for its introduction.
    pub fn start(source: &Source) -> Result<(Self, Guest)> {
        let asked = format!("{}:{}", source.file.display(), source.class);
        let mut command = python::module("ftac.policy_host");
        command.arg(&asked).arg(serde_json::to_string(&source.arguments)?);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is meant for this program, which finishes the trials in progress. A process group of its own can be
        // ended as a whole.
        let mut child = command.process_group(0).spawn().with_context(|| python::missing("--policy"))?;
        let deadline = Deadline::over(child.id());
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            deadline.end();
            bail!("--policy: `{}` has no pipes", python::name());
        };
        let pipes = Pipes { child, questions: Some(BufWriter::new(input)), answers: BufReader::new(output) };
        let limit = Duration::from_secs(source.timeout.into());
        let mut process = Self { pipes, deadline, limit, well: true, interrupted: false };
        match process.within(START.max(limit), Pipes::answer) {
            Ok(guest) => {
                let guest = serde_json::from_value(guest).context("--policy: its introduction")?;
                Ok((process, guest))
            }
            Err(HostError::Failed(why)) => bail!("--policy {asked}: {why}"),
            Err(HostError::Late(limit)) => {
                bail!(
                    "--policy {asked}: found a class that was not made within {} s, expected one that is",
                    limit.as_secs()
                )
            }
            Err(HostError::Interrupted) => bail!(Interrupted),
            Err(error) => bail!(
                "--policy {asked}: `{} -m ftac.policy_host` does not answer: {error}; {}",
                python::name(),
                python::EXPECTED
            ),
        }
    }

    /// True if it can be asked again.
    pub fn is_well(&self) -> bool {
        self.well
    }

    /// True if the operator requested a stop while the policy was thinking.
    pub fn was_interrupted(&self) -> bool {
        self.interrupted
    }

    /// Runs `talk` with the process under the time limit `limit`.
    fn within(
        &mut self,
        limit: Duration,
        talk: impl FnOnce(&mut Pipes) -> Result<Value, HostError>,
    ) -> Result<Value, HostError> {
        let said = self.deadline.within(limit, || talk(&mut self.pipes)).map_err(|error| match error {
            Ok(Ended::Late(limit)) => HostError::Late(limit),
            Ok(Ended::Interrupted) => HostError::Interrupted,
            Err(error) => error,
        });
        self.well &= said.is_ok();
        self.interrupted |= matches!(said, Err(HostError::Interrupted));
        said
    }
}

impl Pipes {
    fn answer(&mut self) -> Result<Value, HostError> {
        let mut line = String::new();
        if self.answers.by_ref().take(LONGEST).read_line(&mut line)? == 0 {
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
            // The reader is gone: the exit status of the process says more.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
                Err(HostError::Ended(self.child.wait()?.to_string()))
            }
            other => Ok(other?),
        }
    }
}

impl Host for Process {
    fn ask(&mut self, question: &Value, arrays: &[Array]) -> Result<Value, HostError> {
        self.within(self.limit, |pipes| pipes.put(question, arrays).and_then(|()| pipes.answer()))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The process ends at the end of its input.
        drop(self.pipes.questions.take());
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE && matches!(self.pipes.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Ends the process if it has not ended, and every process that it has started.
        self.deadline.end();
        let _ = self.pipes.child.wait();
    }
}

/// The operator requested a stop while a policy was thinking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted while the policy thought: this trial is left out, what is finished is kept")]
pub struct Interrupted;
