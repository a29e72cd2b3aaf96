//! Properties of a hand that is known only from its URDF and from the pulls file of its actuators.
//!
//! [`describe`] finds surface, contact candidates and palm frame. [`refusal`] rejects grasps that pass the checks but
//! are not possible with the hand as it is.

pub mod derived_surface;
pub mod describe;
pub(super) mod open_posture;
mod reach;
pub mod refusal;
mod solids;
mod true_surface;
