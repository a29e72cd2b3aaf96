//! What a pose is estimated from: the touches, the servos, the plan, the shape, and how far each is trusted.

use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, Hand};
use nalgebra::Isometry3;

use super::shape::KnownShape;
use crate::pad_touch::PadTouch;

/// Everything that [`estimate_pose`](super::estimate_pose) works with.
#[derive(Clone, Copy)]
pub struct PoseInputs<'a> {
    /// The hand.
    pub hand: &'a Hand,
    /// What the pads feel, at most one element a pad; a pad that is not listed is no evidence.
    pub touches: &'a [PadTouch],
    /// Servo readings.
    pub servos: &'a [ServoState; ACTUATORS],
    /// Where the plan has the object.
    pub prior: &'a PosePrior,
    /// The object's shape.
    pub shape: &'a dyn KnownShape,
    /// Standard deviations and effort.
    pub options: &'a PoseOptions,
}

/// Where the plan thinks the object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePrior {
    /// `palm_from_object`.
    pub palm_from_object: Isometry3<f64>,
    /// Standard deviation of the position along each axis, m.
    pub sigma_translation: f64,
    /// Standard deviation of the rotation about each axis, rad.
    pub sigma_rotation: f64,
}

impl PosePrior {
    /// A weak prior: 15 mm, 25 degrees.
    pub fn weak(palm_from_object: Isometry3<f64>) -> Self {
        Self { palm_from_object, sigma_translation: 0.015, sigma_rotation: 25f64.to_radians() }
    }
}

/// Standard deviations of the evidence, and how hard to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseOptions {
    /// Heights of a broad patch, all together, m; those of a narrow one are known less well.
    pub sigma_height: f64,
    /// How far the deepest point of a pressed pad may be from where `sinking` has it, m.
    pub sigma_lift: f64,
    /// Each component of a felt normal, rad.
    pub sigma_normal: f64,
    /// Cable excursion, m.
    pub sigma_excursion: f64,
    /// Torque balance of a joint, N m ...
    pub sigma_torque: f64,
    /// ... and this fraction of the contact torque felt there, root of the sum of squares.
    pub contact_torque_fraction: f64,
    /// Depth of a point that feels nothing inside the object, m.
    pub sigma_clear: f64,
    /// Angle beyond a joint limit, rad.
    pub sigma_limit: f64,
    /// Huber threshold, in standard deviations.
    pub huber: f64,
    /// Share of a felt indentation by which the object really comes closer to the link under the pad. On a gel that yields it
    /// is 1. A body whose covers are rigid, with images made from forces, has 0: the deepest point is then on the pad's
    /// untouched surface.
    pub sinking: f64,
    /// Whether the evidence of untouched surface is used.
    pub use_clear: bool,
    /// Orientations kept of the many that are tried about the plan's.
    pub starts: usize,
    /// Steps of every start, and of those kept.
    pub coarse_steps: usize,
    /// Starts that are kept after their first steps.
    pub kept: usize,
    /// Solutions that are finished ...
    pub finished: usize,
    /// ... in so many steps.
    pub fine_steps: usize,
    /// Cost per patch above which a solution does not explain what is felt, so that more are looked for around it.
    pub good_cost: f64,
}

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            sigma_height: 8e-5,
            sigma_lift: 1e-4,
            sigma_normal: 8f64.to_radians(),
            sigma_excursion: 1.5e-4,
            sigma_torque: 0.03,
            contact_torque_fraction: 0.25,
            sigma_clear: 2.5e-4,
            sigma_limit: 0.02,
            huber: 2.5,
            sinking: 1.0,
            use_clear: true,
            starts: 48,
            coarse_steps: 6,
            kept: 16,
            finished: 6,
            fine_steps: 30,
            good_cost: 2.0,
        }
    }
}
