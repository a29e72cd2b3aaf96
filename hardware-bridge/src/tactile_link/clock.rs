//! The board's clock in terms of the host's.
//!
//! A question sent at host time a and answered at b with board time t means: the board showed t somewhere between a and b. Taking the middle is off by
//! at most half the round trip (b - a) / 2. Of the last few samples the one with the shortest round trip is believed, carried on at equal
//! rates; a quartz's 50 ppm is 50 us in a second, so asking once a second is enough.

use std::collections::VecDeque;

/// Samples kept: at one a second, drift over the window stays below 1 ms.
const KEPT: usize = 16;

/// One question and its answer, s.
#[derive(Debug, Clone, Copy)]
struct Sample {
    host: f64,
    board: f64,
    round_trip: f64,
}

/// What is known about the board's clock.
#[derive(Debug, Clone, Default)]
pub struct BoardClock {
    samples: VecDeque<Sample>,
}

impl BoardClock {
    /// Adds an answer: asked at `asked`, came at `came` (host, s), showing `board` (s).
    pub fn note(&mut self, asked: f64, came: f64, board: f64) {
        if came < asked {
            return;
        }
        if self.samples.len() == KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample { host: 0.5 * (asked + came), board, round_trip: came - asked });
    }

    fn best(&self) -> Option<&Sample> {
        self.samples.iter().min_by(|a, b| a.round_trip.total_cmp(&b.round_trip))
    }

    /// Host time, s, at which the board showed `board`, s; `None` before the first answer.
    pub fn host_time(&self, board: f64) -> Option<f64> {
        self.best().map(|sample| sample.host + board - sample.board)
    }

    /// By how much [`BoardClock::host_time`] may be off, s, drift apart.
    pub fn uncertainty(&self) -> Option<f64> {
        self.best().map(|sample| 0.5 * sample.round_trip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the delays on the two ways, the error is within half the shortest round trip and the drift.
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
                clock.note(asked, asked + there + back, board_at(asked + there));
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
