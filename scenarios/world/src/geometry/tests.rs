use std::path::Path;

use nalgebra::{Point3, Unit, UnitVector3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::objects::ObjectSet;

fn shapes() -> &'static [(String, ObjectShape)] {
    static SHAPES: std::sync::OnceLock<Vec<(String, ObjectShape)>> = std::sync::OnceLock::new();
    SHAPES.get_or_init(|| {
        let sharp = ObjectShape::Cuboid { half: Vector3::new(0.02, 0.03, 0.025), radius: 0.0 };
        let set = ObjectSet::standard();
        set.iter()
            .map(|object| (object.name.clone(), object.shape.clone()))
            .chain([("sharp box".into(), sharp)])
            .collect()
    })
}

fn direction() -> impl Strategy<Value = UnitVector3<f64>> {
    (-1.0..1.0, 0.0..std::f64::consts::TAU).prop_map(|(z, angle): (f64, f64)| {
        let across = (1.0 - z * z).sqrt();
        UnitVector3::new_normalize(Vector3::new(across * angle.cos(), across * angle.sin(), z))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn rays_end_where_the_distance_is_zero(from in direction(), off in direction(), aside in 0.0..0.03) {
        for (name, shape) in shapes() {
            let origin = Point3::from(from.into_inner() * 0.1);
            let aim = Point3::from(off.into_inner() * aside);
            let along = Unit::new_normalize(aim - origin);
            match shape.ray(&origin, &along) {
                Some(way) => {
                    let (distance, _) = shape.signed_distance(&(origin + along.into_inner() * way));
                    prop_assert!(distance.abs() < 1e-8, "{name}: hit at {distance}");
                    for part in 1..20 {
                        let before = shape.signed_distance(&(origin + along.into_inner() * (way * f64::from(part) / 20.0)));
                        prop_assert!(before.0 > -1e-8, "{name}: went through {before:?}");
                    }
                }
                None => {
                    for step in 0..200 {
                        let on = origin + along.into_inner() * (1e-3 * f64::from(step));
                        prop_assert!(shape.signed_distance(&on).0 > -1e-8, "{name}: missed");
                    }
                }
            }
        }
    }

    #[test]
    fn the_gradient_is_the_slope(at in direction(), reach in 0.0..0.06, along in direction()) {
        for (name, shape) in shapes() {
            let point = Point3::from(at.into_inner() * reach);
            let (distance, gradient) = shape.signed_distance(&point);
            prop_assert!((gradient.norm() - 1.0).abs() < 1e-9, "{name}");
            let step = along.into_inner() * 1e-7;
            let (ahead, behind) = (shape.signed_distance(&(point + step)).0, shape.signed_distance(&(point - step)).0);
            prop_assert!((ahead - distance).abs() <= 1.0001e-7, "{name}: steeper than 1");
            // On the ridge inside the solid, the slope differs between the two sides.
            if (ahead + behind - 2.0 * distance).abs() < 1e-11 {
                let slope = (ahead - behind) / 2e-7;
                prop_assert!((slope - gradient.dot(&along)).abs() < 2e-4, "{name}: {slope} {}", gradient.dot(&along));
            }
        }
    }

    #[test]
    fn the_support_is_on_the_surface_and_farthest(along in direction()) {
        for (name, shape) in shapes() {
            let support = shape.support(&along);
            prop_assert!(shape.signed_distance(&support).0.abs() < 1e-9, "{name}");
            let (low, high) = shape.aabb();
            for axis in 0..3 {
                prop_assert!(support[axis] >= low[axis] - 1e-12 && support[axis] <= high[axis] + 1e-12);
            }
            prop_assert!(support.coords.norm() <= shape.bounding_radius() + 1e-12);
        }
    }
}

#[test]
fn a_ray_from_inside_ends_at_once() {
    for (name, shape) in shapes() {
        assert_eq!(shape.ray(&Point3::new(1e-3, 2e-3, 1e-3), &Vector3::x_axis()), Some(0.0), "{name}");
        assert_eq!(shape.ray(&Point3::new(0.1, 0.0, 0.0), &Vector3::x_axis()), None, "{name}");
    }
}

#[test]
fn drawings_are_closed_outward_and_have_the_shapes_mass() {
    for (name, shape) in shapes() {
        let (points, triangles, normals) = shape.triangles();
        assert_eq!(points.len(), normals.len());
        let mut welded: Vec<Point3<f64>> = Vec::new();
        let index: Vec<u32> = points
            .iter()
            .map(|point| match welded.iter().position(|other| (other - point).norm() < 1e-9) {
                Some(n) => n as u32,
                None => {
                    welded.push(*point);
                    (welded.len() - 1) as u32
                }
            })
            .collect();
        let inward = triangles.iter().filter(|triangle| {
            let [a, b, c] = triangle.map(|n| points[n as usize]);
            (b - a).cross(&(c - a)).dot(&normals[triangle[0] as usize]) < 0.0
        });
        assert_eq!(inward.count(), 0, "{name}");
        let mesh = Mesh::new(welded, triangles.iter().map(|triangle| triangle.map(|n| index[n as usize])).collect())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!((mesh.volume() / shape.volume() - 1.0).abs() < 0.02, "{name}: {} {}", mesh.volume(), shape.volume());
        let (_, inertia) = shape.inertia(0.1);
        assert!((mesh.unit_inertia() * 0.1 - inertia).norm() / inertia.norm() < 0.03, "{name}");
    }
}

#[test]
fn rounded_box_mass_is_exact() {
    // A box rounded into a ball.
    let ball = ObjectShape::Cuboid { half: Vector3::repeat(0.03), radius: 0.03 };
    let sphere = ObjectShape::Sphere { radius: 0.03 };
    assert!((ball.volume() / sphere.volume() - 1.0).abs() < 1e-12);
    assert!((ball.inertia(1.0).1 - sphere.inertia(1.0).1).norm() < 1e-12);
}

#[test]
fn samples_lie_on_the_surface_and_spread() {
    for (name, shape) in shapes() {
        let samples = shape.surface_samples(500);
        assert_eq!(samples.len(), 500);
        assert_eq!(samples, shape.surface_samples(500));
        assert!(samples.iter().all(|sample| shape.signed_distance(sample).0.abs() < 1e-8), "{name}");
        let mean: Vector3<f64> = samples.iter().map(|sample| sample.coords).sum::<Vector3<f64>>() / 500.0;
        // Centroid of the surface: for a vase, it is away from the centre of mass, which is the origin.
        assert!(mean.norm() < 4e-3_f64.max(0.08 * shape.bounding_radius()), "{name}: {mean}");
        for along in [Vector3::x(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
            assert!(
                samples.iter().any(|sample| sample.coords.dot(&along) > 0.7 * shape.support(&along).coords.dot(&along))
            );
        }
    }
}

#[test]
fn revolved_meshes_have_the_volume_of_their_outline() {
    let cone = revolve(&vec![[0.0, 0.0], [0.02, 0.0], [0.0, 0.06]], 256).unwrap();
    let volume = std::f64::consts::PI * 0.02 * 0.02 * 0.06 / 3.0;
    assert!((cone.volume() / volume - 1.0).abs() < 1e-3);
    assert!((cone.center_of_mass().z - 0.015).abs() < 1e-9);
    assert!(cone.is_convex());
    assert!(revolve(&vec![[0.0, 0.0], [0.0, 0.06]], 8).is_err());
}

const TETRAHEDRON: &str =
    "# a corner\nv 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\nf 1 3 2\nf 1/1/1 2/2/2 4/3/3\nf 2 3 4\nf 1 4 -2\n";

fn obj_error(text: &str) -> String {
    Mesh::parse_obj(text, Path::new("thing.obj")).unwrap_err().to_string()
}

#[test]
fn obj_files_are_read_and_turned_outwards() {
    let mesh = Mesh::parse_obj(TETRAHEDRON, Path::new("thing.obj")).unwrap();
    assert!((mesh.volume() - 0.05_f64.powi(3) / 6.0).abs() < 1e-12);
    assert!((mesh.center_of_mass() - Point3::new(0.0125, 0.0125, 0.0125)).norm() < 1e-12);
    let inside_out = "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n";
    let mesh = Mesh::parse_obj(inside_out, Path::new("thing.obj")).unwrap();
    assert!(mesh.volume() > 0.0 && mesh.signed_distance(&mesh.center_of_mass()).0 < 0.0);
    assert!(mesh.signed_distance(&Point3::new(-0.01, 0.01, 0.01)).0 > 0.0);
}

#[test]
fn obj_errors_name_file_line_found_and_expected() {
    assert_eq!(
        obj_error(&TETRAHEDRON.replace("v 0.05 0 0", "v 0.05 zero 0")),
        "thing.obj:3: found \"v 0.05 zero 0\", expected three finite numbers after v"
    );
    assert_eq!(
        obj_error(&TETRAHEDRON.replace("f 2 3 4", "f 2 3 9")),
        "thing.obj:8: found corner \"9\", expected a vertex number from 1 to 4"
    );
    assert!(obj_error(&TETRAHEDRON.replace("f 2 3 4", "f 2 3")).contains(":8: found 2 corners"));
    let open = obj_error(&TETRAHEDRON.replace("f 2 3 4\n", "f 2 3 1\n"));
    assert!(open.starts_with("thing.obj: mesh is not watertight"), "{open}");
    let millimetres = obj_error(&TETRAHEDRON.replace("0.05", "50"));
    assert!(millimetres.contains("found 50.000 m") && millimetres.contains("millimetres"), "{millimetres}");
    assert!(obj_error("").contains("found 0 triangles"));
    let missing = Mesh::load(Path::new("/nowhere/thing.obj")).unwrap_err().to_string();
    assert!(missing.starts_with("/nowhere/thing.obj: "), "{missing}");
}

#[test]
fn a_hollow_mesh_without_known_parts_is_decomposed() {
    // An L of three cubes.
    let outline = [[0.0, 0.0], [0.04, 0.0], [0.04, 0.02], [0.02, 0.02], [0.02, 0.04], [0.0, 0.04]];
    let at = |z: f64| outline.map(|[x, y]| Point3::new(x, y, z));
    let vertices: Vec<Point3<f64>> = at(0.0).into_iter().chain(at(0.02)).collect();
    let caps = [[0, 1, 3], [1, 2, 3], [0, 3, 5], [3, 4, 5]];
    let mut triangles: Vec<[u32; 3]> = caps.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    triangles.extend(caps.iter().map(|triangle| triangle.map(|n| n + 6)));
    for n in 0..6 {
        let next = (n + 1) % 6;
        triangles.extend([[n, next, next + 6], [n, next + 6, n + 6]]);
    }
    let mesh = Mesh::new(vertices, triangles).unwrap();
    assert!((mesh.volume() - 3.0 * 0.02_f64.powi(3)).abs() < 1e-12 && !mesh.is_convex());
    assert!(mesh.signed_distance(&Point3::new(0.03, 0.03, 0.01)).0 > 0.0);
    let volume: f64 = mesh.convex_parts().iter().map(|part| hull_mesh(part).unwrap().volume()).sum();
    assert!(mesh.convex_parts().len() >= 2 && (volume / mesh.volume() - 1.0).abs() < 0.1, "{volume}");
    // A scaled mesh has the same decomposition, whether or not the parts of the original were computed before.
    let fresh = Mesh::new(mesh.vertices().to_vec(), mesh.triangles().to_vec()).unwrap();
    let (asked, unasked) = (mesh.scaled(1.03).unwrap(), fresh.scaled(1.03).unwrap());
    assert_eq!(asked.convex_parts(), unasked.convex_parts());
    assert_eq!(asked.convex_parts()[0][0], mesh.convex_parts()[0][0] * 1.03);
}
