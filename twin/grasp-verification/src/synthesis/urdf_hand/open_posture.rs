//! Projection of a sampled posture of a URDF hand to one that its actuators hold, clear of the object.

use dexterous_grasping::synthesis::field::DistanceField;
use dexterous_grasping::synthesis::frames::{HandState, LinkFrames};
use nalgebra::Vector3;

use crate::synthesis::grasping_hand::GraspingHand;

/// Clearance to which a link opens, m.
const OPENING_CLEARANCE: f64 = 1.5e-3;
/// Opening of an actuator per step, rad, and maximum number of steps and retreats.
const OPENING_STEP: f64 = 0.06;
const MAX_STEPS: usize = 60;

/// Projects a sample onto the actuators' lines and opens it until it is clear of the object. Returns the state and the
/// amounts on the lines.
pub fn open_clear(
    hand: &GraspingHand,
    field: &DistanceField,
    frames: &mut LinkFrames,
    sample: &HandState,
) -> Option<(HandState, Vec<f64>)> {
    let mechanism = &hand.sampled.mechanism;
    let mut state = sample.clone();
    let mut amounts: Vec<f64> = (0..mechanism.lines.len()).map(|line| mechanism.amount(line, &state.joints)).collect();
    let start: Vec<f64> =
        state.joints.iter().zip(&mechanism.limits).map(|(q, (low, high))| q.clamp(*low, *high)).collect();
    state.joints = start;
    for _ in 0..MAX_STEPS {
        for (line, amount) in amounts.iter().enumerate() {
            mechanism.set_amount(line, *amount, &mut state.joints);
        }
        frames.set_state(&state);
        let mut clear = true;
        for (link, surface) in hand.sampled.surface.links.iter().enumerate() {
            let mut least = (f64::INFINITY, Vector3::zeros());
            for local in &surface.points {
                let x = frames.point(link, local);
                let distance = field.distance(&x);
                if distance < least.0 {
                    least = (distance, x);
                }
            }
            let movers: Vec<usize> = (0..amounts.len()).filter(|line| actuator_moves_link(hand, *line, link)).collect();
            let can_open = movers.iter().any(|line| amounts[*line] > 0.0);
            if least.0 < 0.0 && !can_open {
                state.object_from_palm.translation.vector += field.sample_at(&least.1).normal * (0.3e-3 - least.0);
                clear = false;
            } else if least.0 < OPENING_CLEARANCE && can_open {
                let step = |line: usize| OPENING_STEP * mechanism.unit(line);
                movers.iter().for_each(|line| amounts[*line] = (amounts[*line] - step(*line)).max(0.0));
                clear = false;
            }
        }
        if clear {
            return Some((state, amounts));
        }
    }
    None
}

/// True if an actuator moves a link (0 is the root).
fn actuator_moves_link(hand: &GraspingHand, line: usize, link: usize) -> bool {
    link > 0
        && hand
            .sampled
            .tree
            .chain(link - 1)
            .iter()
            .any(|joint| hand.sampled.mechanism.lines[line].joints.contains(joint))
}

/// Returns the tension that holds an actuator `amount` along its line, free of contact, N.
pub fn holding_tension(hand: &GraspingHand, line: usize, amount: f64) -> f64 {
    let Some((joint, arm)) = hand.mechanism().actuators[line].moment_arms().next() else { return 0.0 };
    let own = &hand.sampled.mechanism.lines[line];
    let share = own.joints.iter().position(|own| *own == joint).map_or(1.0, |n| own.share[n]);
    (hand.mechanism().joint_dynamics[joint].spring * amount * share / arm).max(0.0)
}
