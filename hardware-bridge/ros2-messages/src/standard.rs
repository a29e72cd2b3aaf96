//! `std_msgs`: text and arrays of numbers.

use crate::cdr::{CdrError, CdrReader, CdrWriter};
use crate::message::Message;

/// `std_msgs/msg/String`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Text {
    /// The text.
    pub data: String,
}

impl Message for Text {
    const NAME: &'static str = "std_msgs/msg/String";
    const DEFINITION: &'static str = "string data\n";

    fn write(&self, cdr: &mut CdrWriter) {
        cdr.string(&self.data);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Ok(Self { data: cdr.string()? })
    }
}

/// `std_msgs/msg/Float64MultiArray` of one dimension: what the forward command controllers of `ros2_control` take, a
/// number for each joint in the order of the controller's parameters.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Float64Array {
    /// The numbers.
    pub data: Vec<f64>,
}

impl Message for Float64Array {
    const NAME: &'static str = "std_msgs/msg/Float64MultiArray";
    const DEFINITION: &'static str = "std_msgs/MultiArrayLayout layout\nfloat64[] data\n\
         ================================================================================\nMSG: std_msgs/MultiArrayLayout\n\
         std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n\
         ================================================================================\nMSG: std_msgs/MultiArrayDimension\n\
         string label\nuint32 size\nuint32 stride\n";

    fn write(&self, cdr: &mut CdrWriter) {
        // No dimensions are described, and the offset is 0: the controllers read the numbers alone.
        cdr.u32(0).u32(0).numbers(&self.data);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        for _ in 0..cdr.length(12)? {
            cdr.string()?;
            cdr.u32()?;
            cdr.u32()?;
        }
        cdr.u32()?;
        Ok(Self { data: cdr.numbers()? })
    }
}
