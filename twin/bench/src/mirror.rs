//! The mirror: a twin that runs beside the robot, fed with the same commands and corrected by its measurements.
//!
//! [`twin`] gives the residuals, tick by tick. It takes measurements and sent commands alone and cannot reach the robot's truth.

pub mod twin;
