//! Tick-by-tick detectors for a digit's cable: a cable that stays slack is broken, one that becomes taut again has
//! slipped.

use std::collections::VecDeque;

use super::divergence::Kind;
use super::limits::CableLimits;
use super::outside::{Outside, Pushed};
use super::residuals::Cable;
use super::torque::{KEPT, missing};

/// Longest rebound of a spool that reaches the end of its slack, s.
const REBOUND: f64 = 0.08;

/// Minimum interval between two weak-servo findings of one servo, s.
const AGAIN: f64 = 0.25;

/// Minimum share of its tension that a taut cable keeps from one tick to the next while nothing gives way.
const TAUT_BEFORE: f64 = 0.93;

/// A finding: its kind, the measured value and the expected value.
pub type Finding = (Kind, f64, f64);

/// An episode in which a cable carries no load.
#[derive(Debug, Clone, Copy)]
struct Slack {
    /// Time at which the episode began, s.
    since: f64,
    /// Cable on the spool when the episode began, m.
    wound: f64,
    /// True if the digit was pulled so hard that it may grip something.
    grips: bool,
    /// External push on the hand at that time. A push may close a digit that grips nothing.
    pushed: Pushed,
    /// True if the load vanished within one tick.
    sudden: bool,
    /// True if the load vanished from a firm pull: no push does that.
    firm: bool,
    named: bool,
}

impl Slack {
    /// True if only a fault of the cable itself explains the slack.
    fn is_certain(&self) -> bool {
        self.firm || self.sudden && self.pushed != Pushed::Hard && (self.grips || self.pushed == Pushed::No)
    }
}

/// True if the newest of `past` carries no load although the tick before it carried as much as the one before that. For
/// a cable above the tension `grips`, also true if the tick before had already lost most of its load: a running spool
/// takes two ticks to lose it.
fn fell_at_once(past: &VecDeque<Cable>, grips: f64) -> bool {
    let [now, before, earlier, first] = newest(past);
    let bore = |cable: Cable| cable.tension > 0.4 * cable.pulled;
    let within_one =
        bore(before) && bore(earlier) && before.tension - now.tension > 0.65 * (earlier.tension - now.tension);
    let within_two = earlier.tension > grips
        && before.tension < 0.4 * earlier.tension
        && earlier.tension - now.tension > 0.8 * (first.tension - now.tension);
    within_one || within_two
}

/// Returns the four newest ticks, newest first, filled up with slack cables if there are fewer.
fn newest(past: &VecDeque<Cable>) -> [Cable; 4] {
    let mut newest = past.iter().rev().copied();
    std::array::from_fn(|_| newest.next().unwrap_or_default())
}

/// Detector for the cable and servo of one digit.
#[derive(Debug, Clone, Default)]
pub struct CableWatch {
    /// The last ticks, newest last.
    past: VecDeque<Cable>,
    slack: Option<Slack>,
    /// Time of the last weak-servo finding, s.
    weakened: Option<f64>,
    /// Slack that has just ended: end time, s; the episode; cable wound during it, m.
    ended: Option<(f64, Slack, f64)>,
}

impl CableWatch {
    /// Processes one tick at `time` (s). `outside` is the external load on the hand.
    pub fn see(&mut self, limits: &CableLimits, time: f64, cable: &Cable, outside: Outside) -> Option<Finding> {
        self.past.push_back(*cable);
        if self.past.len() > KEPT {
            self.past.pop_front();
        }
        self.slack(limits, time, cable, outside.pushed).or_else(|| self.slipped(limits, time, cable)).or_else(|| {
            if self.past.len() < KEPT {
                return None;
            }
            let past: [Cable; KEPT] = std::array::from_fn(|n| self.past[n]);
            let again = self.weakened.is_some_and(|at| time < at + AGAIN);
            let share = missing(limits, &past, outside).filter(|_| self.slack.is_none() && !again)?;
            self.weakened = Some(time);
            Some((Kind::ServoWeak, 1.0 - share, 1.0))
        })
    }

    /// Detects a broken cable: one that carries no load although it is wound in.
    fn slack(&mut self, limits: &CableLimits, time: f64, cable: &Cable, pushed: Pushed) -> Option<Finding> {
        let bears_nothing = cable.tension < limits.slack_share * cable.pulled + limits.slack;
        let tells = self.slack.is_some() || cable.free > limits.least;
        if !(bears_nothing && tells && cable.pulled > limits.least) {
            let gave = self.gave(limits).then(|| self.begin(limits, time, pushed));
            if let Some(slack) = self.slack.take().or(gave.filter(|_| self.ended.is_none())) {
                self.ended = Some((time, slack, cable.wound - slack.wound));
            }
            return None;
        }
        // A spool that reaches the end of its slack rebounds.
        if let (None, Some((at, again, _))) = (&self.slack, self.ended)
            && time < at + REBOUND
        {
            (self.slack, self.ended) = (Some(again), None);
        }
        let begun = self.begin(limits, time, pushed);
        let slack = self.slack.get_or_insert(begun);
        let wound = cable.wound - slack.wound;
        // An external push takes several ticks to close a digit, and cannot move it further than it closes.
        if time < slack.since + REBOUND {
            slack.pushed = slack.pushed.max(pushed);
        }
        let broken = if slack.is_certain() {
            wound > limits.longest_slip || time - slack.since > limits.slack_time
        } else {
            wound > limits.pushed_closed
        };
        if slack.named || !broken {
            return None;
        }
        slack.named = true;
        Some((Kind::CableBroken, cable.tension.max(0.0), cable.free))
    }

