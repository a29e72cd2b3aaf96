//! Bisection of a rising function that evaluates it only near the root.

/// Width to which the root is bracketed before the bisection, as a share of the interval. It is far above the errors of
/// rounding, which make a function change its sign more than once near its root.
const BRACKET_WIDTH: f64 = 1.0 / (1u64 << 46) as f64;
const MAX_BRACKET_STEPS: usize = 40;

/// Bisects the interval from `low` to `high` `steps` times for the point above which `rises` is not negative. Returns the
/// middle of the last interval; without a root, that is next to the end nearer to it.
///
/// The result is that of a bisection that evaluates every middle, because a rising function has the same sign on one side
/// of a point as at that point. A bracket of the root, found by regula falsi, tells the sign of all middles outside it.
pub fn bisect(rises: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2], steps: usize) -> f64 {
    let [below, above] = bracket(&rises, [low, high]);
    for _ in 0..steps {
        let middle = 0.5 * (low + high);
        if middle == low || middle == high {
            break;
        }
        let negative = middle <= below || (middle < above && rises(middle) < 0.0);
        if negative { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Returns two points around the root: up to the first the function is negative, from the second on it is not.
fn bracket(rises: &impl Fn(f64) -> f64, [low, high]: [f64; 2]) -> [f64; 2] {
    let (mut below, mut above) = ((low, rises(low)), (high, rises(high)));
    if below.1 >= 0.0 {
        return [f64::NEG_INFINITY, low];
    }
    if above.1 < 0.0 {
        return [high, f64::INFINITY];
    }
    let width = BRACKET_WIDTH * (high - low);
    // Regula falsi; an end that stays counts half the second time (Illinois), and no step is shorter than half the width,
    // so that both ends come near the root.
    let mut stayed = 0;
    for _ in 0..MAX_BRACKET_STEPS {
        if above.0 - below.0 <= width {
            break;
        }
        let secant = (below.0 * above.1 - above.0 * below.1) / (above.1 - below.1);
        let inner = (below.0 + 0.5 * width, above.0 - 0.5 * width);
        let point = if secant.is_finite() { secant.max(inner.0).min(inner.1) } else { 0.5 * (below.0 + above.0) };
        let value = rises(point);
        if value < 0.0 {
            below = (point, value);
            if stayed > 0 {
                above.1 *= 0.5;
            }
            stayed = 1;
        } else {
            above = (point, value);
            if stayed < 0 {
                below.1 *= 0.5;
            }
            stayed = -1;
        }
    }
    // An end may be nearer to the root than the function's rounding errors.
    [below.0 - width, above.0 + width]
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use proptest::prelude::*;

    use super::*;

    fn every_middle(rises: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2], steps: usize) -> f64 {
        for _ in 0..steps {
            let middle = 0.5 * (low + high);
            if rises(middle) < 0.0 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    proptest! {
        /// Bit for bit the plain bisection, whatever the curvature of the function and wherever its root, with fewer
        /// evaluations.
        #[test]
        fn is_plain_bisection(root in -0.5..2.0_f64, bend in -3.0..3.0_f64, slope in 1e-3..1e3_f64, steps in 1usize..70) {
            let count = Cell::new(0);
            let rises = |x: f64| {
                count.set(count.get() + 1);
                slope * ((bend * x).exp() - (bend * root).exp()) * bend.signum()
            };
            let found = bisect(rises, [0.0, 1.6], steps);
            let evaluated = count.get();
            prop_assert_eq!(found.to_bits(), every_middle(rises, [0.0, 1.6], steps).to_bits());
            prop_assert!(evaluated <= 40, "{}", evaluated);
        }
    }

    /// A function with a jump has no root, but a place where it becomes positive.
    #[test]
    fn a_jump_is_found() {
        let jump = |x: f64| if x < 0.3 { -1.0 } else { 1e9 };
        assert!((bisect(jump, [0.0, 1.0], 60) - 0.3).abs() < 1e-15);
    }
}
