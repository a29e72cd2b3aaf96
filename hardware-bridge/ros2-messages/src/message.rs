//! The interface of all messages, and the parts that they share.

use std::time::Duration;

use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// A ROS 2 message.
pub trait Message: Sized {
    /// Name in ROS 2, `package/msg/Type`.
    const NAME: &'static str;
    /// Definition of the fields, and of nested types, in the format of a bag (`ros2msg`).
    const DEFINITION: &'static str;

    /// Appends the fields.
    fn write(&self, cdr: &mut CdrWriter);

    /// Reads the fields.
    ///
    /// # Errors
    /// [`CdrError`] for a message that is cut short or malformed.
    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError>;

    /// Returns the message as CDR, with its header.
    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::default();
        self.write(&mut cdr);
        cdr.finish()
    }

    /// Reads a message from CDR with its header.
    ///
    /// # Errors
    /// [`CdrError`] for a message that is cut short, malformed or of another encoding.
    fn from_cdr(bytes: &[u8]) -> Result<Self, CdrError> {
        Self::read(&mut CdrReader::new(bytes)?)
    }
}

/// `std_msgs/msg/Header`: time and frame of a measurement.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Header {
    /// Time since 1970 (or since the start of a simulation).
    pub stamp: Duration,
    /// Name of the frame; empty for none.
    pub frame_id: String,
}

impl Header {
    /// Creates a header.
    pub fn new(stamp: Duration, frame_id: &str) -> Self {
        Self { stamp, frame_id: frame_id.to_owned() }
    }

    /// Appends the fields.
    pub fn write(&self, cdr: &mut CdrWriter) {
        // ROS 2 has 32 bits for the seconds, enough until 2038.
        cdr.u32(self.stamp.as_secs() as u32).u32(self.stamp.subsec_nanos()).string(&self.frame_id);
    }

    /// Reads the fields.
    ///
    /// # Errors
    /// [`CdrError`] for a message that is cut short, and for a time before 1970.
    pub fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let (seconds, nanoseconds) = (cdr.u32()?, cdr.u32()?);
        if i32::try_from(seconds).is_err() || nanoseconds >= 1_000_000_000 {
            return Err(CdrError::Field {
                field: "header.stamp",
                found: format!("{} s and {nanoseconds} ns", seconds as i32),
                expected: "no negative time, and less than 1000000000 ns".to_owned(),
            });
        }
        Ok(Self { stamp: Duration::new(seconds.into(), nanoseconds), frame_id: cdr.string()? })
    }
}

/// Definitions that follow those of a message with a header.
macro_rules! header_definition {
    () => {
        "================================================================================\nMSG: std_msgs/Header\n\
         builtin_interfaces/Time stamp\nstring frame_id\n\
         ================================================================================\nMSG: builtin_interfaces/Time\n\
         int32 sec\nuint32 nanosec\n"
    };
}
pub(crate) use header_definition;
