//! The answer to a fast sync read or a fast bulk read: one packet that several servos write together.
//!
//! The first servo sends the packet's head and its own block; each following servo appends a block as soon as it has
//! seen the one before. A block is `error | id | data | crc (2)`. Its CRC covers everything from the packet's first
//! byte on, so every prefix that ends with a block can be trusted by itself. Blocks are not stuffed. A missing servo
//! breaks the chain: it and those after it stay silent, although the length field has promised all.

use super::bulk::BulkRead;
use super::crc::crc16;
use super::packet::{BROADCAST_ID, HEADER};
use super::status::{ReplyError, STATUS, Status};

/// Bytes of a block besides its data.
pub const BLOCK_OVERHEAD: usize = 4;
/// Bytes before the first block: header, id, length, instruction.
pub const HEAD_LENGTH: usize = 8;

/// Returns the length of the whole answer of `servos` servos with `length` bytes of data each.
pub fn answer_length(servos: usize, length: usize) -> usize {
    packet_length(std::iter::repeat_n(length, servos))
}

/// Returns the length of the whole answer of servos with these numbers of bytes of data.
pub(crate) fn packet_length(lengths: impl Iterator<Item = usize>) -> usize {
    HEAD_LENGTH + lengths.map(|length| length + BLOCK_OVERHEAD).sum::<usize>()
}

/// Encodes an answer: the servos' side. The servos are asked for `lengths` bytes, and the first `statuses.len()` of
/// them take part.
pub fn encode(lengths: &[usize], statuses: &[Status]) -> Vec<u8> {
    if statuses.is_empty() {
        return Vec::new();
    }
    let promised: usize = lengths.iter().map(|length| length + BLOCK_OVERHEAD).sum();
    let mut wire = HEADER.to_vec();
    wire.push(BROADCAST_ID);
    wire.extend_from_slice(&u16::try_from(1 + promised).unwrap_or(u16::MAX).to_le_bytes());
    wire.push(STATUS);
    for status in statuses {
        wire.push(status.error_byte());
        wire.push(status.id);
        wire.extend_from_slice(&status.data);
        wire.extend_from_slice(&crc16(&wire).to_le_bytes());
    }
    wire
}

/// Sorts what came after a fast sync read. Returns for each servo asked, in that order, its `length` bytes, or the
/// reason why there are none.
///
/// `received` is everything that came; the answer is searched for in it. Only blocks before the first damaged or
/// missing one count.
pub fn replies(ids: &[u8], length: usize, received: &[u8]) -> Vec<Result<Status, ReplyError>> {
    sort_replies(&ids.iter().map(|id| (*id, length)).collect::<Vec<_>>(), received)
}

/// Like [`replies`], after a fast bulk read.
pub fn bulk_replies(reads: &[BulkRead], received: &[u8]) -> Vec<Result<Status, ReplyError>> {
    sort_replies(&reads.iter().map(|read| (read.id, read.length.into())).collect::<Vec<_>>(), received)
}

/// Sorts the blocks of an answer by servo; `expected` has the id and the number of bytes of each.
pub(crate) fn sort_replies(expected: &[(u8, usize)], received: &[u8]) -> Vec<Result<Status, ReplyError>> {
    let head = [HEADER.as_slice(), &[BROADCAST_ID]].concat();
    let best = (0..received.len())
        .filter(|start| received[*start..].starts_with(&head))
        .map(|start| blocks(expected, &received[start..]))
        .max_by_key(|blocks| blocks.len())
        .unwrap_or_default();
    let mut blocks = best.into_iter();
    expected.iter().map(|(id, _)| blocks.next().unwrap_or(Err(ReplyError::Missing(*id)))).collect()
}

/// Returns the good blocks at the start of an answer that begins at `wire[0]`.
fn blocks(expected: &[(u8, usize)], wire: &[u8]) -> Vec<Result<Status, ReplyError>> {
    let mut found = Vec::new();
    if wire.get(HEAD_LENGTH - 1) != Some(&STATUS) {
        return found;
    }
    let mut start = HEAD_LENGTH;
    for (id, length) in expected {
        let end = start + length + 2;
        let Some(&[low, high]) = wire.get(end..end + 2) else { break };
        if u16::from_le_bytes([low, high]) != crc16(&wire[..end]) || wire[start + 1] != *id {
            break;
        }
        let status = Status::with_error_byte(*id, wire[start], wire[start + 2..end].to_vec());
        found.push(match status.error {
            Some(error) => Err(ReplyError::Refused { id: *id, error }),
            None => Ok(status),
        });
        start = end + 2;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::stuffing::tests::bytes;
    use super::*;
    use proptest::prelude::*;

    fn answers(data: &[Vec<u8>]) -> Vec<Status> {
        data.iter().zip(1..).map(|(data, id)| Status { id, alert: false, error: None, data: data.clone() }).collect()
    }

    /// Packet sizes of the protocol: 8 + N (L + 4) bytes.
    #[test]
    fn size() {
        let wire = encode(&[10; 6], &answers(&vec![vec![7; 10]; 6]));
        assert_eq!((wire.len(), answer_length(6, 10)), (92, 92));
        assert_eq!(usize::from(u16::from_le_bytes([wire[5], wire[6]])), wire.len() - 7);
    }

    /// Servo 4 of 6 is unplugged: three answers are good, three are missing.
    #[test]
    fn broken_chain() {
        let all = answers(&vec![vec![7; 10]; 3]);
        let found = replies(&[1, 2, 3, 4, 5, 6], 10, &encode(&[10; 6], &all));
        assert_eq!(found[..3], all.into_iter().map(Ok).collect::<Vec<_>>());
        assert_eq!(found[3..], [4, 5, 6].map(|id| Err(ReplyError::Missing(id))));
    }

    proptest! {
        /// Whatever the data, with garbage before and a broken byte: blocks before the break are read, and no wrong one
        /// ever is.
        #[test]
        fn prefix_of_blocks(garbage in bytes(8), data in prop::collection::vec(prop::collection::vec(any::<u8>(), 6), 1..7), hit in any::<prop::sample::Index>(), change in any::<u8>()) {
            let all = answers(&data);
            let ids: Vec<u8> = all.iter().map(|status| status.id).collect();
            let mut wire = encode(&vec![6; ids.len()], &all);
            let position = hit.index(wire.len());
            wire[position] ^= change;
            let good = if change == 0 { ids.len() } else { position.saturating_sub(HEAD_LENGTH) / (6 + BLOCK_OVERHEAD) };
            let found = replies(&ids, 6, &[garbage, wire].concat());
            for (n, reply) in found.iter().enumerate() {
                // A damaged length is detected already by the CRC of the first block.
                if n < good && position >= HEAD_LENGTH || change == 0 {
                    prop_assert_eq!(reply.as_ref(), Ok(&all[n]));
                } else {
                    prop_assert!(reply.is_err());
                }
            }
        }
    }
}
