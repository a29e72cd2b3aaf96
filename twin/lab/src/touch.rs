//! Touch on known presses and grasps: calibration, normals, in-hand poses.

pub mod calibration;
pub mod grasps;
pub mod images;
pub mod normals;
pub mod pictures;
pub mod poses;
pub mod real;
pub mod shapes;
