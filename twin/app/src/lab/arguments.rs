//! Arguments of the commands that `ftac-lab` runs. `ftac` also lists, completes and checks them.

pub mod arm;
pub mod grasps;
pub mod hand;
pub mod report;
pub mod study;
pub mod touch;
