//! Everything to Rerun. The only crate that knows `rerun`.
//!
//! A [`Recorder`] writes one trial: to a file, to a live viewer, or both ([`Target`]). Its layout ([`blueprint`]) travels with
//! the data. Whatever is logged is thinned to the rates in [`Settings`] and not repeated while it does not change, so that a
//! control loop may hand over everything at every tick and a trial of 25 s stays a recording of about 2 MB.
//!
//! The story in order: [`entities`] names every path; [`mesh`] and [`scene`] make the robot visible; [`tactile`] packs images,
//! [`signals`] numbers, [`phase`] words; [`recorder`] offers them as one object; [`viewer`] opens what was recorded.
//! [`gallery`] is another kind of recording: grasps side by side; [`felt`] is one held object as touch sees it.
//!
//! Time lines: `sim_time` (s) and `tick` (control ticks). Wall time is not recorded.

pub mod blueprint;
pub mod entities;
pub mod error;
pub mod felt;
pub mod gallery;
pub mod mesh;
pub mod phase;
pub mod recorder;
pub mod scene;
pub mod signals;
pub mod tactile;
mod thin;
pub mod viewer;

pub use error::StreamError;
pub use mesh::DrawnObject;
pub use phase::{Level, TrialProperties};
pub use recorder::{Recorder, Settings, Target};
pub use signals::{PoseError, SignalFrame};

/// Rerun's application id; recordings of the same application share their layout in the viewer.
pub const APPLICATION: &str = "ftac";
/// The time line of simulation (or hardware) time, in seconds.
pub const SIM_TIME: &str = "sim_time";
/// The time line that counts control ticks.
pub const TICK: &str = "tick";
/// The Rerun release that this program writes for.
pub const RERUN_VERSION: &str = "0.36.3";
