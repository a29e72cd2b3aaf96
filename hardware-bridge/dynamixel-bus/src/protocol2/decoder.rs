//! Decoder that finds packets in the byte stream and recovers from any damage on the wire.
//!
//! Bytes go in as they arrive; packets and errors come out in order. After an error the decoder discards only the
//! current header and searches the bytes that it already has for the next one, so that a stray or damaged byte costs
//! only the packet it hit. A damaged *length* can make it wait for bytes that never come; the reader of the port knows
//! the deadline and calls [`Decoder::time_out`].

use super::packet::{HEADER, PROLOGUE_LENGTH, Packet, PacketError, check_id, check_length};

/// Errors in a stream. Each means that bytes were dropped; none ends the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// Bytes that belong to no packet.
    #[error("{0} bytes between packets")]
    Garbage(usize),
    /// A packet began, but is not valid.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// A packet began, but its rest did not come in time.
    #[error("packet cut short: {found} bytes came, expected {expected}")]
    CutShort {
        /// Bytes received, of this packet and of anything after it.
        found: usize,
        /// Size of the packet by its length field, bytes; 0 if not even the length came.
        expected: usize,
    },
}

/// Decoder that finds packets in a stream of bytes.
///
/// ```
/// use dynamixel_bus::protocol2::{Decoder, Instruction, StreamError};
///
/// let wire = Instruction::Ping.encode(1)?;
/// let mut decoder = Decoder::default();
/// decoder.push(&wire[..6]);
/// assert!(decoder.next_packet().is_none());
/// // The rest does not come before the deadline.
/// assert_eq!(decoder.time_out()[0], Err(StreamError::CutShort { found: 6, expected: 0 }));
/// # Ok::<(), dynamixel_bus::protocol2::error::InstructionError>(())
/// ```
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    /// True if the buffer starts with the rest of a discarded packet, whose bytes have been reported already.
    in_discarded_packet: bool,
}

impl Decoder {
    /// Adds bytes as they come from the port.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// Returns the next packet or error; `None` if more bytes are needed.
    pub fn next_packet(&mut self) -> Option<Result<Packet, StreamError>> {
        let skipped = self.skip_to_header();
        if skipped > 0 && !std::mem::take(&mut self.in_discarded_packet) {
            return Some(Err(StreamError::Garbage(skipped)));
        }
        let wire = match self.frame() {
            Ok(length) => self.buffer.get(..length?)?,
            Err(error) => return Some(Err(self.discard_header(error.into()))),
        };
        match Packet::decode(wire) {
            Ok(packet) => {
                let length = wire.len();
                self.buffer.drain(..length);
                self.in_discarded_packet = false;
                Some(Ok(packet))
            }
            Err(error) => Some(Err(self.discard_header(error.into()))),
        }
    }

    /// Returns everything that is complete by now.
    pub fn drain(&mut self) -> Vec<Result<Packet, StreamError>> {
        std::iter::from_fn(|| self.next_packet()).collect()
    }

    /// Ends the wait for more bytes; to be called when nothing more will come before the next request. Reports a packet
    /// cut short and returns what can still be read from the bytes after its header. Afterwards the decoder is empty.
    pub fn time_out(&mut self) -> Vec<Result<Packet, StreamError>> {
        let mut found = self.drain();
        while !self.buffer.is_empty() {
            let expected = self.frame().ok().flatten().unwrap_or(0);
            let error = StreamError::CutShort { found: self.buffer.len(), expected };
            found.push(Err(self.discard_header(error)));
            found.extend(self.drain());
        }
        self.in_discarded_packet = false;
        found
    }

    /// Drops the bytes before the next header, or before what may become one; returns their number.
    fn skip_to_header(&mut self) -> usize {
        let start = (0..self.buffer.len())
            .find(|start| self.buffer[*start..].iter().zip(HEADER).all(|(byte, expected)| *byte == expected))
            .unwrap_or(self.buffer.len());
        self.buffer.drain(..start);
        start
    }

    /// Returns the size of the packet at the start of the buffer, bytes, if enough of it is there.
    fn frame(&self) -> Result<Option<usize>, PacketError> {
        let [_, _, _, _, id, low, high, ..] = self.buffer[..] else { return Ok(None) };
        let length = usize::from(u16::from_le_bytes([low, high]));
        check_id(id)?;
        check_length(length)?;
        Ok(Some(PROLOGUE_LENGTH + length))
    }

    /// Drops one byte, which breaks the header at the start of the buffer.
    fn discard_header(&mut self, error: StreamError) -> StreamError {
        self.buffer.remove(0);
        self.in_discarded_packet = true;
        error
    }
}

#[cfg(test)]
mod tests {
    use super::super::stuffing::tests::bytes;
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    /// The e-Manual's answer to a read of present position: servo 1 stands at 166.
    const ANSWER: [u8; 15] = [0xFF, 0xFF, 0xFD, 0, 1, 8, 0, 0x55, 0, 0xA6, 0, 0, 0, 0x8C, 0xC0];

