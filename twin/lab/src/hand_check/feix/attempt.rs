//! One attempt at a grasp type: the object's placement and the closing commands, and how attempts are drawn and varied.

use hand_model::DigitVector;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::Serialize;

use super::types::GraspType;

/// Largest cable tension, N: half of the servo's stall tension, which the servo can sustain.
pub const MAX_TENSION: f64 = 57.5;
/// Ranges of the thumb's opposition, rad.
const ABDUCTED_RANGE: (f64, f64) = (0.7, 1.65);
const ADDUCTED_RANGE: (f64, f64) = (0.0, 0.5);

/// One placement with its commands.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct GraspAttempt {
    /// Position of the object, held there while the digits close, palm frame, m.
    pub position: [f64; 3],
    /// Orientation of the object as a rotation vector, palm frame, rad.
    pub rotation: [f64; 3],
    /// Cable tensions that preshape the hand before the object is put there, N.
    #[schemars(with = "Vec<f64>")]
    pub before: DigitVector,
    /// Cable tensions that close on the object, N.
    #[schemars(with = "Vec<f64>")]
    pub tensions: DigitVector,
    /// Opposition command, rad.
    pub opposition: f64,
    /// True if the servos, once closed, hold their angle instead of their current.
    pub locked: bool,
}

impl GraspAttempt {
    /// Creates an attempt that closes from the open hand with constant tensions.
    pub fn new(place: &Isometry3<f64>, tensions: DigitVector, opposition: f64) -> Self {
        let (position, rotation) = (place.translation.vector.into(), place.rotation.scaled_axis().into());
        Self { position, rotation, before: [0.0; 5].into(), tensions, opposition, locked: false }
    }

    /// Returns `palm_from_object`.
    pub fn place(&self) -> Isometry3<f64> {
        Isometry3::new(Vector3::from(self.position), Vector3::from(self.rotation))
    }
}

/// Draws uniformly from a range.
pub fn draw_in_range(rng: &mut ChaCha8Rng, (low, high): (f64, f64)) -> f64 {
    rng.random_range(low..high)
}

/// Draws a tension (N) uniformly in the logarithm.
pub fn draw_tension(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    draw_in_range(rng, (low.ln(), high.ln())).exp()
}

/// Returns the rotation that brings the object's x to `across` and its z as near to `along` as possible.
pub fn aligning_rotation(across: &Vector3<f64>, along: &Vector3<f64>) -> UnitQuaternion<f64> {
    let x = across.normalize();
    let rest = along - x * x.dot(along);
    let z = rest.try_normalize(1e-6).unwrap_or_else(|| x.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize());
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// Draws uniformly from a cube of this half size.
pub fn jitter(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| size * rng.random_range(-1.0..1.0))
}

/// Draws a neighbour of an attempt; `step` scales the usual distance.
pub fn vary(attempt: &GraspAttempt, step: f64, rng: &mut ChaCha8Rng) -> GraspAttempt {
    let mut next = attempt.clone();
    // Vary the placement, the commands, or both.
    let what = rng.random_range(0..3);
    if what != 0 {
        let place = attempt.place();
        next.position = (place.translation.vector + jitter(rng, 0.005 * step)).into();
        let turned = UnitQuaternion::from_scaled_axis(jitter(rng, 0.15 * step)) * place.rotation;
        next.rotation = turned.scaled_axis().into();
    }
    if what != 1 {
        next.tensions = next
            .tensions
            .iter()
            .map(|tension| (tension * (step * draw_in_range(rng, (-0.35, 0.35))).exp()).min(MAX_TENSION))
            .collect();
        next.before =
            next.before.iter().map(|tension| tension * (step * draw_in_range(rng, (-0.2, 0.2))).exp()).collect();
        next.opposition = (next.opposition + 0.12 * step * rng.random_range(-1.0..1.0)).clamp(0.0, ABDUCTED_RANGE.1);
    }
    next
}

/// Returns the range of the opposition command that the type requires, rad.
pub fn opposition_range(kind: &GraspType) -> (f64, f64) {
    if kind.abducted { ABDUCTED_RANGE } else { ADDUCTED_RANGE }
}

/// Draws a command within that range, rad.
pub fn draw_opposition(kind: &GraspType, rng: &mut ChaCha8Rng) -> f64 {
    draw_in_range(rng, opposition_range(kind))
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;

    use super::*;

    #[test]
    fn the_strongest_pull_is_half_the_stall_torque() {
        let parameters = Hand::ftac().parameters;
        let stall = parameters.servo.stall_torque / parameters.cable.spool_radius;
        assert!((MAX_TENSION - 0.5 * stall).abs() < 1e-9, "{stall} N");
    }
}
