//! `geometry_msgs` and `tf2_msgs`: transforms between frames.

use crate::cdr::{CdrError, CdrReader, CdrWriter};
use crate::message::{Header, Message, header_definition};

/// `geometry_msgs/msg/TransformStamped`: the pose of a frame in its parent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StampedTransform {
    /// Time, and name of the parent frame.
    pub header: Header,
    /// Name of the frame.
    pub child_frame_id: String,
    /// Position, m.
    pub translation: [f64; 3],
    /// Unit quaternion: x, y, z, w.
    pub rotation: [f64; 4],
}

impl StampedTransform {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.string(&self.child_frame_id).array(&self.translation).array(&self.rotation);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let (header, child_frame_id) = (Header::read(cdr)?, cdr.string()?);
        Ok(Self { header, child_frame_id, translation: cdr.array()?, rotation: cdr.array()? })
    }
}

/// `tf2_msgs/msg/TFMessage`: transforms of a moment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Transforms {
    /// The transforms.
    pub transforms: Vec<StampedTransform>,
}

/// Fewest bytes of a transform.
const MIN_TRANSFORM_SIZE: usize = 8 + 4 + 4 + 7 * 8;

impl Message for Transforms {
    const NAME: &'static str = "tf2_msgs/msg/TFMessage";
    const DEFINITION: &'static str = concat!(
        "geometry_msgs/TransformStamped[] transforms\n\
         ================================================================================\nMSG: geometry_msgs/TransformStamped\n\
         std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n\
         ================================================================================\nMSG: geometry_msgs/Transform\n\
         geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n\
         ================================================================================\nMSG: geometry_msgs/Vector3\n\
         float64 x\nfloat64 y\nfloat64 z\n\
         ================================================================================\nMSG: geometry_msgs/Quaternion\n\
         float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
        header_definition!()
    );

    fn write(&self, cdr: &mut CdrWriter) {
        cdr.u32(self.transforms.len() as u32);
        self.transforms.iter().for_each(|transform| transform.write(cdr));
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let count = cdr.length(MIN_TRANSFORM_SIZE)?;
        Ok(Self { transforms: (0..count).map(|_| StampedTransform::read(cdr)).collect::<Result<_, _>>()? })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn transforms_are_read_as_written() {
        let transform = |parent: &str, child: &str| StampedTransform {
            header: Header::new(Duration::new(3, 4), parent),
            child_frame_id: child.to_owned(),
            translation: [0.1, 0.2, 0.3],
            rotation: [0.0, 0.0, 0.0, 1.0],
        };
        let all = Transforms { transforms: vec![transform("world", "base_link"), transform("base_link", "palm")] };
        let bytes = all.to_cdr();
        assert_eq!(Transforms::from_cdr(&bytes).as_ref(), Ok(&all));
        // The last number: byte 152 after the header.
        assert_eq!(bytes[bytes.len() - 8..], 1.0_f64.to_le_bytes());
        assert!(Transforms::from_cdr(&bytes[..bytes.len() - 1]).is_err());
    }
}
