use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::*;
use crate::geometry::mesh::Triangles;

/// Returns a tumbler, m: outer radius 44 mm, walls and floor 3 mm, 60 mm high.
fn cup() -> Triangles {
    let profile = [[44.0, 0.0], [44.0, 60.0], [41.0, 60.0], [41.0, 3.0]];
    let mut vertices = vec![Point3::origin(), Point3::new(0.0, 0.0, 0.003)];
    const AROUND: u32 = 48;
    for [radius, z] in profile {
        vertices.extend((0..AROUND).map(|n| {
            let turn = TAU * f64::from(n) / f64::from(AROUND);
            Point3::new(radius * turn.cos(), radius * turn.sin(), z) * 1e-3
        }));
    }
    let at = |ring: u32, n: u32| 2 + ring * AROUND + n % AROUND;
    let mut triangles = Vec::new();
    for n in 0..AROUND {
        triangles.push([0, at(0, n + 1), at(0, n)]);
        triangles.push([1, at(3, n), at(3, n + 1)]);
        for ring in 0..3 {
            let (a, b, c, d) = (at(ring, n), at(ring, n + 1), at(ring + 1, n + 1), at(ring + 1, n));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    (vertices, triangles)
}

/// Returns a ball of `rings` rings by twice as many columns. `radius` gives the distance of each point from the centre
/// (m) as a function of its direction.
pub fn ball(rings: u32, radius: impl Fn(&Vector3<f64>) -> f64) -> Triangles {
    let around = 2 * rings;
    let point = |ring: u32, k: u32| {
        let (tilt, turn) = (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(k) / f64::from(around));
        let out = Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos());
        Point3::from(out * radius(&out))
    };
    let mut vertices = vec![point(0, 0)];
    vertices.extend((1..rings).flat_map(|ring| (0..around).map(move |k| (ring, k))).map(|(ring, k)| point(ring, k)));
    vertices.push(point(rings, 0));
    let (at, last) = (|ring: u32, k: u32| 1 + (ring - 1) * around + k % around, vertices.len() as u32 - 1);
    let mut triangles = Vec::new();
    for ring in 1..rings {
        for k in 0..around {
            if ring == 1 {
                triangles.push([0, at(1, k), at(1, k + 1)]);
            }
            if ring + 1 == rings {
                triangles.push([last, at(ring, k + 1), at(ring, k)]);
                continue;
            }
            let (a, b, c, d) = (at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k));
            triangles.extend([[a, d, c], [a, c, b]]);
        }
    }
    (vertices, triangles)
}

/// Returns a bumpy solid without symmetry, 60 mm across.
fn blob() -> Triangles {
    ball(16, |out| 0.03 + 0.002 * (3.0 * out.x).sin() + 0.0015 * (4.0 * out.y + out.z).cos())
}

fn volume((vertices, triangles): &Triangles) -> f64 {
    Mesh::new(vertices.clone(), triangles.clone()).expect("closed").volume()
}

fn repaired((vertices, triangles): &Triangles) -> (Mesh, RepairReport) {
    Mesh::repaired(vertices, triangles).unwrap_or_else(|error| panic!("{error}"))
}

fn fault((vertices, triangles): &Triangles) -> String {
    Mesh::repaired(vertices, triangles).expect_err("refused").to_string()
}

fn near(found: f64, expected: f64, share: f64) -> bool {
    (found / expected - 1.0).abs() < share
}

/// A sound mesh stays as it is.
#[test]
fn a_sound_mesh_is_left_alone() {
    for mesh in [cup(), blob()] {
        let (same, repair) = repaired(&mesh);
        assert!(repair.is_none());
        assert_eq!((same.vertices(), same.triangles()), (&mesh.0[..], &mesh.1[..]));
    }
}

#[test]
fn one_triangle_of_no_area_is_no_reason_to_rebuild() {
    let sound = cup();
    let (mut vertices, triangles) = sound.clone();
    let [a, b, c] = triangles[7];
    // A needle: two corners at one vertex.
    let mut needle = triangles.clone();
    needle.push([a, b, b]);
    // A needle: two coincident vertices, as found in scans.
    let mut copied = triangles.clone();
    vertices.push(vertices[b as usize]);
    let copy = vertices.len() as u32 - 1;
    copied[7] = [a, copy, c];
    copied.push([a, b, copy]);
    copied.push([b, c, copy]);
    // A cap: three collinear corners, one of them in the middle of an edge.
    let mut cap = triangles.clone();
    vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
    let middle = vertices.len() as u32 - 1;
    cap[7] = [a, middle, c];
    cap.push([middle, b, c]);
    cap.push([a, b, middle]);
    for (name, faces) in [("needle", needle), ("copied", copied), ("cap", cap)] {
        let (mesh, repair) = repaired(&(vertices.clone(), faces));
        assert!(near(mesh.volume(), volume(&sound), 1e-9), "{name}: {repair}");
        assert!(repair.rebuilt.is_none() && repair.degenerate > 0 && repair.max_deviation < 1e-9, "{name}: {repair}");
    }
}

#[test]
fn half_of_the_windings_flipped_is_the_same_solid() {
    for sound in [blob(), cup()] {
        for every in [2, 3, 7] {
            let mut flipped = sound.clone();
            flipped.1.iter_mut().step_by(every).for_each(|triangle| triangle.swap(0, 2));
            let (mesh, repair) = repaired(&flipped);
            assert!(near(mesh.volume(), volume(&sound), 1e-12) && repair.flipped > 0, "{repair}");
        }
    }
}

