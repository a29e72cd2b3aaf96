//! Progress of an episode, from which rewards are made.

use std::sync::Arc;

use grasp_verification::rollout::{PALM, digit_bits};
use hand_model::Hand;
use nalgebra::Point3;
use sim::robot::GroundTruth;
use world::objects::ObjectModel;

/// Centre of the palm in its frame, m: grasped objects lie a few centimetres in front of it.
const GRASP_CENTER: [f64; 3] = [0.0, 0.0, -0.03];
/// Distance at which reaching for an object counts nothing, m: more than there is when an episode begins.
const REACH_DISTANCE: f64 = 0.6;
/// Distance over which proximity falls off, m.
const PROXIMITY_DISTANCE: f64 = 0.05;
/// Height that counts as fully lifted, m.
const FULL_LIFT_HEIGHT: f64 = 0.1;
/// Number of touching digits (and palm) that counts as a full touch.
const FULL_TOUCH_COUNT: f64 = 3.0;

/// Terms of progress, each from 0 to 1 and averaged over the objects of the task.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Linear in the distance of the palm's centre from the object: 1 at the object, 0 from 0.6 m on.
    pub reach: f64,
    /// Proximity on a scale of 5 cm.
    pub near: f64,
    /// Share of three parts of the hand (digits or palm) that touch the object.
    pub touch: f64,
    /// Height over the table, as a share of 0.1 m, while the hand touches the object.
    pub lift: f64,
    /// Share of the required time for which all objects have been held.
    pub hold: f64,
}

impl Progress {
    /// Measures the progress in a scene. `hold` is passed on.
    pub(super) fn measure(hand: &Hand, truth: &GroundTruth, objects: &[Arc<ObjectModel>], hold: f64) -> Self {
        let center = truth.palm * Point3::from(GRASP_CENTER);
        let mut sum = Self::default();
        for (index, object) in objects.iter().enumerate() {
            let position = truth.objects[index].translation.vector;
            let distance = (position - center.coords).norm();
            let touched = truth.touched_by[index];
            let parts = hand.digits().iter().map(|digit| digit_bits(hand, &[*digit])).chain([PALM]);
            let touching = parts.filter(|bits| touched & bits != 0).count() as f64;
            sum.reach += (1.0 - distance / REACH_DISTANCE).clamp(0.0, 1.0);
            sum.near += 1.0 - (distance / PROXIMITY_DISTANCE).tanh();
            sum.touch += (touching / FULL_TOUCH_COUNT).min(1.0);
            if touched != 0 {
                sum.lift += ((position.z - object.rest_height()) / FULL_LIFT_HEIGHT).clamp(0.0, 1.0);
            }
        }
        let share = 1.0 / objects.len() as f64;
        Self {
            reach: share * sum.reach,
            near: share * sum.near,
            touch: share * sum.touch,
            lift: share * sum.lift,
            hold,
        }
    }
}
