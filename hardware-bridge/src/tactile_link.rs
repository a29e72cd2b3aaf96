//! Link to the board of the tactile cameras: messages in frames over a serial port.
//!
//! # On the wire
//! A frame is `COBS(body | crc) 00`: `body` is one [`LinkMessage`] in postcard's encoding, `crc` its CRC-32C, four bytes
//! little-endian. COBS leaves no zero inside, so that a reader can resynchronise at the next zero. [`frame`] has the
//! test vectors for the firmware; [`message`] describes the dialogue.
//!
//! # On the host
//! [`deframer`] finds frames, [`clock`] relates the board's clock to the host's, [`image_data`] decodes images, and
//! [`counters`] counts received, lost, stale and frozen images per camera. [`link::TactileLink`] runs all of it on two
//! threads and delivers finished images.

pub mod clock;
pub mod counters;
pub mod deframer;
pub mod frame;
pub mod image_data;
pub mod link;
pub mod message;

pub use link::TactileLink;
pub use message::LinkMessage;
