//! The real robot's side of the [`hand_model::robot::Robot`] interface. `README.md` takes a person from a box of parts to the first motion.
//!
//! # From the wire to the robot
//! - [`protocol2`]: the wire format of the servo bus (Dynamixel Protocol 2.0); [`xc330`]: the servo's control table as data; [`servo_bus`]: requests and
//!   answers with deadlines; [`hand_bus`]: six servos as one hand.
//! - [`tactile_link`]: the camera board's protocol, and its images on threads of their own; [`uvc`]: webcams in its place; [`cameras`]: either.
//! - [`arm_link`]: what the bridge needs of an arm; [`kortex_link`]: a Gen3 behind it, through the crate [`kortex`].
//! - [`safety`]: what stands between a controller and the motors.
//! - [`servo_cycle`]: the thread in which all of these meet, 200 times a second; [`hardware_robot`]: what a controller holds of it; [`remote`]: what
//!   another terminal holds of it.
//!
//! # Bring-up
//! [`config`] is `bridge.toml`, [`setup`] how a servo must be set up, [`homing`] finds its open mark, [`calibration`] remembers it.
//!
//! # Without the hardware
//! [`emulator`]: the devices on pseudo-terminals, for any host and any plant; [`emulator::lockstep`]: a robot of such devices and the whole bridge, on one [`clock`]. Nothing in this crate has been run against a real servo or camera board; other
//! people's hosts (dynamixel-sdk, dynamixel2, rustypot) drive the emulated servos in `other-hosts/`, a workspace of its own.

pub mod arm_link;
pub mod calibration;
pub mod cameras;
pub mod clock;
pub mod config;
pub mod emulator;
pub mod hand_bus;
pub mod hardware_robot;
pub mod homing;
pub mod kortex_link;
mod lock;
pub mod protocol2;
pub mod remote;
pub mod safety;
pub mod servo_bus;
pub mod servo_cycle;
pub mod setup;
pub mod tactile_link;
pub mod uvc;
pub mod xc330;
