//! The plant's hidden parameters: deviations of the true robot, its covers and the objects from their models.
//!
//! [`arm`] and [`object`] describe one arm and one object, sampled for each trial. [`robot`] is one instance of the
//! nominal model, [`prior`] the prior of each of its parameters, and [`identified`] the file with the parameters
//! identified for one instance. [`gel`] describes the compliance of the covers, [`cameras`] the failures of cameras.
//! Only simulator, benchmark and identification use this crate: no controller does.

pub mod arm;
pub mod cameras;
pub mod draws;
pub mod gel;
pub mod identified;
pub mod object;
pub mod prior;
pub mod robot;

pub use arm::ArmDefects;
pub use cameras::CameraFailure;
pub use gel::GelViscoelasticity;
pub use object::ObjectInstance;
pub use robot::RobotInstance;