    /// Begins an episode of slack.
    fn begin(&self, limits: &CableLimits, time: f64, pushed: Pushed) -> Slack {
        let [now, before, earlier, _] = newest(&self.past);
        Slack {
            since: time,
            wound: before.wound,
            sudden: fell_at_once(&self.past, limits.gripping) || self.gave(limits),
            grips: before.pulled > limits.gripping,
            pushed,
            firm: before.tension > limits.firm
                && now.tension < limits.slack_share * before.tension
                && earlier.tension > TAUT_BEFORE * before.tension,
            named: false,
        }
    }

    /// True if a taut cable lost most of its load within one tick while the servo pulled as before. The tension is so
    /// high that some is left after a short slip.
    fn gave(&self, limits: &CableLimits) -> bool {
        let [now, before, earlier, _] = newest(&self.past);
        before.tension > limits.taut
            && now.tension < limits.taut_share * before.tension
            && before.tension > TAUT_BEFORE * earlier.tension
            && (before.pulled - earlier.pulled).abs() < (1.0 - TAUT_BEFORE) * before.pulled
    }

    /// Detects a slipped cable: slack that began suddenly and ended after a little winding.
    fn slipped(&mut self, limits: &CableLimits, time: f64, cable: &Cable) -> Option<Finding> {
        let (at, slack, wound) = self.ended?;
        // Only after the rebound is it certain that the spool has not gone on without its cable.
        if time < at + REBOUND {
            return None;
        }
        self.ended = None;
        if cable.tension < 0.3 * cable.pulled {
            // The slack continues somewhat unsteadily: the current falls as the spool nears its top speed.
            self.slack = Some(slack);
            return None;
        }
        let bounded = (limits.shortest_slip..limits.longest_slip).contains(&wound);
        let slipped = slack.is_certain() && !slack.named && bounded;
        slipped.then_some((Kind::CableSlipped, 1e3 * wound, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::super::limits::Limits;
    use super::*;

    /// Length of a tick, s.
    const TICK: f64 = 1.0 / 120.0;

    /// Returns the findings, with their ticks, for these tensions (N) of a cable that is pulled with 10 N and wound at
    /// `speed` (m/s).
    fn named(tensions: &[f64], speed: f64) -> Vec<(usize, Kind)> {
        named_of(10.0, Pushed::No, tensions, speed)
    }

    /// As [`named`], for a cable pulled with `pulled` (N) and a hand that is `pushed`.
    fn named_of(pulled: f64, pushed: Pushed, tensions: &[f64], speed: f64) -> Vec<(usize, Kind)> {
        let limits = Limits::standard().expect("the limits").cable;
        let mut watch = CableWatch::default();
        let see = |(n, tension): (usize, &f64)| {
            let (time, wound) = (n as f64 * TICK, n as f64 * TICK * speed);
            let cable =
                Cable { tension: *tension, free: 6.0, pulled, held: 0.0, wound, speed: speed - 1e-4 * n as f64 };
            watch.see(&limits, time, &cable, Outside { pushed, jolt: 0.0 }).map(|(kind, ..)| (n, kind))
        };
        tensions.iter().enumerate().filter_map(see).collect()
    }

    /// Ten ticks of 10 N, `slack` ticks of zero tension, twenty ticks of 10 N.
    fn dip(slack: usize) -> Vec<f64> {
        [vec![10.0; 10], vec![0.0; slack], vec![10.0; 20]].concat()
    }

    #[test]
    fn a_cable_that_stays_slack_is_broken_and_one_that_recovers_has_slipped() {
        let broken = named(&dip(40), 0.04);
        assert!(matches!(broken[..], [(n, Kind::CableBroken)] if (25..35).contains(&n)), "{broken:?}");
        let slipped = named(&dip(6), 0.04);
        assert!(matches!(slipped[..], [(n, Kind::CableSlipped)] if n < 30), "{slipped:?}");
        let pushed_closed = [vec![10.0; 10], vec![8.0, 5.0, 2.5], vec![0.0; 30], vec![10.0; 10]].concat();
        assert_eq!(named(&pushed_closed, 0.04), [], "somebody pushed the digit closed");
        assert_eq!(named_of(3.0, Pushed::Yes, &dip(6), 0.04), [], "what pushes the hand may push a free digit closed");
        assert_eq!(named(&[10.0; 60], 0.04), []);
        let pushed_far = [vec![10.0; 10], vec![8.0, 5.0, 2.5], vec![0.0; 60]].concat();
        assert!(matches!(named(&pushed_far, 0.04)[..], [(_, Kind::CableBroken)]), "nobody pushes a digit so far");
    }

    /// Two limiting cases: a tension so high that a short slip leaves some of it, and a running spool that takes two
    /// ticks to lose its load.
    #[test]
    fn a_taut_cable_slips_without_slack_and_a_fast_one_breaks_in_two_ticks() {
        let slip = [vec![30.0; 10], vec![9.0, 14.0, 20.0], vec![30.0; 20]].concat();
        assert!(matches!(named_of(30.0, Pushed::No, &slip, 0.04)[..], [(_, Kind::CableSlipped)]));
        let let_go = [vec![30.0; 10], vec![25.0, 20.0, 14.0, 9.0, 14.0, 20.0], vec![30.0; 20]].concat();
        assert_eq!(named_of(30.0, Pushed::No, &let_go, 0.04), [], "an object that goes");
        let broken = [vec![10.0; 10], vec![2.0], vec![0.0; 40]].concat();
        assert!(matches!(named(&broken, 0.04)[..], [(n, Kind::CableBroken)] if n < 35));
    }
}
