//! Inputs of a pose estimate: touches, servo readings, prior, shape, and the standard deviation of each kind of evidence.

use hand_model::Hand;
use hand_model::transmission::friction::CableLosses;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::shape::KnownShape;
use crate::pad_touch::PadTouch;
use crate::posture::Readings;

/// All inputs of [`estimate_pose`](super::estimate_pose).
#[derive(Clone, Copy)]
pub struct PoseInputs<'a> {
    /// The hand that holds the object.
    pub hand: &'a Hand,
    /// Touches of the pads, at most one per pad. A pad that is not listed gives no evidence.
    pub touches: &'a [PadTouch],
    /// Servo readings and gravity, from which the joint angles are estimated.
    pub readings: Readings<'a>,
    /// Expected pose with its uncertainty.
    pub prior: &'a PosePrior,
    /// Surface of the object.
    pub shape: &'a dyn KnownShape,
    /// Weights and stopping criteria.
    pub options: &'a PoseOptions,
}

/// The planned pose of the object with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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

/// Standard deviations of the evidence, and computational effort.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseOptions {
    /// Standard deviation of the common error of the heights of a broad patch, m; larger for narrow patches.
    pub sigma_height: f64,
    /// Standard deviation of the deepest point of a pressed pad from the position given by `penetration_share`, m.
    pub sigma_lift: f64,
    /// Standard deviation of each component of a measured normal, rad.
    pub sigma_normal: f64,
    /// Standard deviation of a cable excursion, m, without the backlash of the gear.
    pub sigma_excursion: f64,
    /// Losses in guides and gears: the tension at a joint is known up to the capstan factor, the excursion up to the
    /// backlash.
    pub cables: CableLosses,
    /// Standard deviation of the torque balance of a joint whose cable is slack, N m.
    pub sigma_torque: f64,
    /// Additional error of the torque balance as a fraction of the cable's torque, added in quadrature.
    pub tension_torque_fraction: f64,
    /// Additional error of the torque balance as a fraction of the measured contact torque, added in quadrature.
    pub contact_torque_fraction: f64,
    /// Standard deviation of the depth of a contact-free point inside the object, m.
    pub sigma_contact_free: f64,
    /// Standard deviation of an angle beyond a joint limit, rad.
    pub sigma_limit: f64,
    /// Huber threshold, in standard deviations.
    pub huber: f64,
    /// Share of a measured indentation by which the object really moves towards the link. It is 1 on a gel that yields.
    /// It is 0 in a simulation with rigid covers whose images are computed from forces: there the deepest point is on
    /// the untouched surface of the pad.
    pub penetration_share: f64,
    /// True if points without contact are used.
    pub use_contact_free: bool,
    /// Number of orientations kept after screening around the planned one.
    pub starts: usize,
    /// Number of steps per start in the first two stages.
    pub coarse_steps: usize,
    /// Number of solutions kept after the first stage.
    pub kept_solutions: usize,
    /// Number of solutions in the last stage.
    pub final_solutions: usize,
    /// Number of steps per solution in the last stage.
    pub fine_steps: usize,
    /// Cost per patch above which a solution is considered wrong and more orientations are screened around it.
    pub good_cost: f64,
}

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            sigma_height: 8e-5,
            sigma_lift: 1e-4,
            sigma_normal: 8f64.to_radians(),
            sigma_excursion: 1.5e-4,
            cables: CableLosses::NONE,
            sigma_torque: 0.003,
            tension_torque_fraction: 0.25,
            contact_torque_fraction: 0.25,
            sigma_contact_free: 2.5e-4,
            sigma_limit: 0.02,
            huber: 2.5,
            penetration_share: 1.0,
            use_contact_free: true,
            starts: 48,
            coarse_steps: 6,
            kept_solutions: 16,
            final_solutions: 6,
            fine_steps: 30,
            good_cost: 2.0,
        }
    }
}
