//! The hand's surface for the sampler: points on the covers (for penetration), contact candidates on the palmar pads, and
//! balls that fill the covers (for self-penetration).
//!
//! Points are grouped in *patches* of a few neighbours with a bounding ball, so that a patch far from the object costs
//! one look-up. Link 0 is the palm, link i + 1 the one that joint i moves.

use hand_model::Hand;
use hand_model::hand::CoverShape;
use hand_model::hand_mechanism::{CollisionSolid, HandMechanism, SolidShape};
use hand_model::kinematics::Tree;
use nalgebra::{Point3, Translation3, Vector3};

/// Points of a patch along each side.
const PATCH_SIDE_POINTS: usize = 3;
/// Spacing of contact candidates on a pad, m.
const CANDIDATE_SPACING: f64 = 0.003;
/// Largest distance of a contact candidate from the cover, m. A pad's rim may be farther off.
const MAX_COVER_DISTANCE: f64 = 1.0e-3;
/// Distance within which a point counts as on a surface, m.
const SURFACE_TOLERANCE: f64 = 1.0e-6;

/// A ball in the frame of its link.
#[derive(Debug, Clone, Copy)]
pub struct LinkSphere {
    /// Centre, m.
    pub center: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

/// Neighbouring points with their bounding ball.
#[derive(Debug, Clone)]
pub struct SurfacePatch {
    /// Bounding ball.
    pub bound: LinkSphere,
    /// Indices of the link's points.
    pub range: std::ops::Range<usize>,
}

/// The surface of one link, in its frame.
#[derive(Debug, Clone)]
pub struct LinkSurface {
    /// Points, patch after patch, m.
    pub points: Vec<Vector3<f64>>,
    /// Patches of neighbouring points.
    pub patches: Vec<SurfacePatch>,
    /// Bounding ball of all points.
    pub bound: LinkSphere,
    /// Balls that fill the cover.
    pub spheres: Vec<LinkSphere>,
}

/// A point where the hand may touch the object.
#[derive(Debug, Clone, Copy)]
pub struct ContactCandidate {
    /// Link: 0 is the palm.
    pub link: usize,
    /// Pad, in the hand's order. For a hand without pads, the link.
    pub pad: usize,
    /// Position in the link's frame, m.
    pub point: Vector3<f64>,
    /// Unit normal out of the hand, link frame.
    pub normal: Vector3<f64>,
}

/// The surface of the whole hand.
#[derive(Debug, Clone)]
pub struct HandSurface {
    /// Palm, then the links in joint order.
    pub links: Vec<LinkSurface>,
    /// Contact candidates on all pads.
    pub candidates: Vec<ContactCandidate>,
    /// Pairs of links that may collide: all but neighbours.
    pub pairs: Vec<(usize, usize)>,
}

impl HandSurface {
    /// Places at least `count` points (and few more) evenly on the covers of `hand`, and the candidates on its pads.
    pub fn new(hand: &Hand, count: usize) -> Self {
        let covers: Vec<CoverShape> = std::iter::once(hand.palm_cover).chain(hand.covers.iter().copied()).collect();
        let links = spread_points(&covers.iter().map(std::slice::from_ref).collect::<Vec<_>>(), count);
        Self { links, candidates: candidates(hand, &covers), pairs: separate_links(&hand.tree).collect() }
    }

    /// Places at least `count` points on the collision shapes of a hand from a URDF. Those points for which `may_touch`
    /// is true are the contact candidates; their `pad` is the link.
    ///
    /// Boxes, spheres and capsules are exact. A cylinder loses its edges, and a convex hull is replaced by its bounding
    /// box. A more precise surface is passed to [`Self::from_points`]. Links that overlap at rest may pass through each
    /// other.
    pub fn from_mechanism(
        hand: &HandMechanism,
        count: usize,
        mut may_touch: impl FnMut(&ContactCandidate) -> bool,
    ) -> Self {
        let mut covers: Vec<Vec<CoverShape>> = vec![Vec::new(); hand.tree.len() + 1];
        for solid in &hand.solids {
            covers[solid.link.map_or(0, |link| link + 1)].push(rounded_box(solid));
        }
        let links = spread_points(&covers.iter().map(Vec::as_slice).collect::<Vec<_>>(), count);
        let mut candidates = Vec::new();
        for (link, (surface, covers)) in links.iter().zip(&covers).enumerate() {
            for &point in &surface.points {
                if let Some(normal) = outward_normal(covers, &point) {
                    candidates.push(ContactCandidate { link, pad: link, point, normal });
                }
            }
        }
        candidates.retain(&mut may_touch);
        let rest = hand.tree.forward(&hand.rest_coordinates());
        let center = |link: usize, sphere: &LinkSphere| match link {
            0 => Point3::from(sphere.center),
            link => rest[link - 1] * Point3::from(sphere.center),
        };
        let overlap = |a: usize, b: usize| {
            let meet = |x: &LinkSphere, y: &LinkSphere| (center(a, x) - center(b, y)).norm() < x.radius + y.radius;
            links[a].spheres.iter().any(|x| links[b].spheres.iter().any(|y| meet(x, y)))
        };
        let pairs = separate_links(&hand.tree).filter(|&(a, b)| !overlap(a, b)).collect();
        Self { links, candidates, pairs }
    }

