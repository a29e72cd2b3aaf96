//! Meshes built in code: surfaces of revolution and convex hulls.

use std::f64::consts::TAU;

use nalgebra::Point3;
use parry3d_f64::transformation::try_convex_hull;

use super::mesh::{GeometryError, Mesh, Triangles, from_parry, to_parry};

/// Greatest distance by which a convex part may stand out of the surface it replaces, m.
const PART_TOLERANCE: f64 = 2.5e-4;
/// Number of corners around a convex part.
const PART_SEGMENTS: usize = 24;

/// Outline of a surface of revolution: (radius, z) from the lowest to the highest point, m. Both ends lie on the axis,
/// z never falls, and all radii in between are positive.
pub type Profile = Vec<[f64; 2]>;

/// Revolves a profile about the z axis in `segments` steps. Its convex parts are stacked slices.
pub fn revolve(profile: &Profile, segments: usize) -> Result<Mesh, GeometryError> {
    let rings = profile.len().saturating_sub(2);
    let well_formed = rings > 0
        && segments >= 3
        && profile[0][0] == 0.0
        && profile[rings + 1][0] == 0.0
        && profile[1..=rings].iter().all(|point| point[0] > 0.0)
        && profile.windows(2).all(|pair| pair[1][1] >= pair[0][1]);
    if !well_formed {
        return Err(GeometryError::Element {
            element: "profile".into(),
            found: format!("{profile:?} in {segments} segments"),
            expected: "radius 0 at both ends, positive between, z rising, at least 3 segments".into(),
        });
    }
    let mut vertices = vec![Point3::new(0.0, 0.0, profile[0][1])];
    vertices.extend(profile[1..=rings].iter().flat_map(|&point| ring(point, segments)));
    vertices.push(Point3::new(0.0, 0.0, profile[rings + 1][1]));
    let at = |ring: usize, step: usize| (1 + ring * segments + step % segments) as u32;
    let (bottom, top) = (0, (vertices.len() - 1) as u32);
    let mut triangles = Vec::with_capacity(2 * rings * segments);
    for step in 0..segments {
        triangles.push([bottom, at(0, step + 1), at(0, step)]);
        triangles.push([top, at(rings - 1, step), at(rings - 1, step + 1)]);
        for n in 0..rings - 1 {
            let (a, b, c, d) = (at(n, step), at(n, step + 1), at(n + 1, step + 1), at(n + 1, step));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Ok(Mesh::new(vertices, triangles)?.with_parts(slices(profile)))
}

/// Returns the convex hull of a set of points as a mesh with a single convex part.
pub fn hull_mesh(points: &[Point3<f64>]) -> Result<Mesh, GeometryError> {
    let (hull, triangles) = hull_triangles(points)?;
    Ok(Mesh::new(hull.clone(), triangles)?.with_parts(vec![hull]))
}

/// Returns corners and triangles of the convex hull of a set of points. Among thousands of points, some triangles may
/// have almost no area.
pub fn hull_triangles(points: &[Point3<f64>]) -> Result<Triangles, GeometryError> {
    let points: Vec<_> = points.iter().map(to_parry).collect();
    let (hull, triangles) = try_convex_hull(&points).map_err(|error| GeometryError::Element {
        element: "convex hull".into(),
        found: error.to_string(),
        expected: "points that span a volume".into(),
    })?;
    Ok((hull.into_iter().map(from_parry).collect(), triangles))
}

fn ring([radius, z]: [f64; 2], segments: usize) -> impl Iterator<Item = Point3<f64>> {
    (0..segments).map(move |step| {
        let angle = TAU * step as f64 / segments as f64;
        Point3::new(radius * angle.cos(), radius * angle.sin(), z)
    })
}

/// Cuts the profile into runs that are convex within the tolerance.
fn slices(profile: &Profile) -> Vec<Vec<Point3<f64>>> {
    let mut parts = Vec::new();
    let mut start = 0;
    while start + 1 < profile.len() {
        let mut end = start + 1;
        while end + 1 < profile.len() && hull_protrusion(&profile[start..=end + 1]) <= PART_TOLERANCE {
            end += 1;
        }
        let outline = simplify(&upper_hull(&profile[start..=end]), PART_TOLERANCE);
        parts.push(
            outline
                .into_iter()
                .flat_map(|point| {
                    if point[0] > 0.0 {
                        ring(point, PART_SEGMENTS).collect()
                    } else {
                        vec![Point3::new(0.0, 0.0, point[1])]
                    }
                })
                .collect(),
        );
        start = end;
    }
    parts
}

/// Returns the height of `point` over the line through `a` and `b`, radius being up, times the line's length.
fn height_over_line(a: [f64; 2], b: [f64; 2], point: [f64; 2]) -> f64 {
    (b[1] - a[1]) * (point[0] - a[0]) - (b[0] - a[0]) * (point[1] - a[1])
}

/// Returns the outer side of the convex hull of a run of the profile.
fn upper_hull(run: &[[f64; 2]]) -> Profile {
    let mut hull: Profile = Vec::new();
    for &point in run {
        while hull.len() > 1 && height_over_line(hull[hull.len() - 2], point, hull[hull.len() - 1]) <= 0.0 {
            hull.pop();
        }
        hull.push(point);
    }
    hull
}

/// Returns the distance of `point` from the line through `a` and `b`, m.
fn distance_to_line(a: [f64; 2], b: [f64; 2], point: [f64; 2]) -> f64 {
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    if length > 0.0 { height_over_line(a, b, point).abs() / length } else { (point[0] - a[0]).hypot(point[1] - a[1]) }
}

/// Returns the greatest distance by which the hull of a run stands out of it, m.
fn hull_protrusion(run: &[[f64; 2]]) -> f64 {
    let hull = upper_hull(run);
    let gap_at = |point: [f64; 2]| {
        hull.windows(2)
            .filter(|edge| edge[0][1] <= point[1] && point[1] <= edge[1][1])
            .map(|edge| distance_to_line(edge[0], edge[1], point))
            .fold(f64::INFINITY, f64::min)
    };
    run.iter().map(|&point| gap_at(point)).filter(|gap| gap.is_finite()).fold(0.0, f64::max)
}

/// Drops points that lie within `tolerance` of the line between their remaining neighbours.
fn simplify(outline: &[[f64; 2]], tolerance: f64) -> Profile {
    let (first, last) = (outline[0], outline[outline.len() - 1]);
    let worst = (1..outline.len() - 1)
        .map(|n| (distance_to_line(first, last, outline[n]), n))
        .fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
    if worst.0 <= tolerance {
        return vec![first, last];
    }
    let mut kept = simplify(&outline[..=worst.1], tolerance);
    kept.pop();
    kept.extend(simplify(&outline[worst.1..], tolerance));
    kept
}
