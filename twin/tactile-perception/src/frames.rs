//! Validity of the frames of the camera board.
//!
//! A camera that is dead, frozen or blinded must not read as "nothing touches here". Its image is left out, the fault is
//! reported, and its pad counts as [blind](crate::PadTouch::blind) in all later steps.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::robot::{TactileFrame, TactileImage};

use crate::PIXELS;

/// Mean grey level below which an image counts as black.
const BLACK_LEVEL: f64 = 8.0;
/// Smallest value that counts as saturated.
const SATURATION_LEVEL: u8 = 250;
/// Largest share of saturated values in a valid image.
const MAX_SATURATED_SHARE: f64 = 0.25;
/// Every `VALUE_STRIDE`-th value is examined.
const VALUE_STRIDE: usize = 31;

/// Fault for which a camera is left out.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ImageFault {
    /// No image.
    #[error("no image arrived")]
    Missing,
    /// An image of the wrong size.
    #[error("its image has {found} bytes, expected {expected}")]
    Size {
        /// Number of bytes.
        found: usize,
        /// Number of bytes of a full image.
        expected: usize,
    },
    /// The sequence number has not increased.
    #[error("its image is frozen at sequence number {sequence}")]
    Frozen {
        /// Sequence number of the last two frames.
        sequence: u64,
    },
    /// A black image.
    #[error("its image is black (mean grey level {mean:.1}, expected at least {BLACK_LEVEL})")]
    Black {
        /// Mean grey level.
        mean: f64,
    },
    /// A saturated image.
    #[error("{share:.2} of its image is saturated, expected at most {MAX_SATURATED_SHARE}")]
    Saturated {
        /// Share of saturated values, 0 to 1.
        share: f64,
    },
    /// There is no photometric model for its pad.
    #[error("sensor configuration `{0}` is missing from the calibration")]
    Uncalibrated(char),
}

/// A camera that is left out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("camera {name}: {fault}")]
pub struct CameraFault {
    /// Index of the camera.
    pub camera: usize,
    /// Name of the camera.
    pub name: String,
    /// The fault.
    pub fault: ImageFault,
}

/// The fault visible in a single image, if any.
pub fn image_fault(image: &TactileImage) -> Option<ImageFault> {
    if image.rgb.len() != 3 * PIXELS {
        return Some(ImageFault::Size { found: image.rgb.len(), expected: 3 * PIXELS });
    }
    let (mut sum, mut high, mut count) = (0u64, 0usize, 0usize);
    for &value in image.rgb.iter().step_by(VALUE_STRIDE) {
        sum += u64::from(value);
        high += usize::from(value >= SATURATION_LEVEL);
        count += 1;
    }
    let (mean, share) = (sum as f64 / count as f64, high as f64 / count as f64);
    if mean < BLACK_LEVEL {
        return Some(ImageFault::Black { mean });
    }
    (share > MAX_SATURATED_SHARE).then_some(ImageFault::Saturated { share })
}

/// Returns the newest valid image of every camera, in camera order, and the faults of the other cameras. `before` has
/// the last sequence number of each camera from before the images were requested, if there was one.
pub fn valid_images(
    hand: &Hand,
    frames: &[TactileFrame],
    before: &[Option<u64>],
) -> (Vec<Option<Arc<TactileImage>>>, Vec<CameraFault>) {
    let mut faults = Vec::new();
    let images = (0..hand.cameras.len())
        .map(|camera| {
            let newest = frames.iter().filter(|frame| frame.camera == camera).max_by_key(|frame| frame.sequence);
            let fault = match newest {
                None => ImageFault::Missing,
                Some(frame)
                    if before.get(camera).copied().flatten().is_some_and(|sequence| frame.sequence <= sequence) =>
                {
                    ImageFault::Frozen { sequence: frame.sequence }
                }
                Some(frame) => match image_fault(&frame.image) {
                    None => return Some(frame.image.clone()),
                    Some(fault) => fault,
                },
            };
            faults.push(CameraFault { camera, name: hand.cameras[camera].name.clone(), fault });
            None
        })
        .collect();
    (images, faults)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(hand: &Hand, sequence: u64) -> Vec<TactileFrame> {
        let image = Arc::new(TactileImage { rgb: vec![115; 3 * PIXELS] });
        (0..hand.cameras.len())
            .map(|camera| TactileFrame { camera, time: 1.0, sequence, image: image.clone() })
            .collect()
    }

    #[test]
    fn each_fault_is_named_and_only_its_camera_left_out() {
        let hand = Hand::ftac();
        let mut sent = frames(&hand, 5);
        let with = |value: u8, count: usize| Arc::new(TactileImage { rgb: vec![value; count] });
        sent[1].image = with(115, 7);
        sent[2].image = with(0, 3 * PIXELS);
        sent[3].image = with(255, 3 * PIXELS);
        sent[4].sequence = 4;
        sent.remove(9);
        let mut before = vec![None; hand.cameras.len()];
        before[4] = Some(4);
        let (images, faults) = valid_images(&hand, &sent, &before);
        let found: Vec<(usize, ImageFault)> = faults.iter().map(|fault| (fault.camera, fault.fault)).collect();
        let expected = [
            (1, ImageFault::Size { found: 7, expected: 3 * PIXELS }),
            (2, ImageFault::Black { mean: 0.0 }),
            (3, ImageFault::Saturated { share: 1.0 }),
            (4, ImageFault::Frozen { sequence: 4 }),
            (9, ImageFault::Missing),
        ];
        assert_eq!(found, expected);
        assert_eq!(images.iter().filter(|image| image.is_none()).count(), 5);
        let text = faults[0].to_string();
        assert!(text.contains(&hand.cameras[1].name) && text.contains("7 bytes, expected 172800"), "{text}");
    }

    #[test]
    fn a_board_in_order_has_no_faults() {
        let hand = Hand::ftac();
        let (images, faults) = valid_images(&hand, &frames(&hand, 2), &vec![Some(1); hand.cameras.len()]);
        assert!(faults.is_empty() && images.iter().all(Option::is_some));
    }
}
