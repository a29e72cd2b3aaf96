//! Perception restricted to the senses that an ablation leaves.

use std::borrow::Cow;
use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::parameters::HoldLimits;
use hand_model::robot::{TactileFrame, TactileImage};
use hand_model::{Digit, Hand};
use tactile_perception::{PadPerception, PoseOptions, TouchError, TouchPipeline};
use world::Sensing;

use crate::tactile_snapshot::TactileSnapshot;

/// Side of the blocks of pixels that a coarse image averages, pixels.
const COARSE_BLOCK_SIDE: usize = 10;
/// One of this many pads is left in [`Sensing::QuarterOfPads`].
const PAD_STRIDE: usize = 4;

/// Perception of a hand, restricted to the senses it may use.
#[derive(Debug, Clone)]
pub struct TouchPerception<'a> {
    pipeline: Cow<'a, TouchPipeline>,
    sensing: Sensing,
    hold: HoldLimits,
}

impl<'a> TouchPerception<'a> {
    /// Restricts `pipeline` to `sensing`.
    ///
    /// # Errors
    /// [`TouchError::Hand`] if the hand's file has no thresholds for a hold.
    pub fn new(pipeline: &'a TouchPipeline, sensing: Sensing) -> Result<Self, TouchError> {
        let mut pipeline = Cow::Borrowed(pipeline);
        match sensing {
            Sensing::CoarseImages => {
                let coarse: Vec<_> = pipeline.backgrounds().iter().map(|image| Arc::new(coarsen(image))).collect();
                pipeline = Cow::Owned(pipeline.into_owned().with_backgrounds(coarse)?);
            }
            Sensing::PointsOnly => {
                let pose = PoseOptions { use_contact_free: false, sigma_normal: f64::INFINITY, ..pipeline.pose };
                pipeline.to_mut().pose = pose;
            }
            _ => {}
        }
        let hold = pipeline.hand().parameters.hold()?;
        Ok(Self { pipeline, sensing, hold })
    }

    /// Returns the touch pipeline.
    pub fn pipeline(&self) -> &TouchPipeline {
        &self.pipeline
    }

    /// Thresholds of the signs that the hand holds something.
    pub fn hold_limits(&self) -> &HoldLimits {
        &self.hold
    }

    /// Perceives the contacts on the pads in a tactile snapshot. Cameras that may not be used do not count as faults.
    pub fn perceive(&self, snapshot: &TactileSnapshot) -> Result<PadPerception, TouchError> {
        let hand = self.pipeline.hand();
        let frames = self.remaining_frames(snapshot.images);
        let mut perceived = self.pipeline.perceive_frames(&frames, snapshot.sequences_before)?;
        perceived.faults.retain(|fault| self.uses_pad(hand, hand.cameras[fault.camera].pad));
        Ok(perceived)
    }

    /// True if a pad may be used.
    pub fn uses_pad(&self, hand: &Hand, pad: usize) -> bool {
        let link = hand.pads[pad].link;
        match self.sensing {
            Sensing::ServosOnly => false,
            Sensing::PalmOnly => link.is_none(),
            Sensing::Fingertips => hand.digits().iter().any(|digit| link == hand.links(*digit).last().copied()),
            Sensing::QuarterOfPads => pad.is_multiple_of(PAD_STRIDE),
            _ => true,
        }
    }

    fn remaining_frames<'f>(&self, frames: &'f [TactileFrame]) -> Cow<'f, [TactileFrame]> {
        let hand = self.pipeline.hand();
        match self.sensing {
            Sensing::Full | Sensing::PointsOnly | Sensing::TruePose => Cow::Borrowed(frames),
            Sensing::CoarseImages => frames
                .iter()
                .map(|frame| TactileFrame { image: Arc::new(coarsen(&frame.image)), ..frame.clone() })
                .collect(),
            _ => {
                let used = |frame: &&TactileFrame| {
                    hand.cameras.get(frame.camera).is_some_and(|camera| self.uses_pad(hand, camera.pad))
                };
                frames.iter().filter(used).cloned().collect()
            }
        }
    }
}

