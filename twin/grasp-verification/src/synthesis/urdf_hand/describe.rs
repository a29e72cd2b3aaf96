//! Description of a hand for sampling, derived from its URDF and pulls file alone, with notes on the findings.
//!
//! Surface points lie on the collision shapes. The contact candidates are found by moving the hand. A point of a moving
//! link is a candidate if the closing hand moves it in the direction that it faces. A point of the palm is a candidate
//! if it faces the closing point, on which the fingers close. The closing point is also the pivot of the sampler's
//! rotations, in a frame laid out like our hand's palm: the object comes along -z.

mod palm;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use dexterous_grasping::synthesis::mechanism::Mechanism;
use dexterous_grasping::synthesis::surface::{ContactCandidate, HandSurface, LinkSphere};
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::JointKind;
use nalgebra::{Isometry3, Point3, Vector3};
use sim::collision_model::CollisionModel;
use world::geometry::LINK_MESHES;

use self::palm::{facing_warning, opening, palm_frame};
use super::super::grasping_hand::{ContactModel, GraspingHand, SampledHand};
use super::super::size::HandOpening;
use super::derived_surface::DerivedSurface;
use super::solids::{LinkShapes, LinkSurfacePoint, fill_with_spheres, link_name, link_number, shapes, surface_points};
use super::true_surface::TrueSurfaces;

const MAX_CANDIDATES: usize = 700;
/// Cosine between a point's motion and its normal above which it is a candidate.
const MIN_MOTION_COSINE: f64 = 0.5;
/// Cosine between a palm point's normal and the direction to the closing point above which it is a candidate.
const MIN_CLOSING_POINT_COSINE: f64 = 0.7;
/// Least motion of a candidate in the middle quarter of the closing motion, m. It excludes points beside their own
/// hinge.
const MIN_MOTION: f64 = 2e-3;
/// Least motion of a candidate on a sliding link, m. Such a link has no hinge.
const MIN_SLIDE: f64 = 0.2e-3;
/// Steps into which the closing motion is divided.
const CLOSING_STEPS: usize = 8;
/// Largest distance of a candidate on a collision part from the link's own surface, m.
const SURFACE_TOLERANCE: f64 = 1.5e-3;
/// Arm of the torsional friction that a fingertip bears about its normal, m: 3 pi / 16 of the radius of its contact
/// (Hertz), which is 5 mm for soft tips.
const TORSION_ARM: f64 = 3.0 * std::f64::consts::PI / 16.0 * 5e-3;
/// Arm at which torques count as forces, m: the lever arm at which an object's weight may act.
const TORQUE_ARM: f64 = 0.01;
/// Tension below which a note states that an actuator is weak, N.
const WEAK_TENSION: f64 = 60.0;

/// Reads and describes a hand.
pub fn read(urdf: &Path, pulls: &Path) -> Result<GraspingHand> {
    let hand = HandMechanism::read(urdf, pulls, LINK_MESHES)?;
    describe(hand).with_context(|| urdf.display().to_string())
}

