//! Recordings and live views in Rerun. The only crate that knows `rerun`.
//!
//! A [`Recorder`] writes one trial: to a file, to a live viewer, or both ([`Target`]). Its layout ([`blueprint`]) travels with
//! the data. What is logged is thinned to the rates in [`Settings`] and not repeated while it does not change, so that a
//! control loop may hand over everything at every tick and the recording of a 25 s trial takes about 2 MB.
//!
//! [`entities`] names every path; [`mesh`], [`hand_mesh`] and [`scene`] make the robot visible, [`belief`] what it believes; [`tactile`]
//! packs images, [`signals`] numbers, [`phase`] and [`now`] words; [`recorder`] offers them as one object; [`viewer`] opens what was recorded, and `live` streams to it. [`gallery`] is another kind of
//! recording, grasps side by side; [`felt`] is one held object as touch sees it. [`release`] names application, time lines and
//! the Rerun release.
//!
//! Time lines: `sim_time` (s) and `tick` (control ticks); for bodies that live in real time also `wall_time`.

pub mod belief;
pub mod blueprint;
mod change;
pub mod entities;
pub mod error;
pub mod felt;
pub mod gallery;
pub mod hand_mesh;
mod live;
pub mod mesh;
pub mod now;
pub mod phase;
pub mod recorder;
mod recording_file;
pub mod release;
pub mod scene;
pub mod signals;
pub mod sink;
pub mod tactile;
mod thin;
pub mod viewer;

pub use error::StreamError;
pub use mesh::DrawnObject;
pub use phase::{Level, TrialProperties};
pub use recorder::{Recorder, Settings, Target};
pub use release::{APPLICATION, RERUN_VERSION, SIM_TIME, TICK, WALL_TIME};
pub use signals::{PoseError, SignalFrame};
