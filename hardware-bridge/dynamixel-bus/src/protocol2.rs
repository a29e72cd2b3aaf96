//! Dynamixel Protocol 2.0, the wire format of the servo bus.
//!
//! A packet is `FF FF FD 00 | id | length (2) | instruction | parameters | crc (2)`, little-endian; the length counts
//! everything after itself. From instruction to last parameter, an `FD` is stuffed after every `FF FF FD`, so that the
//! header never occurs inside a packet; length and CRC are those of the stuffed bytes. A servo answers with a status
//! packet, whose instruction is 0x55 and whose first parameter is an error byte.
//!
//! The layers: [`crc`] and [`stuffing`] work on bytes, [`packet`] on one packet, [`decoder`] on the stream.
//! [`instruction`] and [`status`] are the contents of packets; [`bulk`] has the parameters that name different
//! registers for each servo. [`fast_sync`] is the one answer that several servos write into a single packet.
//!
//! # Example
//! ```
//! use dynamixel_bus::protocol2::{Decoder, Instruction, Status};
//!
//! // Read the present position of servo 1: 4 bytes at 132.
//! let request = Instruction::Read { address: 132, length: 4 }.encode(1)?;
//! assert_eq!(request, [0xFF, 0xFF, 0xFD, 0, 1, 7, 0, 2, 132, 0, 4, 0, 0x1D, 0x15]);
//!
//! // Its answer arrives in pieces, after a stray byte.
//! let mut decoder = Decoder::default();
//! decoder.push(&[0x00, 0xFF, 0xFF, 0xFD, 0, 1, 8, 0]);
//! decoder.push(&[0x55, 0, 0xA6, 0, 0, 0, 0x8C, 0xC0]);
//! let packets = decoder.drain();
//! assert!(packets[0].is_err(), "the stray byte");
//! let status = packets[1].as_ref().ok().and_then(Status::decode).ok_or("no answer")?;
//! assert_eq!((status.id, status.error, status.data), (1, None, vec![166, 0, 0, 0]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
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
pub use status::{ReplyError, ServoError, Status, bulk_read_replies, sync_read_replies};
