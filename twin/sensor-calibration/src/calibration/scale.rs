//! Size of a pixel on the gel, and plausibility checks of this size and of the balls' diameters.
//!
//! The shading of a ball determines its slopes in pixels, and these do not change if ball and pixel grow in proportion.
//! Only the radius of the contact circle against that of the ball bounds the size. It therefore has to be measured:
//! with two points a known distance apart, or by the width of the camera's field of view.

use anyhow::{Result, bail};
use tactile_optics::calibration::{Assumptions, BallFit, BallPress, FitEffort, PressFolder};

/// Source of the pixel size; lengths in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelSource {
    /// Known pixel size.
    Known(f64),
    /// Ruler: two points of an image (column, row) lie this far apart on the gel.
    Ruler { ends: [[f64; 2]; 2], length: f64 },
    /// Width of the gel that an image shows.
    Field(f64),
    /// The presses alone.
    Presses,
}

/// Size of a pixel, with its 95 % interval if it was measured, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSize {
    pub size: f64,
    pub interval: Option<[f64; 2]>,
}

/// Standard deviation of a coordinate read off an image by a person, pixels.
const READING_SIGMA: f64 = 0.5;
/// Minimum distance between a ruler's ends, pixels.
const MIN_RULER_LENGTH: f64 = 20.0;
/// Largest plausible radius of a contact, and of a visible circle around it, as a multiple of the ball's.
const MAX_RADIUS_RATIOS: [f64; 2] = [1.05, 1.3];
/// Threshold of shallow presses: median radius of the circles over the ball's, below which they are too shallow for a
/// calibration.
const SHALLOW_RATIO: f64 = 0.35;
/// Candidate pixel sizes if nothing else determines it, as shares of the largest possible one.
const PIXEL_SIZE_SHARES: [f64; 6] = [0.3, 0.4, 0.52, 0.68, 0.84, 1.0];
/// Tolerance for a candidate size: its fit's residual is at most this multiple of the best one's.
const RESIDUAL_TOLERANCE: f64 = 1.15;
/// Number of presses and effort of those fits.
const TRIAL_FIT_PRESSES: usize = 12;
const TRIAL_FIT_EFFORT: FitEffort = FitEffort { per_press: 150, starts: 1, steps: [8, 12], split: true };

impl PixelSource {
    /// Returns the pixel size by this source; `columns` is the images' width. `None` if only the presses can determine
    /// it.
    pub fn measured(&self, columns: usize) -> Result<Option<PixelSize>> {
        let positive = |what: &str, value: f64| {
            if value > 0.0 && value.is_finite() {
                return Ok(value);
            }
            bail!("{what}: found {} mm, expected a positive number", 1e3 * value)
        };
        Ok(Some(match *self {
            Self::Known(size) => PixelSize { size: positive("--pixel-mm", size)?, interval: None },
            Self::Field(width) => PixelSize { size: positive("--field-mm", width)? / columns as f64, interval: None },
            Self::Ruler { ends: [a, b], length } => {
                let pixels = (a[0] - b[0]).hypot(a[1] - b[1]);
                if !pixels.is_finite() || pixels < MIN_RULER_LENGTH {
                    bail!("--ruler: found points {pixels:.1} pixels apart, expected at least {MIN_RULER_LENGTH}");
                }
                let size = positive("--ruler", length)? / pixels;
                let deviation = size * READING_SIGMA * f64::sqrt(2.0) / pixels;
                PixelSize { size, interval: Some([size - 1.96 * deviation, size + 1.96 * deviation]) }
            }
            Self::Presses => return Ok(None),
        }))
    }
}

/// Returns the radius of a press's circle over its ball's, for this pixel size (m).
fn radius_ratio(press: &BallPress, pixel: f64) -> f64 {
    press.radius * pixel / (0.5 * press.diameter)
}

/// Returns the reason why a press's circle cannot be that of its ball, for this pixel size (m).
fn impossibility(press: &BallPress, pixel: f64) -> Option<String> {
    let (found, most) = (radius_ratio(press, pixel), MAX_RADIUS_RATIOS[usize::from(!press.contact_labelled)]);
    (found > most).then(|| {
        format!(
            "found a circle of {:.2} mm radius, {found:.2} of the radius of a ball of {} mm; expected at most {most}",
            1e3 * press.radius * pixel,
            1e3 * press.diameter
        )
    })
}

