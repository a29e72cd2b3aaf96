//! Detector for a servo that gives less torque than its current implies: a step in the spool's torque balance within
//! one tick.

use super::limits::CableLimits;
use super::outside::{Outside, Pushed};
use super::residuals::Cable;

/// Number of past ticks that are kept.
pub const KEPT: usize = 8;
/// Largest own change of a servo's current over the kept ticks, as a share, for which a step of its torque can be
/// found.
const STEADY: f64 = 0.6;
/// Index of the tick in which a step that decays has shown.
const DECAYING: usize = KEPT - 3;
/// Index of the tick in which a step that stays has shown.
const STAYING: usize = KEPT - 4;

/// Returns the share of its torque that a servo lost within a tick, from its last ticks, oldest first. `None` if there
/// is no evidence, or if the load from `outside` may explain it.
pub fn missing(limits: &CableLimits, past: &[Cable; KEPT], outside: Outside) -> Option<f64> {
    if past.iter().any(|cable| cable.pulled < limits.least) {
        return None;
    }
    let told = |share: &f64| is_told(limits, past, outside, *share);
    stays(limits, past).filter(told).or_else(|| decays(limits, past, outside).filter(told))
}

/// True if a missing `share` is large enough to report and no external load explains it.
fn is_told(limits: &CableLimits, past: &[Cable; KEPT], outside: Outside, share: f64) -> bool {
    let large = 1.0 - share > limits.weak_share && share * past[DECAYING].pulled > limits.weak_least;
    let bore = past[..DECAYING].iter().map(|cable| cable.tension / cable.pulled);
    let (least, most) = bore.fold((f64::MAX, f64::MIN), |(a, b), share| (a.min(share), b.max(share)));
    let still = past[KEPT - 1].pulled > limits.firm && most - least < limits.weak_still;
    let met = outside.jolt > limits.jolt && past[STAYING].speed > limits.closing;
    large && (still || outside.pushed < Pushed::Hard && !met)
}

/// Detects a step that stays: a freely moving digit bears as much as the twin's, and with a weak servo a constant share
/// more.
fn stays(limits: &CableLimits, past: &[Cable; KEPT]) -> Option<f64> {
    let excess = past.map(|cable| (cable.tension - cable.free) / cable.pulled);
    let after = &excess[STAYING + 1..];
    let share = after.iter().sum::<f64>() / after.len() as f64;
    let [free, sudden, even, least] = limits.weak_free;
    let rise = |n: usize| past[n].tension - past[n - 1].tension;
    let stays = excess[..STAYING].iter().all(|excess| excess.abs() < free)
        && share > least
        && excess[STAYING] - excess[STAYING - 1] > sudden * share
        && after.iter().all(|excess| (excess - share).abs() < even * share)
        && rise(STAYING + 1) < limits.weak_slows * rise(STAYING)
        && past.iter().all(|cable| cable.pulled > limits.weak_pulled);
    stays.then_some(share)
}

/// Detects a step that decays: a gripping digit is slowed by the missing torque, and the step decays as the spool gives
/// way.
fn decays(limits: &CableLimits, past: &[Cable; KEPT], outside: Outside) -> Option<f64> {
    const I: usize = DECAYING;
    let bore = past.map(|cable| cable.tension / cable.pulled);
    let pulled = past[KEPT - 1].pulled;
    let step = bore[I] - bore[I - 1];
    // A change that goes on as before is no step.
    let bend = |n: usize| bore[n] - 2.0 * bore[n - 1] + bore[n - 2];
    let lags = past[..I].iter().any(|cable| cable.tension - cable.free < limits.weak_lags * cable.pulled);
    let bends = bend(I) > limits.weak_step
        && (2..I).all(|n| bend(n).abs() < limits.weak_before * bend(I))
        && !(outside.pushed > Pushed::No && lags && pulled < limits.weak_pulled);
    // Neither is the tension that a blocked digit adds as its spool winds.
    let beyond = |n: usize| (past[n].tension - past[n - 1].tension - past[n].held) / past[n].pulled;
    let exceeds = beyond(I) > limits.weak_step
        && beyond(I - 1).max(beyond(I - 2)) < limits.weak_before * beyond(I)
        && pulled > limits.weak_pulled
        && bore[I - 1] - bore[I - 2] < limits.weak_slows * step
        && bore[..I].iter().all(|share| *share > limits.weak_bears);
    let [first, second] = limits.weak_decay;
    let decays = (bore[I] - first * step..bore[I] - LEAST_DECAY * step).contains(&bore[I + 1])
        && (bore[I] - second * step..bore[I]).contains(&bore[I + 2]);
    let steady = past.iter().all(|cable| (cable.pulled - pulled).abs() < STEADY * pulled);
    let slower = past[I].speed < past[I - 1].speed;
    (steady && step > limits.weak_step && (bends || exceeds) && decays && slower).then_some(step)
}

/// Minimum share of a step that has decayed one tick later.
const LEAST_DECAY: f64 = 0.03;

#[cfg(test)]
mod tests {
    use super::super::limits::Limits;
    use super::*;

    /// Returns the first tick with missing torque, and the missing share, for a cable pulled with `pulled` (N) that
    /// bears `tensions` (N).
    fn found(pulled: f64, outside: Outside, tensions: &[f64]) -> Option<(usize, f64)> {
        let limits = Limits::standard().expect("the limits").cable;
        let cable = |(n, tension): (usize, &f64)| {
            let (wound, speed) = (0.01, 0.002 - 1e-5 * n as f64);
            Cable { tension: *tension, free: 0.6 * pulled, pulled, held: 0.0, wound, speed }
        };
        let cables: Vec<Cable> = tensions.iter().enumerate().map(cable).collect();
        cables.windows(KEPT).enumerate().find_map(|(n, past)| {
            let past: [Cable; KEPT] = past.try_into().expect("as many ticks");
            missing(&limits, &past, outside).map(|share| (n + KEPT - 1, share))
        })
    }

    const WEAK: [f64; 14] = [10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 13.9, 13.3, 12.2, 11.0, 9.7, 9.0];

    /// A step of the torque decays. An impact grows over some ticks and ends at once.
    #[test]
    fn a_weak_servo_steps_and_an_impact_does_not() {
        let quiet = Outside::default();
        let (tick, share) = found(10.0, quiet, &WEAK).expect("a weak servo");
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
        let hard = Outside { pushed: Pushed::Hard, jolt: 0.0 };
        let met = Outside { pushed: Pushed::No, jolt: 1.0 };
        assert_eq!(found(10.0, hard, &WEAK), None);
        assert_eq!(found(10.0, met, &WEAK), None);
        let firm = WEAK.map(|tension| 2.0 * tension);
        assert!(found(20.0, hard, &firm).is_some());
        assert!(found(20.0, met, &firm).is_some());
    }

    /// On a digit that is hardly pulled, a touch has the same effect as a weak servo.
    #[test]
    fn a_step_of_little_tension_is_not_told() {
        let slight = WEAK.map(|tension| 0.12 * tension);
        assert_eq!(found(1.3, Outside::default(), &slight), None);
    }
}
