//! Options that several commands take: the robot and its backend, names of objects, another hand's files, the scenario, where images are rendered.

pub mod body;
pub mod object_name;
pub mod own_hand;
pub mod robot;
pub mod scenario;
pub mod tactile_backend;
