//! Frames in a TCP stream: eight bytes of preamble, the length as a big-endian word, the frame.
//!
//! TCP neither loses nor damages bytes. If a stream is not at the start of a frame, sender and receiver no longer
//! understand each other. That is an error that ends the connection, not a reason to search for the next frame.

use crate::frame::{Frame, FrameError, LONGEST};

/// Preamble of every frame in a stream.
const PREAMBLE: [u8; 8] = *b"\x07xEtRoK\x07";
const PROLOGUE: usize = PREAMBLE.len() + 4;

/// Encodes `frame` for the stream.
pub fn encode(frame: &Frame) -> Vec<u8> {
    let body = frame.encode();
    let mut stream = Vec::with_capacity(PROLOGUE + body.len());
    stream.extend(PREAMBLE);
    stream.extend((body.len() as u32).to_be_bytes());
    stream.extend(body);
    stream
}

/// Splits a stream into frames.
///
/// # Example
/// ```
/// use kinova_kortex::call;
/// use kinova_kortex::frame::{Frame, FrameKind, Header};
/// use kinova_kortex::tcp_framing::{Deframer, encode};
///
/// let (kind, call) = (FrameKind::Request, call::KEEP_ALIVE);
/// let header = Header { kind, device: 0, error: 0, sub_error: 0, session: 1, message: 7, call };
/// let frame = Frame { header, payload: Vec::new() };
/// let stream = encode(&frame);
///
/// let mut deframer = Deframer::default();
/// deframer.push(&stream[..5]);
/// assert_eq!(deframer.next_frame()?, None);
/// deframer.push(&stream[5..]);
/// assert_eq!(deframer.next_frame()?, Some(frame));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Deframer {
    buffer: Vec<u8>,
}

impl Deframer {
    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// Returns the next frame; `None` if more bytes are needed.
    ///
    /// # Errors
    /// [`FrameError`]; the stream is unusable afterwards.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, FrameError> {
        let Some((prologue, rest)) = self.buffer.split_first_chunk::<PROLOGUE>() else { return Ok(None) };
        let [found @ .., a, b, c, d] = *prologue;
        if found != PREAMBLE {
            return Err(FrameError::NoStart { found });
        }
        let length = u32::from_be_bytes([a, b, c, d]);
        if length as usize > LONGEST {
            return Err(FrameError::TooLong { found: length });
        }
        let Some(body) = rest.get(..length as usize) else { return Ok(None) };
        let frame = Frame::decode(body)?;
        self.buffer.drain(..PROLOGUE + length as usize);
        Ok(Some(frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::call;
    use crate::frame::tests::frames;
    use crate::frame::{FrameKind, Header};
    use proptest::prelude::*;

    fn keep_alive() -> Frame {
        let (session, message) = (0x1234, 7);
        let header = Header {
            kind: FrameKind::Request,
            device: 0,
            error: 0,
            sub_error: 0,
            session,
            message,
            call: call::KEEP_ALIVE,
        };
        Frame { header, payload: vec![] }
    }

    #[test]
    fn preamble_and_length() {
        let stream = encode(&keep_alive());
        assert_eq!(stream[..12], [0x07, b'x', b'E', b't', b'R', b'o', b'K', 0x07, 0, 0, 0, 17]);
        assert_eq!(stream.len(), 12 + 17);
    }

    #[test]
    fn a_stream_out_of_step_is_an_error() {
        let mut deframer = Deframer::default();
        deframer.push(&encode(&keep_alive())[1..]);
        assert_eq!(deframer.next_frame(), Err(FrameError::NoStart { found: *b"xEtRoK\x07\0" }));
        let mut deframer = Deframer::default();
        deframer.push(b"\x07xEtRoK\x07\x01\0\0\0");
        assert_eq!(deframer.next_frame(), Err(FrameError::TooLong { found: 1 << 24 }));
    }

    proptest! {
        /// The frames come out however the stream is split.
        #[test]
        fn frames_come_out_as_they_went_in(sent in prop::collection::vec(frames(), 1..6), piece in 1..50_usize) {
            let stream: Vec<u8> = sent.iter().flat_map(encode).collect();
            let mut deframer = Deframer::default();
            let mut found = Vec::new();
            for piece in stream.chunks(piece) {
                deframer.push(piece);
                while let Some(frame) = deframer.next_frame()? {
                    found.push(frame);
                }
            }
            prop_assert_eq!(found, sent);
            prop_assert!(deframer.buffer.is_empty());
        }
    }
}
