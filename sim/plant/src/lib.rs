//! The plant's hidden parameters: how the true robot, its covers and the objects differ from their models.
//!
//! [`arm`] and [`object`] are one arm and one object, drawn for each trial; [`robot`] is one robot of those built from the nominal model, with
//! the spread of each of its parameters ([`spread`]), and [`identified`] the file that keeps what was identified of one. [`gel`] is how
//! covers give way, [`cameras`] how cameras fail. Only simulator, benchmark and identification know this crate: no controller does.

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
