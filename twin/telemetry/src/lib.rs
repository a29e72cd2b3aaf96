//! Recordings and live views in Rerun. This is the only crate that depends on `rerun`.
//!
//! A [`Recorder`] writes one trial to a file, to a live viewer, or to both ([`RecordingTarget`]). The viewer's layout
//! ([`blueprint`]) is stored with the data. Data are thinned to the rates in [`RecorderSettings`] and are not repeated
//! while they do not change. A control loop may therefore hand over everything at every tick, and the recording of a 25
//! s trial takes about 2 MB.
//!
//! [`entities`] names every path. [`mesh`], [`hand_mesh`] and [`scene`] draw the robot, [`pose_estimate`] draws its pose
//! estimates; [`tactile`] encodes images, [`signals`] numbers, [`phase`] and [`state_page`] text. [`recorder`] offers
//! all of these as one object. [`viewer`] opens recordings, and `live` streams to a viewer. Two other kinds of
//! recording are [`gallery`], grasps side by side, and [`estimated_scene`], one held object as perceived by touch.
//! [`release`] names the application, the time lines and the Rerun release.
//!
//! Time lines: `sim_time` (s) and `tick` (control ticks); for backends in real time also `wall_time`.

pub mod blueprint;
pub mod entities;
pub mod error;
pub mod estimated_scene;
pub mod gallery;
pub mod hand_mesh;
mod live;
pub mod mesh;
pub mod phase;
pub mod pose_estimate;
mod rate_limit;
pub mod recorder;
mod recording_file;
pub mod release;
pub mod scene;
pub mod signals;
pub mod sink;
pub mod state_page;
pub mod tactile;
pub mod tactile_changes;
pub mod viewer;

pub use error::TelemetryError;
pub use mesh::DrawnObject;
pub use phase::{LogLevel, TrialProperties};
pub use recorder::{Recorder, RecorderSettings, RecordingTarget};
pub use release::{APPLICATION, RERUN_VERSION, SIM_TIME, TICK, WALL_TIME};
pub use signals::{PoseError, SignalFrame};
