//! Reaction to slip while carrying: slip is detected by pads and cables and answered with more tension.
//!
//! While objects are carried, nothing should move in the hand. Slip has two signs: the image of a pad changes, or the
//! cable of a digit is taken up further because its support has gone. In either case all digits that hold the same
//! object pull harder by one step, up to a limit. If no further slip is detected for a while, the additional tension
//! decays. The tension never falls below the planned tension.

use std::sync::Arc;

use hand_model::robot::{ServoState, TactileFrame, TactileImage};
use hand_model::{Digit, DigitVector, Hand};

use crate::sensing::is_pad_on_digits;

/// Period of the pad images while carrying, s.
pub const IMAGE_PERIOD: f64 = 0.1;
/// Threshold of a cable's additional excursion that counts as slip, m.
const SLIP_EXCURSION: f64 = 0.0012;
/// Threshold of the mean change of a pad's image that counts as slip, grey levels.
const SLIP_IMAGE_CHANGE: f64 = 1.5;
/// Step of the additional tension, as a share of the planned tension.
const TENSION_STEP: f64 = 0.25;
/// Largest additional tension, as a share of the planned tension; see [`TENSION_STEP`].
const MAX_ADDED_TENSION: f64 = 1.0;
/// Settling time after a step, and after the start, during which nothing counts as slip, s.
const SETTLING_TIME: f64 = 0.15;
/// Rate at which the additional tension decays without slip, share of the plan's tension per second.
const DECAY_RATE: f64 = 0.1;
/// Time without slip after which the decay begins, s; see [`DECAY_RATE`].
const DECAY_DELAY: f64 = 1.0;
/// Stride of the bytes that are compared in an image. It is coprime with three, so that all colours are sampled.
const BYTE_STRIDE: usize = 31;

/// Slip detection for carries, one after the other.
#[derive(Debug, Clone, Default)]
pub struct SlipController {
    /// One entry per object.
    states: Vec<SlipState>,
    previous_images: Vec<Option<Arc<TactileImage>>>,
}

/// Largest tension that every cable servo can pull, N.
pub fn max_tension(hand: &Hand) -> f64 {
    let pull = |n: usize| hand.servos[n].current_limit * hand.servos[n].torque_constant / hand.cables[n].spool_radius;
    (0..hand.cables.len()).map(pull).fold(f64::INFINITY, f64::min)
}

/// Slip state of one object.
#[derive(Debug, Clone, Default)]
struct SlipState {
    /// Digits that hold the object.
    digits: Vec<Digit>,
    /// Additional tension, as a share of the planned tension.
    added_tension: f64,
    /// Number of steps taken.
    steps: u32,
    /// Cable positions at rest, m; `None` while the hand settles.
    rest: Option<DigitVector>,
    /// Time since the last step or the start, s.
    quiet_time: f64,
}

impl SlipController {
    /// Begins a carry of objects that are held by these `digits`, with no additional tension.
    pub fn begin(&mut self, digits: impl Iterator<Item = Vec<Digit>>) {
        let steps = self.slip_counts();
        let grip =
            |(n, digits)| SlipState { digits, steps: steps.get(n).copied().unwrap_or(0), ..SlipState::default() };
        self.states = digits.enumerate().map(grip).collect();
        self.previous_images.fill(None);
    }

    /// Number of slips felt of each object, over all carries.
    pub fn slip_counts(&self) -> Vec<u32> {
        self.states.iter().map(|grip| grip.steps).collect()
    }

    /// Runs one tick of `dt` (s) and returns the tension set-points (N), given those of the `plan` and the largest one,
    /// `most`, that a servo can pull.
    pub fn tick(
        &mut self,
        hand: &Hand,
        servos: &[ServoState],
        arrived: &[TactileFrame],
        plan: &[f64],
        most: f64,
        dt: f64,
    ) -> DigitVector {
        let cables: DigitVector = hand.each_digit(|n| servos[n].position * hand.cables[n].spool_radius);
        let seen = self.changed_images(hand, arrived);
        let mut tension: DigitVector = plan.iter().copied().collect();
        for (n, changed) in seen.into_iter().enumerate() {
            if self.states[n].tick(&cables, changed, dt) {
                // The present images of the pads become the new reference.
                for camera in 0..self.previous_images.len() {
                    if self.object_of_camera(hand, camera) == n {
                        self.previous_images[camera] = None;
                    }
                }
            }
            let grip = &self.states[n];
            for digit in &grip.digits {
                let planned = plan[digit.index()];
                tension[digit.index()] = (planned * (1.0 + grip.added_tension)).min(most).max(planned);
            }
        }
        tension
    }

    /// Finds, for each grip, whether a pad's image has changed.
    fn changed_images(&mut self, hand: &Hand, arrived: &[TactileFrame]) -> Vec<bool> {
        self.previous_images.resize(hand.cameras.len(), None);
        let mut seen = vec![false; self.states.len()];
        for frame in arrived.iter().filter(|frame| frame.camera < hand.cameras.len()) {
            let grip = self.object_of_camera(hand, frame.camera);
            if self.states.get(grip).is_none_or(|grip| grip.quiet_time < SETTLING_TIME) {
                continue;
            }
            match &self.previous_images[frame.camera] {
                Some(before) => seen[grip] |= mean_image_change(before, &frame.image) > SLIP_IMAGE_CHANGE,
                None => self.previous_images[frame.camera] = Some(frame.image.clone()),
            }
        }
        seen
    }

