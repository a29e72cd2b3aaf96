//! Instructions from the host to the servos.

use super::bulk::{self, BulkRead, BulkWrite};
use super::error::InstructionError;
use super::packet::{BROADCAST_ID, Packet};

/// Instructions of Protocol 2.0, except clear, factory reset and control table backup.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Instruction {
    /// Ping, answered with model number and firmware version.
    Ping,
    /// Read `length` bytes from `address` on.
    Read {
        /// First register.
        address: u16,
        /// Number of bytes.
        length: u16,
    },
    /// Write bytes from `address` on.
    Write {
        /// First register.
        address: u16,
        /// Bytes to write.
        data: Vec<u8>,
    },
    /// A write that waits for [`Instruction::Action`].
    RegWrite {
        /// First register.
        address: u16,
        /// Bytes to write.
        data: Vec<u8>,
    },
    /// Execute the registered write.
    Action,
    /// Restart; the only way out of a shutdown. Torque is off afterwards.
    Reboot,
    /// The same read from several servos, which answer one after the other in this order.
    SyncRead {
        /// First register.
        address: u16,
        /// Number of bytes from each.
        length: u16,
        /// Ids of the servos, in the order of their answers.
        ids: Vec<u8>,
    },
    /// A sync read answered in one packet to which each servo appends a block ([`super::fast_sync`]). Firmware 46 and later.
    FastSyncRead {
        /// First register.
        address: u16,
        /// Number of bytes from each.
        length: u16,
        /// Ids of the servos, in the order of their answers.
        ids: Vec<u8>,
    },
    /// Writes of the same registers in several servos at once. Not answered: a refused value is lost silently.
    SyncWrite {
        /// First register.
        address: u16,
        /// Number of bytes to each.
        length: u16,
        /// Id and data of each servo; the data has exactly `length` bytes.
        data: Vec<(u8, Vec<u8>)>,
    },
    /// Reads of different registers from each servo; the servos answer one after the other in this order.
    BulkRead(Vec<BulkRead>),
    /// A bulk read answered in one packet, as a fast sync read is. Firmware 46 and later.
    FastBulkRead(Vec<BulkRead>),
    /// Writes of different registers in each servo. Not answered.
    BulkWrite(Vec<BulkWrite>),
}

const PING: u8 = 0x01;
const READ: u8 = 0x02;
const WRITE: u8 = 0x03;
const REG_WRITE: u8 = 0x04;
const ACTION: u8 = 0x05;
const REBOOT: u8 = 0x08;
const SYNC_READ: u8 = 0x82;
const SYNC_WRITE: u8 = 0x83;
const FAST_SYNC_READ: u8 = 0x8A;
const BULK_READ: u8 = 0x92;
const BULK_WRITE: u8 = 0x93;
const FAST_BULK_READ: u8 = 0x9A;

impl Instruction {
    /// Encodes the instruction as bytes on the wire. Sync and bulk instructions are broadcast; for them `id` is
    /// ignored.
    pub fn encode(&self, id: u8) -> Result<Vec<u8>, InstructionError> {
        let (instruction, parameters) = match self {
            Self::Ping => (PING, Vec::new()),
            Self::Action => (ACTION, Vec::new()),
            Self::Reboot => (REBOOT, Vec::new()),
            Self::Read { address, length } => (READ, words(&[*address, *length])),
            Self::Write { address, data } => (WRITE, [words(&[*address]), data.clone()].concat()),
            Self::RegWrite { address, data } => (REG_WRITE, [words(&[*address]), data.clone()].concat()),
            Self::BulkRead(reads) => (BULK_READ, bulk::encode_reads(reads)?),
            Self::FastBulkRead(reads) => (FAST_BULK_READ, bulk::encode_reads(reads)?),
            Self::BulkWrite(writes) => (BULK_WRITE, bulk::encode_writes(writes)?),
            Self::SyncRead { address, length, ids } => (SYNC_READ, [words(&[*address, *length]), ids.clone()].concat()),
            Self::FastSyncRead { address, length, ids } => {
                (FAST_SYNC_READ, [words(&[*address, *length]), ids.clone()].concat())
            }
            Self::SyncWrite { address, length, data } => {
                let mut parameters = words(&[*address, *length]);
                for (id, bytes) in data {
                    if bytes.len() != usize::from(*length) {
                        return Err(InstructionError::DataLength {
                            id: *id,
                            found: bytes.len(),
                            expected: usize::from(*length),
                        });
                    }
                    parameters.push(*id);
                    parameters.extend_from_slice(bytes);
                }
                (SYNC_WRITE, parameters)
            }
        };
        let id = if instruction >= SYNC_READ { BROADCAST_ID } else { id };
        Ok(Packet { id, instruction, parameters }.encode()?)
    }

