//! The emulated camera board: the device's side of [`crate::tactile_link`].
//!
//! Its clock has an offset and a drift against the host's. The lowest bit of each pixel is noise, so that no two images
//! of a live camera are equal. A frozen camera repeats its last image with new sequence numbers and times.

use std::collections::BTreeMap;

use hand_model::robot::TactileFrame;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::faults::FaultEvent;
use crate::tactile_link::deframer::Deframer;
use crate::tactile_link::message::{CameraFault, LinkImage, LinkMessage, PixelEncoding, VERSION};
use crate::tactile_link::{frame, image_data};

/// Settings of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardSettings {
    /// Serial number.
    pub serial: u32,
    /// Clock offset: reading of the board's clock at time 0, s.
    pub clock_offset: f64,
    /// Clock drift: share by which the board's clock is fast, dimensionless.
    pub clock_drift: f64,
    /// Encoding of the images.
    pub encoding: PixelEncoding,
    /// JPEG quality, 1 to 100.
    pub quality: u8,
}

impl Default for BoardSettings {
    /// JPEG at quality 70, a clock 1234 s ahead and 40 ppm fast.
    fn default() -> Self {
        Self { serial: 1, clock_offset: 1234.5, clock_drift: 40e-6, encoding: PixelEncoding::Jpeg, quality: 70 }
    }
}

/// Reaction of the board to bytes from the host.
#[derive(Debug, Default)]
pub struct BoardReply {
    /// Bytes of the answer.
    pub bytes: Vec<u8>,
    /// True if the board takes an image with every camera now.
    pub capture: bool,
}

#[derive(Debug)]
pub struct CameraBoard {
    settings: BoardSettings,
    /// Number of cameras.
    cameras: usize,
    jpeg_cut_probability: f64,
    deframer: Deframer,
    sequence: u32,
    /// Frozen cameras, and the data that they keep sending, once they have any.
    frozen: BTreeMap<u8, Option<Vec<u8>>>,
    /// Index of a camera that is exchanged with the next one.
    swapped: Option<u8>,
    rng: ChaCha8Rng,
}

impl CameraBoard {
    /// Creates a board with `cameras` cameras, which cuts a JPEG in half with probability `jpeg_chance`.
    pub fn new(settings: BoardSettings, cameras: usize, jpeg_chance: f64, seed: u64) -> Self {
        Self {
            settings,
            cameras,
            jpeg_cut_probability: jpeg_chance,
            deframer: Deframer::default(),
            sequence: 0,
            frozen: BTreeMap::new(),
            swapped: None,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Sets the probability that a JPEG is cut in half.
    pub fn set_jpeg_cut_probability(&mut self, chance: f64) {
        self.jpeg_cut_probability = chance;
    }

    /// Applies a fault of a camera.
    pub fn apply_fault(&mut self, event: FaultEvent) {
        match event {
            FaultEvent::FreezeCamera(camera) => drop(self.frozen.entry(camera).or_default()),
            FaultEvent::SwapCameras(camera) => self.swapped = Some(camera),
            _ => {}
        }
    }

    /// Returns the index under which a camera's images are sent.
    fn reported_index(&self, camera: u8) -> u8 {
        match self.swapped {
            Some(swapped) if camera == swapped => swapped + 1,
            Some(swapped) if camera == swapped + 1 => swapped,
            _ => camera,
        }
    }

    /// Takes bytes from the host at `now` (s).
    pub fn receive(&mut self, bytes: &[u8], now: f64) -> BoardReply {
        let mut reaction = BoardReply::default();
        for message in self.deframer.push(bytes).into_iter().flatten() {
            let answer = match message {
                LinkMessage::Hello => {
                    // The protocol has no room for a larger number.
                    let cameras = u8::try_from(self.cameras).unwrap_or(u8::MAX);
                    LinkMessage::Welcome { version: VERSION, serial: self.settings.serial, cameras }
                }
                LinkMessage::WhatTime { host_us } => LinkMessage::Time { host_us, board_us: self.clock_us(now) },
                LinkMessage::Capture => {
                    reaction.capture = true;
                    continue;
                }
                _ => continue,
            };
            reaction.bytes.extend(frame::encode(&answer));
        }
        reaction
    }

    /// Encodes images taken at `taken` (s) as packets.
    pub fn send_images(&mut self, frames: &[TactileFrame], taken: f64) -> Vec<u8> {
        self.sequence += 1;
        frames.iter().flat_map(|picture| frame::encode(&self.image(picture, taken))).collect()
    }

    fn clock_us(&self, now: f64) -> u64 {
        ((self.settings.clock_offset + now * (1.0 + self.settings.clock_drift)) * 1e6) as u64
    }

    fn image(&mut self, picture: &TactileFrame, taken: f64) -> LinkMessage {
        let camera = picture.camera as u8;
        let Some(mut data) = self.encode_pixels(camera, &picture.image.rgb) else {
            return LinkMessage::CameraFault { camera: self.reported_index(camera), fault: CameraFault::Overrun };
        };
        if self.jpeg_cut_probability > 0.0 && self.rng.random_bool(self.jpeg_cut_probability) {
            data.truncate(data.len() / 2);
        }
        LinkMessage::Image(LinkImage {
            camera: self.reported_index(camera),
            sequence: self.sequence,
            captured_us: self.clock_us(taken),
            width: 240,
            height: 240,
            encoding: self.settings.encoding,
            data,
        })
    }

    /// Returns the encoded picture, or the data that a frozen camera sends instead.
    fn encode_pixels(&mut self, camera: u8, rgb: &[u8]) -> Option<Vec<u8>> {
        if let Some(Some(data)) = self.frozen.get(&camera) {
            return Some(data.clone());
        }
        let mut noisy = vec![0; rgb.len()];
        self.rng.fill_bytes(&mut noisy);
        for (value, pixel) in noisy.iter_mut().zip(rgb) {
            *value = pixel ^ (*value & 1);
        }
        let data = match self.settings.encoding {
            PixelEncoding::Jpeg => image_data::encode_jpeg(&noisy, self.settings.quality).ok()?,
            PixelEncoding::Rgb565 => image_data::encode_rgb565(rgb),
        };
        if let Some(kept) = self.frozen.get_mut(&camera) {
            *kept = Some(data.clone());
        }
        Some(data)
    }
}
