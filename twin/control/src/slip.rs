//! Slip while carrying: felt by the pads or by a digit that closes on, answered by tension.
//!
//! While objects are carried nothing should move in the hand. Two signs say that something does: a pad's picture is no
//! longer the one it was, or a digit's cable is taken up further, because what the digit leant on went away. Either way all
//! digits that hold the same object pull harder by a step, up to a limit. When nothing more is felt for a while the addition
//! fades; it never takes away from the plan.

use std::sync::Arc;

use hand_model::robot::{ServoState, TactileFrame, TactileImage};
use hand_model::{Digit, DigitVector, Hand};

use crate::sensing::is_on;

/// How often pads are looked at while carrying, s.
pub const LOOK_PERIOD: f64 = 0.1;
/// A digit that takes up this much more cable closes on, m.
const CLOSING_ON: f64 = 0.0012;
/// Mean change of a pad's picture that is a slip, grey levels.
const PICTURE_CHANGE: f64 = 1.5;
/// One step of additional tension, as a share of the plan's, and the most.
const STEP: f64 = 0.25;
/// See [`STEP`].
const MOST: f64 = 1.0;
/// Time after a step, and after the start, during which the hand settles and nothing is taken for a slip, s.
const SETTLING: f64 = 0.15;
/// How fast an addition fades when nothing is felt, share of the plan's tension a second, and how long that is waited for, s.
const FADING: f64 = 0.1;
/// See [`FADING`].
const CALM: f64 = 1.0;
/// Every how many bytes of a picture are compared: coprime with three, so that all colours take their turn.
const STRIDE: usize = 31;

/// Watches carries, one after the other.
#[derive(Debug, Clone, Default)]
pub struct SlipWatch {
    /// One an object.
    grips: Vec<GripWatch>,
    pictures: Vec<Option<Arc<TactileImage>>>,
}

/// The most that every servo can pull, N.
pub fn most_tension(hand: &Hand) -> f64 {
    let pull = |n: usize| hand.servos[n].current_limit * hand.servos[n].torque_constant / hand.cables[n].spool_radius;
    (0..hand.cables.len()).map(pull).fold(f64::INFINITY, f64::min)
}

/// What holds one object.
#[derive(Debug, Clone, Default)]
struct GripWatch {
    /// Those that hold it.
    digits: Vec<Digit>,
    /// Additional tension, share of the plan's.
    added: f64,
    /// Steps taken.
    steps: u32,
    /// Cable positions that are taken for rest, m; none while the hand settles.
    rest: Option<DigitVector>,
    /// Time since the last step or the start, s.
    calm: f64,
}

impl SlipWatch {
    /// A carry begins, of objects that these `digits` hold, with nothing added to the plan.
    pub fn begin(&mut self, digits: impl Iterator<Item = Vec<Digit>>) {
        let steps = self.steps();
        let grip =
            |(n, digits)| GripWatch { digits, steps: steps.get(n).copied().unwrap_or(0), ..GripWatch::default() };
        self.grips = digits.enumerate().map(grip).collect();
        self.pictures.fill(None);
    }

    /// How often each object was felt to slip, in all carries.
    pub fn steps(&self) -> Vec<u32> {
        self.grips.iter().map(|grip| grip.steps).collect()
    }

    /// One tick of `dt` (s): the tensions to be had (N), given the `plan`'s and the `most` that a servo can pull.
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
        let seen = self.seen(hand, arrived);
        let mut tension: DigitVector = plan.iter().copied().collect();
        for (n, changed) in seen.into_iter().enumerate() {
            if self.grips[n].tick(&cables, changed, dt) {
                // What the pads show from now on is the new state of things.
                for camera in 0..self.pictures.len() {
                    if self.owner(hand, camera) == n {
                        self.pictures[camera] = None;
                    }
                }
            }
            let grip = &self.grips[n];
            for digit in &grip.digits {
                let planned = plan[digit.index()];
                tension[digit.index()] = (planned * (1.0 + grip.added)).min(most).max(planned);
            }
        }
        tension
    }

    /// Whether pads of each grip show something else than before.
    fn seen(&mut self, hand: &Hand, arrived: &[TactileFrame]) -> Vec<bool> {
        self.pictures.resize(hand.cameras.len(), None);
        let mut seen = vec![false; self.grips.len()];
        for frame in arrived.iter().filter(|frame| frame.camera < hand.cameras.len()) {
            let grip = self.owner(hand, frame.camera);
            if self.grips.get(grip).is_none_or(|grip| grip.calm < SETTLING) {
                continue;
            }
            match &self.pictures[frame.camera] {
                Some(before) => seen[grip] |= change(before, &frame.image) > PICTURE_CHANGE,
                None => self.pictures[frame.camera] = Some(frame.image.clone()),
            }
        }
        seen
    }

    /// The grip whose pads a camera looks through: the palm's belong to the first, which leans on it.
    fn owner(&self, hand: &Hand, camera: usize) -> usize {
        let pad = hand.cameras[camera].pad;
        self.grips.iter().skip(1).position(|grip| is_on(hand, pad, &grip.digits)).map_or(0, |n| n + 1)
    }
}