/// True if a pad is on one of `digits`.
pub fn is_pad_on_digits(hand: &Hand, pad: usize, digits: &[Digit]) -> bool {
    hand.digit_of(hand.pads[pad].link).is_some_and(|digit| digits.contains(&digit))
}

/// Replaces every block of [`COARSE_BLOCK_SIDE`] x [`COARSE_BLOCK_SIDE`] pixels by its mean. An image of another size
/// is returned unchanged, to be refused later.
fn coarsen(image: &TactileImage) -> TactileImage {
    const WIDTH: usize = IMAGE_SIZE;
    let mut rgb = image.rgb.clone();
    if rgb.len() != 3 * WIDTH * WIDTH {
        return TactileImage { rgb };
    }
    for block in 0..(WIDTH / COARSE_BLOCK_SIDE) * (WIDTH / COARSE_BLOCK_SIDE) {
        let (top, left) = (
            block / (WIDTH / COARSE_BLOCK_SIDE) * COARSE_BLOCK_SIDE,
            block % (WIDTH / COARSE_BLOCK_SIDE) * COARSE_BLOCK_SIDE,
        );
        let inside = || {
            (0..COARSE_BLOCK_SIDE * COARSE_BLOCK_SIDE)
                .map(|n| (top + n / COARSE_BLOCK_SIDE) * WIDTH + left + n % COARSE_BLOCK_SIDE)
        };
        for channel in 0..3 {
            let sum: u32 = inside().map(|pixel| u32::from(image.rgb[3 * pixel + channel])).sum();
            let mean = (sum + (COARSE_BLOCK_SIDE * COARSE_BLOCK_SIDE / 2) as u32)
                / (COARSE_BLOCK_SIDE * COARSE_BLOCK_SIDE) as u32;
            inside().for_each(|pixel| rgb[3 * pixel + channel] = mean as u8);
        }
    }
    TactileImage { rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_image_keeps_the_means_of_its_blocks() {
        let rgb: Vec<u8> = (0..3 * IMAGE_SIZE * IMAGE_SIZE).map(|n| (n * 7 % 251) as u8).collect();
        let coarse = coarsen(&TactileImage { rgb: rgb.clone() });
        let mean = |image: &[u8], channel: usize| {
            let sum: u32 =
                (0..100).map(|n| u32::from(image[3 * ((20 + n / 10) * IMAGE_SIZE + 50 + n % 10) + channel])).sum();
            f64::from(sum) / 100.0
        };
        for channel in 0..3 {
            assert!((mean(&coarse.rgb, channel) - mean(&rgb, channel)).abs() <= 0.5);
        }
        // The image is constant within a block, and coarsening it again changes nothing.
        assert_eq!(coarse.rgb[0], coarse.rgb[3 * (IMAGE_SIZE * 9 + 9)]);
        assert_eq!(coarsen(&coarse), coarse);
    }

    #[test]
    fn each_ablation_leaves_its_pads() {
        let hand = Hand::ftac();
        let image = Arc::new(TactileImage { rgb: vec![100; 3 * IMAGE_SIZE * IMAGE_SIZE] });
        let calibration = tactile_perception::PhotometricCalibration { version: 1, configurations: Default::default() };
        let pipeline = TouchPipeline::new(&hand, calibration, vec![image; hand.cameras.len()]).expect("made");
        let pads = |sensing| {
            let senses = TouchPerception::new(&pipeline, sensing).expect("made");
            (0..hand.pads.len()).filter(|pad| senses.uses_pad(&hand, *pad)).count()
        };
        assert_eq!(pads(Sensing::Full), 17);
        assert_eq!(pads(Sensing::ServosOnly), 0);
        assert_eq!(pads(Sensing::Fingertips), 5);
        assert_eq!(pads(Sensing::QuarterOfPads), 5);
        assert_eq!(pads(Sensing::PalmOnly), hand.pads.iter().filter(|pad| pad.link.is_none()).count());
    }
}
