//! The collision shapes of a hand known from its URDF, the points on their surfaces and the balls that fill them.

use std::sync::Arc;

use anyhow::{Context, Result};
use grasping::synthesis::surface::Ball;
use hand_model::any_hand::{AnyHand, SolidShape};
use nalgebra::{Isometry3, Point3, Vector3};
use scenarios::geometry::{Shape, hull_mesh};

/// Points on the whole hand.
const POINTS: usize = 2000;

/// A point of the surface with its normal, link frame (the root's for the palm).
pub struct SurfacePoint {
    pub point: Vector3<f64>,
    pub normal: Vector3<f64>,
}

/// Shapes by link (0 is the root), with their pose in the link's frame.
pub type LinkShapes = Vec<Vec<(Isometry3<f64>, Shape)>>;

/// The collision shapes of every link.
pub fn shapes(hand: &AnyHand) -> Result<LinkShapes> {
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
pub fn surface_points(shapes: &LinkShapes) -> Vec<Vec<SurfacePoint>> {
    let total: f64 = shapes.iter().flatten().map(|(_, shape)| surface_area(shape)).sum();
    let on_link = |parts: &Vec<(Isometry3<f64>, Shape)>| {
        let mut points = Vec::new();
        for (n, (pose, shape)) in parts.iter().enumerate() {
            let count = (POINTS as f64 * surface_area(shape) / total).ceil() as usize;
            for point in shape.surface_samples(count) {
                let (_, normal) = shape.signed_distance(&point);
                let at = pose * point;
                let buried = parts.iter().enumerate().any(|(other, (pose, shape))| {
                    other != n && shape.signed_distance(&pose.inverse_transform_point(&at)).0 < -1e-4
                });
                if !buried {
                    points.push(SurfacePoint { point: at.coords, normal: pose * normal });
                }
            }
        }
        points
    };
    shapes.iter().map(on_link).collect()
}

/// Name of a link (0 is the root).
pub fn name(hand: &AnyHand, link: usize) -> String {
    link.checked_sub(1).map_or("root".into(), |joint| hand.tree.joints[joint].name.clone())
}

/// Balls inside the shapes of one link: grid points that are nearly as deep as any.
pub fn fill(shapes: &[(Isometry3<f64>, Shape)]) -> Vec<Ball> {
    let mut balls = Vec::new();
    for (pose, shape) in shapes {
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
