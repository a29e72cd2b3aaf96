//! Steps of the force on the hand: a weight appears or vanishes within two ticks and stays, whereas a contact force
//! grows and acts sideways.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::limits::StepLimits;

/// Ticks until a step shows, the newest included.
const ONSET_TICKS: usize = 3;
/// Ticks for which the force must be steady before a step.
const REST_TICKS: usize = 12;
/// Ticks at rest over which the force before a step is averaged.
const BASELINE_TICKS: usize = 3;
/// Additional ticks for which a step must persist if contact is expected.
pub const PERSISTENCE_TICKS: usize = 2;

/// A step that has just shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualStep {
    /// Change of weight, N, positive if weight was added.
    pub weight: f64,
    /// Force on the hand before the step, N.
    pub before: Vector3<f64>,
}

/// Removes the lag with which the arm's torques follow the force. Returns the force in each of the newest `count`
/// ticks, N, oldest first.
fn remove_lag(past: &VecDeque<(f64, Vector3<f64>)>, count: usize, lag: f64) -> Option<Vec<Vector3<f64>>> {
    let from = past.len().checked_sub(count + 1)?;
    let felt: Vec<Vector3<f64>> = past.range(from..).map(|(_, force)| *force).collect();
    Some(felt.windows(2).map(|pair| (pair[1] - lag * pair[0]) / (1.0 - lag)).collect())
}

/// Detects a step that shows in the newest of `past` (times in s, forces in N) and has stayed for `stays` ticks since.
/// The limits are those with or without `expected` contact.
pub fn detect_step(
    past: &VecDeque<(f64, Vector3<f64>)>,
    limits: &StepLimits,
    expected: bool,
    stays: usize,
) -> Option<ResidualStep> {
    let forces = remove_lag(past, REST_TICKS + ONSET_TICKS + stays, limits.lag)?;
    let (rest, after) = forces.split_at(REST_TICKS);
    let base = rest[REST_TICKS - BASELINE_TICKS..].iter().sum::<Vector3<f64>>() / BASELINE_TICKS as f64;
    let which = usize::from(expected);
    // The step may have come at any moment of the first of these ticks.
    let shown = &after[1..];
    let weights: Vec<f64> = shown.iter().map(|force| base.z - force.z).collect();
    let weight = weights[0];
    let size = weights.iter().map(|weight| weight.abs()).fold(f64::INFINITY, f64::min);
    let most = weights.iter().map(|weight| weight.abs()).fold(0.0, f64::max);
    let one_way = weights.iter().all(|other| other * weight > 0.0);
    let sideways = shown.iter().map(|force| (force - base).xy().norm()).fold(0.0, f64::max);
    let moved = rest.iter().map(|force| (force - base).xy().norm().max((force - base).z.abs())).fold(0.0, f64::max);
    let even = most < limits.even[which] * size;
    let clear = one_way && even && sideways < limits.level[which] * size && moved < limits.rest[which] * size;
    (clear && size > limits.least).then_some(ResidualStep { weight, before: base })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::DetectionLimits;

    /// Returns the weight of the step that shows after `force` (N) came within `ticks`, measured with the arm's lag.
    fn shown(force: Vector3<f64>, ticks: usize) -> Option<f64> {
        let limits = DetectionLimits::standard().expect("the limits").step;
        let (mut past, mut felt) = (VecDeque::new(), Vector3::zeros());
        for n in 0..30 {
            let acts = force * (n as f64 / ticks as f64 - 20.0 / ticks as f64).clamp(0.0, 1.0);
            felt = acts + limits.lag * (felt - acts);
            past.push_back((n as f64 / 120.0, felt));
            if let Some(step) = detect_step(&past, &limits, false, PERSISTENCE_TICKS) {
                return Some(step.weight);
            }
        }
        None
    }

    #[test]
    fn what_comes_at_once_and_straight_down_is_a_weight() {
        let weight = shown(Vector3::new(0.0, 0.0, -2.0), 1).expect("a step");
        assert!((weight - 2.0).abs() < 1e-9, "{weight}");
        assert_eq!(shown(Vector3::new(0.0, 0.0, -2.0), 8), None, "grows");
        assert_eq!(shown(Vector3::new(2.5, 0.0, -2.0), 1), None, "acts sideways");
        assert_eq!(shown(Vector3::new(0.0, 0.0, -0.5), 1), None, "too little");
    }
}
