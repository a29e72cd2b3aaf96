//! Status packets: the servos' answers.

use super::bulk::BulkRead;
use super::decoder::StreamError;
use super::packet::{Packet, PacketError};

/// Instruction code of every answer.
pub(super) const STATUS: u8 = 0x55;
const ALERT_BIT: u8 = 0x80;

/// A servo's answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// Id of the servo that answers.
    pub id: u8,
    /// Alert bit: true if the hardware error status register (70) holds an error.
    pub alert: bool,
    /// Reason of the refusal, if the servo refused.
    pub error: Option<ServoError>,
    /// Data that was read.
    pub data: Vec<u8>,
}

/// Error with which a servo refuses an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ServoError {
    /// Error 1.
    #[error("could not do it (1, result fail)")]
    ResultFail,
    /// Error 2.
    #[error("does not know the instruction (2)")]
    Instruction,
    /// Error 3.
    #[error("got a damaged packet (3, crc)")]
    Crc,
    /// Error 4; also the answer to goals after the bus watchdog has tripped.
    #[error("value out of range (4, data range)")]
    DataRange,
    /// Error 5.
    #[error("too few bytes for the register (5, data length)")]
    DataLength,
    /// Error 6.
    #[error("value beyond a limit set in the servo (6, data limit)")]
    DataLimit,
    /// Error 7; also the answer to writes to EEPROM registers while torque is on.
    #[error("register not to be read or written now (7, access)")]
    Access,
    /// Any other number.
    #[error("unknown error number {0}")]
    Other(u8),
}

impl ServoError {
    fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            0 => return None,
            1 => Self::ResultFail,
            2 => Self::Instruction,
            3 => Self::Crc,
            4 => Self::DataRange,
            5 => Self::DataLength,
            6 => Self::DataLimit,
            7 => Self::Access,
            other => Self::Other(other),
        })
    }

    fn number(self) -> u8 {
        match self {
            Self::ResultFail => 1,
            Self::Instruction => 2,
            Self::Crc => 3,
            Self::DataRange => 4,
            Self::DataLength => 5,
            Self::DataLimit => 6,
            Self::Access => 7,
            Self::Other(number) => number & !ALERT_BIT,
        }
    }
}

/// Reason why there is no usable answer from one servo.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReplyError {
    /// Nothing came from the servo.
    #[error("servo {0}: no answer")]
    Missing(u8),
    /// The servo refused the instruction.
    #[error("servo {id}: {error}")]
    Refused {
        /// Id of the servo.
        id: u8,
        /// The servo's reason.
        error: ServoError,
    },
    /// The answer has another length than requested.
    #[error("servo {id}: found {found} bytes, expected {expected}")]
    Length {
        /// Id of the servo.
        id: u8,
        /// Bytes in its answer.
        found: usize,
        /// Bytes requested.
        expected: usize,
    },
}

impl Status {
    /// Returns the packet's error byte, with error number and alert bit.
    pub(super) fn error_byte(&self) -> u8 {
        self.error.map_or(0, ServoError::number) | if self.alert { ALERT_BIT } else { 0 }
    }

    pub(super) fn with_error_byte(id: u8, byte: u8, data: Vec<u8>) -> Self {
        Self { id, alert: byte & ALERT_BIT != 0, error: ServoError::from_number(byte & !ALERT_BIT), data }
    }

    /// Encodes the answer as bytes on the wire: the servo's side.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let parameters = std::iter::once(self.error_byte()).chain(self.data.iter().copied()).collect();
        Packet { id: self.id, instruction: STATUS, parameters }.encode()
    }

    /// Decodes the answer in a packet; `None` for a packet that is not an answer, such as the echo of our own on a
    /// half-duplex line.
    pub fn decode(packet: &Packet) -> Option<Self> {
        match (packet.instruction, &packet.parameters[..]) {
            (STATUS, [error, data @ ..]) => Some(Self::with_error_byte(packet.id, *error, data.to_vec())),
            _ => None,
        }
    }
}

/// Sorts the packets that came after a sync read. Returns for each servo asked, in that order, its `length` bytes, or
/// the reason why there are none.
///
/// Damaged packets, echoes and foreign packets are skipped: a servo whose answer was lost is [`ReplyError::Missing`],
/// and the answers of the others stand.
pub fn sync_read_replies(
    ids: &[u8],
    length: usize,
    received: impl IntoIterator<Item = Result<Packet, StreamError>>,
) -> Vec<Result<Status, ReplyError>> {
    sort_replies(&ids.iter().map(|id| (*id, length)).collect::<Vec<_>>(), received)
}

