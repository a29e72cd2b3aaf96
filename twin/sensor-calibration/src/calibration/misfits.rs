//! Presses that the model of a ball's press cannot explain, while it explains the others.

use optics::calibration::{BallFit, PressFolder};

/// A press is a misfit if its error is more than so many times the median, and by so many grey levels more.
const MISFIT: (f64, f64) = (2.5, 4.0);

/// Why each press is a misfit; `None` for one that is not.
pub fn misfits(fit: &BallFit, folder: &PressFolder) -> Vec<Option<String>> {
    let errors = fit.press_errors(folder);
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let is_misfit = |error: f64| error > MISFIT.0 * typical && error > typical + MISFIT.1;
    let reason = |(error, labelled): (f64, bool)| {
        let expected = if labelled { "a ball where the label says" } else { "a ball" };
        format!(
            "found what the model of a ball misses by {error:.1} grey levels, other presses by {typical:.1}; expected {expected}"
        )
    };
    let each = errors.into_iter().zip(folder.presses.iter().map(|press| press.labelled));
    each.map(|(error, labelled)| is_misfit(error).then(|| reason((error, labelled)))).collect()
}
