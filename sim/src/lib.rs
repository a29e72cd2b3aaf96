//! The simulated robot: a rapier scene with arm, hand and objects, servos that wind cables, and tactile images of what presses
//! into the pads.
//!
//! The story in order: [`engine`] holds the physics sets with the settings that make grasps hold; [`body`] puts arm and hand
//! into it as one reduced-coordinate multibody; [`scene`] says where arm and objects start; [`hull`] makes objects stand firmly; [`servo`] models the XC330s that wind the
//! cables, [`play`] their gears' play, [`drive`] puts six of them on the transmission; [`gel`] lets the covers give way, and what they hold sticks to them; [`contacts`] reads who touches whom and how hard; [`tactile`] turns
//! that into images through the `optics` crate; [`robot`] ties them together behind [`hand_model::robot::RobotBackend`]. Ground
//! [`truth`] leaves by [`robot::SimulatedRobot::truth`] alone, which is for the referee.
//!
//! Two scenes beside the story have no arm. [`stand`] is a test stand: the same hand with its servos, palm bolted down, things put
//! into it by hand; [`mjcf`] writes such a scene for a second engine. [`hand_scene`] is made for proving thousands of grasps:
//! a hand pulled by given tensions, with its [`collision_model`], and floating objects.

pub mod body;
pub mod collision_model;
mod collision_shape;
pub mod contacts;
pub mod convert;
pub mod drive;
pub mod engine;
pub mod gel;
pub mod hand_scene;
pub mod hull;
mod loaded_contacts;
pub mod mjcf;
pub mod play;
mod press_curve;
pub mod robot;
pub mod scene;
pub mod servo;
pub mod stand;
mod stick;
pub mod tactile;
pub mod truth;

pub use robot::SimulatedRobot;
pub use scene::{ObjectPlacement, SceneSetup};
pub use truth::Truth;
