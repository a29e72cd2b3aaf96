//! Defects of an arm: deviations from the model that its controller assumes.

use hand_model::ArmVector;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Deviations of an arm from its controller's model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmDefects {
    /// Encoder offsets, rad: true angle = reading - offset. 0 for joints that have none here; offsets of joints that
    /// the arm lacks are not used.
    pub encoders: ArmVector,
    /// Position error of the hand on its flange, in the frame of its nominal pose there, m.
    pub mount_position: Vector3<f64>,
    /// Rotation error of the hand as a rotation vector, about the flange's origin, rad.
    pub mount_rotation: Vector3<f64>,
    /// Mass at the palm's origin that gravity compensation does not include, kg.
    pub payload: f64,
}

impl ArmDefects {
    /// Returns the true pose of the hand on its flange relative to the nominal one.
    pub fn mount(&self) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.mount_rotation);
        Isometry3::from_parts(Translation3::from(self.mount_position), turn)
    }

    /// Converts encoder readings `shown` to true joint angles, rad.
    pub fn true_angles(&self, shown: &[f64]) -> ArmVector {
        shown.iter().zip(self.offsets()).map(|(shown, offset)| shown - offset).collect()
    }

    /// Converts true joint angles `real` to encoder readings, rad.
    pub fn encoder_readings(&self, real: &[f64]) -> ArmVector {
        real.iter().zip(self.offsets()).map(|(real, offset)| real + offset).collect()
    }

    fn offsets(&self) -> impl Iterator<Item = f64> {
        self.encoders.into_iter().chain(std::iter::repeat(0.0))
    }
}