/// Rejects presses whose circles are larger than their balls. If these are at least half of them, the balls' diameter
/// or the pixel size is in another unit or belongs to another ball, and an error is returned. `corrected` is true if
/// the model has corrected the circles found without labels.
pub fn leave_out_impossible(folder: &mut PressFolder, pixel: f64, corrected: bool) -> Result<()> {
    // A circle found without a label is judged only after the model has corrected it.
    let judged = |press: &&BallPress| press.labelled || corrected;
    let reasons: Vec<Option<String>> = folder
        .presses
        .iter()
        .map(|press| Some(press).filter(judged).and_then(|press| impossibility(press, pixel)))
        .collect();
    let first = folder.presses.iter().zip(&reasons).find_map(|(press, reason)| Some((&press.name, reason.as_ref()?)));
    let Some((name, reason)) = first else { return Ok(()) };
    if 2 * reasons.iter().flatten().count() >= folder.presses.len() {
        bail!("{name}: {reason}: the ball's diameter or the size of a pixel ({} mm) is wrong", 1e3 * pixel);
    }
    folder.skip_presses(reasons);
    Ok(())
}

/// Returns an error if the circles are far smaller than their balls, unless `shallow`.
pub fn check_depth(folder: &PressFolder, pixel: f64, shallow: bool) -> Result<()> {
    let mut shares: Vec<f64> = folder.presses.iter().map(|press| radius_ratio(press, pixel)).collect();
    shares.sort_by(f64::total_cmp);
    let Some(median) = shares.get(shares.len() / 2) else { return Ok(()) };
    if *median < SHALLOW_RATIO && !shallow {
        bail!(
            "found circles of {median:.2} of their ball's radius (median); expected at least {SHALLOW_RATIO}: the ball's diameter \
             ({} mm) or the size of a pixel ({} mm) is wrong, or `--shallow` says that the presses are",
            1e3 * folder.presses[0].diameter,
            1e3 * pixel
        );
    }
    Ok(())
}

/// Estimates the pixel size from the presses: the interval of sizes that explain them about equally well, and its
/// geometric mean. The largest candidate puts the largest circle at its limit, about the size of its ball; the smallest
/// one is three tenths of that.
pub fn from_presses(folder: &PressFolder, seed: u64) -> Result<PixelSize> {
    let (some, _) = folder.split(|n, _| n % folder.presses.len().div_ceil(TRIAL_FIT_PRESSES).max(1) == 0);
    let most = folder.presses.iter().map(|press| {
        let visible = MAX_RADIUS_RATIOS[usize::from(!press.contact_labelled)];
        visible * 0.5 * press.diameter / press.radius
    });
    let most = most.fold(f64::INFINITY, f64::min);
    let mut tried = Vec::new();
    for share in PIXEL_SIZE_SHARES {
        let size = share * most;
        let fit = BallFit::new(&some, Assumptions::full(Some(size)), &TRIAL_FIT_EFFORT, seed)?;
        tried.push((size, fit.residual));
    }
    let best = tried.iter().map(|(_, residual)| *residual).fold(f64::INFINITY, f64::min);
    let good = |n: usize| tried[n].1 <= RESIDUAL_TOLERANCE * best;
    let possible: Vec<usize> = (0..tried.len()).filter(|&n| good(n)).collect();
    let (Some(first), Some(last)) = (possible.first(), possible.last()) else {
        bail!("found no pixel size that explains the presses");
    };
    // The true size may lie between the last possible candidate and the first impossible one.
    let low = tried[first.saturating_sub(1)].0;
    let high = tried[(last + 1).min(tried.len() - 1)].0;
    Ok(PixelSize { size: (low * high).sqrt(), interval: Some([low, high]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ruler_is_as_exact_as_it_is_long() {
        let ruler =
            |pixels: f64| PixelSource::Ruler { ends: [[10.0, 20.0], [10.0 + pixels, 20.0]], length: 0.05e-3 * pixels };
        let width = |pixels: f64| {
            let found = ruler(pixels).measured(320).expect("measured").expect("a size");
            assert!((found.size - 0.05e-3).abs() < 1e-12);
            let [low, high] = found.interval.expect("an interval");
            high - low
        };
        assert!((width(100.0) / width(300.0) - 3.0).abs() < 1e-9);
        assert!(ruler(5.0).measured(320).is_err());
        let field = PixelSource::Field(16e-3).measured(320).expect("measured").expect("a size");
        assert!((field.size - 0.05e-3).abs() < 1e-12);
        assert_eq!(PixelSource::Presses.measured(320).expect("no error"), None);
    }
}