    /// Decodes the instruction in a packet: the servo's side of [`Instruction::encode`].
    pub fn decode(packet: &Packet) -> Result<Self, InstructionError> {
        let unfit = InstructionError::Parameters { instruction: packet.instruction, found: packet.parameters.len() };
        let word = |low: u8, high: u8| u16::from_le_bytes([low, high]);
        match (packet.instruction, &packet.parameters[..]) {
            (PING, []) => Ok(Self::Ping),
            (ACTION, []) => Ok(Self::Action),
            (REBOOT, []) => Ok(Self::Reboot),
            (READ, [a, b, c, d]) => Ok(Self::Read { address: word(*a, *b), length: word(*c, *d) }),
            (WRITE, [a, b, data @ ..]) if !data.is_empty() => {
                Ok(Self::Write { address: word(*a, *b), data: data.to_vec() })
            }
            (REG_WRITE, [a, b, data @ ..]) if !data.is_empty() => {
                Ok(Self::RegWrite { address: word(*a, *b), data: data.to_vec() })
            }
            (BULK_READ, parameters) => Ok(Self::BulkRead(bulk::decode_reads(parameters)?.ok_or(unfit)?)),
            (FAST_BULK_READ, parameters) => Ok(Self::FastBulkRead(bulk::decode_reads(parameters)?.ok_or(unfit)?)),
            (BULK_WRITE, parameters) => Ok(Self::BulkWrite(bulk::decode_writes(parameters)?.ok_or(unfit)?)),
            (SYNC_READ, [a, b, c, d, ids @ ..]) => {
                Ok(Self::SyncRead { address: word(*a, *b), length: word(*c, *d), ids: ids.to_vec() })
            }
            (FAST_SYNC_READ, [a, b, c, d, ids @ ..]) => {
                Ok(Self::FastSyncRead { address: word(*a, *b), length: word(*c, *d), ids: ids.to_vec() })
            }
            (SYNC_WRITE, [a, b, c, d, rest @ ..]) if rest.len() % (1 + usize::from(word(*c, *d))) == 0 => {
                let length = word(*c, *d);
                let data = rest.chunks(1 + usize::from(length)).map(|one| (one[0], one[1..].to_vec())).collect();
                Ok(Self::SyncWrite { address: word(*a, *b), length, data })
            }
            (PING | READ | WRITE | REG_WRITE | ACTION | REBOOT | SYNC_READ | SYNC_WRITE | FAST_SYNC_READ, _) => {
                Err(unfit)
            }
            (code, _) => Err(InstructionError::Unknown(code)),
        }
    }
}

