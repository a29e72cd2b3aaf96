//! The simulated robot: a rapier scene with arm, hand and objects, servos that wind cables, and tactile images of what presses
//! into the pads.
//!
//! The story in order: [`engine`] holds the physics sets with the settings that make grasps hold; [`body`] puts arm and hand
//! into it as one reduced-coordinate multibody; [`hull`] makes objects stand firmly; [`servo`] models the XC330s that wind the cables; [`contacts`] reads who
//! touches whom and how hard; [`tactile`] turns that into images through the `optics` crate; [`robot`] ties them together
//! behind [`hand_model::robot::Robot`]. Ground truth leaves by [`robot::SimulatedRobot::truth`] alone, which is for the referee.
//! [`hand_scene`] is the hand alone with a floating object, for testing grasps.

pub mod body;
pub mod contacts;
pub mod convert;
pub mod engine;
pub mod hand_scene;
pub mod hull;
pub mod robot;
pub mod servo;
pub mod tactile;

pub use robot::{ObjectPlacement, SceneSetup, SimulatedRobot};
