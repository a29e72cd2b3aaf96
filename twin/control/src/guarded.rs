//! Guarded motion: the palm advances slowly until a pad feels a contact, and a little further to press firmly.
//!
//! Pads are imaged throughout the motion. A change from the image taken during the approach counts as a touch.

use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use hand_model::{Digit, Hand};
use tactile_perception::StereoOptions;
use tactile_perception::colour_change::find_change;

use crate::sensing::is_pad_on_digits;
use crate::trajectory::PosePath;

/// Period of the image requests during the motion, s.
pub const IMAGE_PERIOD: f64 = 0.04;

/// Time for which the motion continues after a touch, s.
const PRESS_TIME: f64 = 0.2;

/// A guarded motion; see the module documentation.
#[derive(Debug, Clone)]
pub struct GuardedMotion {
    path: PosePath,
    /// Cameras whose pads end the motion.
    watched: Vec<bool>,
    /// Reference images of the untouched pads.
    reference_images: Vec<Option<Arc<TactileImage>>>,
    /// Path time at which a touch was detected, s.
    contact_time: Option<f64>,
}

impl GuardedMotion {
    /// A motion along `path` until a pad of `digits` feels a contact. Only pads for which `used` is true are watched.
    pub fn new(path: PosePath, hand: &Hand, digits: &[Digit], used: impl Fn(usize) -> bool) -> Self {
        let watched =
            hand.cameras.iter().map(|camera| is_pad_on_digits(hand, camera.pad, digits) && used(camera.pad)).collect();
        Self { path, watched, reference_images: vec![None; hand.cameras.len()], contact_time: None }
    }

    /// Returns the whole path.
    pub fn path(&self) -> &PosePath {
        &self.path
    }

    /// True if the motion is over at `clock` (s on its path).
    pub fn is_over(&self, clock: f64) -> bool {
        clock + 1e-9 >= self.path.duration() || self.contact_time.is_some_and(|felt| clock >= felt + PRESS_TIME)
    }

    /// True if the reference images of all watched pads have arrived.
    pub fn has_reference_images(&self) -> bool {
        self.watched.iter().zip(&self.reference_images).all(|(watched, picture)| !watched || picture.is_some())
    }

    /// Takes images that arrived at `clock` (s on the path; `None` on the way to its start).
    pub fn add_images(&mut self, arrived: &[TactileFrame], clock: Option<f64>) {
        for frame in arrived.iter().filter(|frame| self.watched.get(frame.camera).is_some_and(|watched| *watched)) {
            let picture = &mut self.reference_images[frame.camera];
            match (picture.as_ref(), clock) {
                (Some(before), Some(clock)) if self.contact_time.is_none() => {
                    let changed = find_change(&frame.image, before, &StereoOptions::default()).is_some();
                    self.contact_time = changed.then_some(clock);
                }
                (None, _) => *picture = Some(frame.image.clone()),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use hand_model::pads::IMAGE_SIZE;
    use nalgebra::Isometry3;

    use super::*;

    fn frame(camera: usize, level: u8) -> TactileFrame {
        let image = Arc::new(TactileImage { rgb: vec![level; 3 * IMAGE_SIZE * IMAGE_SIZE] });
        TactileFrame { camera, time: 0.0, sequence: 0, image }
    }

    /// A changed pad of the digits ends the motion a little later; other pads and earlier images do not.
    #[test]
    fn a_touch_ends_it() {
        let hand = Hand::ftac();
        let camera = |name: &str| hand.pads.iter().find(|pad| pad.name == name).expect("a pad").cameras[0];
        let (index, ring) = (camera("index_distal"), camera("ring_distal"));
        let path = PosePath::new(vec![(0.0, Isometry3::identity()), (2.0, Isometry3::translation(0.0, 0.0, 0.03))]);
        let mut guarded = GuardedMotion::new(path.expect("a path"), &hand, &[Digit::Index], |_| true);
        assert!(!guarded.has_reference_images());
        let untouched: Vec<TactileFrame> = (0..hand.cameras.len()).map(|camera| frame(camera, 100)).collect();
        guarded.add_images(&untouched, None);
        assert!(guarded.has_reference_images());
        guarded.add_images(&[frame(index, 100), frame(ring, 150)], Some(0.4));
        assert!(!guarded.is_over(1.9) && guarded.is_over(2.0));
        guarded.add_images(&[frame(index, 110)], Some(0.5));
        assert!(!guarded.is_over(0.6) && guarded.is_over(0.5 + PRESS_TIME));
        // Later touches do not postpone the end.
        guarded.add_images(&[frame(index, 140)], Some(0.6));
        assert!(guarded.is_over(0.5 + PRESS_TIME));
    }

    #[test]
    fn a_pad_that_may_not_be_used_is_not_watched() {
        let hand = Hand::ftac();
        let path = PosePath::new(vec![(0.0, Isometry3::identity())]).expect("a path");
        let guarded = GuardedMotion::new(path, &hand, &[Digit::Index], |_| false);
        assert!(guarded.has_reference_images() && guarded.is_over(0.0));
    }
}