fn describe(hand: HandMechanism) -> Result<GraspingHand> {
    let mut notes = Vec::new();
    check(&hand, &mut notes)?;
    let mechanism = Mechanism::from_urdf(&hand);
    let shapes = shapes(&hand)?;
    let by_link = surface_points(&shapes);
    for (link, points) in by_link.iter().enumerate() {
        if points.is_empty() {
            notes.push(format!(
                "WARNING {}: no collision shape, it can neither touch nor be kept clear",
                link_name(&hand, link)
            ));
        }
    }
    notes.extend(palm_note(&hand, &shapes));
    let true_surfaces = TrueSurfaces::new(&hand, &shapes);
    let closing_motion = closing_motion(&hand, &mechanism);
    let place = closing_point(&hand, &mechanism, &closing_motion, &by_link)?;
    let palm_from_root = palm_frame(&hand, &shapes, &place, &mut notes)?;
    notes.extend(facing_warning(&hand, &mechanism, &closing_motion, &palm_from_root));
    let mut candidates: Vec<ContactCandidate> = Vec::new();
    for (link, points) in by_link.iter().enumerate() {
        let faces: Vec<&LinkSurfacePoint> =
            points.iter().filter(|at| may_touch(&hand, &closing_motion, &place, link, at)).collect();
        let on_surface = |at: &&&LinkSurfacePoint| {
            let point = Point3::from(at.point);
            (true_surfaces.nearest(link, &point) - point).norm() <= SURFACE_TOLERANCE
        };
        let faces: Vec<&LinkSurfacePoint> = faces.iter().filter(on_surface).copied().collect();
        candidates.extend(faces.iter().map(|at| ContactCandidate {
            link,
            pad: link,
            point: at.point,
            normal: at.normal,
        }));
        notes.push(format!("{:32} {:5} points, {:4} candidates", link_name(&hand, link), points.len(), faces.len()));
    }
    if !candidates.iter().any(|candidate| candidate.link > 0) {
        bail!(
            "contacts: found no point of a moving link that faces its closing motion, expected some: do the arms' signs close the hand?"
        );
    }
    let every = candidates.len().div_ceil(MAX_CANDIDATES);
    candidates = candidates.into_iter().step_by(every.max(1)).collect();
    let opening = HandOpening { width: opening(&hand, &closing_motion, &candidates), hand: hand.name.clone() };
    notes.push(format!("the fingers take up to {:.0} mm between them", 1e3 * opening.width));
    let balls: Vec<Vec<LinkSphere>> = shapes.iter().map(|own| fill_with_spheres(own)).collect();
    let hand = Arc::new(hand);
    let body = CollisionModel::new(hand.clone());
    let pairs = collision_pairs(&body, &balls, &mut notes);
    let root = |v: &Vector3<f64>| (palm_from_root * Point3::from(*v)).coords;
    let parts = by_link.iter().zip(balls).enumerate().map(|(link, (points, balls))| {
        let here = |v: &Vector3<f64>| if link == 0 { root(v) } else { *v };
        let balls = balls.into_iter().map(|ball| LinkSphere { center: here(&ball.center), ..ball }).collect();
        (points.iter().map(|at| here(&at.point)).collect(), balls)
    });
    for candidate in candidates.iter_mut().filter(|candidate| candidate.link == 0) {
        candidate.point = root(&candidate.point);
        candidate.normal = palm_from_root * candidate.normal;
    }
    let surface = HandSurface::from_points(parts.collect(), candidates, pairs);
    let mut tree = hand.tree.clone();
    for joint in tree.joints.iter_mut().filter(|joint| joint.parent.is_none()) {
        joint.origin = palm_from_root * joint.origin;
    }
    let root = shapes.into_iter().next().unwrap_or_default();
    Ok(GraspingHand {
        body,
        palm_from_root,
        sampled: SampledHand { tree, mechanism, surface },
        may_close: vec![true; hand.actuators.len()],
        opening,
        tensions: (8.0, 60.0),
        contacts: ContactModel::Soft { torsion_arm: TORSION_ARM, torque_arm: TORQUE_ARM },
        named_hand: None,
        derived_surface: Some(DerivedSurface { root, true_surfaces }),
        notes,
    })
}

/// Returns a warning about the parts that may bear an object if the pulls file does not name the palm.
fn palm_note(hand: &HandMechanism, shapes: &LinkShapes) -> Option<String> {
    let mut owners: Vec<&str> =
        hand.solids.iter().filter(|solid| solid.link.is_none()).map(|solid| solid.link_name.as_str()).collect();
    owners.dedup();
    (!shapes[0].is_empty() && !shapes[0].iter().any(|part| part.bears)).then(|| {
        format!(
            "WARNING palm: not named; a grasp that leans on a fixed part ({}) is none. `links` in the pulls file's [palm] names those that may \
             bear an object",
            owners.join(", ")
        )
    })
}

fn check(hand: &HandMechanism, notes: &mut Vec<String>) -> Result<()> {
    if hand.actuators.is_empty() {
        bail!("actuator: found none, expected at least one that pulls a joint");
    }
    notes.extend(hand.notes.iter().cloned());
    for (name, at) in &hand.held_joints {
        notes.push(format!("{name}: no actuator pulls it, it is held at {at:.3}"));
    }
    for (name, (most, by)) in hand.actuators.iter().filter_map(|pull| Some((&pull.name, pull.max_tension.as_ref()?))) {
        if *most < WEAK_TENSION {
            notes.push(format!("{name}: pulls with {most:.1} N at most: {by}"));
        }
    }
    for (index, joint) in hand.tree.joints.iter().enumerate() {
        let pulled = hand.actuators.iter().any(|pull| pull.levers.iter().any(|(joint, _)| *joint == index));
        let follows = hand.followers.iter().find(|follower| follower.joint == index);
        match (pulled, follows) {
            (true, _) => {}
            (false, Some(follower)) => {
                let leader = &hand.tree.joints[follower.leader].name;
                let offset = match follower.offset {
                    0.0 => String::new(),
                    offset => format!(" plus {offset} {}", joint.kind.unit()),
                };
                notes.push(format!("{}: follows {leader} times {}{offset}", joint.name, follower.multiplier));
                continue;
            }
            // The hand's reader holds joints that no actuator pulls.
            (false, None) => continue,
        }
        if !(joint.lower.is_finite() && joint.upper.is_finite()) {
            bail!(
                "joint[{}].limit: found none, expected finite limits of a joint that is pulled: grasps are sampled between them",
                joint.name
            );
        }
    }
    Ok(())
}