impl GripWatch {
    /// Whether a slip is felt; then the tension takes a step.
    fn tick(&mut self, cables: &[f64], seen: bool, dt: f64) -> bool {
        self.calm += dt;
        if self.calm < SETTLING {
            return false;
        }
        let rest = *self.rest.get_or_insert_with(|| cables.iter().copied().collect());
        let closing = self.digits.iter().any(|digit| cables[digit.index()] - rest[digit.index()] > CLOSING_ON);
        if closing || seen {
            (self.added, self.rest, self.calm) = ((self.added + STEP).min(MOST), None, 0.0);
            self.steps += 1;
            return true;
        }
        if self.calm > CALM {
            self.added = (self.added - FADING * dt).max(0.0);
        }
        false
    }
}

/// Mean difference of two pictures, grey levels.
fn change(before: &Arc<TactileImage>, after: &Arc<TactileImage>) -> f64 {
    if Arc::ptr_eq(before, after) || before.rgb.len() != after.rgb.len() {
        return 0.0;
    }
    let pairs = before.rgb.iter().zip(&after.rgb).step_by(STRIDE);
    let count = before.rgb.len().div_ceil(STRIDE).max(1);
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 120.0;
    const PLAN: [f64; 5] = [20.0, 20.0, 20.0, 10.0, 10.0];

    fn servos(hand: &Hand, ring: f64) -> hand_model::ActuatorVector<ServoState> {
        hand.each_actuator(|n| ServoState {
            position: if n == Digit::Ring.index() { ring } else { 0.02 } / hand.parameters.cable.spool_radius,
            ..ServoState::default()
        })
    }

    /// A watch of two objects, by ring and little finger and by the others.
    fn watching() -> SlipWatch {
        let mut watch = SlipWatch::default();
        let digits = [&[Digit::Ring, Digit::Little][..], &[Digit::Thumb, Digit::Index, Digit::Middle]];
        watch.begin(digits.into_iter().map(<[Digit]>::to_vec));
        watch
    }

    /// Runs `seconds` with the ring finger's cable at `ring` (m), returns the last tensions.
    fn run(watch: &mut SlipWatch, hand: &Hand, ring: impl Fn(f64) -> f64, seconds: f64) -> DigitVector {
        let mut tension = hand.slack();
        for tick in 0..(seconds / DT) as usize {
            tension = watch.tick(hand, &servos(hand, ring(tick as f64 * DT)), &[], &PLAN, 60.0, DT);
        }
        tension
    }

    #[test]
    fn nothing_moves_nothing_happens() {
        let (hand, mut watch) = (Hand::ftac(), watching());
        assert_eq!(run(&mut watch, &hand, |_| 0.02, 3.0)[..], PLAN);
        assert_eq!(watch.steps()[..], [0, 0]);
    }

    /// A ring finger that closes on raises ring and little, the others stay; calm brings the plan back, and no less.
    #[test]
    fn tension_rises_on_slip_within_limits_and_falls_back() {
        let (hand, mut watch) = (Hand::ftac(), watching());
        let slipping = run(&mut watch, &hand, |time| 0.02 + if time < 0.3 { 0.0 } else { 0.002 }, 0.5);
        assert_eq!(slipping[..], [20.0, 20.0, 20.0, 12.5, 12.5]);
        assert_eq!(watch.steps()[..], [1, 0]);
        let on_and_on = run(&mut watch, &hand, |time| 0.02 + 0.02 * time, 2.0);
        assert_eq!(on_and_on[3], 20.0, "twice the plan is the limit");
        let calm = run(&mut watch, &hand, |_| 0.05, 30.0);
        assert_eq!(calm[..], PLAN);
        let capped = watch.tick(&hand, &servos(&hand, 0.1), &[], &PLAN, 11.0, DT);
        assert_eq!(capped[3], 11.0, "no more than a servo can pull");
        assert_eq!(watch.tick(&hand, &servos(&hand, 0.1), &[], &PLAN, 5.0, DT)[0], 20.0, "never below the plan");
    }

    /// A pad of the little finger that shows something else is a slip of the first grip; the same picture is none.
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
            watch.tick(&hand, &at_rest, &[frame(&picture(level))], &PLAN, 60.0, DT);
            assert_eq!(watch.steps()[..], [steps, 0], "{level}");
        }
    }
}
