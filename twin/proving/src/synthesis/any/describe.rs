//! What sampling has to know of a hand, found from its URDF and pulls alone, and said aloud.
//!
//! Surface points lie on the collision shapes. Where the hand may touch is found by moving it: a point of a moving link is a
//! contact candidate if the closing hand moves it the way it faces; a point of the palm is one if it faces the place on which
//! the fingers close. That place is also the pivot of the sampler's turns, seen from a frame laid out like our hand's palm: the
//! object comes along -z.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use grasping::synthesis::frames::PIVOT;
use grasping::synthesis::mechanism::{Mechanism, rest};
use grasping::synthesis::surface::{Ball, Candidate, HandSurface};
use hand_model::any_hand::{AnyHand, SolidShape};
use hand_model::kinematics::Tree;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scenarios::geometry::{Shape, hull_mesh};

/// Points on the whole hand.
const POINTS: usize = 2000;
/// Candidates at most.
const MOST_CANDIDATES: usize = 700;
/// Cosine between a point's motion and its normal from which on it is a candidate.
const FACES_MOTION: f64 = 0.5;
/// Cosine between a palm point's normal and the way to the place on which the fingers close.
const FACES_PLACE: f64 = 0.7;
/// How far a point has to move in the middle quarter of the closing motion, m: not one beside its own hinge.
const LEAST_MOTION: f64 = 2e-3;
/// Steps of the closing motion that are looked at.
const STEPS: usize = 8;

/// A hand made ready for sampling. The tree, the surface and all candidates are in the palm frame.
pub struct Described {
    /// As read.
    pub hand: Arc<AnyHand>,
    /// Its tree with the palm frame as root.
    pub tree: Tree,
    /// `palm_from_root`.
    pub palm_from_root: Isometry3<f64>,
    /// Limits and actuator lines.
    pub mechanism: Mechanism,
    /// Points, candidates, pairs.
    pub surface: HandSurface,
    /// What was found, in words; warnings begin with `WARNING`.
    pub story: Vec<String>,
}

/// A point of the surface with its normal, link frame (the root's for the palm).
struct Skin {
    point: Vector3<f64>,
    normal: Vector3<f64>,
}

/// Reads and describes a hand.
pub fn read(urdf: &Path, pulls: &Path) -> Result<Described> {
    let hand = AnyHand::read(urdf, pulls)?;
    describe(hand).with_context(|| urdf.display().to_string())
}

