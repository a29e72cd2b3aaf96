//! The action in progress.

use super::path::{Haste, Path};
use crate::joints::JOINTS;
use crate::message::action::ActionHandle;

#[derive(Debug, Clone)]
pub(super) struct Playing {
    pub handle: ActionHandle,
    /// Target posture, rad.
    pub target: [f64; JOINTS],
    pub haste: Haste,
    /// Path of the joints; none while they brake, and while the action is paused.
    pub path: Option<Path>,
    pub paused: bool,
}
