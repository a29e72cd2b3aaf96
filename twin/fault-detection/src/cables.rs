//! Tick-by-tick detectors for a digit's cable: one that stays slack is broken, one that becomes taut again has slipped.

use std::collections::VecDeque;

use super::external_wrench::{ExternalWrench, WrenchLevel};
use super::fault::FaultKind;
use super::limits::CableLimits;
use super::residuals::CableState;
use super::torque::{HISTORY_TICKS, missing_torque};

/// Longest rebound of a spool that reaches the end of its slack, s.
const MAX_REBOUND_TIME: f64 = 0.08;

/// Minimum interval between two weak-servo findings of one servo, s.
const REPORT_INTERVAL: f64 = 0.25;

/// Minimum share of its tension that a taut cable keeps from one tick to the next while nothing yields.
const MIN_TENSION_RETENTION: f64 = 0.93;

/// A finding: its kind, the measured value and the expected value.
pub type Finding = (FaultKind, f64, f64);

/// An episode in which a cable carries no load.
#[derive(Debug, Clone, Copy)]
struct SlackEpisode {
    /// Time at which the episode began, s.
    since: f64,
    /// Cable on the spool when the episode began, m.
    wound: f64,
    /// True if the digit was pulled so hard that it may grip something.
    grips: bool,
    /// External push on the hand at that time. A push may close a digit that grips nothing.
    wrench_level: WrenchLevel,
    /// True if the load vanished within one tick.
    sudden: bool,
    /// True if the load vanished from a firm pull, which no push explains.
    firm: bool,
    reported: bool,
}

impl SlackEpisode {
    /// True if only a fault of the cable itself explains the slack.
    fn is_certain(&self) -> bool {
        self.firm
            || self.sudden
                && self.wrench_level != WrenchLevel::Strong
                && (self.grips || self.wrench_level == WrenchLevel::Absent)
    }
}

/// True if the newest of `past` carries no load although the two ticks before it carried the same. For a cable above
/// the tension `grips`, also true if the tick before had already lost most of its load: a running spool takes two ticks
/// to lose it.
fn dropped_suddenly(past: &VecDeque<CableState>, grips: f64) -> bool {
    let [now, before, earlier, first] = newest_ticks(past);
    let bore = |cable: CableState| cable.tension > 0.4 * cable.servo_tension;
    let within_one =
        bore(before) && bore(earlier) && before.tension - now.tension > 0.65 * (earlier.tension - now.tension);
    let within_two = earlier.tension > grips
        && before.tension < 0.4 * earlier.tension
        && earlier.tension - now.tension > 0.8 * (first.tension - now.tension);
    within_one || within_two
}

/// Returns the four newest ticks, newest first, filled up with slack cables if there are fewer.
fn newest_ticks(past: &VecDeque<CableState>) -> [CableState; 4] {
    let mut newest = past.iter().rev().copied();
    std::array::from_fn(|_| newest.next().unwrap_or_default())
}

/// Detector for the cable and servo of one digit.
#[derive(Debug, Clone, Default)]
pub struct CableWatch {
    /// The last ticks, newest last.
    past: VecDeque<CableState>,
    slack: Option<SlackEpisode>,
    /// Time of the last weak-servo finding, s.
    last_weak_servo: Option<f64>,
    /// Slack that has just ended: end time, s; the episode; cable wound during it, m.
    ended_slack: Option<(f64, SlackEpisode, f64)>,
}

impl CableWatch {
    /// Processes one tick at `time` (s). `outside` is the external wrench on the hand.
    pub fn update(
        &mut self,
        limits: &CableLimits,
        time: f64,
        cable: &CableState,
        outside: ExternalWrench,
    ) -> Option<Finding> {
        self.past.push_back(*cable);
        if self.past.len() > HISTORY_TICKS {
            self.past.pop_front();
        }
        self.detect_break(limits, time, cable, outside.level).or_else(|| self.detect_slip(limits, time, cable)).or_else(
            || {
                if self.past.len() < HISTORY_TICKS {
                    return None;
                }
                let past: [CableState; HISTORY_TICKS] = std::array::from_fn(|n| self.past[n]);
                let again = self.last_weak_servo.is_some_and(|at| time < at + REPORT_INTERVAL);
                let share = missing_torque(limits, &past, outside).filter(|_| self.slack.is_none() && !again)?;
                self.last_weak_servo = Some(time);
                Some((FaultKind::ServoWeak, 1.0 - share, 1.0))
            },
        )
    }

