//! Detectors for a digit's cable, from one tick to the next: one that is slack has broken, one that is taut again has slipped.

use std::collections::VecDeque;

use super::divergence::Kind;
use super::limits::CableLimits;
use super::outside::{Outside, Pushed};
use super::residuals::Cable;
use super::torque::{KEPT, missing};

/// A spool that meets the end of its slack rebounds from it for no longer than this, s.
const REBOUND: f64 = 0.08;

/// A servo that is named weak is not named again within this time, s.
const AGAIN: f64 = 0.25;

/// Of its tension, what a taut cable bears a tick later where nothing gives, at least.
const TAUT_BEFORE: f64 = 0.93;

/// A finding: what, and the numbers found and expected.
pub type Finding = (Kind, f64, f64);

/// A cable that bears nothing at present.
#[derive(Debug, Clone, Copy)]
struct Slack {
    /// s.
    since: f64,
    /// Cable on the spool when it began, m.
    wound: f64,
    /// Whether the digit was pulled so hard that it may grip something.
    grips: bool,
    /// Whether something pushed the hand at that time: it may push a digit closed that grips nothing.
    pushed: Pushed,
    /// Whether it went from bearing its load to bearing none within a tick.
    sudden: bool,
    /// Whether it did so from a firm pull: no push does that.
    firm: bool,
    named: bool,
}

impl Slack {
    /// Whether nothing but the cable itself explains it.
    fn is_certain(&self) -> bool {
        self.firm || self.sudden && self.pushed != Pushed::Hard && (self.grips || self.pushed == Pushed::No)
    }
}

/// Whether the newest of `past` bears nothing and the one before bore as much as the one before that; or, of a cable that `grips`, the one before
/// had lost most of its load already: a spool that runs takes two ticks to lose it.
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

/// The four newest ticks, newest first; slack cables where there are fewer.
fn newest(past: &VecDeque<Cable>) -> [Cable; 4] {
    let mut newest = past.iter().rev().copied();
    std::array::from_fn(|_| newest.next().unwrap_or_default())
}

/// Watches one digit.
#[derive(Debug, Clone, Default)]
pub struct CableWatch {
    /// The last ticks, newest last.
    past: VecDeque<Cable>,
    slack: Option<Slack>,
    /// When the servo was last named weak, s.
    weakened: Option<f64>,
    /// A slack that has just ended: when, and how much was wound, m.
    ended: Option<(f64, Slack, f64)>,
}

impl CableWatch {
    /// One tick at `time` (s), with what acts on the hand from outside.
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

    /// Cables that bear nothing although they are wound in.
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
        // A spool that meets the end of its slack rebounds.
        if let (None, Some((at, again, _))) = (&self.slack, self.ended)
            && time < at + REBOUND
        {
            (self.slack, self.ended) = (Some(again), None);
        }
        let begun = self.begin(limits, time, pushed);
        let slack = self.slack.get_or_insert(begun);
        let wound = cable.wound - slack.wound;
        // Somebody who pushes a digit closed takes some ticks for it, and no further than it closes.
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

    /// A slack that begins now.
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

    /// Whether a taut cable lost most of its load within a tick, while the servo pulled as before: so much tension that a short slip leaves some.
    fn gave(&self, limits: &CableLimits) -> bool {
        let [now, before, earlier, _] = newest(&self.past);
        before.tension > limits.taut
            && now.tension < limits.taut_share * before.tension
            && before.tension > TAUT_BEFORE * earlier.tension
            && (before.pulled - earlier.pulled).abs() < (1.0 - TAUT_BEFORE) * before.pulled
    }

    /// A slack that began suddenly and ended after a little winding.
    fn slipped(&mut self, limits: &CableLimits, time: f64, cable: &Cable) -> Option<Finding> {
        let (at, slack, wound) = self.ended?;
        // Only then is it known that the spool has not gone on without its cable.
        if time < at + REBOUND {
            return None;
        }
        self.ended = None;
        if cable.tension < 0.3 * cable.pulled {
            // It goes on, somewhat unsteadily: the current falls as the spool comes near its highest speed.
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

    /// What is named of these tensions (N) of a cable that is pulled with 10 N and wound at `speed` (m/s), and when.
    fn named(tensions: &[f64], speed: f64) -> Vec<(usize, Kind)> {
        named_of(10.0, Pushed::No, tensions, speed)
    }

    /// The same pulled with `pulled` (N), by a hand that is `pushed`.
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

    /// Ten ticks of 10 N, `slack` ticks of nothing, twenty of 10 N.
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

    /// So much tension that a short slip leaves some, and a spool that takes two ticks to lose its load.
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