/// Returns the joint coordinates of the closing motion, from open to closed.
fn closing_motion(hand: &HandMechanism, mechanism: &Mechanism) -> Vec<Vec<f64>> {
    let open = hand.rest_coordinates();
    (0..=CLOSING_STEPS)
        .map(|step| {
            let mut joints = open.clone();
            for (line, own) in mechanism.lines.iter().enumerate() {
                // The mean of its joints' ranges.
                let far: f64 = own
                    .joints
                    .iter()
                    .zip(&own.share)
                    .enumerate()
                    .map(|(n, (joint, share))| {
                        let (lower, upper) = mechanism.limits[*joint];
                        let zero = own.offset[n];
                        (if *share > 0.0 { upper - zero } else { zero - lower }).max(0.0)
                    })
                    .sum::<f64>()
                    / own.joints.len() as f64;
                let start = mechanism.amount(line, &open);
                mechanism.set_amount(line, start + (far - start) * step as f64 / CLOSING_STEPS as f64, &mut joints);
            }
            joints
        })
        .collect()
}

/// Returns the pose of a link at joint coordinates, root frame.
fn pose(hand: &HandMechanism, joints: &[f64], link: usize) -> Isometry3<f64> {
    if link == 0 { Isometry3::identity() } else { hand.tree.forward(joints)[link - 1] }
}

/// Returns the closing point: the mean of the last links' centres in the middle of the closing motion, root frame.
fn closing_point(
    hand: &HandMechanism,
    mechanism: &Mechanism,
    closing_motion: &[Vec<f64>],
    by_link: &[Vec<LinkSurfacePoint>],
) -> Result<Point3<f64>> {
    let moved: Vec<usize> = mechanism.lines.iter().flat_map(|line| line.joints.iter().copied()).collect();
    let last = |joint: &usize| !hand.tree.joints.iter().any(|other| other.parent == Some(*joint));
    let tips: Vec<usize> = moved.iter().filter(|joint| last(joint)).map(|joint| joint + 1).collect();
    let half = &closing_motion[CLOSING_STEPS / 2];
    let middles: Vec<Vector3<f64>> = tips
        .iter()
        .filter(|link| !by_link[**link].is_empty())
        .map(|link| {
            let mean = by_link[*link].iter().map(|at| at.point).sum::<Vector3<f64>>() / by_link[*link].len() as f64;
            (pose(hand, half, *link) * Point3::from(mean)).coords
        })
        .collect();
    if middles.is_empty() {
        bail!("fingertips: found no last link that moves and has a collision shape, expected at least one");
    }
    Ok(Point3::from(middles.iter().sum::<Vector3<f64>>() / middles.len() as f64))
}

/// True if the closing hand moves a point in the direction that it faces. For the palm, true if the point faces the
/// closing point.
fn may_touch(
    hand: &HandMechanism,
    closing_motion: &[Vec<f64>],
    place: &Point3<f64>,
    link: usize,
    at: &LinkSurfacePoint,
) -> bool {
    if !at.bears {
        return false;
    }
    if link == 0 {
        let way = place.coords - at.point;
        return at.normal.dot(&way) > MIN_CLOSING_POINT_COSINE * way.norm();
    }
    let half = CLOSING_STEPS / 2;
    let (before, after) = (pose(hand, &closing_motion[half - 1], link), pose(hand, &closing_motion[half + 1], link));
    let point = Point3::from(at.point);
    let motion = after * point - before * point;
    let normal = pose(hand, &closing_motion[half], link) * at.normal;
    let slides = hand.tree.chain(link - 1).iter().all(|joint| hand.tree.joints[*joint].kind == JointKind::Slide);
    motion.norm() > if slides { MIN_SLIDE } else { MIN_MOTION }
        && normal.dot(&motion) > MIN_MOTION_COSINE * motion.norm()
}

