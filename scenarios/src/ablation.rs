//! Ablations: the policy `touch` with one of its parts removed, on the same trials.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use world::sensing::Sensing;

/// The part that is removed from the policy `touch`. The condition `reflex` is `touch` without any image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ablation {
    /// All pads but those of the palm.
    PalmOnly,
    /// All pads but those of the five distal phalanges.
    Fingertips,
    /// Three of four pads.
    QuarterOfPads,
    /// Resolution: images at a tenth of it along each side.
    CoarseImages,
    /// Surface normals and no-contact evidence in the pose estimate.
    PointsOnly,
    /// All errors of the in-hand pose estimate: an upper bound that no sensing can exceed.
    TruePose,
    /// Retries: it decides once.
    NoRetry,
    /// New detections: it retries where the first detection reported the objects.
    #[serde(alias = "no_new_look")]
    NoNewDetection,
    /// The exploratory touch of the second object before it is grasped.
    NoExploration,
}

/// Error: no ablation has this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("ablation: found `{found}`, expected one of {}", Ablation::ALL.map(Ablation::name).join(", "))]
pub struct UnknownAblation {
    /// The name that was given.
    pub found: String,
}

impl Ablation {
    /// All ablations in order.
    pub const ALL: [Self; 9] = [
        Self::PalmOnly,
        Self::Fingertips,
        Self::QuarterOfPads,
        Self::CoarseImages,
        Self::PointsOnly,
        Self::TruePose,
        Self::NoRetry,
        Self::NoNewDetection,
        Self::NoExploration,
    ];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PalmOnly => "palm_only",
            Self::Fingertips => "fingertips",
            Self::QuarterOfPads => "quarter_of_pads",
            Self::CoarseImages => "coarse_images",
            Self::PointsOnly => "points_only",
            Self::TruePose => "true_pose",
            Self::NoRetry => "no_retry",
            Self::NoNewDetection => "no_new_detection",
            Self::NoExploration => "no_exploration",
        }
    }

    /// Name for people.
    pub fn label(self) -> &'static str {
        match self {
            Self::NoRetry => "touch without retry",
            Self::NoNewDetection => "retry without a new detection",
            Self::NoExploration => "touch without an exploratory motion",
            _ => self.sensing().label(),
        }
    }

    /// Returns the sensing that remains.
    pub fn sensing(self) -> Sensing {
        match self {
            Self::PalmOnly => Sensing::PalmOnly,
            Self::Fingertips => Sensing::Fingertips,
            Self::QuarterOfPads => Sensing::QuarterOfPads,
            Self::CoarseImages => Sensing::CoarseImages,
            Self::PointsOnly => Sensing::PointsOnly,
            Self::TruePose => Sensing::TruePose,
            Self::NoRetry | Self::NoNewDetection | Self::NoExploration => Sensing::Full,
        }
    }
}

impl std::fmt::Display for Ablation {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

impl std::str::FromStr for Ablation {
    type Err = UnknownAblation;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        // Version 0.1 called this ablation `no_new_look`.
        let text = if text == "no_new_look" { Self::NoNewDetection.name() } else { text };
        let known = Self::ALL.into_iter().find(|ablation| ablation.name() == text);
        known.ok_or_else(|| UnknownAblation { found: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for ablation in Ablation::ALL {
            assert_eq!(ablation.name().parse(), Ok(ablation));
            assert_eq!(serde_json::to_string(&ablation).expect("text"), format!("\"{ablation}\""));
        }
        let error = "thumbs".parse::<Ablation>().expect_err("unknown").to_string();
        assert!(error.contains("`thumbs`") && error.contains("palm_only, fingertips"), "{error}");
    }
}
