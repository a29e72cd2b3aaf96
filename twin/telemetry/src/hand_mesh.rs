//! Meshes of the hand, made from its parameters: covers, knuckles, pads with their gel, camera boards, servo pack and
//! cables.

use std::f64::consts::FRAC_PI_2;

use hand_model::hand::CoverShape;
use hand_model::transmission::{Crossing, Lever};
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};

use crate::mesh::Mesh;

/// Steps of a rounding: for a stream that should stay small, for a hand in the picture of a scene, where a step of the
/// widest rounding is off by a quarter of a pixel, and for a picture of the hand.
pub const COARSE_STEPS: u32 = 2;
pub const SCENE_STEPS: u32 = 3;
pub const FINE_STEPS: u32 = 7;
/// Points of a pad's sheet along each side.
pub const PAD_POINTS: u32 = 15;
/// Offset of a pad's drawn gel above the sensing surface, m. It must hide the cover below.
const PAD_OFFSET: f64 = 5.0e-4;
/// Radius of a knuckle as a share of the half thickness of its cover.
const KNUCKLE_RADIUS_RATIO: f64 = 0.62;
/// Camera board: half thickness, m; half size as a share of its pad; its limit as a share of the cover's width.
const CAMERA_BOARD_SIZE: (f64, f64, f64) = (6.0e-4, 0.24, 0.30);
/// Distance between the cables and the sides of the covers, m.
const CABLE_OFFSET: f64 = 4.0e-4;

/// Component that a part belongs to; it decides the colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// Shell of the palm.
    Palm,
    /// Shell of a phalanx.
    Cover,
    /// Joint between two phalanges.
    Knuckle,
    /// Circuit board of a camera.
    Board,
    /// Servos between flange and palm.
    ServoPack,
}

/// A rigid part that moves with one link.
#[derive(Debug, Clone)]
pub struct RigidPart {
    /// Link that carries the part; `None` is the palm.
    pub link: Option<usize>,
    pub material: Material,
    /// Mesh in the link's frame.
    pub mesh: Mesh,
}

/// Returns every rigid part except the pads. Roundings take `steps` steps.
pub fn parts(hand: &Hand, steps: u32) -> Vec<RigidPart> {
    let cover = |shape: &CoverShape| Mesh::smooth_box(&shape.half, shape.radius, &shape.link_from_cover, steps);
    let pack = Isometry3::from(Vector3::from(hand.parameters.palm.servo_pack_com));
    let pack = Mesh::smooth_box(&Vector3::new(0.036, 0.018, 0.028), 0.008, &pack, steps);
    let mut parts = vec![
        RigidPart { link: None, material: Material::Palm, mesh: cover(&hand.palm_cover) },
        RigidPart { link: None, material: Material::ServoPack, mesh: pack },
    ];
    for (link, shape) in hand.covers.iter().enumerate() {
        parts.push(RigidPart { link: Some(link), material: Material::Cover, mesh: cover(shape) });
        // The cover of the thumb's first link lies beside its axis.
        if link != hand.links(Digit::Thumb)[0] {
            parts.push(RigidPart { link: Some(link), material: Material::Knuckle, mesh: knuckle(shape, steps) });
        }
    }
    for pad in &hand.pads {
        let shape = pad.link.map_or(&hand.palm_cover, |link| &hand.covers[link]);
        parts.push(RigidPart { link: pad.link, material: Material::Board, mesh: board(pad, shape, steps) });
    }
    parts
}

/// Returns the pin of a link's joint with its bearings.
fn knuckle(shape: &CoverShape, steps: u32) -> Mesh {
    let reach = 0.5 * shape.half.z;
    let ends = [-reach, reach].map(|z| Point3::new(0.0, 0.0, z));
    Mesh::smooth_capsule(ends, KNUCKLE_RADIUS_RATIO * shape.half.y, (4 * steps + 4, steps + 1))
}

/// Returns the board of a pad's cameras, on the back of the cover that carries the pad.
fn board(pad: &hand_model::pads::Pad, shape: &CoverShape, steps: u32) -> Mesh {
    let (thickness, share, width) = CAMERA_BOARD_SIZE;
    let cover_from_pad = shape.link_from_cover.inverse() * pad.link_from_pad;
    // Extents of the cover along the pad's axes.
    let along = |axis: Vector3<f64>| (cover_from_pad * axis).abs().dot(&shape.half);
    let center = cover_from_pad.inverse() * Point3::origin();
    let back = center.z - along(Vector3::z()) - 0.5 * thickness;
    let half = Vector3::new(
        (share * pad.w).min(width * 2.0 * along(Vector3::x())),
        (share * pad.h).min(width * 2.0 * along(Vector3::y())),
        thickness,
    );
    Mesh::smooth_box(&half, 0.5 * thickness, &(pad.link_from_pad * Isometry3::translation(0.0, 0.0, back)), steps)
}

