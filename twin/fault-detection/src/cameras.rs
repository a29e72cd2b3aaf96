//! Detectors for the cameras behind the pads: dead cameras, frozen images, and dimmed lamps.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{TactileFrame, TactileImage};

use super::cables::Finding;
use super::fault::FaultKind;
use super::limits::CameraLimits;

/// Sampling stride of the compared pixels in both directions, px.
const SAMPLE_STRIDE: usize = 10;
/// Darkest value used for a brightness ratio; darker ones are too noisy.
const MIN_BRIGHTNESS: u8 = 24;

/// State of one camera.
#[derive(Debug, Clone, Default)]
struct CameraState {
    newest: Option<(u64, Arc<TactileImage>)>,
    /// Samples of its first image, RGB.
    first: Vec<[u8; 3]>,
    /// Number of images taken, by their sequence numbers. An image lost on the way, or overtaken by the next, does not
    /// count as missing.
    taken: u32,
    /// Number of consecutive images that repeat the one before.
    repeats: u32,
    /// True if the newest image repeats the one before.
    repeated: bool,
    /// Number of consecutive images with a dimmed colour.
    dimmed: u32,
    dead: bool,
    drifted: bool,
}

/// Detector for all cameras.
#[derive(Debug, Clone)]
pub struct CameraWatch {
    cameras: Vec<CameraState>,
    /// Time since which images have been requested without any arriving, s.
    waits_since: Option<f64>,
    /// True if that silence was reported.
    silent: bool,
    /// Longest wait that ended with images, s.
    longest_wait: f64,
}

impl CameraWatch {
    /// Creates the detector for a hand with this many cameras.
    pub fn new(cameras: usize) -> Self {
        Self { cameras: vec![CameraState::default(); cameras], waits_since: None, silent: false, longest_wait: 0.0 }
    }
}

/// Samples every tenth pixel of every tenth row, RGB. Empty if the image has another size.
fn samples(image: &TactileImage) -> Vec<[u8; 3]> {
    if image.rgb.len() != IMAGE_SIZE * IMAGE_SIZE * 3 {
        return Vec::new();
    }
    let rows = (SAMPLE_STRIDE / 2..IMAGE_SIZE).step_by(SAMPLE_STRIDE);
    rows.flat_map(|row| {
        (SAMPLE_STRIDE / 2..IMAGE_SIZE).step_by(SAMPLE_STRIDE).map(move |column| row * IMAGE_SIZE + column)
    })
    .map(|pixel| std::array::from_fn(|channel| image.rgb[3 * pixel + channel]))
    .collect()
}

/// Returns the median brightness of each colour over the samples, as a share of `first`. `None` if too few samples are
/// bright enough.
fn brightness(first: &[[u8; 3]], now: &[[u8; 3]]) -> Option<[f64; 3]> {
    let mut medians = [0.0; 3];
    for (channel, median) in medians.iter_mut().enumerate() {
        let lit = first.iter().zip(now).filter(|(first, _)| first[channel] > MIN_BRIGHTNESS);
        let mut shares: Vec<f64> =
            lit.map(|(first, now)| f64::from(now[channel]) / f64::from(first[channel])).collect();
        if shares.len() < 20 {
            return None;
        }
        let middle = shares.len() / 2;
        *median = *shares.select_nth_unstable_by(middle, f64::total_cmp).1;
    }
    Some(medians)
}

impl CameraWatch {
    /// Returns the median number of images taken per camera.
    fn median_image_count(&self) -> u32 {
        let mut taken: Vec<u32> = self.cameras.iter().map(|camera| camera.taken).collect();
        taken.sort_unstable();
        taken[self.cameras.len() / 2]
    }

