//! Evaluation of touch on known presses and grasps: training, and accuracy of normals and in-hand poses.
//!
//! [`balls`] presses a ball all over simulated pads. [`training`] collects [`samples`] to which [`network_training`]
//! fits the network. [`normals`] measures it and the photometric model, and [`own_pads`] calibrations of a hand's own
//! pads from presses on a ball. [`grasps`] simulates first grasps, [`images`] renders them under changed optics,
//! [`poses`] compares the estimated pose with the true one, and [`pictures`] draws it. [`evaluation`] combines all of
//! it.

pub mod balls;
pub mod evaluation;
pub mod grasps;
pub mod images;
pub mod network_training;
pub mod networks;
pub mod normals;
pub mod own_pads;
pub mod pictures;
pub mod poses;
pub mod samples;
pub mod training;
