//! The message of a tactile image, which holds its change since the camera's previous one.

use std::collections::BTreeMap;
use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{self, TactileImage};

use crate::message::required;
use crate::sizes::{InvalidField, RobotSizes};

/// Number of pixels in an image of a tactile camera.
const PIXEL_COUNT: usize = IMAGE_SIZE * IMAGE_SIZE;

/// Last image of every camera, to which a frame without pixels refers.
pub(crate) type LastImages = BTreeMap<usize, Arc<TactileImage>>;

/// Message for [`robot::TactileFrame`].
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct TactileFrame {
    /// Index of the camera.
    #[prost(uint32, optional, tag = "1")]
    pub camera: Option<u32>,
    /// Capture time, s.
    #[prost(double, optional, tag = "2")]
    pub time: Option<f64>,
    /// Sequence number of this camera's image.
    #[prost(uint64, optional, tag = "3")]
    pub sequence: Option<u64>,
    /// RGB pixels, row by row; absent if `rgb_change` is present, or if they equal those of this camera's previous frame.
    #[prost(bytes = "vec", optional, tag = "4")]
    pub rgb: Option<Vec<u8>>,
    /// RGB pixels minus those of this camera's previous frame, modulo 256: its small numbers are compressed well.
    #[prost(bytes = "vec", optional, tag = "5")]
    pub rgb_change: Option<Vec<u8>>,
}

fn each_byte(one: &[u8], other: &[u8], combine: fn(u8, u8) -> u8) -> Vec<u8> {
    one.iter().zip(other).map(|(one, other)| combine(*one, *other)).collect()
}

impl TactileFrame {
    /// Builds the message for the file. `last` holds the images written before and is updated.
    pub(crate) fn new(frame: &robot::TactileFrame, last: &mut LastImages) -> Self {
        let image = &frame.image;
        let (rgb, rgb_change) = match last.insert(frame.camera, Arc::clone(image)) {
            // An idle pad repeats the same image; a simulated one even shares its memory.
            Some(before) if Arc::ptr_eq(&before, image) || before == *image => (None, None),
            Some(before) if before.rgb.len() == image.rgb.len() => {
                (None, Some(each_byte(&image.rgb, &before.rgb, u8::wrapping_sub)))
            }
            _ => (Some(image.rgb.clone()), None),
        };
        let (camera, time, sequence) = (frame.camera as u32, frame.time, frame.sequence);
        Self { camera: Some(camera), time: Some(time), sequence: Some(sequence), rgb, rgb_change }
    }

    /// Reads the message, of a robot of these `sizes`. `last` holds the images read before and is updated.
    ///
    /// # Errors
    /// The invalid field.
    pub(crate) fn read(self, last: &mut LastImages, sizes: RobotSizes) -> Result<robot::TactileFrame, InvalidField> {
        let camera = required("tactile.camera", self.camera)? as usize;
        if let RobotSizes::Of { cameras, .. } = sizes {
            if camera >= cameras {
                return Err(("tactile.camera", camera.to_string(), format!("0 to {}", cameras.saturating_sub(1))));
            }
            if let Some(rgb) = self.rgb.as_ref().filter(|rgb| rgb.len() != PIXEL_COUNT * 3) {
                return Err(("tactile.rgb", format!("{} bytes", rgb.len()), format!("{} bytes", PIXEL_COUNT * 3)));
            }
        }
        let before = || {
            let expected = || ("tactile.rgb", "missing".to_owned(), format!("the first image of camera {camera}"));
            last.get(&camera).ok_or_else(expected)
        };
        let image = match (self.rgb, self.rgb_change) {
            (Some(rgb), _) => Arc::new(TactileImage { rgb }),
            (None, Some(change)) => {
                let before = &before()?.rgb;
                if change.len() != before.len() {
                    let (found, expected) = (change.len(), before.len());
                    return Err(("tactile.rgb_change", format!("{found} bytes"), format!("{expected} bytes")));
                }
                Arc::new(TactileImage { rgb: each_byte(before, &change, u8::wrapping_add) })
            }
            (None, None) => Arc::clone(before()?),
        };
        last.insert(camera, Arc::clone(&image));
        let (time, sequence) = (required("tactile.time", self.time)?, required("tactile.sequence", self.sequence)?);
        Ok(robot::TactileFrame { camera, time, sequence, image })
    }
}

#[cfg(test)]
mod tests {
    use hand_model::RobotModel;
    use hand_model::robot::{ArmState, ServoState};

    use super::*;
    use crate::message::Observation;

    /// The same pixels are written once per camera, and are one shared image when read.
    #[test]
    fn unchanged_images_are_not_repeated() {
        let image = |value| Arc::new(TactileImage { rgb: vec![value; 12] });
        let frame = |camera, sequence, image: &Arc<TactileImage>| robot::TactileFrame {
            camera,
            time: 0.5,
            sequence,
            image: Arc::clone(image),
        };
        let (dark, light) = (image(1), image(9));
        let tactile = vec![
            frame(0, 0, &dark),
            frame(1, 0, &dark),
            frame(0, 1, &dark),
            frame(0, 2, &image(1)),
            frame(0, 3, &light),
            frame(1, 1, &dark),
        ];
        let observation = robot::Readings { tactile, ..Default::default() };
        let written = Observation::new(&observation, &mut LastImages::new());
        let has_pixels: Vec<bool> = written.tactile.iter().map(|frame| frame.rgb.is_some()).collect();
        assert_eq!(has_pixels, [true, true, false, false, false, false]);
        let changes: Vec<_> = written.tactile.iter().map(|frame| frame.rgb_change.clone()).collect();
        assert_eq!(changes, [None, None, None, None, Some(vec![8; 12]), None]);
        let back = written.read(&mut LastImages::new(), RobotSizes::Any).expect("readable");
        for (found, expected) in back.tactile.iter().zip(&observation.tactile) {
            assert_eq!((found.camera, found.sequence), (expected.camera, expected.sequence));
            assert_eq!(found.image, expected.image);
        }
        assert!(Arc::ptr_eq(&back.tactile[0].image, &back.tactile[3].image));
    }

    #[test]
    fn an_image_that_no_camera_of_the_hand_takes_is_refused() {
        let read = |camera, bytes| {
            let frame = TactileFrame {
                camera: Some(camera),
                time: Some(0.0),
                sequence: Some(0),
                rgb: Some(vec![0; bytes]),
                rgb_change: None,
            };
            let servos = [ServoState::default(); 6].into();
            let arm = ArmState::at_rest([0.0; 7].into());
            let readings = robot::Readings::from(robot::Observation { servos, arm, ..Default::default() });
            let observation =
                Observation { tactile: vec![frame], ..Observation::new(&readings, &mut LastImages::new()) };
            observation.read(&mut LastImages::new(), RobotSizes::from_robot(&RobotModel::ftac_gen3())).map(|_| ())
        };
        assert_eq!(read(17, 172_800), Ok(()));
        assert_eq!(read(18, 172_800), Err(("tactile.camera", "18".to_owned(), "0 to 17".to_owned())));
        assert_eq!(read(0, 48), Err(("tactile.rgb", "48 bytes".to_owned(), "172800 bytes".to_owned())));
    }
}
