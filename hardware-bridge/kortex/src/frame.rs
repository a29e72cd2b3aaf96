//! One Kortex frame: a header of four words and a payload.
//!
//! A frame is itself a protobuf message, `{ 1: header, 2: payload }`, and the header's four words are bit fields:
//!
//! | word | bits 31..28 | 27..24 | 23..16 | 15..12 | 11..0 |
//! |---|---|---|---|---|---|
//! | frame | version | kind | device | error | sub-error |
//! | message | session (31..16) | | | message number (15..0) | |
//! | service | service version | service (27..16) | | function (15..0) | |
//! | payload | length in bytes | | | | |

use prost::Message;

use self::wire::{WireFrame, WireHeader};
use crate::call::Call;

/// Version of the header and of every service that this client speaks.
const VERSION: u32 = 1;

/// Length limit of received frames, bytes. The longest frame of an arm of seven joints is below 1.2 kB. A list of
/// devices with names stays below 4 kB.
pub const LONGEST: usize = 65_536;

/// Purpose of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameKind {
    /// Request of the host.
    Request,
    /// Answer of the arm; the message number is the request's.
    Response,
    /// Unasked message of the arm; the message number is the subscription's handle.
    Notification,
}

impl FrameKind {
    fn number(self) -> u32 {
        match self {
            Self::Request => 1,
            Self::Response => 3,
            Self::Notification => 5,
        }
    }

    fn from_number(found: u32) -> Result<Self, FrameError> {
        match found {
            1 => Ok(Self::Request),
            3 => Ok(Self::Response),
            5 => Ok(Self::Notification),
            _ => Err(FrameError::Kind { found }),
        }
    }
}

/// Header of a frame: its purpose, addressee, session and call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Purpose of the frame.
    pub kind: FrameKind,
    /// Addressed device inside the arm; 0 is the base.
    pub device: u8,
    /// Error class of a response, 0 for none; see [`crate::refusal`].
    pub error: u8,
    /// Reason within that class.
    pub sub_error: u16,
    /// Number of the session, 0 while there is none.
    pub session: u16,
    /// Number of the request, or handle of the subscription.
    pub message: u16,
    /// Called function, or topic of the subscription.
    pub call: Call,
}

/// A header and its payload.
///
/// # Example
/// ```
/// use kinova_kortex::call;
/// use kinova_kortex::frame::{Frame, FrameKind, Header};
///
/// let (kind, call) = (FrameKind::Request, call::GET_ARM_STATE);
/// let header = Header { kind, device: 0, error: 0, sub_error: 0, session: 1, message: 7, call };
/// let frame = Frame { header, payload: Vec::new() };
/// assert_eq!(Frame::decode(&frame.encode())?, frame);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Header of the frame.
    pub header: Header,
    /// The call's argument or result, a protobuf message.
    pub payload: Vec<u8>,
}

/// Reason for which bytes are not a valid frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The bytes are not the protobuf message of a frame.
    #[error("{0} bytes are no frame")]
    Encoding(usize),
    /// The header is missing.
    #[error("frame without a header")]
    NoHeader,
    /// The header has another version or is damaged.
    #[error("frame version {found}, expected {VERSION}")]
    Version {
        /// Version in the header.
        found: u32,
    },
    /// The kind is neither request, response nor notification.
    #[error("frame kind {found}, expected 1, 3 or 5")]
    Kind {
        /// Kind in the header.
        found: u32,
    },
    /// The payload was truncated or extended.
    #[error("payload of {found} bytes, the header says {expected}")]
    PayloadLength {
        /// Number of bytes found.
        found: usize,
        /// Number of bytes announced in the header.
        expected: u32,
    },
    /// The stream is not at the start of a frame; nothing after this can be trusted.
    #[error("no frame starts at {found:02x?}")]
    NoStart {
        /// Bytes found in place of the preamble.
        found: [u8; 8],
    },
    /// The announced length is that of no frame.
    #[error("frame of {found} bytes, at most {LONGEST} expected")]
    TooLong {
        /// Announced length, bytes.
        found: u32,
    },
}

/// The generated messages of a frame.
#[allow(unreachable_pub)]
mod wire {
    include!("message/generated/frame.rs");
}

impl Frame {
    /// Returns the frame's bytes, as in a UDP datagram.
    pub fn encode(&self) -> Vec<u8> {
        let Header { kind, device, error, sub_error, session, message, call } = self.header;
        let header = WireHeader {
            frame: VERSION << 28
                | kind.number() << 24
                | u32::from(device) << 16
                | u32::from(error & 0xF) << 12
                | u32::from(sub_error & 0xFFF),
            message: u32::from(session) << 16 | u32::from(message),
            service: VERSION << 28 | call.id(),
            payload: self.payload.len() as u32,
        };
        WireFrame { header: Some(header), payload: self.payload.clone() }.encode_to_vec()
    }

