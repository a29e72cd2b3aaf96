//! Dynamixel Protocol 2.0, the wire format of the servo bus.
//!
//! A packet is `FF FF FD 00 | id | length (2) | instruction | parameters | crc (2)`, little-endian; the length counts
//! everything after itself. From instruction to last parameter, an `FD` is stuffed after every `FF FF FD`, so that the
//! header never occurs inside a packet; length and CRC are those of the stuffed bytes. A servo answers with a status
//! packet, whose instruction is 0x55 and whose first parameter is an error byte.
//!
//! The layers: [`crc`] and [`stuffing`] work on bytes, [`copy_packet`] on one packet, [`decoder`] on the stream.
//! [`instruction`] and [`status`] are the contents of packets; [`bulk`] has the parameters that name different
//! registers for each servo. [`fast_sync`] is the one answer that several servos write into a single packet.
//!
//! Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0"; the tests use its example packets.

pub mod bulk;
pub mod crc;
pub mod decoder;
pub mod error;
pub mod fast_sync;
pub mod instruction;
pub mod packet;
pub mod status;
pub mod stuffing;

pub use bulk::{BulkRead, BulkWrite};
pub use decoder::{Decoder, StreamError};
pub use instruction::Instruction;
pub use packet::{BROADCAST_ID, Packet, PacketError};
pub use status::{ReplyError, ServoError, Status, sync_read_replies};
