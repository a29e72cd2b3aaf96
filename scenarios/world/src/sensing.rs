//! Sensing that a policy may use: the whole hand, less in an ablation, and no images in `reflex`.

/// Available tactile sensing. Encoders and currents of the servos are always available.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sensing {
    /// All pads.
    #[default]
    Full,
    /// No tactile images at all.
    ServosOnly,
    /// Pads of the five distal phalanges.
    Fingertips,
    /// Pads of the palm.
    PalmOnly,
    /// Every fourth pad.
    QuarterOfPads,
    /// All pads, at a tenth of the resolution along each side.
    CoarseImages,
    /// All pads, but the pose estimate uses contact points only, without their normals and without no-contact evidence.
    PointsOnly,
    /// Ground-truth pose and content of the hand instead of perception: an upper bound that no sensing can exceed.
    TruePose,
}

impl Sensing {
    /// Name for people.
    pub fn label(self) -> &'static str {
        match self {
            Self::Full => "whole hand",
            Self::ServosOnly => "no images: encoders and currents",
            Self::Fingertips => "fingertip pads only",
            Self::PalmOnly => "palm pads only",
            Self::QuarterOfPads => "a quarter of the pads",
            Self::CoarseImages => "images at a tenth of the resolution",
            Self::PointsOnly => "pose without normals",
            Self::TruePose => "true pose",
        }
    }
}
