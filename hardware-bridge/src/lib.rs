//! The real robot behind the [`hand_model::robot::RobotBackend`] interface. `README.md` is the overview;
//! `docs/bring-up.md` leads to the first motion.
//!
//! # From the wire to the robot
//! - [`dynamixel_bus`]: the bus of the servos. [`hand_bus`]: six servos as one hand.
//! - [`tactile_link`]: the camera board's protocol, with its own threads for images. [`uvc`]: webcams instead.
//!   [`cameras`]: either of the two.
//! - [`arm_link`]: the interface to an arm. [`kortex_link`]: a Gen3 behind it, through the crate [`kinova_kortex`].
//! - [`robot_link`]: the interface to all devices of a robot. `bus_link`: those above behind it. A robot of another kind
//!   implements it; [`delivered_images`] takes its images.
//! - [`safety`]: the supervisor between controller and motors.
//! - [`servo_cycle`]: the 200 Hz thread that joins all of these. [`hardware_robot`]: the controller's handle on it.
//!   [`remote`]: the handle of another terminal; `requests` carries out its requests.
//!
//! # Bring-up
//! [`config`] reads `bridge.toml`, [`setup`] checks and provisions servos, [`homing`] finds the open mark, and
//! [`calibration`] stores it. [`reboot`] recovers a servo that has shut down. [`reference_pictures`] identifies cameras by
//! the appearance of their pads. [`install`] sets up the computer.
//!
//! # Without hardware
//! [`emulator`] provides the devices on pseudo-terminals, for any host and any plant; [`emulator::lockstep`] runs the
//! whole bridge on such devices, with one emulated [`clock`]. Nothing here has been run on a real servo or camera
//! board. In `other-hosts/`, a workspace of its own, other projects' clients (dynamixel-sdk, dynamixel2, rustypot)
//! drive the emulated servos.

pub mod arm_link;
mod bus_link;
pub mod calibration;
pub mod cameras;
pub mod clock;
pub mod config;
pub mod delivered_images;
#[cfg(feature = "emulator")]
pub mod emulator;
pub mod hand_bus;
pub mod hardware_robot;
pub mod homing;
pub mod install;
pub mod kortex_link;
mod lock;
pub mod real_time;
pub mod reboot;
pub mod reference_pictures;
pub mod remote;
mod requests;
pub mod robot_link;
pub mod safety;
pub mod servo_cycle;
pub mod setup;
mod stop_sockets;
pub mod supported_robot;
pub mod tactile_link;
pub mod uvc;
