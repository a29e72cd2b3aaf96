//! `sensor_msgs`: joint states, images and camera parameters.

use crate::cdr::{CdrError, CdrReader, CdrWriter};
use crate::message::{Header, Message, header_definition};

/// `sensor_msgs/msg/JointState`. Each list has a value for each name, or is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointState {
    /// Time of the measurement; the frame is not used.
    pub header: Header,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Efforts, N m or N.
    pub effort: Vec<f64>,
}

impl Message for JointState {
    const NAME: &'static str = "sensor_msgs/msg/JointState";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        header_definition!()
    );

    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.strings(&self.name).numbers(&self.position).numbers(&self.velocity).numbers(&self.effort);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(cdr)?;
        let name = cdr.strings()?;
        let (position, velocity, effort) = (cdr.numbers()?, cdr.numbers()?, cdr.numbers()?);
        for (field, values) in [("position", &position), ("velocity", &velocity), ("effort", &effort)] {
            if !values.is_empty() && values.len() != name.len() {
                let expected = format!("{}, one for each name, or none", name.len());
                return Err(CdrError::Field { field, found: format!("{} values", values.len()), expected });
            }
        }
        Ok(Self { header, name, position, velocity, effort })
    }
}

/// `sensor_msgs/msg/Image`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Image {
    /// Time of capture and frame of the camera: z along the view, x to the right, y down.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Format of a pixel, such as `rgb8`.
    pub encoding: String,
    /// True if numbers of several bytes have the most significant first.
    pub is_bigendian: bool,
    /// Bytes of a row.
    pub step: u32,
    /// Pixels, row by row.
    pub data: Vec<u8>,
}

impl Image {
    /// Creates a square image of `side` pixels from row-major RGB.
    pub fn rgb(header: Header, side: u32, data: Vec<u8>) -> Self {
        Self {
            header,
            height: side,
            width: side,
            encoding: "rgb8".to_owned(),
            is_bigendian: false,
            step: 3 * side,
            data,
        }
    }

    /// Returns the pixels as row-major RGB without gaps between rows.
    ///
    /// # Errors
    /// [`CdrError::Field`] for an encoding other than `rgb8` and `bgr8`, and for rows that are too short or missing.
    pub fn into_rgb(self) -> Result<Vec<u8>, CdrError> {
        let swapped = match self.encoding.as_str() {
            "rgb8" => false,
            "bgr8" => true,
            _ => {
                let (found, expected) = (format!("`{}`", self.encoding), "`rgb8` or `bgr8`".to_owned());
                return Err(CdrError::Field { field: "encoding", found, expected });
            }
        };
        let (row, step, height) = (3 * self.width as usize, self.step as usize, self.height as usize);
        let needed = step.saturating_mul(height);
        if step < row || self.data.len() < needed {
            let found = format!("{} bytes in rows of {step}", self.data.len());
            let expected = format!("{height} rows of {row} bytes or more");
            return Err(CdrError::Field { field: "data", found, expected });
        }
        let mut rgb = self.data;
        if step != row || rgb.len() != needed {
            rgb = rgb.chunks_exact(step.max(1)).take(height).flat_map(|line| &line[..row]).copied().collect();
        }
        if swapped {
            rgb.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
        }
        Ok(rgb)
    }
}

impl Message for Image {
    const NAME: &'static str = "sensor_msgs/msg/Image";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
        header_definition!()
    );

    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.u32(self.height).u32(self.width).string(&self.encoding).u8(self.is_bigendian.into());
        cdr.u32(self.step).bytes(&self.data);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Ok(Self {
            header: Header::read(cdr)?,
            height: cdr.u32()?,
            width: cdr.u32()?,
            encoding: cdr.string()?,
            is_bigendian: cdr.u8()? != 0,
            step: cdr.u32()?,
            data: cdr.bytes()?.to_vec(),
        })
    }
}

/// `sensor_msgs/msg/CameraInfo` of a camera without binning and without a region of interest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraInfo {
    /// Time and frame of the image.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Model of the distortion, such as `plumb_bob`.
    pub distortion_model: String,
    /// Parameters of the distortion.
    pub d: Vec<f64>,
    /// Intrinsic matrix, row by row.
    pub k: [f64; 9],
    /// Rectification, row by row.
    pub r: [f64; 9],
    /// Projection, row by row.
    pub p: [f64; 12],
}

