//! Films as animated WebP, which browsers and pages of repositories show as a picture.

use std::sync::mpsc;

use anyhow::{Context as _, Result, anyhow};
use image::RgbImage;
use rayon::prelude::*;
use webp_animation::{ColorMode, Encoder, EncoderOptions, EncodingConfig, Error};

/// Quality of a frame, 0 to 100, and effort of the encoder, 0 to 6.
const QUALITY: f32 = 68.0;
const METHOD: usize = 2;
/// Time for which the last frame stays, s.
const LAST_FRAME_DURATION: f64 = 2.5;
/// Number of frames that are drawn at once.
const BATCH: usize = 32;

/// Encodes frames 0 to `count` of `draw`, all of the same size, at `rate` Hz as an endless animation. The frames are
/// drawn on all cores while the ones before are encoded.
pub fn encode(count: usize, rate: f64, draw: &(dyn Fn(usize) -> RgbImage + Sync)) -> Result<Vec<u8>> {
    let time = |frame: usize| (1e3 * frame as f64 / rate).round() as i32;
    let mut encoding = EncodingConfig::new_lossy(QUALITY);
    encoding.method = METHOD;
    let options =
        EncoderOptions { color_mode: ColorMode::Rgb, encoding_config: Some(encoding), ..EncoderOptions::default() };
    let failed = |error: Error| anyhow!("a film: {error}");
    std::thread::scope(|scope| {
        let (sender, batches) = mpsc::sync_channel::<Vec<RgbImage>>(1);
        scope.spawn(move || {
            for start in (0..count).step_by(BATCH) {
                let batch = (start..count.min(start + BATCH)).into_par_iter().map(draw).collect();
                // Nobody listens after an error of the encoder.
                if sender.send(batch).is_err() {
                    break;
                }
            }
        });
        let mut frames = batches.into_iter().flatten().enumerate().peekable();
        let (_, first) = frames.peek().context("a film: found no frames")?;
        let mut encoder = Encoder::new_with_options(first.dimensions(), options).map_err(failed)?;
        for (n, frame) in frames {
            encoder.add_frame(frame.as_raw(), time(n)).map_err(failed)?;
        }
        let end = time(count) + (1e3 * LAST_FRAME_DURATION) as i32;
        Ok(encoder.finalize(end).map_err(failed)?.to_vec())
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use webp_animation::Decoder;

    use super::*;

    /// Frames come back in their order, with their times and nearly their colours.
    #[test]
    fn frames_come_back() {
        let color = |frame: usize| [(37 * frame % 250) as u8, 200, 90];
        let bytes = encode(40, 25.0, &|frame| RgbImage::from_pixel(64, 48, Rgb(color(frame)))).expect("encoded");
        let decoder = Decoder::new(&bytes).expect("a WebP");
        assert_eq!(decoder.dimensions(), (64, 48));
        let frames: Vec<_> = decoder.into_iter().collect();
        assert_eq!(frames.len(), 40);
        for (n, frame) in frames.iter().enumerate() {
            // A frame's time is the one at which it ends.
            let end = if n == 39 { 1600 + 2500 } else { 40 * (n as i32 + 1) };
            assert_eq!(frame.timestamp(), end, "frame {n}");
            let middle = &frame.data()[4 * (24 * 64 + 32)..][..3];
            for (found, expected) in middle.iter().zip(color(n)) {
                assert!(found.abs_diff(expected) <= 6, "frame {n}: {middle:?}");
            }
        }
        assert!(encode(0, 25.0, &|_| RgbImage::new(8, 8)).is_err());
    }
}
