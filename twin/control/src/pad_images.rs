//! Combines the camera frames into one image per pad, all of one size.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{TactileFrame, TactileImage};

use crate::action::TICKS_PER_STEP;

/// Smallest side of an image, pixels.
pub const MIN_SIDE: usize = 8;

/// An invalid image size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("side of the tactile images: found {0} pixels, expected {MIN_SIDE} to {IMAGE_SIZE}")]
pub struct ImageSizeError(pub usize);

/// Tick of a step, counted from 1, at which images must be captured to arrive within the step, given a latency of
/// `delay` s.
pub fn capture_tick(delay: f64, tick: f64) -> usize {
    // Times are sums of ticks: tolerate rounding up to a thousandth of a tick.
    let under_way = (delay / tick - 1e-3).ceil().max(0.0) as usize;
    TICKS_PER_STEP.saturating_sub(under_way).max(1)
}

/// The newest image of every pad. A pixel is the mean of the camera pixels it covers. Where a pad has two cameras, each
/// shows one half.
#[derive(Debug, Clone)]
pub struct PadImages {
    side: usize,
    newest: Vec<Option<Arc<TactileImage>>>,
    rgb: Vec<u8>,
    times: Vec<Option<f64>>,
}

impl PadImages {
    /// Black images of `side` x `side` pixels.
    pub fn new(hand: &Hand, side: usize) -> Result<Self, ImageSizeError> {
        if !(MIN_SIDE..=IMAGE_SIZE).contains(&side) {
            return Err(ImageSizeError(side));
        }
        let pads = hand.pads.len();
        Ok(Self {
            side,
            newest: vec![None; hand.cameras.len()],
            rgb: vec![0; pads * side * side * 3],
            times: vec![None; pads],
        })
    }

    /// Side of an image, pixels.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Pads x rows x columns x RGB; row 0 is the distal edge.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Capture time of each pad's image, s; `None` for an image from before the scene began.
    pub fn times(&self) -> &[Option<f64>] {
        &self.times
    }

    /// Shows the images of the untouched pads, one per camera.
    pub fn show_backgrounds(&mut self, hand: &Hand, images: Vec<Arc<TactileImage>>) {
        for (newest, image) in self.newest.iter_mut().zip(images) {
            *newest = Some(image);
        }
        for pad in 0..hand.pads.len() {
            self.draw(hand, pad);
        }
    }

    /// Takes the frames that arrived and redraws the pads whose image changed.
    pub fn show(&mut self, hand: &Hand, frames: Vec<TactileFrame>) {
        let mut changed = vec![false; hand.pads.len()];
        for frame in frames {
            let Some(newest) = self.newest.get_mut(frame.camera) else { continue };
            let pad = hand.cameras[frame.camera].pad;
            self.times[pad] = Some(frame.time);
            let same = newest.as_ref().is_some_and(|known| Arc::ptr_eq(known, &frame.image));
            changed[pad] |= !same;
            *newest = Some(frame.image);
        }
        for pad in (0..changed.len()).filter(|pad| changed[*pad]) {
            self.draw(hand, pad);
        }
    }

    /// Composes the image of a pad from the newest images of its cameras, distal to proximal. Does nothing until there
    /// is one of each camera and all have the same size.
    fn draw(&mut self, hand: &Hand, pad: usize) {
        let images: Option<Vec<&TactileImage>> =
            hand.pads[pad].cameras.iter().rev().map(|camera| self.newest[*camera].as_deref()).collect();
        let same_size = |images: &Vec<&TactileImage>| images.iter().all(|image| image.rgb.len() == images[0].rgb.len());
        let Some(images) = images.filter(same_size) else { return };
        let size = self.side * self.side * 3;
        shrink(&images, self.side, &mut self.rgb[pad * size..(pad + 1) * size]);
    }
}

