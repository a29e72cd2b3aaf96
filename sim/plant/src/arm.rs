//! An arm that is not as its controller believes.

use hand_model::ArmVector;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Deviation of an arm from its controller's model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmDefects {
    /// Encoder offsets, rad: true angle = reading - offset. 0 for joints that have none here; those of joints that the arm lacks are not used.
    pub encoders: ArmVector,
    /// Position of the hand on its flange, in the frame of its nominal place there, m.
    pub mount_position: Vector3<f64>,
    /// Rotation vector of its turn, about the flange's origin, rad.
    pub mount_rotation: Vector3<f64>,
    /// Mass at the palm's origin of which gravity compensation knows nothing, kg.
    pub payload: f64,
}

impl ArmDefects {
    /// The hand on its flange, seen from where it nominally is.
    pub fn mount(&self) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.mount_rotation);
        Isometry3::from_parts(Translation3::from(self.mount_position), turn)
    }

    /// Angles of the joints whose encoders show `shown`, rad.
    pub fn real(&self, shown: &[f64]) -> ArmVector {
        shown.iter().zip(self.offsets()).map(|(shown, offset)| shown - offset).collect()
    }

    /// Encoder readings of joints at `real`, rad.
    pub fn shown(&self, real: &[f64]) -> ArmVector {
        real.iter().zip(self.offsets()).map(|(real, offset)| real + offset).collect()
    }

    fn offsets(&self) -> impl Iterator<Item = f64> {
        self.encoders.into_iter().chain(std::iter::repeat(0.0))
    }
}
