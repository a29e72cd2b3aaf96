//! Published figures of the paper, for comparison (its figure on adaptive behaviours and the text around it).

/// Number of object combinations.
pub const COMBINATION_COUNT: usize = 60;
pub const TRIALS_PER_COMBINATION: usize = 10;
/// Collision rate with perfect execution: mean and standard deviation over combinations, as for the next three.
pub const COLLISION_IDEAL: (f64, f64) = (0.0, 0.0);
/// Collision rate with real-world execution.
pub const COLLISION_BLIND: (f64, f64) = (0.465, 0.306);
/// Success rate without tactile feedback.
pub const SUCCESS_BLIND: (f64, f64) = (0.535, 0.306);
/// Success rate with tactile feedback.
pub const SUCCESS_TOUCH: (f64, f64) = (1.0, 0.0);
/// t statistic of both of its tests; degrees of freedom and p follow below.
pub const T_STATISTIC: f64 = 11.8;
/// Degrees of freedom; see [`T_STATISTIC`].
pub const DEGREES_OF_FREEDOM: f64 = 59.0;
/// p-value; see [`T_STATISTIC`].
pub const P_VALUE: f64 = 2.1e-17;
/// Approximate time of its switch to another strategy, ms.
pub const DECISION_MS: f64 = 100.0;
/// Approximate time that tactile feedback adds to a trial without a collision, s.
pub const TOUCH_TIME_S: f64 = 1.0;
