//! The paper's figures, for comparison with ours (its figure on adaptive behaviours and the text around it).

use scenarios::Condition;

/// Mean and standard deviation over the 60 combinations, and the paper's words for the condition.
#[derive(Debug, Clone, Copy)]
pub struct PaperRates {
    /// Collision rate; the paper gives none for its touch condition.
    pub contact: Option<(f64, f64)>,
    /// Success rate; the paper gives none for its ideal condition.
    pub success: Option<(f64, f64)>,
}

/// Object combinations.
pub const COMBINATIONS: usize = 60;
pub const TRIALS: usize = 10;
/// The t of both of its tests; with the degrees of freedom and p below.
pub const T: f64 = 11.8;
/// See [`T`].
pub const DF: f64 = 59.0;
/// See [`T`].
pub const P: f64 = 2.1e-17;
/// About how long its switch to another strategy takes, ms.
pub const DECISION_MS: f64 = 100.0;

/// The paper's rates under `condition`.
pub fn rates(condition: Condition) -> PaperRates {
    match condition {
        Condition::Ideal => PaperRates { contact: Some((0.0, 0.0)), success: None },
        Condition::Blind => PaperRates { contact: Some((0.465, 0.306)), success: Some((0.535, 0.306)) },
        Condition::Reflex | Condition::Own => PaperRates { contact: None, success: None },
        Condition::Touch => PaperRates { contact: None, success: Some((1.0, 0.0)) },
    }
}
