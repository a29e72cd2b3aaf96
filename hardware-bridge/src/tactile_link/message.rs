//! Messages between host and camera board.
//!
//! The host asks and the board answers; the board never speaks first. `Hello` opens a session and is answered with
//! `Welcome`. `WhatTime` is answered at once with `Time`. `Capture` is answered with one `Image` of every camera, in
//! camera order, each as soon as it has been read out, or with `CameraFault` instead.
//!
//! postcard writes an enum as its variant's number (in the order below) followed by the fields, integers above 8 bits
//! as varints (7 bits per byte, low first), and byte strings as their length followed by their bytes.

use serde::{Deserialize, Serialize};

/// Version of this protocol; a board with another is refused.
pub const VERSION: u16 = 1;

/// Encoding of an image's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PixelEncoding {
    /// A baseline JPEG, from SOI to EOI.
    Jpeg,
    /// Two bytes per pixel, high byte first: RRRRRGGG GGGBBBBB.
    Rgb565,
}

/// One image as it was taken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkImage {
    /// Index of the camera, 0 to 17, in the hand model's order.
    pub camera: u8,
    /// Sequence number of this camera's image; it increases with each image taken, sent or not.
    pub sequence: u32,
    /// Middle of the exposure, us, by the board's clock.
    pub captured_us: u64,
    /// Pixels in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Encoding of `data`.
    pub encoding: PixelEncoding,
    /// Encoded pixels.
    pub data: Vec<u8>,
}

/// Reason why a camera gave no image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum CameraFault {
    /// The camera does not answer on its control bus.
    Silent,
    /// Its frame did not fit the board's buffer.
    Overrun,
    /// No frame came in time.
    Timeout,
}

/// One message. The numbers of the variants are part of the protocol.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum LinkMessage {
    /// 0, host: opens a session.
    Hello,
    /// 1, board: protocol version, serial number, number of cameras.
    Welcome {
        /// [`VERSION`].
        version: u16,
        /// Serial number of the board.
        serial: u32,
        /// Cameras that answer.
        cameras: u8,
    },
    /// 2, host: asks for the board's time.
    WhatTime {
        /// Host clock when this was sent, us.
        host_us: u64,
    },
    /// 3, board: its time, sent at once.
    Time {
        /// Copied from the question.
        host_us: u64,
        /// Board clock, us.
        board_us: u64,
    },
    /// 4, host: asks for one image of every camera.
    Capture,
    /// 5, board: an image.
    Image(LinkImage),
    /// 6, board: no image of this camera.
    CameraFault {
        /// Index of the camera.
        camera: u8,
        fault: CameraFault,
    },
}
