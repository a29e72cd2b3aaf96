//! The link to the tactile cameras' board: messages in frames over a serial port.
//!
//! # On the wire
//! A frame is `COBS(body | crc) 00`: `body` is one [`Message`] in postcard's encoding, `crc` its CRC-32C, four bytes little-endian. COBS
//! leaves no zero inside, so a reader that lost its place goes on after the next zero. [`frame`] has the test vectors for the firmware,
//! [`message`] says who sends what when.
//!
//! # On the host
//! [`deframer`] finds frames, [`clock`] relates the board's clock to ours, [`image_data`] turns an image's bytes into pixels, [`counters`]
//! keeps the books of every camera: what came, what is missing, what is stale or frozen. [`link::TactileLink`] does all that on two threads of its own
//! and hands over finished images.

pub mod clock;
pub mod counters;
pub mod deframer;
pub mod frame;
pub mod image_data;
pub mod link;
pub mod message;

pub use link::TactileLink;
pub use message::Message;
