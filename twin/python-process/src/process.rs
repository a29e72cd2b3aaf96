//! An object of a Python class in a separate process: `python3 -m MODULE FILE:CLASS ARGUMENTS`, with the arguments as a
//! JSON object.
//!
//! Questions go to its standard input, answers come from its standard output. Each is a line of JSON whose `shapes`, if
//! it has any, describe the arrays of bytes that follow; `{"error": ...}` means that the object failed. The first answer
//! comes unasked and introduces the object. The output that the object prints goes to standard error.

use std::io::{self, BufRead as _, BufReader, BufWriter, Read as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::class::PythonClass;
use crate::deadline::{Deadline, EndCause};
use crate::{Role, interpreter};

/// Time limit for a process to end by itself once it is no longer needed.
const EXIT_TIMEOUT: Duration = Duration::from_millis(500);
/// Time limit for the introduction of an object, which includes loading large libraries and weights.
const INTRODUCTION_TIMEOUT: Duration = Duration::from_secs(300);

/// Largest line of an answer, bytes.
const MAX_LINE_SIZE: u64 = 1 << 24;
/// Largest sum of the arrays of an answer, bytes.
const MAX_ARRAY_SIZE: usize = 1 << 26;

/// Failure to get an answer.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// The object has failed, in its own words: an exception with its traceback.
    #[error("it failed: {0}")]
    Failed(String),
    #[error("its process has ended ({0})")]
    Ended(String),
    #[error("its answer: {0}")]
    InvalidAnswer(String),
    /// It exceeded the time limit, and its process was ended.
    #[error("it has not answered within {} s", .0.as_secs_f64())]
    TimedOut(Duration),
    /// The operator requested a stop while the answer was awaited.
    #[error("interrupted while it computed")]
    Interrupted,
    #[error("its pipes: {0}")]
    Pipe(#[from] io::Error),
}

/// Failure to start a process.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    #[error("--{role}: cannot start `{program}`; {}: {source}", interpreter::INTERPRETER_REQUIREMENTS)]
    Interpreter { role: &'static str, program: String, source: io::Error },
    /// The class was refused or failed, in its own words.
    #[error("--{role} {asked}: {why}")]
    Refused { role: &'static str, asked: String, why: String },
    #[error("--{role} {asked}: found a class that was not constructed within {} s, expected one that is", limit.as_secs())]
    TimedOut { role: &'static str, asked: String, limit: Duration },
    /// The operator requested a stop meanwhile.
    #[error("--{role} {asked}: interrupted")]
    Interrupted { role: &'static str, asked: String },
    #[error(
        "--{role} {asked}: `{program} -m {module}` does not answer: {source}; {}",
        interpreter::INTERPRETER_REQUIREMENTS
    )]
    Silent { role: &'static str, asked: String, program: String, module: String, source: ProcessError },
}

/// Bytes that accompany a question, and their shape.
#[derive(Debug, Clone)]
pub struct QuestionArray<'a> {
    pub shape: Vec<usize>,
    pub bytes: &'a [u8],
}

/// Array that accompanies an answer: shape and bytes.
pub type AnswerArray = (Vec<usize>, Vec<u8>);

/// An answer, and the arrays that accompany it.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    pub value: Value,
    pub arrays: Vec<AnswerArray>,
}

/// The process of an object.
pub struct HostedProcess {
    pipes: Pipes,
    deadline: Deadline,
    /// Time limit of an answer.
    timeout: Duration,
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

impl HostedProcess {
    /// Starts the process of an object of `class` with this time limit of its answers, and waits for its introduction.
    pub fn start(role: Role, class: &PythonClass, timeout: Duration) -> Result<(Self, Value), StartError> {
        let mut command = interpreter::module_command(&role.module());
        // A map with text keys always has a JSON form.
        command.arg(class.name()).arg(serde_json::to_string(&class.arguments).unwrap_or_default());
        Self::start_command(command, role, &class.name(), timeout)
    }

    /// As [`HostedProcess::start`], with a command that hosts the object named `asked`.
    pub fn start_command(
        mut command: Command,
        role: Role,
        asked: &str,
        timeout: Duration,
    ) -> Result<(Self, Value), StartError> {
        let program = command.get_program().to_string_lossy().into_owned();
        let (role, module, asked) = (role.name(), role.module(), asked.to_owned());
        let unstarted = |source| StartError::Interpreter { role, program: program.clone(), source };
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is meant for this program, which finishes the trials in progress. A process group of its own can be
        // ended as a whole.
        let mut child = command.process_group(0).spawn().map_err(unstarted)?;
        let deadline = Deadline::supervise(child.id());
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            deadline.kill_group();
            return Err(unstarted(io::Error::other("it has no pipes")));
        };
        let pipes = Pipes { child, questions: Some(BufWriter::new(input)), answers: BufReader::new(output) };
        let mut process = Self { pipes, deadline, timeout, healthy: true, interrupted: false };
        match process.exchange_within(INTRODUCTION_TIMEOUT.max(timeout), Pipes::read_answer) {
            Ok(introduction) => Ok((process, introduction.value)),
            Err(ProcessError::Failed(why)) => Err(StartError::Refused { role, asked, why }),
            Err(ProcessError::TimedOut(limit)) => Err(StartError::TimedOut { role, asked, limit }),
            Err(ProcessError::Interrupted) => Err(StartError::Interrupted { role, asked }),
            Err(source) => Err(StartError::Silent { role, asked, program, module, source }),
        }
    }

    /// Asks a question, accompanied by `arrays`, and waits for the answer up to the time limit.
    pub fn ask(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<Answer, ProcessError> {
        self.ask_within(self.timeout, question, arrays)
    }

    /// As [`HostedProcess::ask`], with another time limit.
    pub fn ask_within(
        &mut self,
        limit: Duration,
        question: &Value,
        arrays: &[QuestionArray],
    ) -> Result<Answer, ProcessError> {
        self.exchange_within(limit, |pipes| pipes.write_question(question, arrays).and_then(|()| pipes.read_answer()))
    }

    /// Returns the time limit of the answers.
    pub fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Changes the time limit of the answers.
    pub fn set_timeout(&mut self, timeout: Duration) {
        self.timeout = timeout;
    }

    /// True if it can be asked again.
    pub fn is_healthy(&self) -> bool {
        self.healthy
    }

    /// True if the operator requested a stop while an answer was awaited.
    pub fn was_interrupted(&self) -> bool {
        self.interrupted
    }

    /// Runs `talk` with the process under the time limit `limit`.
    fn exchange_within(
        &mut self,
        limit: Duration,
        talk: impl FnOnce(&mut Pipes) -> Result<Answer, ProcessError>,
    ) -> Result<Answer, ProcessError> {
        let said = self.deadline.wait_for(limit, || talk(&mut self.pipes)).map_err(|error| match error {
            Ok(EndCause::Late(limit)) => ProcessError::TimedOut(limit),
            Ok(EndCause::Interrupted) => ProcessError::Interrupted,
            Err(error) => error,
        });
        self.healthy &= said.is_ok();
        self.interrupted |= matches!(said, Err(ProcessError::Interrupted));
        said
    }
}

impl Pipes {
    fn read_answer(&mut self) -> Result<Answer, ProcessError> {
        let mut line = String::new();
        if self.answers.by_ref().take(MAX_LINE_SIZE).read_line(&mut line)? == 0 {
            return Err(ProcessError::Ended(self.child.wait()?.to_string()));
        }
        let invalid =
            |error: serde_json::Error| ProcessError::InvalidAnswer(format!("found {:.80}: {error}", line.trim_end()));
        let mut value: Value = serde_json::from_str(&line).map_err(invalid)?;
        match value.get_mut("error").map(Value::take) {
            Some(Value::String(why)) => return Err(ProcessError::Failed(why)),
            Some(other) => return Err(ProcessError::Failed(other.to_string())),
            None => {}
        }
        let shapes = value.as_object_mut().and_then(|fields| fields.remove("shapes"));
        let shapes: Vec<Vec<usize>> =
            shapes.map(serde_json::from_value).transpose().map_err(invalid)?.unwrap_or_default();
        Ok(Answer { value, arrays: self.read_arrays(shapes)? })
    }

    fn read_arrays(&mut self, shapes: Vec<Vec<usize>>) -> Result<Vec<AnswerArray>, ProcessError> {
        let size = |shape: &[usize]| shape.iter().try_fold(1_usize, |size, side| size.checked_mul(*side));
        let total = shapes.iter().try_fold(0_usize, |total, shape| total.checked_add(size(shape)?));
        if total.is_none_or(|total| total > MAX_ARRAY_SIZE) {
            return Err(ProcessError::InvalidAnswer(format!(
                "found arrays of {shapes:?}, expected {MAX_ARRAY_SIZE} bytes together at most"
            )));
        }
        let read = |shape: Vec<usize>| {
            let mut bytes = vec![0; size(&shape).unwrap_or_default()];
            match self.answers.read_exact(&mut bytes) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                    Err(ProcessError::Ended(self.child.wait()?.to_string()))
                }
                other => Ok(other.map(|()| (shape, bytes))?),
            }
        };
        shapes.into_iter().map(read).collect()
    }

    fn write_question(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<(), ProcessError> {
        let mut question = question.clone();
        question["shapes"] = arrays.iter().map(|array| array.shape.clone()).collect::<Vec<_>>().into();
        let Some(to) = &mut self.questions else {
            return Err(ProcessError::Ended("stopped on request".to_owned()));
        };
        let mut put = || {
            writeln!(to, "{question}")?;
            arrays.iter().try_for_each(|array| to.write_all(array.bytes))?;
            to.flush()
        };
        match put() {
            // The pipe is closed: the exit status of the process is more informative.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                Err(ProcessError::Ended(self.child.wait()?.to_string()))
            }
            other => Ok(other?),
        }
    }
}

