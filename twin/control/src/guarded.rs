//! Guarded motion: the palm advances slowly until a pad feels a contact, and a little further to press firmly.
//!
//! Pads are imaged throughout the motion. A change from the image taken on the way there counts as a touch.

use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use hand_model::{Digit, Hand};
use tactile_perception::StereoOptions;
use tactile_perception::colour_change::find_change;

use crate::sensing::is_on;
use crate::trajectory::PosePath;

/// Period of the image requests during the motion, s.
pub const LOOK_PERIOD: f64 = 0.04;

/// Time for which the motion continues after a touch, s.
const PRESSING: f64 = 0.2;

/// A guarded motion; see the module documentation.
#[derive(Debug, Clone)]
pub struct Guarded {
    path: PosePath,
    /// Cameras whose pads end the motion.
    watched: Vec<bool>,
    /// Reference images of the untouched pads.
    pictures: Vec<Option<Arc<TactileImage>>>,
    /// Path time at which a touch was detected, s.
    felt: Option<f64>,
}

impl Guarded {
    /// A motion along `path` until a pad of `digits` feels a contact. Only pads for which `used` is true are watched.
    pub fn new(path: PosePath, hand: &Hand, digits: &[Digit], used: impl Fn(usize) -> bool) -> Self {
        let watched = hand.cameras.iter().map(|camera| is_on(hand, camera.pad, digits) && used(camera.pad)).collect();
        Self { path, watched, pictures: vec![None; hand.cameras.len()], felt: None }
    }

    /// Returns the whole path.
    pub fn path(&self) -> &PosePath {
        &self.path
    }

    /// True if the motion is over at `clock` (s on its path).
    pub fn is_over(&self, clock: f64) -> bool {
        clock + 1e-9 >= self.path.duration() || self.felt.is_some_and(|felt| clock >= felt + PRESSING)
    }

    /// True if the reference images of all watched pads have arrived.
    pub fn knows_untouched(&self) -> bool {
        self.watched.iter().zip(&self.pictures).all(|(watched, picture)| !watched || picture.is_some())
    }

    /// Takes images that arrived at `clock` (s on the path; `None` on the way to its start).
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
        let mut guarded = Guarded::new(path.expect("a path"), &hand, &[Digit::Index], |_| true);
        assert!(!guarded.knows_untouched());
        let untouched: Vec<TactileFrame> = (0..hand.cameras.len()).map(|camera| frame(camera, 100)).collect();
        guarded.see(&untouched, None);
        assert!(guarded.knows_untouched());
        guarded.see(&[frame(index, 100), frame(ring, 150)], Some(0.4));
        assert!(!guarded.is_over(1.9) && guarded.is_over(2.0));
        guarded.see(&[frame(index, 110)], Some(0.5));
        assert!(!guarded.is_over(0.6) && guarded.is_over(0.5 + PRESSING));
        // Later touches do not postpone the end.
        guarded.see(&[frame(index, 140)], Some(0.6));
        assert!(guarded.is_over(0.5 + PRESSING));
    }

    #[test]
    fn a_pad_that_may_not_be_used_is_not_watched() {
        let hand = Hand::ftac();
        let path = PosePath::new(vec![(0.0, Isometry3::identity())]).expect("a path");
        let guarded = Guarded::new(path, &hand, &[Digit::Index], |_| false);
        assert!(guarded.knows_untouched() && guarded.is_over(0.0));
    }
}