impl CameraInfo {
    /// Creates the parameters of a square image of `side` pixels from a pinhole camera without distortion, with focal
    /// lengths (pixels) along columns and rows, and its principal point in the centre.
    pub fn pinhole(header: Header, side: u32, [fx, fy]: [f64; 2]) -> Self {
        let center = 0.5 * (f64::from(side) - 1.0);
        Self {
            header,
            height: side,
            width: side,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.0; 5],
            k: [fx, 0.0, center, 0.0, fy, center, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, center, 0.0, 0.0, fy, center, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
    }
}

impl Message for CameraInfo {
    const NAME: &'static str = "sensor_msgs/msg/CameraInfo";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
         float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n\
         ================================================================================\nMSG: sensor_msgs/RegionOfInterest\n\
         uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
        header_definition!()
    );

    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.u32(self.height).u32(self.width).string(&self.distortion_model).numbers(&self.d);
        cdr.array(&self.k).array(&self.r).array(&self.p);
        // Binning, then the region of interest: zeros stand for the whole image.
        cdr.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let info = Self {
            header: Header::read(cdr)?,
            height: cdr.u32()?,
            width: cdr.u32()?,
            distortion_model: cdr.string()?,
            d: cdr.numbers()?,
            k: cdr.array()?,
            r: cdr.array()?,
            p: cdr.array()?,
        };
        for _ in 0..6 {
            cdr.u32()?;
        }
        cdr.u8()?;
        Ok(info)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Compares with a layout worked out by hand: numbers aligned to their size after the header, strings with a
    /// terminating zero.
    #[test]
    fn a_joint_state_is_laid_out_as_cdr() {
        let header = Header::new(Duration::new(7, 9), "");
        let state =
            JointState { header, name: vec!["ab".into()], position: vec![1.0], velocity: vec![], effort: vec![2.0] };
        let mut expected = vec![0, 1, 0, 0];
        expected.extend([7, 0, 0, 0, 9, 0, 0, 0]);
        // An empty frame: length 1, its zero, then padding.
        expected.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        expected.extend([1, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0]);
        // One number at 32.
        expected.extend([1, 0, 0, 0]);
        expected.extend(1.0_f64.to_le_bytes());
        expected.extend([0, 0, 0, 0, 1, 0, 0, 0]);
        expected.extend(2.0_f64.to_le_bytes());
        assert_eq!(state.to_cdr(), expected);
        assert_eq!(JointState::from_cdr(&expected), Ok(state));
    }

    #[test]
    fn a_joint_state_has_a_value_for_each_name() {
        let state = JointState { name: vec!["a".into(), "b".into()], position: vec![1.0], ..JointState::default() };
        let error = JointState::from_cdr(&state.to_cdr()).expect_err("refused").to_string();
        assert_eq!(error, "position: found 1 values, expected 2, one for each name, or none");
    }

    #[test]
    fn an_image_ends_with_its_pixels() {
        let bytes = Image::rgb(Header::new(Duration::ZERO, "pad"), 1, vec![5; 6]).to_cdr();
        assert!(bytes.ends_with(&[6, 0, 0, 0, 5, 5, 5, 5, 5, 5]));
        assert_eq!((bytes.len() - 6) % 4, 0);
    }

    #[test]
    fn an_image_becomes_rgb_without_gaps() {
        let image = Image { width: 1, height: 2, step: 4, encoding: "bgr8".into(), ..Image::default() };
        let data = vec![1, 2, 3, 0, 4, 5, 6, 0];
        assert_eq!(Image { data: data.clone(), ..image.clone() }.into_rgb(), Ok(vec![3, 2, 1, 6, 5, 4]));
        let grey = Image { encoding: "mono8".into(), data: data.clone(), ..image.clone() }.into_rgb();
        assert_eq!(grey.expect_err("refused").to_string(), "encoding: found `mono8`, expected `rgb8` or `bgr8`");
        let short = Image { data: data[..7].to_vec(), ..image }.into_rgb().expect_err("refused").to_string();
        assert_eq!(short, "data: found 7 bytes in rows of 4, expected 2 rows of 3 bytes or more");
    }

    #[test]
    fn camera_parameters_are_read_as_written() {
        let info = CameraInfo::pinhole(Header::new(Duration::new(1, 2), "camera"), 240, [200.0, 210.0]);
        assert_eq!((info.k[2], info.p[5]), (119.5, 210.0));
        assert_eq!(CameraInfo::from_cdr(&info.to_cdr()), Ok(info));
    }
}
