//! What a closed grasp has to pass: (a) the friction-cone program, (b) penetration, (c) holding against forces in physics.

use anyhow::Result;
use grasping::force_closure::{Contact, wrench_margin};
use grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use hand_model::hand::CoverShape;
use nalgebra::{Isometry3, Point3, Vector3};
use sim::hand_scene::{HandScene, Pull, displacement};

use super::closing::Closed;
use super::subject::Subject;

/// Acceleration of the holding test, m/s2 (DexGraspBench).
pub const PULL: f64 = 10.0;
/// Force limit of the friction-cone program: all normal forces together, N (the paper's total grasp force).
pub const TOTAL_FORCE: f64 = 10.3;
/// (b) m.
pub const MOST_PENETRATION: f64 = 1e-3;
/// (c) Time for each direction, s, and how far the object may move: m, rad.
pub const HOLD_TIME: f64 = 2.0;
pub const MOST_MOTION: (f64, f64) = (0.05, 15.0 * std::f64::consts::PI / 180.0);
/// A payload is searched for up to this mass, kg, and until it is known to this ratio.
const MOST_PAYLOAD: f64 = 10.0;
const PAYLOAD_RATIO: f64 = 1.1;

/// (a) The margin has to be at least this, N, with [`TOTAL_FORCE`]: the weight of 0.1 kg in the holding test. It judges where the
/// contacts are, whatever the object weighs: a heavier one may be pressed harder. Whether it is held, (c) tells.
pub const LEAST_MARGIN: f64 = 1.0;

/// The wrench margin of the contacts that touch, N.
pub fn margin(subject: &Subject, closed: &Closed) -> Result<f64> {
    let contacts: Vec<Contact> = closed
        .touches
        .iter()
        .map(|touch| Contact { point: touch.point, normal: touch.normal, friction: subject.model.friction })
        .collect();
    let center = closed.scene.object() * subject.field.center;
    Ok(wrench_margin(&contacts, &center, subject.field.length, TOTAL_FORCE)?)
}

/// The deepest penetration of the closed grasp, m: points of the hand in the object, and points of the object in the hand.
pub fn penetration(hand: &Hand, surface: &HandSurface, subject: &Subject, closed: &Closed) -> f64 {
    let palm_from_object = closed.scene.object();
    let object_from_palm = palm_from_object.inverse();
    let links = hand.tree.forward(closed.scene.angles());
    let pose = |link: usize| if link == 0 { Isometry3::identity() } else { links[link - 1] };
    let mut deepest = 0.0_f64;
    for (link, own) in surface.links.iter().enumerate() {
        let object_from_link = object_from_palm * pose(link);
        for p in &own.points {
            let (rough, _) = subject.field.distance_gradient(&(object_from_link * Point3::from(*p)).coords);
            // The grid is off by some hundredths of a millimetre on a face, by more at an edge: ask the shape itself.
            if rough < 1e-3 {
                let (distance, _) = subject.model.shape.signed_distance(&(object_from_link * Point3::from(*p)));
                deepest = deepest.max(-distance);
            }
        }
        let cover = if link == 0 { &hand.palm_cover } else { &hand.covers[link - 1] };
        let cover_from_object = (pose(link) * cover.link_from_cover).inverse() * palm_from_object;
        for p in &subject.surface {
            deepest = deepest.max(-cover_distance(cover, &(cover_from_object * p)));
        }
    }
    deepest
}

/// Signed distance to a rounded box in its own frame, m.
fn cover_distance(cover: &CoverShape, p: &Point3<f64>) -> f64 {
    let q = p.coords.abs() - cover.half.add_scalar(-cover.radius);
    q.map(|x| x.max(0.0)).norm() + q.max().min(0.0) - cover.radius
}

/// How a holding test went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Within the limits in all six directions.
    pub held: bool,
    /// Largest motion, m.
    pub distance: f64,
    /// Largest turn, rad.
    pub angle: f64,
}