    fn decode(bytes: &[u8]) -> Vec<Result<Packet, StreamError>> {
        let mut decoder = Decoder::default();
        decoder.push(bytes);
        decoder.time_out()
    }

    fn packets(bytes: &[u8]) -> Vec<Packet> {
        decode(bytes).into_iter().flatten().collect()
    }

    #[test]
    fn published_answer() {
        let expected = Packet { id: 1, instruction: 0x55, parameters: vec![0, 0xA6, 0, 0, 0] };
        assert_eq!(decode(&ANSWER), [Ok(expected)]);
    }

    /// All 15 x 255 ways of damaging one byte of the answer, with a good packet following.
    #[test]
    fn any_changed_byte_costs_one_packet_and_no_more() {
        let good = packets(&ANSWER);
        for position in 0..ANSWER.len() {
            for change in 1..=255 {
                let mut wire = ANSWER.to_vec();
                wire[position] ^= change;
                assert_eq!(packets(&wire), [], "byte {position} changed by {change:02x}");
                wire.extend_from_slice(&ANSWER);
                assert_eq!(packets(&wire), good, "byte {position} changed by {change:02x}");
                assert!(decode(&wire).iter().any(Result::is_err), "not reported");
            }
        }
    }

    #[test]
    fn errors_are_told_apart() {
        assert_eq!(decode(&[1, 2, 3]), [Err(StreamError::Garbage(3))]);
        assert_eq!(decode(&ANSWER[..12]), [Err(StreamError::CutShort { found: 12, expected: 15 })]);
        let changed = |position: usize, value: u8| {
            let mut wire = ANSWER;
            wire[position] = value;
            decode(&wire).first().cloned()
        };
        assert_eq!(changed(4, 0xFF), Some(Err(StreamError::Packet(PacketError::Id(0xFF)))));
        assert_eq!(changed(6, 0x80), Some(Err(StreamError::Packet(PacketError::Length(0x8008)))));
        assert_eq!(
            changed(13, 0x8D),
            Some(Err(StreamError::Packet(PacketError::Crc { found: 0xC08D, expected: 0xC08C })))
        );
    }

    /// A packet that arrives byte by byte is not mistaken for anything before it is whole.
    #[test]
    fn byte_by_byte() {
        let mut decoder = Decoder::default();
        for byte in &ANSWER[..14] {
            decoder.push(&[*byte]);
            assert_eq!(decoder.next_packet(), None);
        }
        decoder.push(&ANSWER[14..]);
        assert!(matches!(decoder.next_packet(), Some(Ok(_))));
        assert_eq!(decoder.next_packet(), None);
    }

    fn packet() -> impl Strategy<Value = Packet> {
        (0..=252_u8, any::<u8>(), bytes(40)).prop_map(|(id, instruction, parameters)| Packet {
            id,
            instruction,
            parameters,
        })
    }

    proptest! {
        // A CRC of 16 bits lets one in 65,536 arbitrary strings pass, so tests over arbitrary bytes use a fixed seed.
        #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(20), ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn round_trip(packet in packet()) {
            prop_assert_eq!(decode(&packet.encode()?), [Ok(packet)]);
        }

        /// The CRC detects a changed byte wherever it is. (A change in the length field moves the CRC itself. It is
        /// detected except in one case in 65,536, in which the number of parameters is wrong.)
        #[test]
        fn a_changed_byte_is_noticed(packet in packet(), position in any::<prop::sample::Index>(), change in 1..=255_u8) {
            let mut wire = packet.encode()?;
            let position = position.index(wire.len());
            wire[position] ^= change;
            prop_assert_eq!(packets(&wire), []);
        }

        /// Garbage before, between and after packets costs none of them, in whatever pieces the bytes arrive. (Garbage
        /// that holds a whole header may hide packets until the deadline, never longer.)
        #[test]
        fn finds_every_packet_in_garbage(
            sent in prop::collection::vec((bytes(12), packet()), 1..6),
            tail in bytes(12),
            piece in 1..40_usize,
        ) {
            let mut wire = Vec::new();
            for (garbage, packet) in &sent {
                wire.extend_from_slice(garbage);
                wire.extend(packet.encode()?);
            }
            wire.extend_from_slice(&tail);
            let mut decoder = Decoder::default();
            let mut found = Vec::new();
            for piece in wire.chunks(piece) {
                decoder.push(piece);
                found.extend(decoder.drain());
            }
            found.extend(decoder.time_out());
            let found: Vec<Packet> = found.into_iter().flatten().collect();
            let sent: Vec<Packet> = sent.into_iter().map(|(_, packet)| packet).collect();
            prop_assert_eq!(found, sent);
        }
    }
}