/// Stacks `images`, all of one size, and resamples them to a picture of `side` x `side` pixels.
fn shrink(images: &[&TactileImage], side: usize, picture: &mut [u8]) {
    let size = images.first().map_or(0, |image| (image.rgb.len() / 3).isqrt());
    if let ([image], true) = (images, size == side) {
        picture.copy_from_slice(&image.rgb);
        return;
    }
    let rows = images.len() * size;
    let span = |at: usize, whole: usize| at * whole / side..(at + 1) * whole / side;
    let columns: Vec<_> = (0..side).map(|column| span(column, size)).collect();
    // Rows first, because whole rows add up many values at a time.
    let mut sums = vec![0_u32; 3 * size];
    for (at, line) in picture.chunks_exact_mut(3 * side).enumerate() {
        sums.fill(0);
        let covered = span(at, rows);
        for row in covered.clone() {
            let start = 3 * size * (row % size);
            let values = &images[row / size].rgb[start..start + 3 * size];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += u32::from(*value));
        }
        for (grey, columns) in line.chunks_exact_mut(3).zip(&columns) {
            let count = (covered.len() * columns.len()) as u32;
            let mut total = [count / 2; 3];
            for sum in sums[3 * columns.start..3 * columns.end].chunks_exact(3) {
                total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
            }
            // A mean of bytes is a byte.
            grey.iter_mut().zip(total).for_each(|(grey, total)| *grey = (total / count) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(value: impl Fn(usize, usize, usize) -> u8) -> Arc<TactileImage> {
        let pixels = (0..IMAGE_SIZE).flat_map(|row| (0..IMAGE_SIZE).map(move |column| (row, column)));
        let rgb = pixels.flat_map(|(row, column)| [0, 1, 2].map(|channel| value(row, column, channel))).collect();
        Arc::new(TactileImage { rgb })
    }

    #[test]
    fn full_size_passes_unchanged_and_a_smaller_one_is_the_mean() {
        let original = image(|row, column, channel| ((row * 7 + column * 3) % 200 + channel) as u8);
        let mut full = vec![0; 3 * IMAGE_SIZE * IMAGE_SIZE];
        shrink(&[&original], IMAGE_SIZE, &mut full);
        assert_eq!(full, original.rgb);
        let mut small = vec![0; 3 * 64 * 64];
        shrink(&[&original], 64, &mut small);
        let mean = |values: &[u8]| values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
        assert!((mean(&small) - mean(&full)).abs() < 0.6);
    }

    /// Of the two cameras of the palm's ulnar pad, the one on the fingers' side is shown above the other.
    #[test]
    fn two_cameras_show_the_halves_of_a_pad() {
        let hand = Hand::ftac();
        let pad = hand.pads.iter().position(|pad| pad.cameras.len() == 2).unwrap();
        let mut images = PadImages::new(&hand, 9).unwrap();
        let grey = |camera: usize| {
            let distal = hand.cameras[camera].center_y > 0.0;
            let value = if distal { 200 } else { 40 };
            TactileFrame { camera, time: 0.5, sequence: 1, image: image(move |_, _, _| value) }
        };
        images.show(&hand, hand.pads[pad].cameras.iter().map(|camera| grey(*camera)).collect());
        let picture = &images.rgb()[pad * 243..(pad + 1) * 243];
        assert_eq!((picture[0], picture[242]), (200, 40));
        assert!(picture[4 * 27] > 40 && picture[4 * 27] < 200, "the middle row shows both");
        assert_eq!((images.times()[pad], images.times()[pad + 1]), (Some(0.5), None));
    }

    #[test]
    fn other_sizes_are_refused() {
        let hand = Hand::ftac();
        assert_eq!(PadImages::new(&hand, 7).unwrap_err(), ImageSizeError(7));
        let error = PadImages::new(&hand, 241).unwrap_err().to_string();
        assert_eq!(error, "side of the tactile images: found 241 pixels, expected 8 to 240");
    }
}
