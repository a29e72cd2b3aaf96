//! Deframer: finds messages in the stream of bytes.

use super::frame::{self, DELIMITER, FrameError, MAX_FRAME_LENGTH};
use super::message::LinkMessage;

/// Finds messages in a stream of bytes.
#[derive(Debug, Default)]
pub struct Deframer {
    buffer: Vec<u8>,
    /// True while bytes are dropped until the next delimiter.
    lost: bool,
}

impl Deframer {
    /// Takes bytes as they come; returns the messages and errors that became complete.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Result<LinkMessage, FrameError>> {
        let mut found = Vec::new();
        for byte in bytes {
            if *byte == DELIMITER {
                if !std::mem::take(&mut self.lost) && !self.buffer.is_empty() {
                    found.push(frame::decode(&self.buffer));
                }
                self.buffer.clear();
            } else if !self.lost {
                self.buffer.push(*byte);
                if self.buffer.len() > MAX_FRAME_LENGTH {
                    found.push(Err(FrameError::Endless(self.buffer.len())));
                    self.buffer.clear();
                    self.lost = true;
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Garbage costs at most the frame it runs into, in whatever pieces the bytes come.
        #[test]
        fn finds_messages_in_garbage(garbage in prop::collection::vec(any::<u8>(), 0..50), piece in 1..20_usize) {
            let sent = [LinkMessage::Capture, LinkMessage::WhatTime { host_us: 5 }];
            let mut wire = garbage;
            wire.push(DELIMITER);
            wire.extend(sent.iter().flat_map(frame::encode));
            let mut deframer = Deframer::default();
            let found: Vec<LinkMessage> = wire.chunks(piece).flat_map(|piece| deframer.push(piece)).flatten().collect();
            prop_assert!(found.ends_with(&sent), "{:?}", found);
        }
    }

    #[test]
    fn endless_garbage_is_dropped_once() {
        let mut deframer = Deframer::default();
        let found = deframer.push(&vec![7; 3 * MAX_FRAME_LENGTH]);
        assert_eq!(found, [Err(FrameError::Endless(MAX_FRAME_LENGTH + 1))]);
        deframer.push(&[DELIMITER]);
        assert_eq!(deframer.push(&frame::encode(&LinkMessage::Hello)), [Ok(LinkMessage::Hello)]);
    }
}