impl Drop for HostedProcess {
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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// A process that says `introduction` and answers with what `script` (sh) prints.
    fn start(introduction: &str, script: &str, timeout: Duration) -> Result<(HostedProcess, Value), StartError> {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("echo '{introduction}'; {script}")]);
        HostedProcess::start_command(command, Role::Robot, "mine.py:Mine", timeout)
    }

    const MINUTE: Duration = Duration::from_secs(60);

    #[test]
    fn arrays_follow_an_answer() {
        let script = r#"read line; echo '{"shapes": [[2, 3], [1]], "n": 7}'; printf abcdefg; cat >/dev/null"#;
        let (mut process, introduction) = start("{\"name\": \"Mine\"}", script, MINUTE).expect("started");
        assert_eq!(introduction, json!({ "name": "Mine" }));
        let answer = process.ask(&json!({ "ask": "observe" }), &[]).expect("an answer");
        assert_eq!(answer.value, json!({ "n": 7 }));
        assert_eq!(answer.arrays, [(vec![2, 3], b"abcdef".to_vec()), (vec![1], b"g".to_vec())]);
    }

    #[test]
    fn failures_are_told_apart() {
        let asked = |script: &str| {
            let (mut process, _) = start("{}", script, MINUTE).expect("started");
            let error = process.ask(&json!({}), &[]).expect_err("no answer");
            assert!(!process.is_healthy());
            error.to_string()
        };
        assert_eq!(asked("read line; exit 3"), "its process has ended (exit status: 3)");
        assert_eq!(asked("read line; echo '{\"error\": \"no servo\"}'; cat"), "it failed: no servo");
        assert!(asked("read line; echo NaN; cat").starts_with("its answer: found NaN: "));
        assert!(asked("read line; echo '{\"shapes\": [[99999, 99999]]}'; cat").contains("bytes together at most"));
        assert!(asked("read line; echo '{\"shapes\": [[9]]}'; printf abc").contains("its process has ended"));
    }

    #[test]
    fn a_process_that_hangs_is_ended_at_its_time_limit() {
        let (mut process, _) = start("{}", "read line; sleep 600", Duration::from_millis(200)).expect("started");
        let error = process.ask(&json!({}), &[]).expect_err("no answer");
        assert_eq!(error.to_string(), "it has not answered within 0.2 s");
        assert!(matches!(process.ask(&json!({}), &[]), Err(ProcessError::TimedOut(_) | ProcessError::Ended(_))));
    }

    #[test]
    fn a_refusal_names_the_class() {
        let error = start("{\"error\": \"--robot-arg: found no port\"}", "cat", MINUTE).err().expect("refused");
        assert_eq!(error.to_string(), "--robot mine.py:Mine: --robot-arg: found no port");
    }
}
