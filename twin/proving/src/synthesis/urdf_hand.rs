//! Properties found of a hand that is known from its URDF and what pulls on its joints.
//!
//! [`describe`] finds surface, contact candidates and palm frame, and [`refusal`] says which of the grasps that pass the checks are
//! none of the hand as it is.

pub mod describe;
pub mod found_surface;
pub(super) mod open_posture;
mod reach;
pub mod refusal;
mod solids;
mod true_surface;