    /// Decodes the frame in `bytes`.
    ///
    /// # Errors
    /// [`FrameError`], never [`FrameError::NoStart`] or [`FrameError::TooLong`], which belong to streams.
    pub fn decode(bytes: &[u8]) -> Result<Self, FrameError> {
        let WireFrame { header, payload } = WireFrame::decode(bytes).map_err(|_| FrameError::Encoding(bytes.len()))?;
        let header = header.ok_or(FrameError::NoHeader)?;
        let version = header.frame >> 28;
        if version != VERSION {
            return Err(FrameError::Version { found: version });
        }
        let kind = FrameKind::from_number(header.frame >> 24 & 0xF)?;
        if payload.len() != header.payload as usize {
            return Err(FrameError::PayloadLength { found: payload.len(), expected: header.payload });
        }
        Ok(Self {
            header: Header {
                kind,
                device: (header.frame >> 16) as u8,
                error: (header.frame >> 12 & 0xF) as u8,
                sub_error: (header.frame & 0xFFF) as u16,
                session: (header.message >> 16) as u16,
                message: header.message as u16,
                call: Call::from_id(header.service & 0x0FFF_FFFF),
            },
            payload,
        })
    }
}

/// True if message number `a` was assigned after `b`; numbers wrap at 65,536.
pub(crate) fn is_younger(a: u16, b: u16) -> bool {
    a != b && a.wrapping_sub(b) < 0x8000
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    #[test]
    fn younger_across_the_wrap() {
        assert!(is_younger(2, 1) && is_younger(0, 65_535) && is_younger(5, 65_530));
        assert!(!is_younger(1, 1) && !is_younger(65_535, 0) && !is_younger(1, 2));
    }
    use crate::call;
    use proptest::prelude::*;

    /// A keep-alive, word by word from the layout: version 1, kind 1; session 0x1234, message 7; service 1, function 3;
    /// no payload (a zero word is left out, as in every proto3 message).
    #[test]
    fn keep_alive_bytes() {
        let header = Header {
            kind: FrameKind::Request,
            device: 0,
            error: 0,
            sub_error: 0,
            session: 0x1234,
            message: 7,
            call: call::KEEP_ALIVE,
        };
        let expected = [
            0x0A, 15, // field 1, 15 bytes
            0x0D, 0x00, 0x00, 0x00, 0x11, // frame 0x1100_0000, little-endian
            0x15, 0x07, 0x00, 0x34, 0x12, // message 0x1234_0007
            0x1D, 0x03, 0x00, 0x01, 0x10, // service 0x1001_0003
        ];
        let frame = Frame { header, payload: vec![] };
        assert_eq!(frame.encode(), expected);
        assert_eq!(Frame::decode(&expected), Ok(frame));
    }

    /// A refusal from actuator 3: kind 3, device 3, error class 3 (device), reason 75 (wrong servoing mode), and a
    /// payload.
    #[test]
    fn refusal_bytes() {
        let bytes = [
            0x0A, 20, 0x0D, 0x4B, 0x30, 0x03, 0x13, 0x15, 0x09, 0x00, 0x02, 0x00, 0x1D, 0x01, 0x00, 0x03, 0x10, 0x25,
            0x02, 0x00, 0x00, 0x00, 0x12, 2, 0x08, 0x03,
        ];
        let header = Header {
            kind: FrameKind::Response,
            device: 3,
            error: 3,
            sub_error: 75,
            session: 2,
            message: 9,
            call: call::REFRESH,
        };
        assert_eq!(Frame::decode(&bytes), Ok(Frame { header, payload: vec![8, 3] }));
        assert_eq!(Frame { header, payload: vec![8, 3] }.encode(), bytes);
    }

    #[test]
    fn damage_is_named() {
        let word = |frame: u32, payload: u32| {
            let header = WireHeader { frame, message: 0, service: 0, payload };
            WireFrame { header: Some(header), payload: vec![1, 2] }.encode_to_vec()
        };
        assert_eq!(Frame::decode(&word(0x2100_0000, 2)), Err(FrameError::Version { found: 2 }));
        assert_eq!(Frame::decode(&word(0x1200_0000, 2)), Err(FrameError::Kind { found: 2 }));
        assert_eq!(Frame::decode(&word(0x1100_0000, 3)), Err(FrameError::PayloadLength { found: 2, expected: 3 }));
        assert_eq!(Frame::decode(&[]), Err(FrameError::NoHeader));
        assert_eq!(Frame::decode(&[0x0A, 9]), Err(FrameError::Encoding(2)));
    }

    pub(crate) fn frames() -> impl Strategy<Value = Frame> {
        let kind = prop_oneof![Just(FrameKind::Request), Just(FrameKind::Response), Just(FrameKind::Notification)];
        (
            kind,
            any::<(u8, u16, u16)>(),
            0..16_u8,
            0..4096_u16,
            0..0x1000_0000_u32,
            prop::collection::vec(any::<u8>(), 0..80),
        )
            .prop_map(|(kind, (device, session, message), error, sub_error, id, payload)| Frame {
                header: Header { kind, device, error, sub_error, session, message, call: Call::from_id(id) },
                payload,
            })
    }

    proptest! {
        #[test]
        fn round_trip(frame in frames()) {
            prop_assert_eq!(Frame::decode(&frame.encode()), Ok(frame));
        }

        /// Any bytes may arrive on a UDP port; none of them may end the program.
        #[test]
        fn any_bytes_are_a_frame_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            if let Ok(frame) = Frame::decode(&bytes) {
                prop_assert_eq!(Frame::decode(&frame.encode()), Ok(frame));
            }
        }
    }
}
