//! Instructions that cannot be sent or understood.

use super::packet::PacketError;

/// An instruction that cannot be sent or understood.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InstructionError {
    /// The instruction does not fit a packet.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// A sync write has data of different lengths, or a bulk write is too long.
    #[error("write to servo {id}: found {found} bytes, expected {expected}")]
    DataLength {
        /// Id of the servo.
        id: u8,
        /// Length of its data.
        found: usize,
        /// Length expected.
        expected: usize,
    },
    /// A bulk instruction names a servo twice.
    #[error("bulk instruction: servo {id} is named twice")]
    Repeated {
        /// Id of the servo.
        id: u8,
    },
    /// The instruction code is unknown.
    #[error("instruction: found {0:#04x}, expected one of 01 02 03 04 05 08 82 83 8a 92 93 9a")]
    Unknown(u8),
    /// The parameters do not fit the instruction.
    #[error("instruction {instruction:#04x}: found {found} parameters, which do not fit it")]
    Parameters {
        /// Instruction code.
        instruction: u8,
        /// Number of parameters.
        found: usize,
    },
}
