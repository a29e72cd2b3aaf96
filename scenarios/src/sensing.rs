//! What of the hand's senses the policy `touch` may use: the whole hand, or less of it in an ablation.

use serde::{Deserialize, Serialize};

/// What is left of the senses. Encoders and currents of the servos are always there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sensing {
    /// All pads.
    #[default]
    Full,
    /// No tactile images at all.
    ServosOnly,
    /// The pads of the five last phalanges.
    Fingertips,
    /// The pads of the palm.
    PalmOnly,
    /// Every fourth pad.
    QuarterOfPads,
    /// All pads, at a tenth of the resolution along each side.
    CoarseImages,
    /// All pads; the object's pose is made from felt points without their normals and without what feels nothing.
    PointsOnly,
    /// The true pose and the true content of the hand instead of perception: what no sensing can better.
    TruePose,
}

/// What is wrong with a name of [`Sensing`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("ablation: found `{found}`, expected one of {}", Sensing::ABLATIONS.map(Sensing::name).join(", "))]
pub struct UnknownSensing {
    /// What was given.
    pub found: String,
}

impl Sensing {
    /// All but the whole hand.
    pub const ABLATIONS: [Self; 7] = [
        Self::ServosOnly,
        Self::PalmOnly,
        Self::Fingertips,
        Self::QuarterOfPads,
        Self::CoarseImages,
        Self::PointsOnly,
        Self::TruePose,
    ];

    /// As files and the command line write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::ServosOnly => "servos_only",
            Self::Fingertips => "fingertips",
            Self::PalmOnly => "palm_only",
            Self::QuarterOfPads => "quarter_of_pads",
            Self::CoarseImages => "coarse_images",
            Self::PointsOnly => "points_only",
            Self::TruePose => "true_pose",
        }
    }

    /// In words.
    pub fn label(self) -> &'static str {
        match self {
            Self::Full => "whole hand",
            Self::ServosOnly => "no images: encoders and currents",
            Self::Fingertips => "fingertip pads only",
            Self::PalmOnly => "palm pads only",
            Self::QuarterOfPads => "a quarter of the pads",
            Self::CoarseImages => "images ten times coarser",
            Self::PointsOnly => "pose without normals",
            Self::TruePose => "true pose",
        }
    }
}

impl std::fmt::Display for Sensing {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

impl std::str::FromStr for Sensing {
    type Err = UnknownSensing;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let known = Self::ABLATIONS.into_iter().find(|sensing| sensing.name() == text);
        known.ok_or_else(|| UnknownSensing { found: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for sensing in Sensing::ABLATIONS {
            assert_eq!(sensing.name().parse(), Ok(sensing));
            assert_eq!(serde_json::to_string(&sensing).expect("text"), format!("\"{sensing}\""));
        }
        let error = "thumbs".parse::<Sensing>().expect_err("unknown").to_string();
        assert!(error.contains("`thumbs`") && error.contains("servos_only, palm_only, fingertips"), "{error}");
    }
}
