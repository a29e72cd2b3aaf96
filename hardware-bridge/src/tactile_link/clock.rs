//! Conversion of the board's clock to the host's.
//!
//! A question sent at host time a and answered at b with board time t means that the board's clock showed t somewhere
//! between a and b. The midpoint is off by at most half the round trip, (b - a) / 2. Of the last few samples, the one
//! with the shortest round trip is used and extrapolated at equal rates. A quartz's 50 ppm is 50 us in a second, so
//! asking once a second is enough.

use std::collections::VecDeque;

/// Samples kept: at one a second, drift over the window stays below 1 ms.
const MAX_SAMPLES: usize = 16;

/// One question and its answer, s.
#[derive(Debug, Clone, Copy)]
struct Sample {
    host: f64,
    board: f64,
    round_trip: f64,
}

/// Estimate of the board's clock.
#[derive(Debug, Clone, Default)]
pub struct BoardClock {
    samples: VecDeque<Sample>,
}

impl BoardClock {
    /// Adds a sample: asked at `asked`, answered at `came` (host clock, s), with board time `board` (s).
    pub fn add_sample(&mut self, asked: f64, came: f64, board: f64) {
        if came < asked {
            return;
        }
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample { host: 0.5 * (asked + came), board, round_trip: came - asked });
    }

    fn best_sample(&self) -> Option<&Sample> {
        self.samples.iter().min_by(|a, b| a.round_trip.total_cmp(&b.round_trip))
    }

    /// Converts a time on the board's clock, `board` (s), to host time, s; `None` before the first sample.
    pub fn host_time(&self, board: f64) -> Option<f64> {
        self.best_sample().map(|sample| sample.host + board - sample.board)
    }

    /// Returns the uncertainty of [`BoardClock::host_time`], s, without drift.
    pub fn uncertainty(&self) -> Option<f64> {
        self.best_sample().map(|sample| 0.5 * sample.round_trip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// For any delays in the two directions, the error is within half the shortest round trip plus the drift.
        #[test]
        fn within_half_a_round_trip(
            offset in -1e6..1e6_f64,
            delays in prop::collection::vec((1e-4..0.05_f64, 1e-4..0.05_f64), 1..16),
        ) {
            let drift = 50e-6;
            let board_at = |host: f64| offset + host * (1.0 + drift);
            let mut clock = BoardClock::default();
            for (n, (there, back)) in delays.iter().enumerate() {
                let asked = n as f64;
                clock.add_sample(asked, asked + there + back, board_at(asked + there));
            }
            let now = delays.len() as f64;
            let error = (clock.host_time(board_at(now)).expect("samples") - now).abs();
            prop_assert!(error <= clock.uncertainty().expect("samples") + drift * 17.0 + 1e-9);
        }
    }

    #[test]
    fn nothing_is_known_without_samples() {
        assert_eq!(BoardClock::default().host_time(3.0), None);
    }
}
