//! Encoding of one message as a frame: the bytes between two zeros.

use crc::{CRC_32_ISCSI, Crc};

use super::message::LinkMessage;

/// CRC-32C; the catalogue calls it CRC-32/ISCSI.
const CRC32C: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);
/// Delimiter at the end of every frame.
pub const DELIMITER: u8 = 0;
/// Maximum length of a frame, bytes: a raw 240 x 240 RGB565 image with room to spare. More bytes without a zero are
/// garbage.
pub const MAX_FRAME_LENGTH: usize = 130_000;

/// Error of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The bytes are not COBS.
    #[error("frame of {0} bytes: not COBS")]
    Cobs(usize),
    /// The frame is shorter than its CRC.
    #[error("frame of {0} bytes: too short for a message")]
    Short(usize),
    /// The frame was damaged in transit.
    #[error("crc: found {found:08x}, expected {expected:08x}")]
    Crc {
        /// CRC at the end of the frame.
        found: u32,
        /// CRC of the message.
        expected: u32,
    },
    /// The CRC is right, but the message is not one of this protocol.
    #[error("message: first byte {0}, not a message of this protocol")]
    Message(u8),
    /// There is no end within [`MAX_FRAME_LENGTH`] bytes.
    #[error("{0} bytes without an end")]
    Endless(usize),
}

/// Computes a short digest of bytes, to distinguish equal from different ones.
pub fn digest(bytes: &[u8]) -> u32 {
    CRC32C.checksum(bytes)
}

/// Encodes a message as bytes on the wire.
pub fn encode(message: &LinkMessage) -> Vec<u8> {
    // A message holds nothing postcard cannot write to a growing buffer.
    let mut body = postcard::to_stdvec(message).unwrap_or_default();
    body.extend_from_slice(&CRC32C.checksum(&body).to_le_bytes());
    let mut wire = cobs::encode_vec(&body);
    wire.push(DELIMITER);
    wire
}

/// Decodes the message in the bytes before a delimiter.
pub fn decode(wire: &[u8]) -> Result<LinkMessage, FrameError> {
    let body = cobs::decode_vec(wire).map_err(|_| FrameError::Cobs(wire.len()))?;
    let split = body.len().checked_sub(4).filter(|split| *split > 0).ok_or(FrameError::Short(wire.len()))?;
    let (message, crc) = body.split_at(split);
    let (found, expected) = (u32::from_le_bytes([crc[0], crc[1], crc[2], crc[3]]), CRC32C.checksum(message));
    if found != expected {
        return Err(FrameError::Crc { found, expected });
    }
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::Message(message[0])),
    }
}

#[cfg(test)]
mod tests {
    use super::super::message::{CameraFault, LinkImage, PixelEncoding};
    use super::*;
    use proptest::prelude::*;

    fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
    }

    /// The catalogue's check value.
    #[test]
    fn check_value() {
        assert_eq!(CRC32C.checksum(b"123456789"), 0xE306_9283);
    }

    /// The vectors for the firmware's own tests; docs/camera-board.md repeats them.
    #[test]
    fn vectors() {
        let image = LinkImage {
            camera: 17,
            sequence: 300,
            captured_us: 1_000_000,
            width: 2,
            height: 1,
            encoding: PixelEncoding::Rgb565,
            data: vec![0xF8, 0x00, 0x07, 0xE0],
        };
        let cases = [
            (LinkMessage::Hello, VECTORS[0]),
            (LinkMessage::Welcome { version: 1, serial: 7, cameras: 18 }, VECTORS[1]),
            (LinkMessage::WhatTime { host_us: 1000 }, VECTORS[2]),
            (LinkMessage::Time { host_us: 1000, board_us: 0 }, VECTORS[3]),
            (LinkMessage::Capture, VECTORS[4]),
            (LinkMessage::Image(image), VECTORS[5]),
            (LinkMessage::CameraFault { camera: 3, fault: CameraFault::Timeout }, VECTORS[6]),
        ];
        for (message, expected) in cases {
            assert_eq!(hex(&encode(&message)), expected, "{message:?}");
        }
        let page = include_str!("../../docs/camera-board.md");
        for vector in VECTORS {
            assert!(page.contains(vector), "docs/camera-board.md lacks {vector}");
        }
    }

    /// Computed by an independent program (another language, another COBS and CRC).
    const VECTORS: [&str; 7] = [
        "01 05 51 53 7d 52 00",
        "09 01 01 07 12 dc 0d 6b bb 00",
        "08 02 e8 07 db 89 8a 1d 00",
        "04 03 e8 07 05 f0 39 7f c5 00",
        "06 04 4e c4 e7 95 00",
        "0d 05 11 ac 02 c0 84 3d 02 01 01 04 f8 07 07 e0 6d d0 77 08 00",
        "08 06 03 02 03 8d 09 64 00",
    ];

    #[test]
    fn refusals() {
        let wire = encode(&LinkMessage::Capture);
        let mut damaged = wire[..wire.len() - 1].to_vec();
        damaged[1] ^= 2;
        assert!(matches!(decode(&damaged), Err(FrameError::Crc { .. })));
        assert!(matches!(decode(&[9, 1]), Err(FrameError::Cobs(2))));
        assert!(matches!(decode(&[1]), Err(FrameError::Short(1))));
        let mut foreign = vec![77];
        foreign.extend(CRC32C.checksum(&[77]).to_le_bytes());
        assert_eq!(decode(&cobs::encode_vec(&foreign)), Err(FrameError::Message(77)));
    }

    fn image() -> impl Strategy<Value = LinkMessage> {
        (any::<u8>(), any::<u32>(), any::<u64>(), prop::collection::vec(prop_oneof![Just(0), any::<u8>()], 0..600))
            .prop_map(|(camera, sequence, captured_us, data)| {
                let encoding = PixelEncoding::Jpeg;
                LinkMessage::Image(LinkImage { camera, sequence, captured_us, width: 240, height: 240, encoding, data })
            })
    }

    proptest! {
        #[test]
        fn round_trip(message in image()) {
            let wire = encode(&message);
            let (end, frame) = wire.split_last().expect("not empty");
            prop_assert_eq!((*end, frame.contains(&DELIMITER)), (DELIMITER, false));
            prop_assert_eq!(decode(frame)?, message);
        }
    }
}
