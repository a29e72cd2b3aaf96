//! Projection of a sampled posture to one that cables and springs can hold: the sampler moves joints, and a hand has
//! more joints than actuators.
//!
//! A cable at a given tension holds its joints, free of contact, on a curve. A posture is projected to the point of the
//! curve with the same mean angle. From there a digit *opens* along its curve until it is clear of the object. This is
//! the posture in which the hand approaches. Increasing the tension closes it.

use hand_model::Hand;
use hand_model::bisection::bisect;
use nalgebra::Vector3;

use super::field::DistanceField;
use super::frames::{HandState, LinkFrames};
use super::surface::HandSurface;

/// Tension at which a free digit is fully closed, N.
const FULL_TENSION: f64 = 40.0;
/// Clearance to which a digit opens, m.
const OPENING_CLEARANCE: f64 = 1.5e-3;
/// Decrease of the mean angle per step of opening, rad.
const OPENING_STEP: f64 = 0.08;
/// Largest number of steps that move the palm out of the object.
const MAX_RETREATS: usize = 12;

/// A posture that the actuators can hold without contact.
#[derive(Debug, Clone, PartialEq)]
pub struct FreePosture {
    /// Tensions of the actuators, N.
    pub tensions: Vec<f64>,
    /// Opposition angle, rad. 0 for a hand without an opposition drive.
    pub opposition: f64,
    /// Resulting joint coordinates, rad or m.
    pub joints: Vec<f64>,
}

/// Finds the tension at which the mean angle of a free cable's joints is `mean` (rad), by bisection: the angle
/// increases with tension.
fn tension_for_mean(hand: &Hand, cable: usize, mean: f64) -> f64 {
    let at = |tension: f64| {
        let angles = hand.transmission.free_angles(cable, tension);
        angles.iter().map(|(_, q)| q).sum::<f64>() / angles.len() as f64
    };
    if mean <= 0.0 {
        return 0.0;
    }
    if at(FULL_TENSION) <= mean {
        return FULL_TENSION;
    }
    bisect(|tension| at(tension) - mean, [0.0, FULL_TENSION], 24)
}

fn mean_angle(hand: &Hand, cable: usize, joints: &[f64]) -> f64 {
    let path = &hand.transmission.cables[cable].joints;
    path.iter().map(|crossing| joints[crossing.joint]).sum::<f64>() / path.len() as f64
}

/// Returns the free posture with the same opposition angle and the same mean angle of each digit as `joints`.
pub fn project(hand: &Hand, joints: &[f64]) -> FreePosture {
    let drive = hand.transmission.opposition;
    let opposition =
        drive.map_or(0.0, |drive| joints[drive].clamp(hand.tree.joints[drive].lower, hand.tree.joints[drive].upper));
    let mut posture =
        FreePosture { tensions: hand.slack_tensions().to_vec(), opposition, joints: hand.open_angles().to_vec() };
    if let Some(drive) = drive {
        posture.joints[drive] = opposition;
    }
    for cable in 0..hand.cables.len() {
        set_mean(hand, &mut posture, cable, mean_angle(hand, cable, joints));
    }
    posture
}

fn set_mean(hand: &Hand, posture: &mut FreePosture, cable: usize, mean: f64) {
    posture.tensions[cable] = tension_for_mean(hand, cable, mean);
    let angles = hand.transmission.free_angles(cable, posture.tensions[cable]);
    for (joint, angle) in angles {
        posture.joints[joint] = angle;
    }
}

/// Returns the least distance (m) of a link's surface from the object, and the object's normal there.
fn clearance(frames: &LinkFrames, surface: &HandSurface, field: &DistanceField, link: usize) -> (f64, Vector3<f64>) {
    let mut least = (f64::INFINITY, Vector3::zeros());
    for local in &surface.links[link].points {
        let x = frames.point(link, local);
        let distance = field.distance(&x);
        if distance < least.0 {
            least = (distance, field.sample_at(&x).normal);
        }
    }
    least
}

