//! Touch on known presses and grasps: what it is trained on, and how accurate normals and in-hand poses are.
//!
//! [`balls`] presses a ball all over simulated pads. [`training`] collects [`samples`] from which [`network_training`] fits the network;
//! [`normals`] measures it and the photometric model, [`own_pads`] calibrations of a hand's own pads from presses on a ball. [`grasps`] plays
//! first grasps, [`images`] shows them under changed optics, [`poses`] compares the felt pose with the true one, and [`pictures`] draws it.
//! [`evaluation`] brings all of it together.

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
