//! The ten points of the Kapandji test on the model's covers, and the distance of the thumb's tip from them.
//!
//! Distances of creases from their joints were measured on 53 hands by Bugbee and Botte (Clin Orthop 296, 1993): the
//! distal digital crease lies 7 to 8 mm and the middle one 2 to 3 mm on the wrist's side of their joints, the proximal
//! one 14 to 20 mm on the fingertip's side of the MCP joint (the model's ends with the palm's cover, at 14.5 mm), the
//! distal palmar crease 6.8 to 10.3 mm on the wrist's side of the MCP joints, from the ulnar edge to the middle finger.

use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};

/// Tolerance on the overlap of covers, m: the engine's contacts yield a little.
pub const OVERLAP_TOLERANCE: f64 = 5e-4;
/// Distances of creases from their joints, m, centres of the measured ranges: DIP, PIP, distal palmar crease from the
/// MCP joints.
const DIP_CREASE: f64 = 0.0075;
const PIP_CREASE: f64 = 0.0025;
const PALMAR_CREASE: f64 = 0.0085;
/// Number of points of a crease that runs across the palm.
const CREASE_POINT_COUNT: usize = 24;

/// One of the ten target points.
pub struct KapandjiTarget {
    pub name: &'static str,
    /// Link that carries it; `None` is the palm.
    pub link: Option<usize>,
    /// Points in the link's frame, m. A crease across the palm has many, any of which counts.
    pub points: Vec<Point3<f64>>,
}

/// Returns the ten points, in the order of the test.
pub fn targets(hand: &Hand) -> Vec<KapandjiTarget> {
    let side = |link: usize| {
        // Radial is the thumb's side: minus z of a finger's link.
        let cover = &hand.covers[link];
        cover.link_from_cover * Point3::new(0.0, 0.0, -cover.half.z)
    };
    // On the rounded edge between pad and end, half way around.
    let tip = |link: usize| {
        let cover = &hand.covers[link];
        let inner = cover.half.add_scalar(-cover.radius);
        let edge = Vector3::new(1.0, 1.0, 0.0).normalize() * cover.radius;
        cover.link_from_cover * Point3::from(Vector3::new(inner.x, inner.y, 0.0) + edge)
    };
    let palmar = |link: usize| hand.covers[link].link_from_cover.translation.y + hand.covers[link].half.y;
    let [i1, i2] = [Digit::Index.ftac_joints()[1], Digit::Index.ftac_joints()[2]];
    let [l0, l1, l2] = Digit::Little.ftac_joints();
    let mcp = |digit: Digit| hand.tree.joints[digit.ftac_joints()[0]].origin.translation.vector;
    let palm = &hand.palm_cover;
    let (skin, end) =
        (palm.link_from_cover.translation.z - palm.half.z, palm.link_from_cover.translation.y + palm.half.y);
    let on = |name: &'static str, link: usize, point: Point3<f64>| KapandjiTarget {
        name,
        link: Some(link),
        points: vec![point],
    };
    let [dip, pip] = [l2, l1].map(|link| hand.tree.joints[link].origin.translation.x);
    // Across the palm through the MCP joints of little, ring and middle finger, starting at the ulnar edge of the flat
    // part.
    let knuckles = [Digit::Little, Digit::Ring, Digit::Middle].map(mcp);
    let edge = palm.link_from_cover.translation.x - palm.half.x + palm.radius;
    let palmar_crease = (0..CREASE_POINT_COUNT)
        .map(|n| {
            let x = edge + (knuckles[2].x - edge) * n as f64 / (CREASE_POINT_COUNT - 1) as f64;
            let [a, b] = if x < knuckles[1].x { [knuckles[0], knuckles[1]] } else { [knuckles[1], knuckles[2]] };
            let y = a.y + (b.y - a.y) * ((x - a.x) / (b.x - a.x)).max(0.0);
            Point3::new(x, y - PALMAR_CREASE, skin)
        })
        .collect();
    vec![
        on("side of index, second phalanx", i1, side(i1)),
        on("side of index, third phalanx", i2, side(i2)),
        on("tip of index", i2, tip(i2)),
        on("tip of middle", Digit::Middle.ftac_joints()[2], tip(Digit::Middle.ftac_joints()[2])),
        on("tip of ring", Digit::Ring.ftac_joints()[2], tip(Digit::Ring.ftac_joints()[2])),
        on("tip of little", l2, tip(l2)),
        on("DIP crease of little", l1, Point3::new(dip - DIP_CREASE, palmar(l1), 0.0)),
        on("PIP crease of little", l0, Point3::new(pip - PIP_CREASE, 0.5 * (palmar(l0) + palmar(l1)), 0.0)),
        on("proximal crease of little", l0, Point3::new(end - mcp(Digit::Little).y, palmar(l0), 0.0)),
        KapandjiTarget { name: "distal palmar crease", link: None, points: palmar_crease },
    ]
}

/// Returns the points of the thumb's tip: the distal half of its last link's skin, palmar side and end, link frame.
pub fn thumb_tip(hand: &Hand) -> Vec<Point3<f64>> {
    let cover = &hand.covers[Digit::Thumb.ftac_joints()[2]];
    let middle = cover.link_from_cover.translation.x;
    let on_pad = |n: &Vector3<f64>| n.y >= 0.25 || n.x >= 0.5;
    cover
        .skin_elements(0.001)
        .into_iter()
        .filter(|element| element.point.x >= middle && on_pad(&element.normal))
        .map(|element| element.point)
        .collect()
}

pub fn distance(target: &KapandjiTarget, tip: &[Point3<f64>], links: &[Isometry3<f64>]) -> f64 {
    nearest(target, tip, links).0
}

/// Returns the smallest distance (m) of the thumb's tip from the target, and the target's nearest point, palm frame.
pub fn nearest(target: &KapandjiTarget, tip: &[Point3<f64>], links: &[Isometry3<f64>]) -> (f64, Point3<f64>) {
    let carrier = target.link.map_or(Isometry3::identity(), |link| links[link]);
    let mut best = (f64::INFINITY, Point3::origin());
    for place in target.points.iter().map(|point| carrier * point) {
        let local = links[Digit::Thumb.ftac_joints()[2]].inverse_transform_point(&place);
        let distance = tip.iter().map(|point| (point - local).norm()).fold(f64::INFINITY, f64::min);
        if distance < best.0 {
            best = (distance, place);
        }
    }
    best
}