/// Triangles that share no corner are not connected. Without an orientation there is no inside, and the error states
/// this.
#[test]
fn what_cannot_be_told_is_refused() {
    let (vertices, triangles) = blob();
    let mut loose: Triangles = Default::default();
    for (number, triangle) in triangles.iter().enumerate() {
        let first = loose.0.len() as u32;
        // Each triangle is slightly shrunk, so that no two touch.
        let corners = triangle.map(|index| vertices[index as usize]);
        let middle = Point3::from(corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0);
        loose.0.extend(corners.iter().map(|corner| middle + (corner - middle) * 0.98));
        loose.1.push(if number % 2 == 0 { [first, first + 1, first + 2] } else { [first, first + 2, first + 1] });
    }
    let error = fault(&loose);
    assert!(error.contains("not watertight") && error.contains("cannot be mended"), "{error}");
    // With a common orientation, they are practically closed.
    for triangle in &mut loose.1 {
        triangle.sort_unstable();
    }
    let (mesh, repair) = repaired(&loose);
    assert!(near(mesh.volume(), volume(&(vertices, triangles)), 0.05) && repair.rebuilt.is_some(), "{repair}");
}

#[test]
fn a_small_hole_is_closed_and_a_large_one_is_refused() {
    let sound = blob();
    let without = |share: f64| {
        let kept = (sound.1.len() as f64 * (1.0 - share)) as usize;
        (sound.0.clone(), sound.1[..kept].to_vec())
    };
    let (mesh, repair) = repaired(&without(0.02));
    assert!(repair.holes == 1 && repair.rebuilt.is_none() && near(mesh.volume(), volume(&sound), 0.01), "{repair}");
    let error = fault(&without(0.4));
    assert!(error.contains("cannot be mended"), "{error}");
    // A cup of a single layer encloses no well-defined volume.
    let (vertices, triangles) = cup();
    let outside = triangles.iter().enumerate().filter(|(n, _)| n % 8 == 0 || (2..4).contains(&(n % 8)));
    let error = fault(&(vertices, outside.map(|(_, triangle)| *triangle).collect()));
    assert!(error.contains("not watertight") && error.contains("cannot be mended"), "{error}");
}

#[test]
fn a_sheet_is_no_solid() {
    let sheet: Vec<Point3<f64>> =
        (0..9).map(|n| Point3::new(0.02 * f64::from(n % 3), 0.02 * f64::from(n / 3), 0.0)).collect();
    let mut faces: Vec<[u32; 3]> = [0, 1, 3, 4].iter().flat_map(|&a| [[a, a + 1, a + 4], [a, a + 4, a + 3]]).collect();
    assert!(fault(&(sheet.clone(), faces.clone())).contains("cannot be mended"));
    // The same sheet from both sides is closed, but still no solid.
    faces.extend(faces.clone().into_iter().map(|[a, b, c]| [a, c, b]));
    assert!(Mesh::repaired(&sheet, &faces).is_err());
}

/// Every triangle has corners of its own, as in STL files, slightly apart because of rounding.
#[test]
fn seams_are_closed() {
    let (vertices, triangles) = cup();
    let mut torn: Triangles = Default::default();
    for (number, triangle) in triangles.iter().enumerate() {
        let first = torn.0.len() as u32;
        let shift = Vector3::repeat(1e-7 * (number % 5) as f64);
        torn.0.extend(triangle.map(|index| vertices[index as usize] + shift));
        torn.1.push([first, first + 1, first + 2]);
    }
    let (mesh, repair) = repaired(&torn);
    assert!(near(mesh.volume(), volume(&(vertices, triangles)), 1e-3) && repair.rebuilt.is_none(), "{repair}");
}

#[test]
fn one_of_two_balls_inside_out_does_not_take_the_others_volume() {
    let (vertices, triangles) = blob();
    let both = |apart: f64, scale: f64, flip: bool| {
        let count = vertices.len() as u32;
        let mut points = vertices.clone();
        points.extend(vertices.iter().map(|at| at * scale + Vector3::x() * apart));
        let mut faces = triangles.clone();
        faces.extend(
            triangles
                .iter()
                .map(|t| if flip { [t[0] + count, t[2] + count, t[1] + count] } else { t.map(|n| n + count) }),
        );
        (points, faces)
    };
    let one = volume(&(vertices.clone(), triangles.clone()));
    let (beside, repair) = repaired(&both(0.1, 0.9, true));
    assert!(near(beside.volume(), one * (1.0 + 0.729), 1e-9) && repair.flipped > 0, "{repair}");
    // Inside, the opposite orientation is a cavity, and the same orientation a solid within a solid.
    let (hollow, repair) = repaired(&both(0.0, 0.5, true));
    assert!(near(hollow.volume(), one * 0.875, 1e-9) && repair.is_none());
    let (filled, repair) = repaired(&both(0.0, 0.5, false));
    assert!(near(filled.volume(), one, 1e-9) && repair.enclosed == 1, "{repair}");
}

/// Two boxes touch along an edge, where four triangles meet.
#[test]
fn surfaces_that_touch_are_both_closed() {
    let corner = |n: u32, shift: f64| {
        Point3::new(f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2 & 1)) * 0.02
            + Vector3::new(shift, shift, 0.0)
    };
    let faces = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    let vertices = (0..8).map(|n| corner(n, 0.0)).chain((0..8).map(|n| corner(n, 0.02))).collect();
    let triangles = faces.into_iter().chain(faces.map(|face: [u32; 3]| face.map(|n| n + 8))).collect();
    let mut soup = TriangleSoup { vertices, triangles };
    soup.weld(&mut RepairReport::default());
    let (mesh, _) = repaired(&soup.compact());
    assert!(near(mesh.volume(), 2.0 * 0.02f64.powi(3), 1e-9));
    assert!(mesh.signed_distance(&Point3::new(0.012, 0.028, 0.01)).0 > 0.0);
    assert!(mesh.signed_distance(&Point3::new(0.018, 0.018, 0.01)).0 < 0.0);
}
