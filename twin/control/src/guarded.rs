//! Guarded motion: the palm goes on slowly until a pad feels something, and a little further, so that it feels it well.
//!
//! Pads are looked at throughout. A picture that is no longer the one from the way there is a touch.

use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use hand_model::{Digit, Hand};
use touch::StereoOptions;
use touch::colour_change::find_change;

use crate::sensing::is_on;
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
    watched: Vec<bool>,
    /// Their first pictures.
    pictures: Vec<Option<Arc<TactileImage>>>,
    /// Time on the path at which something was felt, s.
    felt: Option<f64>,
}

impl Guarded {
    /// Along `path`, until a pad of `digits` feels something, as far as `used` lets it.
    pub fn new(path: PosePath, hand: &Hand, digits: &[Digit], used: impl Fn(usize) -> bool) -> Self {
        let watched = hand.cameras.iter().map(|camera| is_on(hand, camera.pad, digits) && used(camera.pad)).collect();
        Self { path, watched, pictures: vec![None; hand.cameras.len()], felt: None }
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
        self.watched.iter().zip(&self.pictures).all(|(watched, picture)| !watched || picture.is_some())
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

#[cfg(test)]
mod tests {
    use hand_model::pads::IMAGE_SIZE;
    use nalgebra::Isometry3;

    use super::*;

    fn frame(camera: usize, level: u8) -> TactileFrame {
        let image = Arc::new(TactileImage { rgb: vec![level; 3 * IMAGE_SIZE * IMAGE_SIZE] });
        TactileFrame { camera, time: 0.0, sequence: 0, image }
    }

    /// A pad of the digits that changes ends the motion a little later; other pads, and what was there on the way, do not.
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
        // What is felt later does not put the end off.
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
