//! Python classes in processes of their own.
//!
//! [`class`] names a class by its file and the arguments of its constructor. [`process`] makes an object of it in a
//! process with the [`interpreter`] that is installed, and exchanges questions and answers with it under a time limit.
//! The package's modules `ftac.policy_host` and `ftac.robot_host` are the other side.

pub mod class;
mod deadline;
pub mod interpreter;
pub mod process;

pub use class::{ClassError, PythonClass};
pub use process::{Answer, HostedProcess, ProcessError, QuestionArray, StartError};

/// Role of an object in its process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A policy, of `--policy`.
    Policy,
    /// Driver of a robot, of `--robot`.
    Robot,
}

impl Role {
    /// Returns the role's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Policy => "policy",
            Self::Robot => "robot",
        }
    }

    /// Returns the module of the package that hosts such objects.
    pub fn module(self) -> String {
        format!("ftac.{}_host", self.name())
    }

    /// Returns an example of a class.
    fn example(self) -> &'static str {
        match self {
            Self::Policy => "my_policy.py:MyPolicy",
            Self::Robot => "my_robot.py:MyRobot",
        }
    }
}
