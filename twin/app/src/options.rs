//! Options shared by several commands: the robot, its backend and its driver, names of objects, numbers of
//! combinations, files of another hand, the scenario, the renderer of tactile images.

pub mod backend;
pub mod combination;
pub mod driver;
pub mod object_name;
pub mod output_file;
pub mod renamed_options;
pub mod robot;
pub mod ros2;
pub mod scenario;
pub mod tactile_backend;
