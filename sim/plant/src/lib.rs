//! The plant's hidden parameters: deviations of the true robot, its covers and the objects from their models.
//!
//! [`arm`] and [`object`] describe one arm and one object, sampled for each trial. [`robot`] is one of the robots built
//! from the nominal model, with the spread of each of its parameters ([`spread`]), and [`identified`] is the file with
//! the parameters identified for one. [`gel`] describes the compliance of the covers, [`cameras`] the failures of
//! cameras. Only simulator, benchmark and identification use this crate: no controller does.

pub mod arm;
pub mod cameras;
pub mod draws;
pub mod gel;
pub mod identified;
pub mod object;
pub mod robot;
pub mod spread;

pub use arm::ArmDefects;
pub use cameras::Blindness;
pub use gel::Gel;
pub use object::Individual;
pub use robot::RobotIndividual;