    /// Detects a broken cable: one that carries no load although it is wound in.
    fn detect_break(
        &mut self,
        limits: &CableLimits,
        time: f64,
        cable: &CableState,
        pushed: WrenchLevel,
    ) -> Option<Finding> {
        let bears_nothing = cable.tension < limits.slack_share * cable.servo_tension + limits.slack;
        let tells = self.slack.is_some() || cable.reference_tension > limits.least;
        if !(bears_nothing && tells && cable.servo_tension > limits.least) {
            let gave = self.lost_load(limits).then(|| self.begin_slack(limits, time, pushed));
            if let Some(slack) = self.slack.take().or(gave.filter(|_| self.ended_slack.is_none())) {
                self.ended_slack = Some((time, slack, cable.wound_length - slack.wound));
            }
            return None;
        }
        // A spool that reaches the end of its slack rebounds.
        if let (None, Some((at, again, _))) = (&self.slack, self.ended_slack)
            && time < at + MAX_REBOUND_TIME
        {
            (self.slack, self.ended_slack) = (Some(again), None);
        }
        let begun = self.begin_slack(limits, time, pushed);
        let slack = self.slack.get_or_insert(begun);
        let wound = cable.wound_length - slack.wound;
        // An external push takes several ticks to close a digit, and cannot move it further than it closes.
        if time < slack.since + MAX_REBOUND_TIME {
            slack.wrench_level = slack.wrench_level.max(pushed);
        }
        let broken = if slack.is_certain() {
            wound > limits.longest_slip || time - slack.since > limits.slack_time
        } else {
            wound > limits.pushed_closed
        };
        if slack.reported || !broken {
            return None;
        }
        slack.reported = true;
        Some((FaultKind::CableBroken, cable.tension.max(0.0), cable.reference_tension))
    }

    /// Begins a slack episode.
    fn begin_slack(&self, limits: &CableLimits, time: f64, pushed: WrenchLevel) -> SlackEpisode {
        let [now, before, earlier, _] = newest_ticks(&self.past);
        SlackEpisode {
            since: time,
            wound: before.wound_length,
            sudden: dropped_suddenly(&self.past, limits.gripping) || self.lost_load(limits),
            grips: before.servo_tension > limits.gripping,
            wrench_level: pushed,
            firm: before.tension > limits.firm
                && now.tension < limits.slack_share * before.tension
                && earlier.tension > MIN_TENSION_RETENTION * before.tension,
            reported: false,
        }
    }

    /// True if a taut cable lost most of its load within one tick while the servo pulled as before. The tension is so
    /// high that some is left after a short slip.
    fn lost_load(&self, limits: &CableLimits) -> bool {
        let [now, before, earlier, _] = newest_ticks(&self.past);
        before.tension > limits.taut
            && now.tension < limits.taut_share * before.tension
            && before.tension > MIN_TENSION_RETENTION * earlier.tension
            && (before.servo_tension - earlier.servo_tension).abs()
                < (1.0 - MIN_TENSION_RETENTION) * before.servo_tension
    }