/// Returns the coordinates (m) of a pad sheet's points along an axis of length `size` (m), denser over the edges
/// rounded by `radius` (m).
pub fn pad_points(size: f64, radius: f64) -> [f64; PAD_POINTS as usize] {
    const EDGE_POINTS: usize = 3;
    let flat = 0.5 * size - radius;
    std::array::from_fn(|n| {
        let inner = PAD_POINTS as usize - 2 * EDGE_POINTS - 1;
        let turn = |k: usize| flat + radius * (FRAC_PI_2 * k as f64 / EDGE_POINTS as f64).sin();
        match n {
            n if n < EDGE_POINTS => -turn(EDGE_POINTS - n),
            n if n > EDGE_POINTS + inner => turn(n - EDGE_POINTS - inner),
            n => flat * (2.0 * (n - EDGE_POINTS) as f64 / inner as f64 - 1.0),
        }
    })
}

/// Returns the sheet of a pad's gel, pad frame: [`PAD_POINTS`] squared, rows from small to large y. Corners are cut off
/// along the rounding.
pub fn pad_sheet(pad: &hand_model::pads::Pad) -> Mesh {
    let r = pad.edge_radius;
    let beyond = |x: f64, size: f64| (x.abs() - (0.5 * size - r)).max(0.0);
    let (columns, rows) = (pad_points(pad.w, r), pad_points(pad.h, r));
    let inside = |x: f64, y: f64| {
        let (ex, ey) = (beyond(x, pad.w), beyond(y, pad.h));
        let share = (r / ex.hypot(ey)).min(1.0);
        (x - x.signum() * ex * (1.0 - share), y - y.signum() * ey * (1.0 - share))
    };
    Mesh::surface(&columns, &rows, |x, y| {
        let (x, y) = inside(x, y);
        let (ex, ey) = (beyond(x, pad.w) * x.signum(), beyond(y, pad.h) * y.signum());
        let normal = Vector3::new(ex, ey, (r * r - ex * ex - ey * ey).max(0.0).sqrt().max(0.05 * r)).normalize();
        (Vector3::new(x, y, pad.surface_height(x, y)) + normal * PAD_OFFSET, normal)
    })
}

/// Returns both runs of each cable beside its digit, palm frame, m: from guide to guide, with the link poses `links`
/// ([`hand_model::kinematics::Tree::forward`]). The thumb comes first; each digit has two runs.
pub fn cables(hand: &Hand, links: &[Isometry3<f64>]) -> Vec<Vec<Point3<f64>>> {
    let joints = &hand.tree.joints;
    let parent = |joint: usize| joints[joint].parent.map_or_else(Isometry3::identity, |parent| links[parent]);
    let mut runs = Vec::new();
    for cable in &hand.transmission.cables {
        for side in [-1.0, 1.0] {
            let mut run = Vec::new();
            for Crossing { joint, lever, .. } in &cable.joints {
                let Lever::Guides(guides) = lever else { continue };
                let z = side * (hand.covers[*joint].half.z + CABLE_OFFSET);
                let at = |[x, y]: [f64; 2]| Point3::new(x, y, z);
                run.push(parent(*joint) * joints[*joint].origin * at(guides.before));
                run.push(links[*joint] * at(guides.after));
            }
            runs.push(run);
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The drawn length of a cable agrees with the transmission: spans shorten by the excursion.
    #[test]
    fn drawn_cables_are_as_long_as_the_transmission_says() {
        let hand = Hand::ftac();
        let drawn = |angle: f64| {
            let q = vec![angle; hand.tree.len()];
            let runs = cables(&hand, &hand.tree.forward(&q));
            let span = |run: &Vec<Point3<f64>>| run.chunks(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>();
            (runs.iter().map(span).collect::<Vec<_>>(), q)
        };
        let ((straight, _), (bent, q)) = (drawn(0.0), drawn(0.8));
        for (n, (straight, bent)) in straight.iter().zip(&bent).enumerate() {
            let excursion = hand.transmission.cables[n / 2].excursion(&q);
            assert!((straight - bent - excursion).abs() < 1e-9, "run {n}: {straight} {bent} {excursion}");
        }
    }

    /// A board lies behind its pad, outside the cover, at most its own thickness away.
    #[test]
    fn boards_lie_on_the_back_of_their_covers() {
        let hand = Hand::ftac();
        let boards: Vec<RigidPart> =
            parts(&hand, COARSE_STEPS).into_iter().filter(|part| part.material == Material::Board).collect();
        assert_eq!(boards.len(), hand.pads.len());
        for (pad, board) in hand.pads.iter().zip(&boards) {
            let shape = pad.link.map_or(&hand.palm_cover, |link| &hand.covers[link]);
            let middle: Vector3<f64> = board.mesh.vertices.iter().map(|v| Vector3::from(*v).cast::<f64>()).sum();
            let middle = Point3::from(middle / board.mesh.vertices.len() as f64);
            let (distance, _) = shape.signed_distance(&middle);
            assert!((0.0..2e-3).contains(&distance), "{}: {distance}", pad.name);
            assert!((pad.link_from_pad.inverse() * middle).z < -5e-3, "{} is before its pad", pad.name);
        }
    }
}
