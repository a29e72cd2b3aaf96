//! Decision, from the errors of held-out presses, on whether a method may be used.

use super::accuracy::Accuracy;

/// Warning thresholds: root-mean-square error of the depth over the depth, and error of the normals over that of a
/// level surface.
const DOUBTFUL_DEPTH: f64 = 0.25;
const DOUBTFUL_NORMALS: f64 = 0.5;
/// Range of plausible ratios of estimated to true depth and slope; others are doubtful.
const DOUBTFUL_RATIO: std::ops::RangeInclusive<f64> = 0.8..=1.25;

impl Accuracy {
    /// Returns the reason why the method is no better than the trivial estimate, a level surface.
    pub fn fault(&self) -> Option<String> {
        let (presses, normals) = (self.presses, self.normals_deg.mean);
        if presses == 0 {
            return Some("no press was held out, so its errors are unknown".to_owned());
        }
        // NaN fails every comparison.
        let better = self.depth_relative < 1.0;
        if !better {
            return Some(format!(
                "depths of presses held out are wrong by {:.0} % (rms); those of a level surface by 100 %",
                100.0 * self.depth_relative
            ));
        }
        let better = normals < self.level_deg;
        if !better {
            return Some(format!(
                "normals of presses held out are wrong by {normals:.1} degrees (mean); those of a level surface by {:.1}",
                self.level_deg
            ));
        }
        (2 * self.wrong_sign >= presses)
            .then(|| format!("{} of {presses} presses held out appear as bumps; expected dents", self.wrong_sign))
    }

    /// Returns the caveats of a method that is better than the trivial estimate.
    pub fn doubt(&self) -> Option<String> {
        let mut doubts = Vec::new();
        if self.depth_relative > DOUBTFUL_DEPTH {
            doubts.push(format!("depths are wrong by {:.0} % (rms)", 100.0 * self.depth_relative));
        }
        if self.normals_deg.mean > DOUBTFUL_NORMALS * self.level_deg {
            let (found, level) = (self.normals_deg.mean, self.level_deg);
            doubts.push(format!("normals are wrong by {found:.1} of {level:.1} degrees"));
        }
        for (what, found) in [("depths", self.depth_ratio), ("slopes", self.slope_ratio)] {
            if !DOUBTFUL_RATIO.contains(&found) {
                doubts.push(format!("{what} are estimated at {found:.2} times their true size"));
            }
        }
        if self.wrong_sign > 0 {
            doubts.push(format!("{} of {} presses appear as bumps", self.wrong_sign, self.presses));
        }
        (!doubts.is_empty()).then(|| doubts.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::super::errors::ReconstructionErrors;
    use super::*;

    fn good() -> Accuracy {
        Accuracy {
            presses: 6,
            level_deg: 16.0,
            slope_ratio: 0.97,
            depth_ratio: 1.02,
            depth_relative: 0.08,
            normals_deg: tactile_perception::AngularError { mean: 5.0, median: 4.0, p95: 12.0, pixels: 9000 },
            ..ReconstructionErrors::default().accuracy()
        }
    }

    #[test]
    fn a_useless_calibration_is_refused_by_its_figures() {
        assert_eq!((good().fault(), good().doubt()), (None, None));
        let normals = |mean: f64| tactile_perception::AngularError { mean, ..good().normals_deg };
        let faults = [
            Accuracy { depth_relative: 1.5, ..good() },
            Accuracy { depth_relative: f64::NAN, ..good() },
            Accuracy { normals_deg: normals(17.0), ..good() },
            Accuracy { normals_deg: normals(f64::NAN), ..good() },
            Accuracy { wrong_sign: 3, ..good() },
            ReconstructionErrors::default().accuracy(),
        ];
        for accuracy in faults {
            assert!(accuracy.fault().is_some(), "{accuracy:?}");
        }
        let doubts = [
            Accuracy { depth_relative: 0.32, ..good() },
            Accuracy { normals_deg: normals(9.0), ..good() },
            Accuracy { slope_ratio: 0.6, ..good() },
            Accuracy { depth_ratio: 1.4, ..good() },
            Accuracy { wrong_sign: 1, ..good() },
        ];
        for accuracy in doubts {
            assert!(accuracy.fault().is_none() && accuracy.doubt().is_some(), "{accuracy:?}");
        }
    }
}
