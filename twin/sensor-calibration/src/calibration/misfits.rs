//! Outliers among the presses: those that the fitted ball model cannot explain although it explains the others.

use tactile_optics::calibration::{BallFit, PressFolder};

/// Outlier thresholds: the error of a misfit exceeds this multiple of the median error, and the median by this many
/// grey levels.
const MISFIT_THRESHOLDS: (f64, f64) = (2.5, 4.0);

/// Returns for each press the reason why it is a misfit; `None` if it is not.
pub fn misfits(fit: &BallFit, folder: &PressFolder) -> Vec<Option<String>> {
    let errors = fit.press_errors(folder);
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let is_misfit = |error: f64| error > MISFIT_THRESHOLDS.0 * typical && error > typical + MISFIT_THRESHOLDS.1;
    let reason = |(error, labelled): (f64, bool)| {
        let expected = if labelled { "a ball at the label" } else { "a ball" };
        format!("found a misfit of {error:.1} grey levels, {typical:.1} for other presses; expected {expected}")
    };
    let each = errors.into_iter().zip(folder.presses.iter().map(|press| press.labelled));
    each.map(|(error, labelled)| is_misfit(error).then(|| reason((error, labelled)))).collect()
}