    /// Detects a slipped cable: slack that began suddenly and ended after a little winding.
    fn detect_slip(&mut self, limits: &CableLimits, time: f64, cable: &CableState) -> Option<Finding> {
        let (at, slack, wound) = self.ended_slack?;
        // The spool counts as still bearing its cable only after the rebound.
        if time < at + MAX_REBOUND_TIME {
            return None;
        }
        self.ended_slack = None;
        if cable.tension < 0.3 * cable.servo_tension {
            // The slack continues somewhat unsteadily: the current falls as the spool nears its top speed.
            self.slack = Some(slack);
            return None;
        }
        let bounded = (limits.shortest_slip..limits.longest_slip).contains(&wound);
        let slipped = slack.is_certain() && !slack.reported && bounded;
        slipped.then_some((FaultKind::CableSlipped, 1e3 * wound, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::super::limits::DetectionLimits;
    use super::*;

    /// Length of a tick, s.
    const TICK: f64 = 1.0 / 120.0;

    /// Returns the findings, with their ticks, for these tensions (N) of a cable that is pulled with 10 N and wound at
    /// `speed` (m/s).
    fn detected_faults(tensions: &[f64], speed: f64) -> Vec<(usize, FaultKind)> {
        detected_faults_for(10.0, WrenchLevel::Absent, tensions, speed)
    }

    /// As [`detected_faults`], for a cable pulled with `pulled` (N) and a hand that is `pushed`.
    fn detected_faults_for(pulled: f64, pushed: WrenchLevel, tensions: &[f64], speed: f64) -> Vec<(usize, FaultKind)> {
        let limits = DetectionLimits::standard().expect("the limits").cable;
        let mut watch = CableWatch::default();
        let see = |(n, tension): (usize, &f64)| {
            let (time, wound) = (n as f64 * TICK, n as f64 * TICK * speed);
            let cable = CableState {
                tension: *tension,
                reference_tension: 6.0,
                servo_tension: pulled,
                blocked_increase: 0.0,
                wound_length: wound,
                speed: speed - 1e-4 * n as f64,
            };
            watch.update(&limits, time, &cable, ExternalWrench { level: pushed, jolt: 0.0 }).map(|(kind, ..)| (n, kind))
        };
        tensions.iter().enumerate().filter_map(see).collect()
    }

    /// Ten ticks of 10 N, `slack` ticks of zero tension, twenty ticks of 10 N.
    fn dip(slack: usize) -> Vec<f64> {
        [vec![10.0; 10], vec![0.0; slack], vec![10.0; 20]].concat()
    }

    #[test]
    fn a_cable_that_stays_slack_is_broken_and_one_that_recovers_has_slipped() {
        let broken = detected_faults(&dip(40), 0.04);
        assert!(matches!(broken[..], [(n, FaultKind::CableBroken)] if (25..35).contains(&n)), "{broken:?}");
        let slipped = detected_faults(&dip(6), 0.04);
        assert!(matches!(slipped[..], [(n, FaultKind::CableSlipped)] if n < 30), "{slipped:?}");
        let pushed_closed = [vec![10.0; 10], vec![8.0, 5.0, 2.5], vec![0.0; 30], vec![10.0; 10]].concat();
        assert_eq!(detected_faults(&pushed_closed, 0.04), [], "a push closed the digit");
        assert_eq!(
            detected_faults_for(3.0, WrenchLevel::Moderate, &dip(6), 0.04),
            [],
            "a push on the hand may close a free digit"
        );
        assert_eq!(detected_faults(&[10.0; 60], 0.04), []);
        let pushed_far = [vec![10.0; 10], vec![8.0, 5.0, 2.5], vec![0.0; 60]].concat();
        assert!(
            matches!(detected_faults(&pushed_far, 0.04)[..], [(_, FaultKind::CableBroken)]),
            "no push moves a digit so far"
        );
    }

    /// Two limiting cases: a tension so high that a short slip leaves some of it, and a running spool that takes two
    /// ticks to lose its load.
    #[test]
    fn a_taut_cable_slips_without_slack_and_a_fast_one_breaks_in_two_ticks() {
        let slip = [vec![30.0; 10], vec![9.0, 14.0, 20.0], vec![30.0; 20]].concat();
        assert!(matches!(
            detected_faults_for(30.0, WrenchLevel::Absent, &slip, 0.04)[..],
            [(_, FaultKind::CableSlipped)]
        ));
        let let_go = [vec![30.0; 10], vec![25.0, 20.0, 14.0, 9.0, 14.0, 20.0], vec![30.0; 20]].concat();
        assert_eq!(detected_faults_for(30.0, WrenchLevel::Absent, &let_go, 0.04), [], "an object that is taken away");
        let broken = [vec![10.0; 10], vec![2.0], vec![0.0; 40]].concat();
        assert!(matches!(detected_faults(&broken, 0.04)[..], [(n, FaultKind::CableBroken)] if n < 35));
    }
}
