//! Collision shapes of a URDF hand, points on their surfaces, and balls that fill them.

use std::sync::Arc;

use anyhow::{Context, Result};
use dexterous_grasping::synthesis::surface::LinkSphere;
use hand_model::hand_mechanism::{HandMechanism, SolidShape};
use nalgebra::{Isometry3, Point3, Vector3};
use world::geometry::{GeometryError, Mesh, ObjectShape, hull_mesh};

/// Largest distance by which collinear corners of a hull are moved out, m.
const MAX_CORNER_SHIFT: f64 = 2e-5;
const GOLDEN_RATIO: f64 = 0.618_033_988_749_895;
/// Number of points on the whole hand.
const SURFACE_POINTS: usize = 2000;

/// Surface point with its normal, in the link's frame (the root's for the palm).
pub struct LinkSurfacePoint {
    pub point: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// True if it may bear an object.
    pub bears: bool,
}

/// Collision shape of a link.
pub struct LinkPart {
    /// `link_from_shape`.
    pub pose: Isometry3<f64>,
    pub shape: ObjectShape,
    /// True if it represents a mesh or a part of one.
    pub of_mesh: bool,
    /// True if it may bear an object: every part of a moving link, and of the root the parts that the pulls file names
    /// as palm.
    pub bears: bool,
}

/// Shapes by link (0 is the root).
pub type LinkShapes = Vec<Vec<LinkPart>>;

/// Returns the number of a link, with 0 for the root.
pub fn link_number(link: Option<usize>) -> usize {
    link.map_or(0, |link| link + 1)
}

/// Returns the collision shapes of every link.
pub fn shapes(hand: &HandMechanism) -> Result<LinkShapes> {
    let mut found: LinkShapes = Vec::new();
    found.resize_with(hand.tree.len() + 1, Vec::new);
    for solid in &hand.solids {
        let link = link_number(solid.link);
        let shape = match &solid.shape {
            SolidShape::Cuboid(half) => ObjectShape::Cuboid { half: *half, radius: 0.0 },
            SolidShape::RoundedCuboid(half, radius) => ObjectShape::Cuboid { half: *half, radius: *radius },
            SolidShape::Sphere(radius) => ObjectShape::Sphere { radius: *radius },
            SolidShape::Cylinder(radius, half) => ObjectShape::Cylinder { radius: *radius, half_height: *half },
            SolidShape::Capsule(radius, half) => {
                ObjectShape::Cuboid { half: Vector3::new(*radius, *radius, half + radius), radius: *radius }
            }
            SolidShape::Hull(points) => {
                let mesh = hull(points).with_context(|| format!("the collision hull of {}", link_name(hand, link)))?;
                ObjectShape::Mesh(Arc::new(mesh))
            }
        };
        found[link].push(LinkPart {
            pose: solid.link_from_solid,
            shape,
            of_mesh: matches!(solid.shape, SolidShape::Hull(_)),
            bears: link > 0 || hand.palm.links.contains(&solid.link_name),
        });
    }
    Ok(found)
}

/// Computes the hull of points as a mesh. Corners of a cut are collinear with others, which gives triangles without
/// area. They are then moved apart by up to [`MAX_CORNER_SHIFT`].
fn hull(points: &[Point3<f64>]) -> Result<Mesh, GeometryError> {
    hull_mesh(points).or_else(|_| {
        let middle = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let out = |(n, point): (usize, &Point3<f64>)| {
            // Quasi-random shares, the same in every run.
            let share = (n as f64 * GOLDEN_RATIO).fract();
            point
                + (point.coords - middle).try_normalize(1e-9).unwrap_or_else(Vector3::zeros)
                    * (MAX_CORNER_SHIFT * share)
        };
        hull_mesh(&points.iter().enumerate().map(out).collect::<Vec<_>>())
    })
}

fn surface_area(shape: &ObjectShape) -> f64 {
    let (points, triangles, _) = shape.triangles();
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|index| points[index as usize]);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    triangles.iter().map(area).sum()
}

/// Returns points distributed evenly over all links, without those inside another shape of the same link.
pub fn surface_points(shapes: &LinkShapes) -> Vec<Vec<LinkSurfacePoint>> {
    let total: f64 = shapes.iter().flatten().map(|part| surface_area(&part.shape)).sum();
    let on_link = |parts: &Vec<LinkPart>| {
        let mut points = Vec::new();
        for (n, LinkPart { pose, shape, bears, .. }) in parts.iter().enumerate() {
            let count = (SURFACE_POINTS as f64 * surface_area(shape) / total).ceil() as usize;
            for point in shape.surface_samples(count) {
                let (_, normal) = shape.signed_distance(&point);
                let at = pose * point;
                let buried = parts.iter().enumerate().any(|(other, part)| {
                    other != n && part.shape.signed_distance(&part.pose.inverse_transform_point(&at)).0 < -1e-4
                });
                if !buried {
                    points.push(LinkSurfacePoint { point: at.coords, normal: pose * normal, bears: *bears });
                }
            }
        }
        points
    };
    shapes.iter().map(on_link).collect()
}

/// Returns the name of a link (0 is the root).
pub fn link_name(hand: &HandMechanism, link: usize) -> String {
    link.checked_sub(1).map_or("root".into(), |joint| hand.tree.joints[joint].name.clone())
}

/// Fills the shapes of one link with balls, centred on the grid points that are nearly as deep as any.
pub fn fill_with_spheres(shapes: &[LinkPart]) -> Vec<LinkSphere> {
    let mut balls = Vec::new();
    for LinkPart { pose, shape, .. } in shapes {
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
        balls.extend(deep.map(|(at, radius)| LinkSphere { center: (pose * at).coords, radius }));
    }
    balls
}
