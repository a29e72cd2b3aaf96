//! Cameras that the computer sees as UVC devices (webcams), instead of the camera board.
//!
//! A device may show one pad's camera, or several side by side. For each camera of the hand, `bridge.toml` names the
//! device and the pixel at which its 240 x 240 square begins ([`crate::config::UvcConfig`]). [`picture`] cuts a
//! device's pictures into squares. `device`, which talks to the kernel, is compiled only with the feature `uvc`,
//! because few hands have such cameras; without it, a configuration that names some is refused.
//!
//! The crate `linuxvideo` uses the kernel's interface directly. It needs no C library and no header (the crate `v4l`
//! generates its bindings by libclang). Nothing here has been run on a real camera.

#[cfg(feature = "uvc")]
pub mod device;
pub mod picture;

#[cfg(feature = "uvc")]
pub use device::UvcCameras;
