//! External policies: a condition of the benchmark with a decision maker outside this program.
//!
//! [`server`] is the interface to the process or object that answers for a policy, including the introduction of the
//! policy. [`message`] composes a question from information that a controller may have. [`process`] runs a policy in a
//! separate process (see [`python_process`]), and [`pool`] keeps such processes for a run. [`chooser`] is a policy that chooses grasps. The benchmark itself runs a policy that moves the robot.
//!
//! A policy receives the same information as the built-in ones: measurements, images, detections, and the estimates
//! from touch. It runs outside of this process, or behind the Python interface. It can influence this process only
//! through its answers to these questions.

pub mod chooser;
pub mod message;
pub mod pool;
pub mod process;
pub mod server;
pub mod source;

pub use pool::ExternalPolicy;
pub use process::PolicyInterrupted;
pub use server::{DecisionLevel, PolicyIntroduction, PolicyServer, PolicyServerError};
pub use source::{PolicySource, SimulatedTimePassage};
