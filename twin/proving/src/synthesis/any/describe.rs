//! What sampling has to know of a hand, found from its URDF and pulls alone, with notes on what was found.
//!
//! Surface points lie on the collision shapes. Where the hand may touch is found by moving it: a point of a moving link is a
//! contact candidate if the closing hand moves it the way it faces; a point of the palm is one if it faces the place on which
//! the fingers close. That place is also the pivot of the sampler's turns, seen from a frame laid out like our hand's palm: the
//! object comes along -z.

mod solids;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use grasping::synthesis::frames::PIVOT;
use grasping::synthesis::mechanism::Mechanism;
use grasping::synthesis::surface::{Ball, Candidate, HandSurface};
use hand_model::any_hand::AnyHand;
use hand_model::kinematics::Tree;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sim::stand::AnyBody;

use self::solids::{LinkShapes, SurfacePoint, fill, name, shapes, surface_points};

const MOST_CANDIDATES: usize = 700;
/// Cosine between a point's motion and its normal from which on it is a candidate.
const FACES_MOTION: f64 = 0.5;
/// Cosine between a palm point's normal and the way to the place on which the fingers close.
const FACES_CLOSING_POINT: f64 = 0.7;
/// How far a point has to move in the middle quarter of the closing motion, m: not one beside its own hinge.
const LEAST_MOTION: f64 = 2e-3;
/// Steps of the closing motion that are looked at.
const STEPS: usize = 8;

