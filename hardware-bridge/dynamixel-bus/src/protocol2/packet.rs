//! Encoding and decoding of one packet.

use super::crc::crc16;
use super::stuffing::{stuff, unstuff};

/// Start of every packet, with the reserved byte.
pub const HEADER: [u8; 4] = [0xFF, 0xFF, 0xFD, 0x00];
/// Id that addresses all servos.
pub const BROADCAST_ID: u8 = 0xFE;
/// Maximum length field sent or accepted: far above anything that servos need (a whole control table is 228 bytes), and
/// low enough that a damaged length cannot make a reader wait for 64 kB.
pub const MAX_LENGTH: usize = 1024;

/// Bytes before the instruction: header, id, length.
pub(super) const PROLOGUE_LENGTH: usize = 7;
/// Minimum of the length field: instruction and CRC, in a packet without parameters.
pub(super) const MIN_LENGTH: usize = 3;

/// One packet without its framing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// Id of the servo that is addressed or that answers: 0 to 252, or [`BROADCAST_ID`].
    pub id: u8,
    /// Instruction code; 0x55 in a status packet.
    pub instruction: u8,
    /// Parameters, not stuffed.
    pub parameters: Vec<u8>,
}

/// Error in one packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// Invalid id: 253 and 255 would be taken for parts of a header.
    #[error("id: found {0}, expected 0 to 252, or 254 for all")]
    Id(u8),
    /// Impossible or absurd length field.
    #[error("length: found {0}, expected {MIN_LENGTH} to {MAX_LENGTH}")]
    Length(usize),
    /// The packet was damaged in transit.
    #[error("crc: found {found:04x}, expected {expected:04x}")]
    Crc {
        /// CRC at the end of the packet.
        found: u16,
        /// CRC of the bytes before it.
        expected: u16,
    },
    /// The CRC is right, but a byte FD is missing after FF FF FD.
    #[error("byte stuffing: found a bare FF FF FD, expected FF FF FD FD")]
    Stuffing,
}

pub(super) fn check_id(id: u8) -> Result<(), PacketError> {
    if matches!(id, 0xFD | 0xFF) { Err(PacketError::Id(id)) } else { Ok(()) }
}

pub(super) fn check_length(length: usize) -> Result<(), PacketError> {
    if (MIN_LENGTH..=MAX_LENGTH).contains(&length) { Ok(()) } else { Err(PacketError::Length(length)) }
}

impl Packet {
    /// Encodes the packet as bytes on the wire.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        check_id(self.id)?;
        let mut body = Vec::with_capacity(1 + self.parameters.len());
        body.push(self.instruction);
        body.extend_from_slice(&self.parameters);
        let body = stuff(&body);
        let length = body.len() + 2;
        check_length(length)?;
        let mut wire = Vec::with_capacity(PROLOGUE_LENGTH + length);
        wire.extend_from_slice(&HEADER);
        wire.push(self.id);
        wire.extend_from_slice(&(length as u16).to_le_bytes());
        wire.extend_from_slice(&body);
        wire.extend_from_slice(&crc16(&wire).to_le_bytes());
        Ok(wire)
    }

    /// Decodes a whole packet whose header and length have been found: `wire` is exactly as long as its length field
    /// says.
    pub(super) fn decode(wire: &[u8]) -> Result<Self, PacketError> {
        let (signed, crc) = wire.split_at(wire.len() - 2);
        let (found, expected) = (u16::from_le_bytes([crc[0], crc[1]]), crc16(signed));
        if found != expected {
            return Err(PacketError::Crc { found, expected });
        }
        let mut body = unstuff(&signed[PROLOGUE_LENGTH..]).ok_or(PacketError::Stuffing)?;
        let instruction = body.remove(0);
        Ok(Self { id: wire[4], instruction, parameters: body })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_that_look_like_headers_are_refused() {
        for id in [0xFD, 0xFF] {
            assert_eq!(Packet { id, instruction: 1, parameters: vec![] }.encode(), Err(PacketError::Id(id)));
        }
    }

    #[test]
    fn too_long_is_refused() {
        let packet = Packet { id: 1, instruction: 3, parameters: vec![0; MAX_LENGTH] };
        assert_eq!(packet.encode(), Err(PacketError::Length(MAX_LENGTH + 3)));
    }
}