    /// Processes the newest images of all cameras at `time` (s); `asked` is true if new ones were requested. Returns
    /// the findings with their cameras, or without one if all cameras are concerned. In `real_time` the latency of
    /// images depends on host and link, so only a wait much longer than any before counts as silence.
    pub fn update(
        &mut self,
        limits: &CameraLimits,
        (time, asked, real_time): (f64, bool, bool),
        images: &[TactileFrame],
    ) -> Vec<(Option<usize>, Finding)> {
        let (mut fresh, usual, cameras) = (Vec::new(), self.median_image_count(), self.cameras.len());
        for frame in images.iter().filter(|frame| frame.camera < cameras) {
            let camera = &mut self.cameras[frame.camera];
            if camera.newest.as_ref().is_some_and(|(sequence, _)| *sequence == frame.sequence) {
                continue;
            }
            let before = camera.newest.replace((frame.sequence, frame.image.clone()));
            let same = |image: &Arc<TactileImage>| Arc::ptr_eq(image, &frame.image) || **image == *frame.image;
            camera.repeated = before.as_ref().is_some_and(|(_, image)| same(image));
            camera.repeats = if camera.repeated { camera.repeats + 1 } else { 0 };
            // A camera's first image sets its count to one above the median of all cameras.
            camera.taken = match &before {
                None => usual + 1,
                Some((sequence, _)) => {
                    let numbers = frame.sequence.saturating_sub(*sequence).max(1);
                    camera.taken.saturating_add(u32::try_from(numbers).unwrap_or(1))
                }
            };
            fresh.push(frame.camera);
        }
        if fresh.is_empty() {
            let waits = asked.then_some(time);
            self.waits_since = self.waits_since.or(waits);
            let timeout = if real_time { limits.silent_real.max(3.0 * self.longest_wait) } else { limits.silent };
            let silent = self.waits_since.is_some_and(|since| time > since + timeout);
            let named = silent && !std::mem::replace(&mut self.silent, silent);
            return if named { vec![(None, (FaultKind::CameraDead, 0.0, 1.0))] } else { Vec::new() };
        }
        self.longest_wait = self.longest_wait.max(self.waits_since.map_or(0.0, |since| time - since));
        (self.waits_since, self.silent) = (asked.then_some(time), false);
        let usual = self.median_image_count();
        // Without read-out noise an idle pad repeats its image, as most cameras then do.
        let repeating = self.cameras.iter().filter(|camera| camera.repeated).count();
        let (lively, alone) = (repeating <= cameras / 2, repeating == 1);
        let missed = if real_time { limits.missed_real } else { limits.missed };
        let mut found = Vec::new();
        for (n, camera) in self.cameras.iter_mut().enumerate() {
            let behind = usual.saturating_sub(camera.taken);
            let frozen = lively && camera.repeats >= limits.missed || alone && camera.repeated;
            if !camera.dead && (behind >= missed || frozen) {
                camera.dead = true;
                found.push((
                    Some(n),
                    (FaultKind::CameraDead, f64::from(camera.taken.saturating_sub(camera.repeats)), f64::from(usual)),
                ));
            }
            if behind == 0 && camera.dimmed == 0 {
                camera.dead &= frozen;
            }
        }
        for n in fresh {
            let camera = &mut self.cameras[n];
            let Some((_, image)) = &camera.newest else { continue };
            let now = samples(image);
            if camera.first.is_empty() {
                camera.first = now;
                continue;
            }
            let Some(shares) = brightness(&camera.first, &now) else { continue };
            let brightest = shares.iter().copied().fold(f64::EPSILON, f64::max);
            let worst = shares.iter().copied().fold(f64::INFINITY, f64::min) / brightest;
            let black = shares.iter().all(|share| *share < limits.black);
            let dim = black || worst < limits.colour;
            camera.dimmed = if dim { camera.dimmed + 1 } else { 0 };
            if camera.dimmed < limits.drifted {
                continue;
            }
            if black && !camera.dead {
                camera.dead = true;
                found.push((Some(n), (FaultKind::CameraDead, 0.0, 1.0)));
            } else if !black && !camera.drifted {
                camera.drifted = true;
                found.push((Some(n), (FaultKind::PadDrifted, worst, 1.0)));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::limits::DetectionLimits;
    use super::*;

    const CAMERAS: usize = 18;

    /// Returns the findings over eight captures. `image` maps capture, camera and usual image to the camera's image in
    /// that capture.
    fn detected_faults(
        image: impl Fn(usize, usize, TactileImage) -> Option<TactileImage>,
    ) -> Vec<(usize, usize, FaultKind)> {
        let limits = DetectionLimits::standard().expect("the limits").camera;
        let mut watch = CameraWatch::new(CAMERAS);
        let mut newest: Vec<TactileFrame> = Vec::new();
        let mut all = Vec::new();
        for n in 0..8 {
            for camera in 0..CAMERAS {
                let noise = |pixel: usize| 100 + ((pixel * 7 + n * 13 + camera) % 5) as u8;
                let usual = TactileImage { rgb: (0..IMAGE_SIZE * IMAGE_SIZE * 3).map(noise).collect() };
                let Some(image) = image(n, camera, usual) else { continue };
                newest.retain(|frame| frame.camera != camera);
                newest.push(TactileFrame { camera, time: n as f64, sequence: n as u64, image: Arc::new(image) });
            }
            let found = watch.update(&limits, (0.2 * n as f64, true, false), &newest);
            all.extend(found.into_iter().map(|(camera, (kind, ..))| (n, camera.unwrap_or(CAMERAS), kind)));
        }
        all
    }

    #[test]
    fn cameras_that_send_nothing_or_the_same_are_dead() {
        assert_eq!(detected_faults(|_, _, image| Some(image)), []);
        let gone = detected_faults(|n, camera, image| (camera != 3 || n < 4).then_some(image));
        assert_eq!(gone, [(5, 3, FaultKind::CameraDead)]);
        let frozen = TactileImage { rgb: vec![90; IMAGE_SIZE * IMAGE_SIZE * 3] };
        let frozen =
            detected_faults(|n, camera, image| Some(if camera == 5 && n >= 3 { frozen.clone() } else { image }));
        assert_eq!(frozen, [(4, 5, FaultKind::CameraDead)]);
        // A camera that loses images on the way, but none at the end.
        let lossy = detected_faults(|n, camera, image| (camera != 3 || n % 2 == 1).then_some(image));
        assert_eq!(lossy, []);
        let silent = detected_faults(|n, _, image| (n < 3).then_some(image));
        assert_eq!(silent, [(4, CAMERAS, FaultKind::CameraDead)], "no image for longer than the latency");
    }

    /// Without noise all idle pads repeat their images, and none of them is faulty.
    #[test]
    fn idle_pads_without_noise_are_not_dead() {
        let still = TactileImage { rgb: vec![90; IMAGE_SIZE * IMAGE_SIZE * 3] };
        assert_eq!(detected_faults(|_, _, _| Some(still.clone())), []);
    }

    #[test]
    fn a_camera_that_sees_black_is_dead() {
        let black = TactileImage { rgb: vec![0; IMAGE_SIZE * IMAGE_SIZE * 3] };
        let named = detected_faults(|n, camera, image| Some(if camera == 7 && n >= 3 { black.clone() } else { image }));
        assert_eq!(
            named.iter().map(|(_, camera, kind)| (*camera, *kind)).collect::<Vec<_>>(),
            [(7, FaultKind::CameraDead)]
        );
    }

    #[test]
    fn a_colour_that_has_lost_its_light_is_a_pad_that_drifted() {
        let dim = |n: usize, camera: usize, mut image: TactileImage| {
            if camera == 2 && n >= 4 {
                image.rgb.iter_mut().skip(1).step_by(3).for_each(|value| *value = (f64::from(*value) * 0.6) as u8);
            }
            Some(image)
        };
        assert_eq!(detected_faults(dim), [(5, 2, FaultKind::PadDrifted)]);
        // A contact changes a part of the image, and all colours.
        let touched = |n: usize, _: usize, mut image: TactileImage| {
            if n >= 4 {
                image.rgb.iter_mut().take(IMAGE_SIZE * IMAGE_SIZE).for_each(|value| *value /= 2);
            }
            Some(image)
        };
        assert_eq!(detected_faults(touched), []);
    }
}