/// A hand made ready for sampling. The tree, the surface and all candidates are in the palm frame.
pub struct Described {
    /// As read.
    pub hand: Arc<AnyHand>,
    /// With its collision shapes.
    pub body: AnyBody,
    /// Its tree with the palm frame as root.
    pub tree: Tree,
    /// `palm_from_root`.
    pub palm_from_root: Isometry3<f64>,
    /// Limits and actuator lines.
    pub mechanism: Mechanism,
    /// Points, candidates, pairs.
    pub surface: HandSurface,
    /// What was found, in words; warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

/// Reads and describes a hand.
pub fn read(urdf: &Path, pulls: &Path) -> Result<Described> {
    let hand = AnyHand::read(urdf, pulls)?;
    describe(hand).with_context(|| urdf.display().to_string())
}

fn describe(hand: AnyHand) -> Result<Described> {
    let mut notes = Vec::new();
    check(&hand, &mut notes)?;
    let mechanism = Mechanism::of_any(&hand);
    let shapes = shapes(&hand)?;
    let by_link = surface_points(&shapes);
    for (link, points) in by_link.iter().enumerate() {
        if points.is_empty() {
            notes.push(format!(
                "WARNING {}: no collision shape, it can neither touch nor be kept clear",
                name(&hand, link)
            ));
        }
    }
    let closing_motion = closing_motion(&hand, &mechanism);
    let place = closing_point(&hand, &mechanism, &closing_motion, &by_link)?;
    let palm_from_root = palm_frame(&shapes, &place, &mut notes)?;
    notes.extend(facing_warning(&hand, &mechanism, &closing_motion, &palm_from_root));
    let mut candidates: Vec<Candidate> = Vec::new();
    for (link, points) in by_link.iter().enumerate() {
        let faces: Vec<&SurfacePoint> =
            points.iter().filter(|at| may_touch(&hand, &closing_motion, &place, link, at)).collect();
        candidates.extend(faces.iter().map(|at| Candidate { link, pad: link, point: at.point, normal: at.normal }));
        notes.push(format!("{:32} {:5} points, {:4} candidates", name(&hand, link), points.len(), faces.len()));
    }
    if !candidates.iter().any(|candidate| candidate.link > 0) {
        bail!(
            "contacts: found no point of a moving link that faces its closing motion, expected some: do the arms' signs close the hand?"
        );
    }
    let every = candidates.len().div_ceil(MOST_CANDIDATES);
    candidates = candidates.into_iter().step_by(every.max(1)).collect();
    let balls: Vec<Vec<Ball>> = shapes.iter().map(|own| fill(own)).collect();
    let hand = Arc::new(hand);
    let body = AnyBody::new(hand.clone());
    let pairs = pairs(&body, &balls, &mut notes);
    let root = |v: &Vector3<f64>| (palm_from_root * Point3::from(*v)).coords;
    let parts = by_link.iter().zip(balls).enumerate().map(|(link, (points, balls))| {
        let here = |v: &Vector3<f64>| if link == 0 { root(v) } else { *v };
        let balls = balls.into_iter().map(|ball| Ball { center: here(&ball.center), ..ball }).collect();
        (points.iter().map(|at| here(&at.point)).collect(), balls)
    });
    for candidate in candidates.iter_mut().filter(|candidate| candidate.link == 0) {
        candidate.point = root(&candidate.point);
        candidate.normal = palm_from_root * candidate.normal;
    }
    let surface = HandSurface::of_points(parts.collect(), candidates, pairs);
    let mut tree = hand.tree.clone();
    for joint in tree.joints.iter_mut().filter(|joint| joint.parent.is_none()) {
        joint.origin = palm_from_root * joint.origin;
    }
    Ok(Described { hand, body, tree, palm_from_root, mechanism, surface, notes })
}

fn check(hand: &AnyHand, notes: &mut Vec<String>) -> Result<()> {
    if hand.pulls.is_empty() {
        bail!("actuator: found none, expected at least one that pulls a joint");
    }
    for (name, angle) in &hand.held {
        notes.push(format!("{name}: no actuator pulls it, it is held at {angle:.3} rad"));
    }
    for (index, joint) in hand.tree.joints.iter().enumerate() {
        let pulled = hand.pulls.iter().any(|pull| pull.arms.iter().any(|(joint, _)| *joint == index));
        let follows = hand.followers.iter().find(|follower| follower.joint == index);
        match (pulled, follows) {
            (true, _) => {}
            (false, Some(follower)) => {
                let leader = &hand.tree.joints[follower.leader].name;
                let offset = match follower.offset {
                    0.0 => String::new(),
                    offset => format!(" plus {offset} rad"),
                };
                notes.push(format!("{}: follows {leader} times {}{offset}", joint.name, follower.multiplier));
                continue;
            }
            // The hand's reader holds what nothing pulls.
            (false, None) => continue,
        }
        if !(joint.lower.is_finite() && joint.upper.is_finite()) {
            bail!("joint[{}].limit: found none, expected finite limits of a joint that is pulled", joint.name);
        }
    }
    Ok(())
}

/// Joint angles from open to closed.
fn closing_motion(hand: &AnyHand, mechanism: &Mechanism) -> Vec<Vec<f64>> {
    let open = hand.rest();
    (0..=STEPS)
        .map(|step| {
            let mut joints = open.clone();
            for (line, own) in mechanism.lines.iter().enumerate() {
                // As far as its joints go on average.
                let far: f64 = own
                    .joints
                    .iter()
                    .zip(&own.share)
                    .map(|(joint, share)| {
                        let (lower, upper) = mechanism.limits[*joint];
                        (if *share > 0.0 { upper } else { -lower }).max(0.0)
                    })
                    .sum::<f64>()
                    / own.joints.len() as f64;
                let start = mechanism.amount(line, &open);
                mechanism.set_amount(line, start + (far - start) * step as f64 / STEPS as f64, &mut joints);
            }
            joints
        })
        .collect()
}

/// The pose of a link at joint angles, root frame.
fn pose(hand: &AnyHand, joints: &[f64], link: usize) -> Isometry3<f64> {
    if link == 0 { Isometry3::identity() } else { hand.tree.forward(joints)[link - 1] }
}

/// Where the fingers close: the mean of the last links' middles in the middle of the motion, root frame.
fn closing_point(
    hand: &AnyHand,
    mechanism: &Mechanism,
    closing_motion: &[Vec<f64>],
    by_link: &[Vec<SurfacePoint>],
) -> Result<Point3<f64>> {
    let moved: Vec<usize> = mechanism.lines.iter().flat_map(|line| line.joints.iter().copied()).collect();
    let last = |joint: &usize| !hand.tree.joints.iter().any(|other| other.parent == Some(*joint));
    let tips: Vec<usize> = moved.iter().filter(|joint| last(joint)).map(|joint| joint + 1).collect();
    let half = &closing_motion[STEPS / 2];
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

/// The palm frame: its pivot on the place, its -z away from the root's nearest surface.
fn palm_frame(shapes: &LinkShapes, place: &Point3<f64>, notes: &mut Vec<String>) -> Result<Isometry3<f64>> {
    let nearest = shapes[0]
        .iter()
        .map(|(pose, shape)| {
            let (distance, outward) = shape.signed_distance(&pose.inverse_transform_point(place));
            (distance, pose * outward)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (distance, facing) = match nearest {
        Some((distance, facing)) if distance > 0.0 => (distance, facing),
        _ => {
            let facing =
                place.coords.try_normalize(1e-6).context("root: found no shape and no direction to the fingers")?;
            notes.push(
                "WARNING root: no collision shape behind the fingers, they are taken to face away from its origin"
                    .into(),
            );
            (place.coords.norm(), facing)
        }
    };
    notes.push(format!(
        "the fingers close on [{:.3}, {:.3}, {:.3}] m, {:.0} mm before the root, facing [{:.2}, {:.2}, {:.2}]",
        place.x,
        place.y,
        place.z,
        1e3 * distance,
        facing.x,
        facing.y,
        facing.z
    ));
    let turn = UnitQuaternion::rotation_between(&facing, &-Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    Ok(Isometry3::from_parts(Translation3::from(PIVOT - turn * place.coords), turn))
}

/// A warning if closing takes the last links away from the palm: where the palm's facing was found from another part of the root,
/// or the arms' signs open the hand.
fn facing_warning(
    hand: &AnyHand,
    mechanism: &Mechanism,
    closing_motion: &[Vec<f64>],
    palm_from_root: &Isometry3<f64>,
) -> Option<String> {
    let moved = mechanism.lines.iter().flat_map(|line| line.joints.iter().copied());
    let tips: Vec<usize> =
        moved.filter(|joint| !hand.tree.joints.iter().any(|other| other.parent == Some(*joint))).collect();
    let (before, after) = (&closing_motion[STEPS / 2], &closing_motion[STEPS]);
    let way: Vector3<f64> = tips
        .iter()
        .map(|tip| {
            let ball = Point3::from(hand.masses[*tip].com);
            pose(hand, after, tip + 1) * ball - pose(hand, before, tip + 1) * ball
        })
        .sum();
    let away = -(palm_from_root * way).z / tips.len() as f64;
    (away > LEAST_MOTION).then(|| {
        format!(
            "WARNING palm: the closing fingertips go {:.0} mm the way it faces; is its facing wrong, or an arm's sign?",
            1e3 * away
        )
    })
}

/// Whether the closing hand moves a point the way it faces; for the palm, whether it faces where the fingers close.
fn may_touch(hand: &AnyHand, closing_motion: &[Vec<f64>], place: &Point3<f64>, link: usize, at: &SurfacePoint) -> bool {
    if link == 0 {
        let way = place.coords - at.point;
        return at.normal.dot(&way) > FACES_CLOSING_POINT * way.norm();
    }
    let half = STEPS / 2;
    let (before, after) = (pose(hand, &closing_motion[half - 1], link), pose(hand, &closing_motion[half + 1], link));
    let point = Point3::from(at.point);
    let motion = after * point - before * point;
    let normal = pose(hand, &closing_motion[half], link) * at.normal;
    motion.norm() > LEAST_MOTION && normal.dot(&motion) > FACES_MOTION * motion.norm()
}

/// Pairs of links whose balls the sampler keeps apart: not joined, and not overlapping already at rest, as published boxes often
/// do. The balls lie inside the shapes: what collides in physics is among these pairs.
fn pairs(body: &AnyBody, balls: &[Vec<Ball>], notes: &mut Vec<String>) -> Vec<(usize, usize)> {
    let hand = &**body.hand();
    let open = hand.rest();
    let placed: Vec<Vec<Ball>> = balls
        .iter()
        .enumerate()
        .map(|(link, own)| {
            let pose = pose(hand, &open, link);
            own.iter().map(|ball| Ball { center: (pose * Point3::from(ball.center)).coords, ..*ball }).collect()
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
    let number = |link: Option<usize>| link.map_or(0, |link| link + 1);
    let overlap = body.passing().iter().map(|(a, b)| format!("{}+{}", name(hand, number(*a)), name(hand, number(*b))));
    let overlap: Vec<String> = overlap.collect();
    if !overlap.is_empty() {
        notes.push(format!("WARNING pass through each other, because they overlap at rest: {}", overlap.join(", ")));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two jaws on a base, one pulled and one following the other way.
    fn clamp(arms: &str) -> Result<Described> {
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
            "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n[[actuator]]\nname = \"close\"\narms = {arms}\n"
        );
        describe(AnyHand::parse(&urdf, Path::new("clamp.urdf"), &pulls, Path::new("clamp.toml"))?)
    }

    /// Candidates are found on the inner faces of the jaws and on the base between them, and nowhere else.
    #[test]
    fn inner_faces_are_candidates() {
        let clamp = clamp("{ a = -0.01 }").expect("described");
        let root_from_palm = clamp.palm_from_root.inverse();
        for candidate in &clamp.surface.candidates {
            match candidate.link {
                0 => assert!((root_from_palm * candidate.normal).x > 0.9, "the base's front"),
                1 => assert!(candidate.normal.y < -0.9, "{:?}", candidate),
                _ => assert!(candidate.normal.y > 0.9, "{:?}", candidate),
            }
        }
        for link in 0..3 {
            assert!(clamp.surface.candidates.iter().filter(|c| c.link == link).count() > 10, "link {link}");
        }
        // The jaws close before the base, which lies behind them along +z.
        let place = clamp.palm_from_root * Point3::new(0.06, 0.0, 0.0);
        assert!((place.coords - PIVOT).norm() < 0.02, "{place}");
        assert!(clamp.notes.iter().any(|line| line.contains("b: follows a times -1")), "{:?}", clamp.notes);
    }

    /// A hand whose arms open it is refused with the reason; one that nothing pulls is too.
    #[test]
    fn hands_that_cannot_close_are_refused() {
        let error = clamp("{ }").err().map(|error| format!("{error:#}")).unwrap_or_default();
        assert!(error.contains("fingertips") || error.contains("actuator"), "{error}");
    }
}
