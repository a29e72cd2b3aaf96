//! Guarded motion: the palm goes on slowly until a pad feels something, and a little further, so that it feels it well.
//!
//! Pads are looked at throughout. A picture that is no longer the one from the way there is a touch.

use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use hand_model::{CAMERAS, Digit, Hand};
use touch::StereoOptions;
use touch::colour_change::find_change;
use touch::posture::digit_of;

use crate::trajectory::PosePath;

/// How often pads are looked at on the way, s.
pub const LOOK_PERIOD: f64 = 0.04;

/// How long the motion goes on after a touch, s.
const PRESSING: f64 = 0.2;

/// A guarded motion; see the module's page.
#[derive(Debug, Clone)]
pub struct Guarded {
    path: PosePath,
    /// Cameras whose pads end it.
    watched: [bool; CAMERAS],
    /// Their first pictures.
    pictures: Vec<Option<Arc<TactileImage>>>,
    /// Time on the path at which something was felt, s.
    felt: Option<f64>,
}

impl Guarded {
    /// Along `path`, until a pad of `digits` feels something, as far as `used` lets it.
    pub fn new(path: PosePath, hand: &Hand, digits: &[Digit], used: impl Fn(usize) -> bool) -> Self {
        let of_digits = |pad: usize| digit_of(hand.pads[pad].link).is_some_and(|digit| digits.contains(&digit));
        let watched = std::array::from_fn(|camera| {
            hand.cameras.get(camera).is_some_and(|camera| of_digits(camera.pad) && used(camera.pad))
        });
        Self { path, watched, pictures: vec![None; CAMERAS], felt: None }
    }

    /// The whole way.
    pub fn path(&self) -> &PosePath {
        &self.path
    }

    /// Whether the motion is over at `clock` (s on its path).
    pub fn is_over(&self, clock: f64) -> bool {
        clock + 1e-9 >= self.path.duration() || self.felt.is_some_and(|felt| clock >= felt + PRESSING)
    }

    /// Whether the pictures of untouched pads have arrived.
    pub fn knows_untouched(&self) -> bool {
        (0..CAMERAS).all(|camera| !self.watched[camera] || self.pictures[camera].is_some())
    }

    /// Takes images that arrived at `clock` (s on the path; `None` on the way to where it begins).
    pub fn see(&mut self, arrived: &[TactileFrame], clock: Option<f64>) {
        for frame in arrived.iter().filter(|frame| self.watched.get(frame.camera).is_some_and(|watched| *watched)) {
            let picture = &mut self.pictures[frame.camera];
            match (picture.as_ref(), clock) {
                (Some(before), Some(clock)) if self.felt.is_none() => {
                    let changed = find_change(&frame.image, before, &StereoOptions::default()).is_some();
                    self.felt = changed.then_some(clock);
                }
                (None, _) => *picture = Some(frame.image.clone()),
                _ => {}
            }
        }
    }
}