/// Returns the pairs of links whose balls the sampler keeps apart. Links that are joined are left out, and so are links
/// that already overlap at rest, as published boxes often do. The balls lie inside the shapes, so everything that
/// collides in physics is among these pairs.
fn collision_pairs(body: &CollisionModel, balls: &[Vec<LinkSphere>], notes: &mut Vec<String>) -> Vec<(usize, usize)> {
    let hand = &**body.hand();
    let open = hand.rest_coordinates();
    let placed: Vec<Vec<LinkSphere>> = balls
        .iter()
        .enumerate()
        .map(|(link, own)| {
            let pose = pose(hand, &open, link);
            own.iter().map(|ball| LinkSphere { center: (pose * Point3::from(ball.center)).coords, ..*ball }).collect()
        })
        .collect();
    let parent = |link: usize| hand.tree.joints[link - 1].parent.map_or(0, |joint| joint + 1);
    let mut kept = Vec::new();
    for b in 1..placed.len() {
        for a in (0..b).filter(|a| *a != parent(b)) {
            let meet =
                placed[a].iter().any(|x| placed[b].iter().any(|y| (x.center - y.center).norm() < x.radius + y.radius));
            if !meet {
                kept.push((a, b));
            }
        }
    }
    let overlap = body
        .ignored_pairs()
        .iter()
        .map(|(a, b)| format!("{}+{}", link_name(hand, link_number(*a)), link_name(hand, link_number(*b))));
    let overlap: Vec<String> = overlap.collect();
    if !overlap.is_empty() {
        notes.push(format!("WARNING pass through each other, because they overlap at rest: {}", overlap.join(", ")));
    }
    kept
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use dexterous_grasping::synthesis::frames::PIVOT;

    /// Builds two jaws on a base, one of them pulled and the other following in the opposite direction.
    pub fn clamp(arms: &str) -> Result<GraspingHand> {
        let link = |name: &str| {
            format!(
                r#"<link name="{name}"><inertial><mass value="0.1"/><origin xyz="0.03 0 0"/>
                <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
                <collision><origin xyz="0.03 0 0"/><geometry><box size="0.06 0.01 0.02"/></geometry></collision></link>"#
            )
        };
        let joint = |name: &str, child: &str, y: f64, (low, high): (f64, f64), mimic: &str| {
            format!(
                r#"<joint name="{name}" type="revolute"><parent link="base"/><child link="{child}"/><origin xyz="0.02 {y} 0"/>
                <axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{mimic}</joint>"#
            )
        };
        let urdf = format!(
            r#"<robot name="clamp"><link name="base"><collision><geometry><box size="0.04 0.1 0.02"/></geometry></collision></link>
            {}{}{}{}</robot>"#,
            link("left"),
            link("right"),
            joint("a", "left", 0.04, (-1.0, 0.0), ""),
            joint("b", "right", -0.04, (0.0, 1.0), r#"<mimic joint="a" multiplier="-1"/>"#)
        );
        let pulls = format!(
            "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n[[actuator]]\nname = \"close\"\narms = {arms}\n[palm]\nlinks = [\"base\"]\n"
        );
        describe(HandMechanism::parse(&urdf, Path::new("clamp.urdf"), &pulls, Path::new("clamp.toml"), LINK_MESHES)?)
    }

    /// Candidates are found on the inner faces of the jaws and on the base between them, and nowhere else.
    #[test]
    fn inner_faces_are_candidates() {
        let clamp = clamp("{ a = -0.01 }").expect("described");
        let root_from_palm = clamp.palm_from_root.inverse();
        for candidate in &clamp.sampled.surface.candidates {
            match candidate.link {
                0 => assert!((root_from_palm * candidate.normal).x > 0.9, "the base's front"),
                1 => assert!(candidate.normal.y < -0.9, "{:?}", candidate),
                _ => assert!(candidate.normal.y > 0.9, "{:?}", candidate),
            }
        }
        for link in 0..3 {
            assert!(clamp.sampled.surface.candidates.iter().filter(|c| c.link == link).count() > 10, "link {link}");
        }
        // The jaws close in front of the base, which lies behind them along +z.
        let place = clamp.palm_from_root * Point3::new(0.06, 0.0, 0.0);
        assert!((place.coords - PIVOT).norm() < 0.02, "{place}");
        assert!(clamp.notes.iter().any(|line| line.contains("b: follows a times -1")), "{:?}", clamp.notes);
    }

    /// A hand that cannot close is refused with the reason.
    #[test]
    fn hands_that_cannot_close_are_refused() {
        let error = clamp("{ }").err().map(|error| format!("{error:#}")).unwrap_or_default();
        assert!(error.contains("fingertips") || error.contains("actuator"), "{error}");
    }
}