    /// Builds the surface from links given as points on their surface and balls that fill them (link frames, m), palm
    /// first.
    pub fn from_points(
        links: Vec<(Vec<Vector3<f64>>, Vec<LinkSphere>)>,
        candidates: Vec<ContactCandidate>,
        pairs: Vec<(usize, usize)>,
    ) -> Self {
        let links = links.into_iter().map(|(mut points, balls)| {
            let mut patches = Vec::new();
            split_into_patches(&mut points, 0, &mut patches);
            LinkSurface { bound: bounding_sphere(&points), points, patches, spheres: balls }
        });
        Self { links: links.collect(), candidates, pairs }
    }

    /// Limits the contact candidates to these links.
    pub fn touch_only(&mut self, links: &[usize]) {
        self.candidates.retain(|candidate| links.contains(&candidate.link));
    }

    /// Adds points of a held object (palm frame, m), which move with the palm.
    pub fn extend_palm(&mut self, points: &[Vector3<f64>]) {
        let (palm, mut points) = (&mut self.links[0], points.to_vec());
        split_into_patches(&mut points, palm.points.len(), &mut palm.patches);
        palm.points.append(&mut points);
        palm.bound = bounding_sphere(&palm.points);
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.links.iter().map(|link| link.points.len()).sum()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Returns the pairs of links that no joint connects. Link 0 is the root.
fn separate_links(tree: &Tree) -> impl Iterator<Item = (usize, usize)> {
    let parent = |link: usize| tree.joints[link - 1].parent.map_or(0, |joint| joint + 1);
    let links = tree.len() + 1;
    (0..links).flat_map(move |a| (a + 1..links).map(move |b| (a, b))).filter(move |&(a, b)| parent(b) != a)
}

/// Spreads at least `count` points evenly on the covers of all links.
fn spread_points(covers: &[&[CoverShape]], count: usize) -> Vec<LinkSurface> {
    let half = |c: &CoverShape| 8.0 * (c.half.x * c.half.y + c.half.y * c.half.z + c.half.z * c.half.x);
    let area: f64 = covers.iter().copied().flatten().map(half).sum();
    // Rounding to whole steps on every face may give too few points. The spacing is then reduced until there are
    // enough.
    let mut spacing = (area / count.max(1) as f64).sqrt();
    loop {
        let links: Vec<LinkSurface> = covers.iter().map(|covers| link_surface(covers, spacing)).collect();
        if area == 0.0 || links.iter().map(|link| link.points.len()).sum::<usize>() >= count {
            return links;
        }
        spacing *= 0.99;
    }
}

/// Returns the rounded box that stands for a collision shape.
fn rounded_box(solid: &CollisionSolid) -> CoverShape {
    let (middle, half) = solid.shape.extent();
    let radius = match solid.shape {
        SolidShape::Cuboid(_) | SolidShape::Hull(_) => 0.0,
        SolidShape::RoundedCuboid(_, radius) | SolidShape::Sphere(radius) | SolidShape::Capsule(radius, _) => radius,
        SolidShape::Cylinder(radius, half) => radius.min(half),
    };
    CoverShape { link_from_cover: solid.link_from_solid * Translation3::from(middle), half, radius }
}

/// Returns the outward normal at a point on the surface of one of the covers. `None` if the point is inside another.
fn outward_normal(covers: &[CoverShape], point: &Vector3<f64>) -> Option<Vector3<f64>> {
    let mut found = None;
    for cover in covers {
        let local = cover.link_from_cover.inverse_transform_point(&Point3::from(*point)).coords;
        let (surface, normal) = nearest(cover, &local);
        let height = (local - surface).dot(&normal);
        if height < -SURFACE_TOLERANCE {
            return None;
        }
        if height < SURFACE_TOLERANCE && (local - surface).norm() < SURFACE_TOLERANCE {
            found = found.or(Some(cover.link_from_cover * normal));
        }
    }
    found
}

/// Returns the nearest point of a rounded box's surface and the outward normal there, box frame.
fn nearest(cover: &CoverShape, p: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let inner = cover.half.add_scalar(-cover.radius);
    let core = p.zip_map(&inner, |x, limit| x.clamp(-limit, limit));
    let normal = match (p - core).try_normalize(1e-9) {
        Some(normal) => normal,
        None => {
            let axis = (p.abs() - inner).imax();
            Vector3::ith(axis, 1.0_f64.copysign(p[axis]))
        }
    };
    // The nearest face applies inside the core, the rounding elsewhere.
    let reach = if p == &core { (inner - p.abs()).min() } else { 0.0 };
    (core + normal * (cover.radius + reach), normal)
}

fn link_surface(covers: &[CoverShape], spacing: f64) -> LinkSurface {
    let (mut points, mut patches) = (Vec::new(), Vec::new());
    for cover in covers {
        tile(cover, spacing, &mut points, &mut patches);
    }
    let spheres = covers.iter().flat_map(fill_with_spheres).collect();
    LinkSurface { bound: bounding_sphere(&points), spheres, points, patches }
}

/// Adds points on a cover, patch after patch.
fn tile(cover: &CoverShape, spacing: f64, points: &mut Vec<Vector3<f64>>, patches: &mut Vec<SurfacePatch>) {
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let steps = |a: usize| ((2.0 * cover.half[a] / spacing).round() as usize).max(1);
        let (nu, nv) = (steps(u), steps(v));
        for side in [-1.0, 1.0] {
            for tile in 0..nu.div_ceil(PATCH_SIDE_POINTS) * nv.div_ceil(PATCH_SIDE_POINTS) {
                let (first_u, first_v) = (
                    PATCH_SIDE_POINTS * (tile % nu.div_ceil(PATCH_SIDE_POINTS)),
                    PATCH_SIDE_POINTS * (tile / nu.div_ceil(PATCH_SIDE_POINTS)),
                );
                let start = points.len();
                for i in first_u..(first_u + PATCH_SIDE_POINTS).min(nu) {
                    for j in first_v..(first_v + PATCH_SIDE_POINTS).min(nv) {
                        let mut p = Vector3::zeros();
                        p[axis] = side * cover.half[axis];
                        p[u] = ((i as f64 + 0.5) / nu as f64 * 2.0 - 1.0) * cover.half[u];
                        p[v] = ((j as f64 + 0.5) / nv as f64 * 2.0 - 1.0) * cover.half[v];
                        let (surface, _) = nearest(cover, &p);
                        points.push((cover.link_from_cover * Point3::from(surface)).coords);
                    }
                }
                patches.push(SurfacePatch { bound: bounding_sphere(&points[start..]), range: start..points.len() });
            }
        }
    }
}

/// Returns the bounding ball of points, centred on their mean. Without points it is empty.
fn bounding_sphere(points: &[Vector3<f64>]) -> LinkSphere {
    if points.is_empty() {
        return LinkSphere { center: Vector3::zeros(), radius: 0.0 };
    }
    let center = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    LinkSphere { center, radius: points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max) }
}

/// Sorts points into patches of neighbours by bisection along the longest side. `first` is the index of the first point.
fn split_into_patches(points: &mut [Vector3<f64>], first: usize, patches: &mut Vec<SurfacePatch>) {
    if points.len() <= PATCH_SIDE_POINTS * PATCH_SIDE_POINTS {
        if !points.is_empty() {
            patches.push(SurfacePatch { bound: bounding_sphere(points), range: first..first + points.len() });
        }
        return;
    }
    let (low, high) =
        points.iter().fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), p| {
            (low.inf(p), high.sup(p))
        });
    let axis = (high - low).imax();
    let half = points.len() / 2;
    points.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis]));
    let (left, right) = points.split_at_mut(half);
    split_into_patches(left, first, patches);
    split_into_patches(right, first + half, patches);
}

