//! Detector for a servo that gives less torque than its current implies: a step in the spool's torque balance within
//! one tick.

use super::external_wrench::{ExternalWrench, WrenchLevel};
use super::limits::CableLimits;
use super::residuals::CableState;

/// Number of past ticks that are kept.
pub const HISTORY_TICKS: usize = 8;
/// Largest change of a servo's current over the kept ticks, as a share, that permits detection of a step of its torque.
const MAX_CURRENT_CHANGE: f64 = 0.6;
/// Index of the tick in which a step that decays has shown.
const DECAY_INDEX: usize = HISTORY_TICKS - 3;
/// Index of the tick in which a step that stays has shown.
const LASTING_INDEX: usize = HISTORY_TICKS - 4;

/// Returns the share of its torque that a servo lost within a tick, from its last ticks, oldest first. `None` if there
/// is no evidence, or if the load from `outside` may explain it.
pub fn missing_torque(
    limits: &CableLimits,
    past: &[CableState; HISTORY_TICKS],
    outside: ExternalWrench,
) -> Option<f64> {
    if past.iter().any(|cable| cable.servo_tension < limits.least) {
        return None;
    }
    let told = |share: &f64| is_reportable(limits, past, outside, *share);
    lasting_step(limits, past).filter(told).or_else(|| decaying_step(limits, past, outside).filter(told))
}

/// True if a missing `share` is large enough to report and no external load explains it.
fn is_reportable(
    limits: &CableLimits,
    past: &[CableState; HISTORY_TICKS],
    outside: ExternalWrench,
    share: f64,
) -> bool {
    let large = 1.0 - share > limits.weak_share && share * past[DECAY_INDEX].servo_tension > limits.weak_least;
    let bore = past[..DECAY_INDEX].iter().map(|cable| cable.tension / cable.servo_tension);
    let (least, most) = bore.fold((f64::MAX, f64::MIN), |(a, b), share| (a.min(share), b.max(share)));
    let still = past[HISTORY_TICKS - 1].servo_tension > limits.firm && most - least < limits.weak_still;
    let met = outside.jolt > limits.jolt && past[LASTING_INDEX].speed > limits.closing;
    large && (still || outside.level < WrenchLevel::Strong && !met)
}

/// Detects a step that stays: a freely moving digit bears the model's load, and with a weak servo a constant share
/// more.
fn lasting_step(limits: &CableLimits, past: &[CableState; HISTORY_TICKS]) -> Option<f64> {
    let excess = past.map(|cable| (cable.tension - cable.reference_tension) / cable.servo_tension);
    let after = &excess[LASTING_INDEX + 1..];
    let share = after.iter().sum::<f64>() / after.len() as f64;
    let [free, sudden, even, least] = limits.weak_free;
    let rise = |n: usize| past[n].tension - past[n - 1].tension;
    let stays = excess[..LASTING_INDEX].iter().all(|excess| excess.abs() < free)
        && share > least
        && excess[LASTING_INDEX] - excess[LASTING_INDEX - 1] > sudden * share
        && after.iter().all(|excess| (excess - share).abs() < even * share)
        && rise(LASTING_INDEX + 1) < limits.weak_slows * rise(LASTING_INDEX)
        && past.iter().all(|cable| cable.servo_tension > limits.weak_pulled);
    stays.then_some(share)
}

/// Detects a step that decays: a gripping digit is slowed by the missing torque, and the step decays as the spool
/// yields.
fn decaying_step(limits: &CableLimits, past: &[CableState; HISTORY_TICKS], outside: ExternalWrench) -> Option<f64> {
    const INDEX: usize = DECAY_INDEX;
    let bore = past.map(|cable| cable.tension / cable.servo_tension);
    let pulled = past[HISTORY_TICKS - 1].servo_tension;
    let step = bore[INDEX] - bore[INDEX - 1];
    // A change that continues as before is no step.
    let bend = |n: usize| bore[n] - 2.0 * bore[n - 1] + bore[n - 2];
    let lags = past[..INDEX]
        .iter()
        .any(|cable| cable.tension - cable.reference_tension < limits.weak_lags * cable.servo_tension);
    let bends = bend(INDEX) > limits.weak_step
        && (2..INDEX).all(|n| bend(n).abs() < limits.weak_before * bend(INDEX))
        && !(outside.level > WrenchLevel::Absent && lags && pulled < limits.weak_pulled);
    // Nor is the tension that a blocked digit adds as its spool winds.
    let beyond = |n: usize| (past[n].tension - past[n - 1].tension - past[n].blocked_increase) / past[n].servo_tension;
    let exceeds = beyond(INDEX) > limits.weak_step
        && beyond(INDEX - 1).max(beyond(INDEX - 2)) < limits.weak_before * beyond(INDEX)
        && pulled > limits.weak_pulled
        && bore[INDEX - 1] - bore[INDEX - 2] < limits.weak_slows * step
        && bore[..INDEX].iter().all(|share| *share > limits.weak_bears);
    let [first, second] = limits.weak_decay;
    let decays = (bore[INDEX] - first * step..bore[INDEX] - MIN_DECAY * step).contains(&bore[INDEX + 1])
        && (bore[INDEX] - second * step..bore[INDEX]).contains(&bore[INDEX + 2]);
    let steady = past.iter().all(|cable| (cable.servo_tension - pulled).abs() < MAX_CURRENT_CHANGE * pulled);
    let slower = past[INDEX].speed < past[INDEX - 1].speed;
    (steady && step > limits.weak_step && (bends || exceeds) && decays && slower).then_some(step)
}

