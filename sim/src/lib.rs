//! The simulated robot: a rapier scene with arm, hand and objects, servos that wind cables, and tactile images of what presses
//! into the pads.
//!
//! The story in order: [`engine`] holds the physics sets with the settings that make grasps hold; [`body`] puts arm and hand
//! into it as one reduced-coordinate multibody; [`servo`] models the XC330s that wind the cables, [`drive`] puts six of
//! them on the transmission; [`contacts`] reads who
//! touches whom and how hard; [`tactile`] turns that into images through the `optics` crate; [`robot`] ties them together
//! behind [`hand_model::robot::Robot`]. Ground truth leaves by [`robot::SimulatedRobot::truth`] alone, which is for the referee.
//!
//! [`stand`] is a test stand beside the story: the hand without the arm, its palm bolted down, things put into it by hand. [`mjcf`]
//! writes such a scene for a second engine.

pub mod body;
pub mod contacts;
pub mod convert;
pub mod drive;
pub mod engine;
pub mod mjcf;
pub mod robot;
pub mod servo;
pub mod stand;
pub mod tactile;

pub use robot::{ObjectPlacement, SceneSetup, SimulatedRobot};
