//! Names that every recording carries: application, time lines, and the Rerun release for which it is written.

/// Rerun's application id; recordings of the same application share their layout in the viewer.
pub const APPLICATION: &str = "ftac";
/// The time line of simulation (or hardware) time, in seconds.
pub const SIM_TIME: &str = "sim_time";
/// The time line that counts control ticks.
pub const TICK: &str = "tick";
/// The time line of the wall clock, if there is one.
pub const WALL_TIME: &str = "wall_time";
/// Rerun release for which recordings are written.
pub const RERUN_VERSION: &str = "0.36.3";
