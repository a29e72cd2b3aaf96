//! Errors of operations on the bus.

use std::io::ErrorKind;
use std::path::PathBuf;

use super::BusSettings;
use crate::protocol2::ReplyError;
use crate::protocol2::error::InstructionError;
use crate::register::RegisterError;

/// Error of an operation on the bus.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The port cannot be opened, read or written.
    #[error("{port}: {}", describe_port_error(.source))]
    Port {
        /// Device path.
        port: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// No time-out follows from the settings.
    #[error("bus settings: found {0:?}, expected a positive baud rate, and times from 0 to 3600 s")]
    Settings(BusSettings),
    /// The request does not fit a packet.
    #[error(transparent)]
    Request(#[from] InstructionError),
    /// There is no usable answer.
    #[error(transparent)]
    Reply(#[from] ReplyError),
    /// The value does not fit its register.
    #[error("servo {id}: {source}")]
    Register {
        /// Id of the servo.
        id: u8,
        /// Error of the value.
        source: RegisterError,
    },
    /// The register does not hold the value that was written.
    #[error("servo {id}: {register}: read back {found}, expected {expected}")]
    ReadBack {
        /// Id of the servo.
        id: u8,
        /// Name of the register.
        register: &'static str,
        /// Value read back, SI.
        found: f64,
        /// Value written, SI.
        expected: f64,
    },
}

/// Describes an operating system's error of a port, with advice where the error alone is no help.
fn describe_port_error(error: &std::io::Error) -> String {
    // A hung-up terminal reads as end of file, or as an input/output error.
    const EIO: i32 = 5;
    let gone = error.kind() == ErrorKind::UnexpectedEof || error.raw_os_error() == Some(EIO);
    if gone { format!("the port is gone; check the USB cable and the adapter ({error})") } else { error.to_string() }
}