/// A hand that is clear of the object and ready to close.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenedHand {
    /// Pose and joints, clear of the object.
    pub state: HandState,
    /// Open posture, in which the hand approaches.
    pub open: FreePosture,
    /// Projected posture, before opening.
    pub projected: FreePosture,
}

/// Projects a sampled state, moves the palm out of the object if necessary, and opens every digit until it is clear.
/// `None` if the palm or a digit cannot be cleared.
pub fn open_clear(
    hand: &Hand,
    surface: &HandSurface,
    field: &DistanceField,
    frames: &mut LinkFrames,
    state: &HandState,
) -> Option<OpenedHand> {
    let aimed = project(hand, &state.joints);
    let mut state = HandState { object_from_palm: state.object_from_palm, joints: aimed.joints.clone() };
    // Cables do not move the palm and the thumb's first link, so the whole hand retreats.
    let fixed: Vec<usize> = std::iter::once(0).chain(hand.transmission.opposition.map(|joint| joint + 1)).collect();
    for retreat in 0.. {
        frames.set_state(&state);
        let (depth, normal) =
            fixed.iter().map(|link| clearance(frames, surface, field, *link)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        if depth >= 0.0 {
            break;
        }
        if retreat == MAX_RETREATS {
            return None;
        }
        state.object_from_palm.translation.vector += normal * (0.3e-3 - depth);
    }
    let mut open = aimed.clone();
    for digit in hand.digits() {
        let cable = digit.index();
        let links: Vec<usize> = hand.links(*digit).iter().map(|joint| joint + 1).collect();
        let mut mean = mean_angle(hand, cable, &open.joints);
        loop {
            state.joints.copy_from_slice(&open.joints);
            frames.set_state(&state);
            let moved = links.iter().filter(|link| !fixed.contains(link));
            let least = moved.map(|link| clearance(frames, surface, field, *link).0).fold(f64::INFINITY, f64::min);
            if least >= OPENING_CLEARANCE {
                break;
            }
            if mean <= 0.0 {
                // A straight digit cannot open further; it may touch the object but not be inside it.
                if least >= 0.0 {
                    break;
                }
                return None;
            }
            mean = (mean - OPENING_STEP).max(0.0);
            set_mean(hand, &mut open, cable, mean);
        }
    }
    Some(OpenedHand { state, open, projected: aimed })
}

#[cfg(test)]
mod tests {
    use super::super::field::tests::ball;
    use super::*;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    proptest! {
        /// A free posture is its own projection.
        #[test]
        fn projecting_twice_changes_nothing(joints in proptest::collection::vec(0.0..1.4_f64, 15)) {
            let hand = Hand::ftac();
            let once = project(&hand, &joints);
            let twice = project(&hand, &once.joints);
            for (a, b) in once.joints.iter().zip(&twice.joints) {
                prop_assert!((a - b).abs() < 1e-4, "{} {}", a, b);
            }
            for cable in 0..5 {
                let wanted = mean_angle(&hand, cable, &joints);
                prop_assert!((mean_angle(&hand, cable, &once.joints) - wanted).abs() < 1e-3);
            }
        }
    }

    /// A fist around a ball opens until every link is out of it.
    #[test]
    fn opens_out_of_the_object() {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 1000);
        let field = ball(0.03);
        let mut frames = LinkFrames::new(&hand.tree);
        let state = HandState { object_from_palm: Isometry3::translation(0.0, 0.0, 0.035), joints: vec![0.9; 15] };
        frames.set_state(&state);
        let deepest = |frames: &LinkFrames| {
            (0..16).map(|link| clearance(frames, &surface, &field, link).0).fold(f64::INFINITY, f64::min)
        };
        assert!(deepest(&frames) < -3e-3, "the test starts inside");
        let opened = open_clear(&hand, &surface, &field, &mut frames, &state).expect("can be opened");
        frames.set_state(&opened.state);
        assert!(deepest(&frames) >= 0.0);
        assert!(opened.open.tensions.iter().zip(&opened.projected.tensions).all(|(open, aimed)| open <= aimed));
    }
}
