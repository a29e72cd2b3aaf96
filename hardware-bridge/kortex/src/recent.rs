//! Statistics of the last second or so of a cyclic exchange: regularity of the commands, and number of answers in time.

use std::time::{Duration, Instant};

/// Length of a span. The present span and the one before it are kept.
const SPAN: Duration = Duration::from_millis(500);

/// Cycles of one span.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Cycles {
    /// Longest interval between two commands.
    pub gap: Duration,
    pub sent: u64,
    /// Commands without an answer at their deadline.
    pub missed: u64,
}

/// The cycles of the present span and of the one before.
#[derive(Debug)]
pub(super) struct Recent {
    last: Instant,
    began: Instant,
    now: Cycles,
    before: Cycles,
}

impl Recent {
    /// Begins at `now`.
    pub(super) fn new(now: Instant) -> Self {
        Self { last: now, began: now, now: Cycles::default(), before: Cycles::default() }
    }

    /// Notes a command that is sent `at` this time.
    pub(super) fn note_sent(&mut self, at: Instant) {
        if at - self.began > SPAN {
            (self.before, self.now, self.began) = (self.now, Cycles::default(), at);
        }
        self.now.gap = self.now.gap.max(at - self.last);
        self.now.sent += 1;
        self.last = at;
    }

    /// Notes that the last command was not answered in time.
    pub(super) fn note_missed(&mut self) {
        self.now.missed += 1;
    }

    /// Returns the cycles of both spans together.
    pub(super) fn cycles(&self) -> Cycles {
        let (now, before) = (self.now, self.before);
        Cycles { gap: now.gap.max(before.gap), sent: now.sent + before.sent, missed: now.missed + before.missed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap is remembered for half a second at least, and forgotten after a second of regular cycles.
    #[test]
    fn gaps_are_remembered_for_a_while() {
        let begin = Instant::now();
        let mut recent = Recent::new(begin);
        let at = |ms: u64| begin + Duration::from_millis(ms);
        recent.note_sent(at(80));
        recent.note_missed();
        for ms in 81..580 {
            recent.note_sent(at(ms));
        }
        let cycles = recent.cycles();
        assert_eq!((cycles.gap, cycles.sent, cycles.missed), (Duration::from_millis(80), 500, 1));
        for ms in 580..2000 {
            recent.note_sent(at(ms));
        }
        let cycles = recent.cycles();
        assert_eq!((cycles.gap, cycles.missed), (Duration::from_millis(1), 0));
    }
}