fn words(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::decoder::Decoder;
    use super::super::stuffing::tests::bytes;
    use super::*;
    use proptest::prelude::*;

    fn wire(hex: &str) -> Vec<u8> {
        hex.split(' ').map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect()
    }

    /// Example packets from the e-Manual.
    #[test]
    fn published_packets() {
        let position = |value: u32| value.to_le_bytes().to_vec();
        let cases = [
            (Instruction::Ping, 1, "FF FF FD 00 01 03 00 01 19 4E"),
            (Instruction::Ping, BROADCAST_ID, "FF FF FD 00 FE 03 00 01 31 42"),
            (Instruction::Read { address: 132, length: 4 }, 1, "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
            (
                Instruction::Write { address: 116, data: position(512) },
                1,
                "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
            ),
            (
                Instruction::RegWrite { address: 104, data: position(200) },
                1,
                "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
            ),
            (Instruction::Action, 1, "FF FF FD 00 01 03 00 05 02 CE"),
            (Instruction::Reboot, 1, "FF FF FD 00 01 03 00 08 2F 4E"),
            (
                Instruction::SyncRead { address: 132, length: 4, ids: vec![1, 2] },
                BROADCAST_ID,
                "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
            ),
            (
                Instruction::SyncWrite { address: 116, length: 4, data: vec![(1, position(150)), (2, position(170))] },
                BROADCAST_ID,
                "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
            ),
            (
                Instruction::BulkRead(vec![
                    BulkRead { id: 1, address: 144, length: 2 },
                    BulkRead { id: 2, address: 146, length: 1 },
                ]),
                BROADCAST_ID,
                "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
            ),
            (
                Instruction::BulkWrite(vec![
                    BulkWrite { id: 1, address: 32, data: vec![160, 0] },
                    BulkWrite { id: 2, address: 31, data: vec![80] },
                ]),
                BROADCAST_ID,
                "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
            ),
        ];
        for (instruction, id, expected) in cases {
            assert_eq!(instruction.encode(id), Ok(wire(expected)), "{instruction:?}");
        }
    }

    #[test]
    fn sync_write_of_unequal_lengths_is_refused() {
        let unequal = Instruction::SyncWrite { address: 116, length: 4, data: vec![(1, vec![0; 4]), (2, vec![0; 3])] };
        assert_eq!(unequal.encode(BROADCAST_ID), Err(InstructionError::DataLength { id: 2, found: 3, expected: 4 }));
    }

    #[test]
    fn unfit_packets_are_refused() {
        let packet = |instruction, parameters| Packet { id: 1, instruction, parameters };
        assert_eq!(Instruction::decode(&packet(0x77, vec![])), Err(InstructionError::Unknown(0x77)));
        assert_eq!(
            Instruction::decode(&packet(READ, vec![1, 0, 4])),
            Err(InstructionError::Parameters { instruction: READ, found: 3 })
        );
    }

    fn reads() -> impl Strategy<Value = Vec<BulkRead>> {
        prop::collection::btree_map(any::<u8>(), any::<(u16, u16)>(), 0..6).prop_map(|reads| {
            reads.into_iter().map(|(id, (address, length))| BulkRead { id, address, length }).collect()
        })
    }

    fn instruction() -> impl Strategy<Value = Instruction> {
        prop_oneof![
            Just(Instruction::Ping),
            Just(Instruction::Reboot),
            Just(Instruction::Action),
            (any::<u16>(), any::<u8>(), bytes(30)).prop_map(|(address, first, rest)| Instruction::RegWrite {
                address,
                data: [vec![first], rest].concat()
            }),
            reads().prop_map(Instruction::BulkRead),
            reads().prop_map(Instruction::FastBulkRead),
            prop::collection::btree_map(any::<u8>(), (any::<u16>(), bytes(12)), 0..6).prop_map(|writes| {
                let write = |(id, (address, data))| BulkWrite { id, address, data };
                Instruction::BulkWrite(writes.into_iter().map(write).collect())
            }),
            any::<(u16, u16)>().prop_map(|(address, length)| Instruction::Read { address, length }),
            (any::<u16>(), any::<u8>(), bytes(30))
                .prop_map(|(address, first, rest)| Instruction::Write { address, data: [vec![first], rest].concat() }),
            (any::<u16>(), any::<u16>(), bytes(6)).prop_map(|(address, length, ids)| Instruction::SyncRead {
                address,
                length,
                ids
            }),
            (any::<u16>(), any::<u16>(), bytes(6)).prop_map(|(address, length, ids)| Instruction::FastSyncRead {
                address,
                length,
                ids
            }),
            (any::<u16>(), prop::collection::vec((any::<u8>(), bytes(8)), 0..6)).prop_map(|(address, mut data)| {
                let length = data.iter().map(|(_, bytes)| bytes.len()).max().unwrap_or(0);
                data.iter_mut().for_each(|(_, bytes)| bytes.resize(length, 0xFF));
                Instruction::SyncWrite { address, length: length as u16, data }
            }),
        ]
    }

    proptest! {
        #[test]
        fn round_trip(instruction in instruction(), id in 0..=252_u8) {
            let mut decoder = Decoder::default();
            decoder.push(&instruction.encode(id)?);
            let packet = decoder.next_packet().expect("a whole packet")?;
            prop_assert_eq!(Instruction::decode(&packet)?, instruction);
            prop_assert!(decoder.time_out().is_empty());
        }
    }
}