    /// Index of the grip to which a camera's pad belongs. The palm belongs to the first one, which leans on it.
    fn object_of_camera(&self, hand: &Hand, camera: usize) -> usize {
        let pad = hand.cameras[camera].pad;
        self.states.iter().skip(1).position(|grip| is_pad_on_digits(hand, pad, &grip.digits)).map_or(0, |n| n + 1)
    }
}

impl SlipState {
    /// True if slip is detected; the tension is then raised by one step.
    fn tick(&mut self, cables: &[f64], seen: bool, dt: f64) -> bool {
        self.quiet_time += dt;
        if self.quiet_time < SETTLING_TIME {
            return false;
        }
        let rest = *self.rest.get_or_insert_with(|| cables.iter().copied().collect());
        let closing = self.digits.iter().any(|digit| cables[digit.index()] - rest[digit.index()] > SLIP_EXCURSION);
        if closing || seen {
            (self.added_tension, self.rest, self.quiet_time) =
                ((self.added_tension + TENSION_STEP).min(MAX_ADDED_TENSION), None, 0.0);
            self.steps += 1;
            return true;
        }
        if self.quiet_time > DECAY_DELAY {
            self.added_tension = (self.added_tension - DECAY_RATE * dt).max(0.0);
        }
        false
    }
}

/// Mean difference of two images, grey levels.
fn mean_image_change(before: &Arc<TactileImage>, after: &Arc<TactileImage>) -> f64 {
    if Arc::ptr_eq(before, after) || before.rgb.len() != after.rgb.len() {
        return 0.0;
    }
    let pairs = before.rgb.iter().zip(&after.rgb).step_by(BYTE_STRIDE);
    let count = before.rgb.len().div_ceil(BYTE_STRIDE).max(1);
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 120.0;
    const PLANNED_TENSIONS: [f64; 5] = [20.0, 20.0, 20.0, 10.0, 10.0];

    fn servos(hand: &Hand, ring: f64) -> hand_model::ActuatorVector<ServoState> {
        hand.each_actuator(|n| ServoState {
            position: if n == Digit::Ring.index() { ring } else { 0.02 } / hand.parameters.cable.spool_radius,
            ..ServoState::default()
        })
    }

    /// Controller of a carry of two objects, held by ring and little finger and by the other digits.
    fn watching() -> SlipController {
        let mut watch = SlipController::default();
        let digits = [&[Digit::Ring, Digit::Little][..], &[Digit::Thumb, Digit::Index, Digit::Middle]];
        watch.begin(digits.into_iter().map(<[Digit]>::to_vec));
        watch
    }

    /// Runs for `seconds` with the ring finger's cable at `ring` (m) and returns the last tensions.
    fn run(watch: &mut SlipController, hand: &Hand, ring: impl Fn(f64) -> f64, seconds: f64) -> DigitVector {
        let mut tension = hand.slack_tensions();
        for tick in 0..(seconds / DT) as usize {
            tension = watch.tick(hand, &servos(hand, ring(tick as f64 * DT)), &[], &PLANNED_TENSIONS, 60.0, DT);
        }
        tension
    }

    #[test]
    fn nothing_moves_nothing_happens() {
        let (hand, mut watch) = (Hand::ftac(), watching());
        assert_eq!(run(&mut watch, &hand, |_| 0.02, 3.0)[..], PLANNED_TENSIONS);
        assert_eq!(watch.slip_counts()[..], [0, 0]);
    }

    /// If the ring finger closes further, ring and little finger pull harder and the others stay. Without slip the
    /// planned tension returns, and no less.
    #[test]
    fn tension_rises_on_slip_within_limits_and_falls_back() {
        let (hand, mut watch) = (Hand::ftac(), watching());
        let slipping = run(&mut watch, &hand, |time| 0.02 + if time < 0.3 { 0.0 } else { 0.002 }, 0.5);
        assert_eq!(slipping[..], [20.0, 20.0, 20.0, 12.5, 12.5]);
        assert_eq!(watch.slip_counts()[..], [1, 0]);
        let on_and_on = run(&mut watch, &hand, |time| 0.02 + 0.02 * time, 2.0);
        assert_eq!(on_and_on[3], 20.0, "twice the plan is the limit");
        let calm = run(&mut watch, &hand, |_| 0.05, 30.0);
        assert_eq!(calm[..], PLANNED_TENSIONS);
        let capped = watch.tick(&hand, &servos(&hand, 0.1), &[], &PLANNED_TENSIONS, 11.0, DT);
        assert_eq!(capped[3], 11.0, "no more than a servo can pull");
        assert_eq!(
            watch.tick(&hand, &servos(&hand, 0.1), &[], &PLANNED_TENSIONS, 5.0, DT)[0],
            20.0,
            "never below the plan"
        );
    }

    /// A changed image of a pad of the little finger is a slip of the first grip; an unchanged one is none.
    #[test]
    fn a_pad_feels_it() {
        let hand = Hand::ftac();
        let pad = hand.pads.iter().position(|pad| pad.name == "little_distal").unwrap();
        let picture = |level: u8| Arc::new(TactileImage { rgb: vec![level; 240 * 240 * 3] });
        let frame = |image: &Arc<TactileImage>| TactileFrame {
            camera: hand.pads[pad].cameras[0],
            time: 0.0,
            sequence: 0,
            image: image.clone(),
        };
        let mut watch = watching();
        run(&mut watch, &hand, |_| 0.02, 0.3);
        let at_rest = servos(&hand, 0.02);
        for (level, steps) in [(100, 0), (101, 0), (104, 1)] {
            watch.tick(&hand, &at_rest, &[frame(&picture(level))], &PLANNED_TENSIONS, 60.0, DT);
            assert_eq!(watch.slip_counts()[..], [steps, 0], "{level}");
        }
    }
}
