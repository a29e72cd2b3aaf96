//! Image requests for a recording. No decision may depend on these images: a recorded trial is the same as an
//! unrecorded one.

use hand_model::robot::{Observation, TactileFrame};

/// Time limit for requested images, s; after it, new ones are requested.
const REQUEST_TIMEOUT: f64 = 1.0;

/// Requests images at intervals while no other component does.
#[derive(Debug, Clone)]
pub struct PeriodicImageRequests {
    /// Period of the requests, s; `None` for no requests.
    period: Option<f64>,
    /// Time of its own last request, s.
    last: f64,
    /// True if images have arrived since the last request.
    answered: bool,
    /// Times of its own requests whose images may still be on their way, s.
    pending_requests: Vec<f64>,
}

impl Default for PeriodicImageRequests {
    fn default() -> Self {
        Self { period: None, last: f64::NEG_INFINITY, answered: true, pending_requests: Vec::new() }
    }
}

impl PeriodicImageRequests {
    /// Requests images every `period` (s) from now on, independent of any earlier clock.
    pub fn begin(&mut self, period: f64) {
        (self.period, self.last) = (Some(period), f64::NEG_INFINITY);
    }

    /// Images out of `arrived` that others requested. A simulated camera exposes at the end of the `tick` (s) of the
    /// request. Images that a real camera takes at any other time count as requested by others.
    pub fn images_for_others(&self, arrived: &[TactileFrame], tick: f64) -> Vec<TactileFrame> {
        let own = |frame: &TactileFrame| {
            self.pending_requests.iter().any(|asked| (frame.time - asked - tick).abs() < 0.5 * tick)
        };
        arrived.iter().filter(|frame| !own(frame)).cloned().collect()
    }

    /// True if images are to be captured in this tick. That is the case if `others` request some. It is also the case
    /// at its own period, provided that others leave the cameras `free` for the time being and that the link is idle.
    pub fn should_capture(&mut self, observation: &Observation, others: bool, free: bool) -> bool {
        let now = observation.time;
        self.pending_requests.retain(|asked| now < asked + REQUEST_TIMEOUT);
        let link_is_free = self.answered && observation.tactile.is_empty() || now > self.last + REQUEST_TIMEOUT;
        let due = self.period.is_some_and(|period| now >= self.last + period);
        let own = !others && free && link_is_free && due;
        if own {
            self.last = now;
            self.pending_requests.push(now);
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

    /// It requests images at its period while no other component does, waits for the answer, and distinguishes its own
    /// images from those of others.
    #[test]
    fn its_images_are_told_from_those_of_others() {
        let mut watch = PeriodicImageRequests { period: Some(0.1), ..PeriodicImageRequests::default() };
        assert!(watch.should_capture(&observation(0.0, vec![]), false, true));
        assert!(!watch.should_capture(&observation(0.2, vec![]), false, true), "the first have not come");
        assert!(watch.should_capture(&observation(0.2, vec![]), true, true), "others want some");
        let arrived = [frame(TICK), frame(0.2 + TICK)];
        let others: Vec<f64> = watch.images_for_others(&arrived, TICK).iter().map(|frame| frame.time).collect();
        assert_eq!(others, [0.2 + TICK]);
        assert!(!watch.should_capture(&observation(0.3, arrived.to_vec()), false, true), "the link is busy");
        assert!(!watch.should_capture(&observation(0.4, vec![]), false, false), "others have their own period");
        assert!(watch.should_capture(&observation(0.5, vec![]), false, true));
        assert!(
            watch.should_capture(&observation(0.5 + 2.0 * REQUEST_TIMEOUT, vec![]), false, true),
            "images that were lost"
        );
    }

    #[test]
    fn nobody_who_does_not_record_is_shown_anything() {
        let mut watch = PeriodicImageRequests::default();
        assert!((0..100).all(|n| !watch.should_capture(&observation(0.1 * f64::from(n), vec![]), false, true)));
    }
}
