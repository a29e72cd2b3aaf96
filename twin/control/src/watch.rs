//! Images that are taken for a recording. Nothing may be decided by them: a trial that is recorded is the same one.

use hand_model::robot::{Observation, TactileFrame};

/// Longest wait for images that were asked for before others are, s.
const LOST: f64 = 1.0;

/// Asks for images now and then, where nobody else does.
#[derive(Debug, Clone)]
pub struct Watch {
    /// How often, s; never where there is none.
    period: Option<f64>,
    /// When it asked last, s.
    last: f64,
    /// Whether images have come since any were asked for last.
    answered: bool,
    /// When it asked for the images that may still be on their way, s.
    asked: Vec<f64>,
}

impl Default for Watch {
    fn default() -> Self {
        Self { period: None, last: f64::NEG_INFINITY, answered: true, asked: Vec::new() }
    }
}

impl Watch {
    /// Asks every `period` (s) from now on, whatever clock it went by before.
    pub fn begin(&mut self, period: f64) {
        (self.period, self.last) = (Some(period), f64::NEG_INFINITY);
    }

    /// Those of the images that `arrived` that it did not ask for. A simulated camera exposes at the end of the `tick` (s) in which it is
    /// asked; what a real one takes at any other time counts as somebody else's.
    pub fn others(&self, arrived: &[TactileFrame], tick: f64) -> Vec<TactileFrame> {
        let own = |frame: &TactileFrame| self.asked.iter().any(|asked| (frame.time - asked - tick).abs() < 0.5 * tick);
        arrived.iter().filter(|frame| !own(frame)).cloned().collect()
    }

    /// Whether images are to be taken in this tick: where `others` want some, and, where they are `free` of others for the time being and the
    /// link is too, as often as it wants some itself.
    pub fn captures(&mut self, observation: &Observation, others: bool, free: bool) -> bool {
        let now = observation.time;
        self.asked.retain(|asked| now < asked + LOST);
        let link_is_free = self.answered && observation.tactile.is_empty() || now > self.last + LOST;
        let due = self.period.is_some_and(|period| now >= self.last + period);
        let own = !others && free && link_is_free && due;
        if own {
            self.last = now;
            self.asked.push(now);
        }
        let capture = others || own;
        self.answered = !capture && (self.answered || !observation.tactile.is_empty());
        capture
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hand_model::robot::{ArmState, ServoState, TactileImage};

    use super::*;

    const TICK: f64 = 1.0 / 60.0;

    fn frame(time: f64) -> TactileFrame {
        TactileFrame { camera: 0, time, sequence: 0, image: Arc::new(TactileImage { rgb: Vec::new() }) }
    }

    fn observation(time: f64, tactile: Vec<TactileFrame>) -> Observation {
        let servos = [ServoState::default(); 6].into();
        Observation { time, sequence: 0, servos, arm: ArmState::default(), tactile }
    }

    /// It asks at its period where nobody else does, waits for the answer, and knows its images again among others'.
    #[test]
    fn its_images_are_told_from_those_of_others() {
        let mut watch = Watch { period: Some(0.1), ..Watch::default() };
        assert!(watch.captures(&observation(0.0, vec![]), false, true));
        assert!(!watch.captures(&observation(0.2, vec![]), false, true), "the first have not come");
        assert!(watch.captures(&observation(0.2, vec![]), true, true), "others want some");
        let arrived = [frame(TICK), frame(0.2 + TICK)];
        let others: Vec<f64> = watch.others(&arrived, TICK).iter().map(|frame| frame.time).collect();
        assert_eq!(others, [0.2 + TICK]);
        assert!(!watch.captures(&observation(0.3, arrived.to_vec()), false, true), "the link is busy");
        assert!(!watch.captures(&observation(0.4, vec![]), false, false), "others have their own period");
        assert!(watch.captures(&observation(0.5, vec![]), false, true));
        assert!(watch.captures(&observation(0.5 + 2.0 * LOST, vec![]), false, true), "images that were lost");
    }

    #[test]
    fn nobody_who_does_not_record_is_shown_anything() {
        let mut watch = Watch::default();
        assert!((0..100).all(|n| !watch.captures(&observation(0.1 * f64::from(n), vec![]), false, true)));
    }
}
