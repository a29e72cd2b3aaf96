//! What of the hand's senses a policy may use: the whole hand, less of it in an ablation, no image at all in `reflex`.

/// What is left of the senses. Encoders and currents of the servos are always there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
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

impl Sensing {
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
