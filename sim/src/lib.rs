//! The simulated robot: a rapier scene with arm, hand and objects, servos that wind cables, and tactile images of what
//! presses into the pads.
//!
//! The modules in reading order: [`engine`] holds the physics sets with the settings under which grasps hold.
//! [`body`] inserts arm and hand as one reduced-coordinate multibody, and [`scene`] defines the initial state of arm
//! and objects. [`servo`] models the XC330s that wind the cables, [`backlash`] the backlash of their gears, and
//! [`drive`] connects six of them to the transmission. [`gel`] makes the covers compliant, and `friction_anchor`
//! gives them static friction. [`contacts`] reads contact pairs and forces, and [`tactile`] renders them as images
//! through the `tactile_optics` crate. [`robot`] ties everything together behind [`hand_model::robot::RobotBackend`].
//! Ground [`truth`] is available only through [`robot::SimulatedRobot::truth`], which is for the referee.
//!
//! Two further scenes have no arm. [`test_stand`] is the same hand with its servos, its palm bolted down, and props put
//! into it by hand; [`mjcf`] exports such a scene to a second engine. [`hand_scene`] is made for testing thousands of
//! grasps: a hand pulled by given tensions, with its [`collision_model`], and floating objects.

pub mod backlash;
pub mod body;
pub mod collision_model;
mod collision_shape;
pub mod contacts;
pub mod convert;
pub mod drive;
pub mod engine;
mod friction_anchor;
pub mod gel;
pub mod hand_scene;
mod loaded_contacts;
pub mod mjcf;
mod press_curve;
pub mod robot;
pub mod scene;
pub mod servo;
pub mod tactile;
pub mod test_stand;
pub mod truth;

pub use robot::SimulatedRobot;
pub use scene::{ObjectPlacement, SceneSetup};
pub use truth::GroundTruth;
