//! Conversion of the stamps of messages to the bridge's clock.
//!
//! A message that carries the stamp s and arrives at t was under way for t - s less the difference of the clocks. The least
//! t - s of the last 10 to 20 seconds is that of the fastest message; a stamp counts as if every message were under way
//! at least as long as that one. Measurements are thus dated late by the fastest way through the network, which is below
//! a millisecond on one computer.

/// Length of a window, s; the least difference of the present window and the one before counts.
const WINDOW: f64 = 10.0;

/// Estimate of the difference between the bridge's clock and that of a topic's stamps.
#[derive(Debug, Clone, Default)]
pub struct StampClock {
    /// Start and least difference of the present window, s.
    present: Option<(f64, f64)>,
    /// Least difference of the window before, s.
    before: Option<f64>,
}

impl StampClock {
    /// Converts the stamp (s) of a message that has arrived at `now` (s on the bridge's clock) to the bridge's clock, s. The
    /// result is not later than `now`.
    pub fn host_time(&mut self, stamp: f64, now: f64) -> f64 {
        let difference = now - stamp;
        let (start, least) = self.present.map_or((now, difference), |(start, least)| (start, least.min(difference)));
        self.present = Some((start, least));
        if now - start > WINDOW {
            self.before = Some(least);
            self.present = Some((now, difference));
        }
        let least = self.before.map_or(least, |before| before.min(least));
        (stamp + least).min(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A delayed message is dated as early as its stamp says, in whatever clock.
    #[test]
    fn a_delay_does_not_move_a_measurement() {
        let mut clock = StampClock::default();
        let offset = 1.7e9;
        assert_eq!(clock.host_time(offset + 1.0, 1.002), 1.002);
        let late = clock.host_time(offset + 1.1, 1.19);
        assert!((late - 1.102).abs() < 1e-6, "{late}");
        // A faster message sharpens the estimate, and none is dated into the future.
        assert_eq!(clock.host_time(offset + 1.2, 1.2005), 1.2005);
        assert!((clock.host_time(offset + 1.3, 1.35) - 1.3005).abs() < 1e-6);
    }

    /// A clock that is set, or that runs slower, is followed within two windows.
    #[test]
    fn a_clock_that_was_set_is_followed() {
        let mut clock = StampClock::default();
        let mut now = 0.0;
        while now < 5.0 {
            clock.host_time(now, now);
            now += 0.01;
        }
        while now < 40.0 {
            clock.host_time(now - 3.0, now);
            now += 0.01;
        }
        assert!((clock.host_time(now - 3.0, now) - now).abs() < 1e-9);
    }
}