/// Fills a box with balls of its least half extent, at most a radius apart.
fn fill_with_spheres(cover: &CoverShape) -> Vec<LinkSphere> {
    let radius = cover.half.min();
    let room = cover.half.add_scalar(-radius);
    let steps = [0, 1, 2].map(|axis| (2.0 * room[axis] / radius).ceil() as usize + 1);
    let place = |axis: usize, n: usize| {
        if steps[axis] == 1 { 0.0 } else { room[axis] * (2.0 * n as f64 / (steps[axis] - 1) as f64 - 1.0) }
    };
    let mut balls = Vec::new();
    for i in 0..steps[0] {
        for j in 0..steps[1] {
            for k in 0..steps[2] {
                let center = Point3::new(place(0, i), place(1, j), place(2, k));
                balls.push(LinkSphere { center: (cover.link_from_cover * center).coords, radius });
            }
        }
    }
    balls
}

fn candidates(hand: &Hand, covers: &[CoverShape]) -> Vec<ContactCandidate> {
    let mut found = Vec::new();
    for (index, pad) in hand.pads.iter().enumerate() {
        let link = pad.link.map_or(0, |link| link + 1);
        let cover = &covers[link];
        let steps = |size: f64| (size / CANDIDATE_SPACING).round() as usize;
        for sample in pad.surface_samples(steps(pad.w), steps(pad.h)) {
            let local = cover.link_from_cover.inverse_transform_point(&(pad.link_from_pad * sample)).coords;
            let (surface, normal) = nearest(cover, &local);
            if (surface - local).norm() < MAX_COVER_DISTANCE {
                found.push(ContactCandidate {
                    link,
                    pad: index,
                    point: (cover.link_from_cover * Point3::from(surface)).coords,
                    normal: cover.link_from_cover * normal,
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_points_as_asked_and_every_pad_has_candidates() {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 2000);
        assert!((2000..2150).contains(&surface.len()), "{}", surface.len());
        for (index, pad) in hand.pads.iter().enumerate() {
            let own: Vec<_> = surface.candidates.iter().filter(|c| c.pad == index).collect();
            assert!(own.len() > 30, "{}: {}", pad.name, own.len());
            for candidate in own {
                let local = pad.link_from_pad.inverse_transform_point(&candidate.point.into());
                assert!(local.z.abs() < 7e-3 && local.x.abs() < 0.5 * pad.w + 1e-3, "{}: {local}", pad.name);
                assert!((candidate.normal.norm() - 1.0).abs() < 1e-9);
            }
        }
    }

    /// Points lie on the surface of the rounded boxes, and inside their patch's and link's balls.
    #[test]
    fn points_lie_on_covers() {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 2000);
        for (link, cover) in surface.links[1..].iter().zip(&hand.covers) {
            for patch in &link.patches {
                for p in &link.points[patch.range.clone()] {
                    let local = cover.link_from_cover.inverse_transform_point(&Point3::from(*p)).coords;
                    let outside = (local.abs() - cover.half.add_scalar(-cover.radius)).map(|x| x.max(0.0));
                    assert!((outside.norm() - cover.radius).abs() < 1e-9);
                    assert!((p - patch.bound.center).norm() <= patch.bound.radius + 1e-12);
                    assert!((p - link.bound.center).norm() <= link.bound.radius + 1e-12);
                }
            }
        }
    }

    /// Every point of a cloud is in exactly one patch, and inside its ball.
    #[test]
    fn clouds_are_tiled() {
        let turn = |n: usize| Vector3::new((0.7 * n as f64).sin(), (1.9 * n as f64).cos(), 0.01 * n as f64);
        let points: Vec<Vector3<f64>> = (0..100).map(turn).collect();
        let surface =
            HandSurface::from_points(vec![(points, Vec::new()), (Vec::new(), Vec::new())], Vec::new(), Vec::new());
        let link = &surface.links[0];
        let mut next = 0;
        for patch in &link.patches {
            assert_eq!(patch.range.start, next);
            next = patch.range.end;
            assert!(patch.range.len() <= PATCH_SIDE_POINTS * PATCH_SIDE_POINTS);
            let inside = |p: &Vector3<f64>| (p - patch.bound.center).norm() <= patch.bound.radius + 1e-12;
            assert!(link.points[patch.range.clone()].iter().all(inside));
        }
        assert_eq!((next, surface.len()), (100, 100));
    }

    /// The balls that fill the open hand do not overlap.
    #[test]
    fn the_open_hand_is_free() {
        let hand = Hand::ftac();
        let surface = HandSurface::new(&hand, 500);
        let poses = hand.tree.forward(&[0.0; 15]);
        let at =
            |link: usize, p: &Vector3<f64>| if link == 0 { *p } else { (poses[link - 1] * Point3::from(*p)).coords };
        for &(a, b) in &surface.pairs {
            for x in &surface.links[a].spheres {
                for y in &surface.links[b].spheres {
                    let gap = (at(a, &x.center) - at(b, &y.center)).norm() - x.radius - y.radius;
                    assert!(gap > 0.0, "links {a} and {b} overlap by {gap}");
                }
            }
        }
    }
}
