//! The action that is carried out.

use super::path::{Haste, Path};
use crate::joints::JOINTS;
use crate::message::action::ActionHandle;

#[derive(Debug, Clone)]
pub(super) struct Playing {
    pub handle: ActionHandle,
    /// rad.
    pub target: [f64; JOINTS],
    pub haste: Haste,
    /// None while the joints brake, and while it is paused.
    pub path: Option<Path>,
    pub paused: bool,
}
