//! A policy in a separate process: `python3 -m ftac.policy_host FILE:CLASS ARGUMENTS`, with the arguments as a JSON
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

use super::deadline::{Deadline, EndCause};
use super::python;
use super::server::{PolicyIntroduction, PolicyServer, PolicyServerError, QuestionArray};
use super::source::PolicySource;

/// Time limit for a process to end by itself once it is no longer needed.
const EXIT_TIMEOUT: Duration = Duration::from_millis(500);
/// Time limit for the introduction of a policy, which includes loading large libraries and weights.
const INTRODUCTION_TIMEOUT: Duration = Duration::from_secs(300);

/// Largest answer, bytes.
const MAX_ANSWER_SIZE: u64 = 1 << 24;

/// The process of a policy.
pub struct PolicyProcess {
    pipes: Pipes,
    deadline: Deadline,
    /// Time limit of an answer.
    answer_timeout: Duration,
    /// True if every question was answered.
    healthy: bool,
    interrupted: bool,
}

/// The child process and its pipes.
struct Pipes {
    child: Child,
    questions: Option<BufWriter<ChildStdin>>,
    answers: BufReader<ChildStdout>,
}

impl PolicyProcess {
    /// Starts the process of a policy and waits for its introduction.
    pub fn start(source: &PolicySource) -> Result<(Self, PolicyIntroduction)> {
        let asked = format!("{}:{}", source.file.display(), source.class);
        let mut command = python::module_command("ftac.policy_host");
        command.arg(&asked).arg(serde_json::to_string(&source.arguments)?);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is meant for this program, which finishes the trials in progress. A process group of its own can be
        // ended as a whole.
        let mut child = command.process_group(0).spawn().with_context(|| python::missing_interpreter("--policy"))?;
        let deadline = Deadline::supervise(child.id());
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            deadline.kill_group();
            bail!("--policy: `{}` has no pipes", python::interpreter_name());
        };
        let pipes = Pipes { child, questions: Some(BufWriter::new(input)), answers: BufReader::new(output) };
        let limit = Duration::from_secs(source.timeout.into());
        let mut process = Self { pipes, deadline, answer_timeout: limit, healthy: true, interrupted: false };
        match process.exchange_within(INTRODUCTION_TIMEOUT.max(limit), Pipes::read_answer) {
            Ok(introduction) => {
                let introduction = serde_json::from_value(introduction).context("--policy: its introduction")?;
                Ok((process, introduction))
            }
            Err(PolicyServerError::Failed(why)) => bail!("--policy {asked}: {why}"),
            Err(PolicyServerError::TimedOut(limit)) => {
                bail!(
                    "--policy {asked}: found a class that was not constructed within {} s, expected one that is",
                    limit.as_secs()
                )
            }
            Err(PolicyServerError::Interrupted) => bail!(PolicyInterrupted),
            Err(error) => bail!(
                "--policy {asked}: `{} -m ftac.policy_host` does not answer: {error}; {}",
                python::interpreter_name(),
                python::INTERPRETER_REQUIREMENTS
            ),
        }
    }

    /// True if it can be asked again.
    pub fn is_healthy(&self) -> bool {
        self.healthy
    }

    /// True if the operator requested a stop while the policy was computing.
    pub fn was_interrupted(&self) -> bool {
        self.interrupted
    }

    /// Runs `talk` with the process under the time limit `limit`.
    fn exchange_within(
        &mut self,
        limit: Duration,
        talk: impl FnOnce(&mut Pipes) -> Result<Value, PolicyServerError>,
    ) -> Result<Value, PolicyServerError> {
        let said = self.deadline.wait_for(limit, || talk(&mut self.pipes)).map_err(|error| match error {
            Ok(EndCause::Late(limit)) => PolicyServerError::TimedOut(limit),
            Ok(EndCause::Interrupted) => PolicyServerError::Interrupted,
            Err(error) => error,
        });
        self.healthy &= said.is_ok();
        self.interrupted |= matches!(said, Err(PolicyServerError::Interrupted));
        said
    }
}

impl Pipes {
    fn read_answer(&mut self) -> Result<Value, PolicyServerError> {
        let mut line = String::new();
        if self.answers.by_ref().take(MAX_ANSWER_SIZE).read_line(&mut line)? == 0 {
            return Err(PolicyServerError::ProcessEnded(self.child.wait()?.to_string()));
        }
        match serde_json::from_str::<Value>(&line) {
            Ok(mut answer) => match answer.get_mut("error").map(Value::take) {
                Some(Value::String(why)) => Err(PolicyServerError::Failed(why)),
                Some(other) => Err(PolicyServerError::Failed(other.to_string())),
                None => Ok(answer),
            },
            Err(error) => Err(PolicyServerError::InvalidAnswer(format!("found {:.80}: {error}", line.trim_end()))),
        }
    }

    fn write_question(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<(), PolicyServerError> {
        let mut question = question.clone();
        question["shapes"] = arrays.iter().map(|array| array.shape.clone()).collect::<Vec<_>>().into();
        let Some(to) = &mut self.questions else {
            return Err(PolicyServerError::ProcessEnded("stopped on request".to_owned()));
        };
        let mut put = || {
            writeln!(to, "{question}")?;
            arrays.iter().try_for_each(|array| to.write_all(array.bytes))?;
            to.flush()
        };
        match put() {
            // The pipe is closed: the exit status of the process is more informative.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
                Err(PolicyServerError::ProcessEnded(self.child.wait()?.to_string()))
            }
            other => Ok(other?),
        }
    }
}

impl PolicyServer for PolicyProcess {
    fn ask(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<Value, PolicyServerError> {
        self.exchange_within(self.answer_timeout, |pipes| {
            pipes.write_question(question, arrays).and_then(|()| pipes.read_answer())
        })
    }
}

impl Drop for PolicyProcess {
    fn drop(&mut self) {
        // The process ends at the end of its input.
        drop(self.pipes.questions.take());
        let begun = Instant::now();
        while begun.elapsed() < EXIT_TIMEOUT && matches!(self.pipes.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Ends the process if it has not ended, and every process that it has started.
        self.deadline.kill_group();
        let _ = self.pipes.child.wait();
    }
}

/// The operator requested a stop while a policy was computing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted while the policy thought: this trial is left out, what is finished is kept")]
pub struct PolicyInterrupted;