fn describe(hand: AnyHand) -> Result<Described> {
    let mut story = Vec::new();
    check(&hand, &mut story)?;
    let mechanism = Mechanism::of_any(&hand);
    let shapes = shapes(&hand)?;
    let skins = skins(&hand, &shapes);
    let links = skins.len();
    for (link, skin) in skins.iter().enumerate() {
        if skin.is_empty() {
            story.push(format!(
                "WARNING {}: no collision shape, it can neither touch nor be kept clear",
                name(&hand, link)
            ));
        }
    }
    let swing = swing(&hand, &mechanism);
    let place = place(&hand, &mechanism, &swing, &skins)?;
    let palm_from_root = palm_frame(&shapes, &place, &mut story)?;
    let mut candidates: Vec<Candidate> = Vec::new();
    for (link, skin) in skins.iter().enumerate() {
        let faces: Vec<&Skin> = skin.iter().filter(|skin| may_touch(&hand, &swing, &place, link, skin)).collect();
        candidates.extend(faces.iter().map(|skin| Candidate {
            link,
            pad: link,
            point: skin.point,
            normal: skin.normal,
        }));
        story.push(format!("{:32} {:5} points, {:4} candidates", name(&hand, link), skin.len(), faces.len()));
    }
    if !candidates.iter().any(|candidate| candidate.link > 0) {
        bail!(
            "contacts: found no point of a moving link that faces its closing motion, expected some: do the arms' signs close the hand?"
        );
    }
    let every = candidates.len().div_ceil(MOST_CANDIDATES);
    candidates = candidates.into_iter().step_by(every.max(1)).collect();
    let balls: Vec<Vec<Ball>> = (0..links).map(|link| fill(&hand, &shapes, link)).collect();
    let pairs = pairs(&hand, &balls, &mut story);
    let root = |v: &Vector3<f64>| (palm_from_root * Point3::from(*v)).coords;
    let parts = skins.iter().zip(balls).enumerate().map(|(link, (skin, balls))| {
        let here = |v: &Vector3<f64>| if link == 0 { root(v) } else { *v };
        let balls = balls.into_iter().map(|ball| Ball { center: here(&ball.center), ..ball }).collect();
        (skin.iter().map(|skin| here(&skin.point)).collect(), balls)
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
    Ok(Described { hand: Arc::new(hand), tree, palm_from_root, mechanism, surface, story })
}

fn name(hand: &AnyHand, link: usize) -> String {
    link.checked_sub(1).map_or("root".into(), |joint| hand.tree.joints[joint].name.clone())
}

fn check(hand: &AnyHand, story: &mut Vec<String>) -> Result<()> {
    if hand.pulls.is_empty() {
        bail!("actuator: found none, expected at least one that pulls a joint");
    }
    for (index, joint) in hand.tree.joints.iter().enumerate() {
        let pulled = hand.pulls.iter().any(|pull| pull.arms.iter().any(|(joint, _)| *joint == index));
        let follows = hand.followers.iter().find(|follower| follower.joint == index);
        match (pulled, follows) {
            (true, _) => {}
            (false, Some(follower)) => {
                let leader = &hand.tree.joints[follower.leader].name;
                story.push(format!("{}: follows {leader} times {}", joint.name, follower.multiplier));
                if follower.offset != 0.0 {
                    story.push(format!("WARNING {}: offset {} rad is not sampled", joint.name, follower.offset));
                }
                continue;
            }
            (false, None) => {
                story.push(format!("WARNING {}: no actuator pulls it, it stays at rest", joint.name));
                continue;
            }
        }
        if !(joint.lower.is_finite() && joint.upper.is_finite()) {
            bail!("joint[{}].limit: found none, expected finite limits of a joint that is pulled", joint.name);
        }
    }
    Ok(())
}

/// Shapes by link (0 is the root), with their pose in the link's frame.
type LinkShapes = Vec<Vec<(Isometry3<f64>, Shape)>>;

fn shapes(hand: &AnyHand) -> Result<LinkShapes> {
    let mut found: LinkShapes = vec![Vec::new(); hand.tree.len() + 1];
    for solid in &hand.solids {
        let link = solid.link.map_or(0, |link| link + 1);
        let shape = match &solid.shape {
            SolidShape::Cuboid(half) => Shape::Cuboid { half: *half, radius: 0.0 },
            SolidShape::Sphere(radius) => Shape::Sphere { radius: *radius },
            SolidShape::Cylinder(radius, half) => Shape::Cylinder { radius: *radius, half_height: *half },
            SolidShape::Hull(points) => {
                let mesh = hull_mesh(points).with_context(|| format!("the collision hull of {}", name(hand, link)))?;
                Shape::Mesh(Arc::new(mesh))
            }
        };
        found[link].push((solid.link_from_solid, shape));
    }
    Ok(found)
}

fn surface_area(shape: &Shape) -> f64 {
    let (points, triangles, _) = shape.triangles();
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|index| points[index as usize]);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    triangles.iter().map(area).sum()
}

/// Points spread evenly over all links, those inside another shape of the same link left out.
fn skins(hand: &AnyHand, shapes: &LinkShapes) -> Vec<Vec<Skin>> {
    let total: f64 = shapes.iter().flatten().map(|(_, shape)| surface_area(shape)).sum();
    let on_link = |parts: &Vec<(Isometry3<f64>, Shape)>| {
        let mut skin = Vec::new();
        for (n, (pose, shape)) in parts.iter().enumerate() {
            let count = (POINTS as f64 * surface_area(shape) / total).ceil() as usize;
            for point in shape.surface_samples(count) {
                let (_, normal) = shape.signed_distance(&point);
                let at = pose * point;
                let buried = parts.iter().enumerate().any(|(other, (pose, shape))| {
                    other != n && shape.signed_distance(&pose.inverse_transform_point(&at)).0 < -1e-4
                });
                if !buried {
                    skin.push(Skin { point: at.coords, normal: pose * normal });
                }
            }
        }
        skin
    };
    debug_assert_eq!(shapes.len(), hand.tree.len() + 1);
    shapes.iter().map(on_link).collect()
}

/// Joint angles from open to closed.
fn swing(hand: &AnyHand, mechanism: &Mechanism) -> Vec<Vec<f64>> {
    let open = rest(hand);
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
fn place(hand: &AnyHand, mechanism: &Mechanism, swing: &[Vec<f64>], skins: &[Vec<Skin>]) -> Result<Point3<f64>> {
    let moved: Vec<usize> = mechanism.lines.iter().flat_map(|line| line.joints.iter().copied()).collect();
    let last = |joint: &usize| !hand.tree.joints.iter().any(|other| other.parent == Some(*joint));
    let tips: Vec<usize> = moved.iter().filter(|joint| last(joint)).map(|joint| joint + 1).collect();
    let half = &swing[STEPS / 2];
    let middles: Vec<Vector3<f64>> = tips
        .iter()
        .filter(|link| !skins[**link].is_empty())
        .map(|link| {
            let mean = skins[*link].iter().map(|skin| skin.point).sum::<Vector3<f64>>() / skins[*link].len() as f64;
            (pose(hand, half, *link) * Point3::from(mean)).coords
        })
        .collect();
    if middles.is_empty() {
        bail!("fingertips: found no last link that moves and has a collision shape, expected at least one");
    }
    Ok(Point3::from(middles.iter().sum::<Vector3<f64>>() / middles.len() as f64))
}

/// The palm frame: its pivot on the place, its -z away from the root's nearest surface.
fn palm_frame(shapes: &LinkShapes, place: &Point3<f64>, story: &mut Vec<String>) -> Result<Isometry3<f64>> {
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
            story.push(
                "WARNING root: no collision shape behind the fingers, they are taken to face away from its origin"
                    .into(),
            );
            (place.coords.norm(), facing)
        }
    };
    story.push(format!(
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

/// Whether the closing hand moves a point the way it faces; for the palm, whether it faces where the fingers close.
fn may_touch(hand: &AnyHand, swing: &[Vec<f64>], place: &Point3<f64>, link: usize, skin: &Skin) -> bool {
    if link == 0 {
        let way = place.coords - skin.point;
        return skin.normal.dot(&way) > FACES_PLACE * way.norm();
    }
    let half = STEPS / 2;
    let (before, after) = (pose(hand, &swing[half - 1], link), pose(hand, &swing[half + 1], link));
    let point = Point3::from(skin.point);
    let motion = after * point - before * point;
    let normal = pose(hand, &swing[half], link) * skin.normal;
    motion.norm() > LEAST_MOTION && normal.dot(&motion) > FACES_MOTION * motion.norm()
}

/// Balls inside a link's shapes: grid points that are nearly as deep as any.
fn fill(hand: &AnyHand, shapes: &LinkShapes, link: usize) -> Vec<Ball> {
    debug_assert!(link <= hand.tree.len());
    let mut balls = Vec::new();
    for (pose, shape) in &shapes[link] {
        let (low, high) = shape.aabb();
        let step = 0.5 * (high - low).min();
        let depth = |p: &Point3<f64>| -shape.signed_distance(p).0;
        let count = |axis: usize| ((high[axis] - low[axis]) / step).floor() as usize;
        let mut inside: Vec<(Point3<f64>, f64)> = Vec::new();
        for (i, j, k) in
            (0..=count(0)).flat_map(|i| (0..=count(1)).flat_map(move |j| (0..=count(2)).map(move |k| (i, j, k))))
        {
            let at = low + Vector3::new(i as f64, j as f64, k as f64) * step;
            inside.push((at, depth(&at)));
        }
        let deepest = inside.iter().map(|(_, depth)| *depth).fold(0.0, f64::max);
        let deep = inside.into_iter().filter(|(_, depth)| *depth > 0.6 * deepest && *depth > 0.0);
        balls.extend(deep.map(|(at, radius)| Ball { center: (pose * at).coords, radius }));
    }
    balls
}

/// Pairs of links that are kept apart: not joined, and not overlapping already at rest, as published boxes often do.
fn pairs(hand: &AnyHand, balls: &[Vec<Ball>], story: &mut Vec<String>) -> Vec<(usize, usize)> {
    let open = rest(hand);
    let placed: Vec<Vec<Ball>> = balls
        .iter()
        .enumerate()
        .map(|(link, own)| {
            let pose = pose(hand, &open, link);
            own.iter().map(|ball| Ball { center: (pose * Point3::from(ball.center)).coords, ..*ball }).collect()
        })
        .collect();
    let parent = |link: usize| hand.tree.joints[link - 1].parent.map_or(0, |joint| joint + 1);
    let (mut kept, mut overlap) = (Vec::new(), Vec::new());
    for b in 1..placed.len() {
        for a in (0..b).filter(|a| *a != parent(b)) {
            let meet =
                placed[a].iter().any(|x| placed[b].iter().any(|y| (x.center - y.center).norm() < x.radius + y.radius));
            if meet {
                overlap.push(format!("{}+{}", name(hand, a), name(hand, b)));
            } else {
                kept.push((a, b));
            }
        }
    }
    if !overlap.is_empty() {
        story.push(format!("WARNING not kept apart, because they overlap at rest: {}", overlap.join(", ")));
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
        assert!(clamp.story.iter().any(|line| line.contains("b: follows a times -1")), "{:?}", clamp.story);
    }

    /// A hand whose arms open it is refused with the reason; one that nothing pulls is too.
    #[test]
    fn hands_that_cannot_close_are_refused() {
        let error = clamp("{ }").err().map(|error| format!("{error:#}")).unwrap_or_default();
        assert!(error.contains("fingertips") || error.contains("actuator"), "{error}");
    }
}