/// Minimum share of a step that has decayed one tick later.
const MIN_DECAY: f64 = 0.03;

#[cfg(test)]
mod tests {
    use super::super::limits::DetectionLimits;
    use super::*;

    /// Returns the first tick with missing torque, and the missing share, for a cable pulled with `pulled` (N) that
    /// bears `tensions` (N).
    fn found(pulled: f64, outside: ExternalWrench, tensions: &[f64]) -> Option<(usize, f64)> {
        let limits = DetectionLimits::standard().expect("the limits").cable;
        let cable = |(n, tension): (usize, &f64)| {
            let (wound, speed) = (0.01, 0.002 - 1e-5 * n as f64);
            CableState {
                tension: *tension,
                reference_tension: 0.6 * pulled,
                servo_tension: pulled,
                blocked_increase: 0.0,
                wound_length: wound,
                speed,
            }
        };
        let cables: Vec<CableState> = tensions.iter().enumerate().map(cable).collect();
        cables.windows(HISTORY_TICKS).enumerate().find_map(|(n, past)| {
            let past: [CableState; HISTORY_TICKS] = past.try_into().expect("as many ticks");
            missing_torque(&limits, &past, outside).map(|share| (n + HISTORY_TICKS - 1, share))
        })
    }

    const WEAK_SERVO_TENSIONS: [f64; 14] =
        [10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 13.9, 13.3, 12.2, 11.0, 9.7, 9.0];

    /// A step of the torque decays. An impact grows over some ticks and ends at once.
    #[test]
    fn a_weak_servo_steps_and_an_impact_does_not() {
        let quiet = ExternalWrench::default();
        let (tick, share) = found(10.0, quiet, &WEAK_SERVO_TENSIONS).expect("a weak servo");
        assert_eq!(tick, 10);
        assert!((share - 0.39).abs() < 1e-9, "{share}");
        let rest = [10.0; 8];
        let impact = [&rest[..], &[11.0, 12.5, 13.9, 13.0, 11.0, 10.0]].concat();
        assert_eq!(found(10.0, quiet, &impact), None);
        let knock = [&rest[..], &[13.9, 13.8, 9.5, 9.0, 10.0, 10.0]].concat();
        assert_eq!(found(10.0, quiet, &knock), None);
    }

    /// A hard push on the hand, or a jolt while the digit closes, may cause the step, unless the cable pulled firmly
    /// and evenly.
    #[test]
    fn what_acts_on_the_hand_explains_a_step() {
        let hard = ExternalWrench { level: WrenchLevel::Strong, jolt: 0.0 };
        let met = ExternalWrench { level: WrenchLevel::Absent, jolt: 1.0 };
        assert_eq!(found(10.0, hard, &WEAK_SERVO_TENSIONS), None);
        assert_eq!(found(10.0, met, &WEAK_SERVO_TENSIONS), None);
        let firm = WEAK_SERVO_TENSIONS.map(|tension| 2.0 * tension);
        assert!(found(20.0, hard, &firm).is_some());
        assert!(found(20.0, met, &firm).is_some());
    }

    /// On a digit that is hardly pulled, a touch has the same effect as a weak servo.
    #[test]
    fn a_step_of_little_tension_is_not_told() {
        let slight = WEAK_SERVO_TENSIONS.map(|tension| 0.12 * tension);
        assert_eq!(found(1.3, ExternalWrench::default(), &slight), None);
    }
}