/// (c) The DexGraspBench protocol: from the closed grasp, the force of 10 m/s2 on `mass` (kg) along each of the six axes for 2 s
/// each, every time from the same state; stops at the first direction that fails. Motion counts from the closed grasp.
pub fn hold(scene: &HandScene, pull: &Pull, mass: f64) -> Hold {
    hold_by(scene.dt(), mass, &scene.object(), |force, steps| {
        let (mut scene, pull, force) = (scene.clone(), *pull, *force);
        (0..steps).map(move |_| {
            scene.step(&pull, &force);
            scene.object()
        })
    })
}

/// The same for anything that answers, for a force and a number of steps of `dt` (s), with the object's pose after each step.
pub fn hold_by<Run: Iterator<Item = Isometry3<f64>>>(
    dt: f64,
    mass: f64,
    start: &Isometry3<f64>,
    run: impl Fn(&Vector3<f64>, usize) -> Run,
) -> Hold {
    let mut worst = Hold { held: true, distance: 0.0, angle: 0.0 };
    let steps = (HOLD_TIME / dt).round() as usize;
    for direction in 0..6 {
        let sign = if direction % 2 == 0 { 1.0 } else { -1.0 };
        let force = Vector3::ith(direction / 2, sign * PULL * mass);
        for (step, object) in run(&force, steps).enumerate() {
            if (step + 1) % 24 == 0 || step + 1 == steps {
                let (distance, angle) = displacement(start, &object);
                worst.distance = worst.distance.max(distance);
                worst.angle = worst.angle.max(angle);
                if distance > MOST_MOTION.0 || angle > MOST_MOTION.1 {
                    return Hold { held: false, ..worst };
                }
            }
        }
    }
    worst
}

/// The largest mass (kg) that `holds` in six directions, to within a tenth below it: upwards from `held`, which does, by doubling,
/// then by bisection. The closed grasp stays the one of the object's own mass.
pub fn payload(held: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (held, 2.0 * held);
    while high < MOST_PAYLOAD && holds(high) {
        (low, high) = (high, 2.0 * high);
    }
    high = high.min(MOST_PAYLOAD.max(low));
    while high > PAYLOAD_RATIO * low {
        let middle = (low * high).sqrt();
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::HAND_JOINTS;
    use std::sync::Arc;

    #[test]
    fn distance_to_a_rounded_box() {
        let half = Vector3::new(0.02, 0.01, 0.01);
        let cover = CoverShape { link_from_cover: Isometry3::identity(), half, radius: 0.005 };
        let at = |x: f64, y: f64, z: f64| cover_distance(&cover, &Point3::new(x, y, z));
        assert!((at(0.03, 0.0, 0.0) - 0.01).abs() < 1e-12, "over a face");
        assert!((at(0.0, 0.0, 0.004) + 0.006).abs() < 1e-12, "inside");
        let corner = 0.005 * (3.0_f64.sqrt() - 1.0);
        assert!((at(0.02, 0.01, 0.01) - corner).abs() < 1e-12, "the corner is rounded off");
    }

    /// Known to a tenth, from below, wherever it lies; never below what is known to hold, never above the most that is tried.
    #[test]
    fn payload_is_found() {
        for most in [0.1, 0.137, 0.4, 2.9, 9.0] {
            let found = payload(0.1, |mass| mass <= most);
            assert!(found <= most && 1.1 * found >= most, "{found} for {most}");
        }
        assert!((9.0..=10.0).contains(&payload(0.1, |_| true)));
        assert_eq!(payload(12.0, |_| true), 12.0);
    }

    /// An object that nothing touches flies off: the test can fail.
    #[test]
    fn a_floating_object_is_not_held() {
        let hand = Arc::new(Hand::ftac());
        let subject = Subject::named("ball").expect("the ball");
        let away = Isometry3::translation(0.0, 0.0, -0.5);
        let scene = HandScene::new(&hand, &subject.model, &away, &[0.0; HAND_JOINTS]);
        let hold = hold(&scene, &Pull { tensions: [0.0; 5], opposition: 0.0 }, 0.1);
        assert!(!hold.held && hold.distance > 0.05, "{hold:?}");
    }
}
