//! Cameras that the computer sees as UVC devices (webcams), instead of the camera board.
//!
//! A device may be one pad's camera or show several at once, side by side: `bridge.toml` says for each camera of the hand on which device and at which
//! pixel its 240 x 240 square begins ([`crate::config::UvcConfig`]). [`picture`] turns what such a device sends into squares. `device`, which talks to the
//! kernel, comes with the feature `uvc` only, because few hands have such cameras; without it a configuration that names some is refused.
//!
//! The kernel's interface is used by the crate `linuxvideo`, which needs no C library and no header (the crate `v4l` generates its bindings by libclang).
//! Nothing here has met a real camera.

#[cfg(feature = "uvc")]
pub mod device;
pub mod picture;

#[cfg(feature = "uvc")]
pub use device::UvcCameras;