/// Like [`sync_read_replies`], after a bulk read.
pub fn bulk_read_replies(
    reads: &[BulkRead],
    received: impl IntoIterator<Item = Result<Packet, StreamError>>,
) -> Vec<Result<Status, ReplyError>> {
    sort_replies(&reads.iter().map(|read| (read.id, read.length.into())).collect::<Vec<_>>(), received)
}

/// Sorts answers by servo; `expected` has the id and the number of bytes of each.
pub(crate) fn sort_replies(
    expected: &[(u8, usize)],
    received: impl IntoIterator<Item = Result<Packet, StreamError>>,
) -> Vec<Result<Status, ReplyError>> {
    let mut replies: Vec<_> = expected.iter().map(|(id, _)| Err(ReplyError::Missing(*id))).collect();
    for status in received.into_iter().flatten().filter_map(|packet| Status::decode(&packet)) {
        let Some(place) = expected.iter().position(|(id, _)| *id == status.id) else { continue };
        let length = expected[place].1;
        replies[place] = match status.error {
            Some(error) => Err(ReplyError::Refused { id: status.id, error }),
            None if status.data.len() != length => {
                Err(ReplyError::Length { id: status.id, found: status.data.len(), expected: length })
            }
            None => Ok(status),
        };
    }
    replies
}

#[cfg(test)]
mod tests {
    use super::super::decoder::Decoder;
    use super::super::stuffing::tests::bytes;
    use super::*;
    use proptest::prelude::*;

    fn answer(id: u8, data: &[u8]) -> Status {
        Status { id, alert: false, error: None, data: data.to_vec() }
    }

    /// Example packets from the e-Manual: answers to ping, read and write.
    #[test]
    fn published_packets() {
        let cases: [(Status, &[u8]); 4] = [
            (answer(1, &[0x06, 0x04, 0x26]), &[0xFF, 0xFF, 0xFD, 0, 1, 7, 0, 0x55, 0, 0x06, 0x04, 0x26, 0x65, 0x5D]),
            (answer(2, &[0x06, 0x04, 0x26]), &[0xFF, 0xFF, 0xFD, 0, 2, 7, 0, 0x55, 0, 0x06, 0x04, 0x26, 0x6F, 0x6D]),
            (answer(2, &[0x1F, 8, 0, 0]), &[0xFF, 0xFF, 0xFD, 0, 2, 8, 0, 0x55, 0, 0x1F, 8, 0, 0, 0xBA, 0xBE]),
            (answer(1, &[]), &[0xFF, 0xFF, 0xFD, 0, 1, 4, 0, 0x55, 0, 0xA1, 0x0C]),
        ];
        for (status, expected) in cases {
            assert_eq!(status.encode().as_deref(), Ok(expected));
        }
    }

    /// Six servos are asked; one answer is damaged, one is a refusal, one is too short, and our own packet comes back
    /// as an echo.
    #[test]
    fn one_bad_answer_leaves_the_others() {
        let ids = [1, 2, 3, 4, 5, 6];
        let request = super::super::Instruction::SyncRead { address: 126, length: 10, ids: ids.to_vec() };
        let mut wire = request.encode(super::super::BROADCAST_ID).expect("fits");
        for id in ids {
            let mut status = answer(id, &[id; 10]);
            if id == 4 {
                (status.error, status.data) = (Some(ServoError::Access), vec![]);
            }
            if id == 5 {
                status.data.truncate(4);
            }
            let mut bytes = status.encode().expect("fits");
            if id == 2 {
                bytes[10] ^= 0x10;
            }
            wire.push(0);
            wire.extend(bytes);
        }
        let mut decoder = Decoder::default();
        decoder.push(&wire);
        let replies = sync_read_replies(&ids, 10, decoder.time_out());
        assert_eq!(
            replies,
            [
                Ok(answer(1, &[1; 10])),
                Err(ReplyError::Missing(2)),
                Ok(answer(3, &[3; 10])),
                Err(ReplyError::Refused { id: 4, error: ServoError::Access }),
                Err(ReplyError::Length { id: 5, found: 4, expected: 10 }),
                Ok(answer(6, &[6; 10])),
            ]
        );
    }

    proptest! {
        #[test]
        fn round_trip(id in 0..=252_u8, error in any::<u8>(), data in bytes(40)) {
            let status = Status::with_error_byte(id, error, data);
            let mut decoder = Decoder::default();
            decoder.push(&status.encode()?);
            let packet = decoder.next_packet().expect("a whole packet")?;
            prop_assert_eq!(Status::decode(&packet), Some(status));
        }
    }
}
