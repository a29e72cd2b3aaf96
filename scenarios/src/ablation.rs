//! Ablations: the policy `touch` with one of its means taken away, on the same trials.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use world::sensing::Sensing;

/// What is taken from the policy `touch`. The condition `reflex` is `touch` without any image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ablation {
    /// Everything but the pads of the palm.
    PalmOnly,
    /// Everything but the pads of the five last phalanges.
    Fingertips,
    /// Three of four pads.
    QuarterOfPads,
    /// Resolution: images at a tenth of it along each side.
    CoarseImages,
    /// Normals, and what feels nothing, in the pose estimate.
    PointsOnly,
    /// Every error of what it believes is in the hand: what no sensing can better.
    TruePose,
    /// Further tries: it decides once.
    NoRetry,
    /// New looks: it tries again where the first look saw the objects.
    NoNewLook,
    /// The touch of the second object before it is grasped.
    NoExploration,
}

/// A name that is no ablation's.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("ablation: found `{found}`, expected one of {}", Ablation::ALL.map(Ablation::name).join(", "))]
pub struct UnknownAblation {
    /// What was given.
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
        Self::NoNewLook,
        Self::NoExploration,
    ];

    /// As files and the command line write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::PalmOnly => "palm_only",
            Self::Fingertips => "fingertips",
            Self::QuarterOfPads => "quarter_of_pads",
            Self::CoarseImages => "coarse_images",
            Self::PointsOnly => "points_only",
            Self::TruePose => "true_pose",
            Self::NoRetry => "no_retry",
            Self::NoNewLook => "no_new_look",
            Self::NoExploration => "no_exploration",
        }
    }

    /// In words.
    pub fn label(self) -> &'static str {
        match self {
            Self::NoRetry => "touch without retry",
            Self::NoNewLook => "retry without a new look",
            Self::NoExploration => "touch without an exploratory motion",
            _ => self.sensing().label(),
        }
    }

    /// The senses that are left.
    pub fn sensing(self) -> Sensing {
        match self {
            Self::PalmOnly => Sensing::PalmOnly,
            Self::Fingertips => Sensing::Fingertips,
            Self::QuarterOfPads => Sensing::QuarterOfPads,
            Self::CoarseImages => Sensing::CoarseImages,
            Self::PointsOnly => Sensing::PointsOnly,
            Self::TruePose => Sensing::TruePose,
            Self::NoRetry | Self::NoNewLook | Self::NoExploration => Sensing::Full,
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
