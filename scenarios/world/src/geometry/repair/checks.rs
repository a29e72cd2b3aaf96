//! Validation of a mended mesh against the triangles it was made from and the volume that they imply.

use nalgebra::Point3;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::orientation;
use super::report::{MAX_FILLED_SHARE, RepairReport};
use super::soup::TriangleSoup;
use crate::geometry::mesh::{Mesh, to_parry};
use crate::geometry::tessellation::sample;

/// Number of points at which two surfaces are compared.
const SAMPLE_COUNT: usize = 4000;
/// Greatest distance of a mesh that was not rebuilt from its file's triangles, m, and relative to its extent; the
/// larger one applies.
const MAX_DEVIATIONS: (f64, f64) = (3e-4, 2e-3);
/// Greatest distance of a rebuilt mesh from its file's triangles, in cells.
const MAX_REBUILT_DEVIATION: f64 = 0.75;
/// Greatest share of the file's triangles that a rebuilt surface may omit.
const MAX_OMITTED_SHARE: f64 = 0.005;
/// Greatest relative difference between the volume of the result and the volume that the triangles imply, besides the
/// effect of open holes.
const VOLUME_TOLERANCE: f64 = 0.02;
/// Least mean thickness of a solid, m: twice its volume divided by its surface.
const MIN_THICKNESS: f64 = 5e-5;
/// Greatest number of nodes of the finest grid.
const MAX_GRID_NODES: f64 = 3e6;

/// Returns the distance between sampled points of one surface and another: the greatest distance, m, and the share of
/// points beyond `limit`.
fn surface_deviation(from: (&[Point3<f64>], &[[u32; 3]]), to: &TriMesh, limit: f64) -> (f64, f64) {
    let points = sample(from.0, from.1, SAMPLE_COUNT);
    let distances: Vec<f64> = points.iter().map(|point| to.distance_to_local_point(to_parry(point), false)).collect();
    let beyond = distances.iter().filter(|distance| **distance > limit).count();
    (distances.iter().copied().fold(0.0, f64::max), beyond as f64 / distances.len() as f64)
}

fn surface(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<TriMesh, String> {
    TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).map_err(|error| error.to_string())
}

/// Rebuilds open triangles on a grid, with finer cells until the mesh follows them. Returns the mesh and the cell size,
/// m.
pub fn rebuilt(open: &TriangleSoup) -> Result<(Mesh, f64), String> {
    let (vertices, triangles) = open.compact();
    let file = surface(&vertices, &triangles)?;
    let implied = orientation::volume(open).abs();
    let mut cell = Mesh::rebuilding_cell(&vertices);
    loop {
        let mesh = Mesh::rebuilt(&vertices, &triangles, cell).map_err(|error| error.to_string())?;
        let fault = describe_mismatch(&mesh, (&vertices, &triangles), &file, cell, implied);
        let nodes = Mesh::rebuilding_nodes(&vertices, 0.5 * cell);
        match fault {
            Ok(None) => return Ok((mesh, cell)),
            Ok(Some(_)) if nodes <= MAX_GRID_NODES => cell *= 0.5,
            Ok(Some(reason)) | Err(reason) => return Err(reason),
        }
    }
}

/// Describes a disagreement between a rebuilt mesh and its triangles, if any.
fn describe_mismatch(
    mesh: &Mesh,
    file: (&[Point3<f64>], &[[u32; 3]]),
    original: &TriMesh,
    cell: f64,
    implied: f64,
) -> Result<Option<String>, String> {
    let limit = MAX_REBUILT_DEVIATION * cell;
    let (most, lost) = surface_deviation(file, &surface(mesh.vertices(), mesh.triangles())?, limit);
    if lost > MAX_OMITTED_SHARE || most > 3.0 * cell {
        return Ok(Some(format!(
            "rebuilt on {:.1} mm cells it omits {:.1} % of the file's triangles, by up to {:.1} mm",
            1e3 * cell,
            100.0 * lost,
            1e3 * most
        )));
    }
    let (most, invented) = surface_deviation((mesh.vertices(), mesh.triangles()), original, limit);
    if invented > MAX_FILLED_SHARE {
        return Ok(Some(format!(
            "{:.0} % of the surface that would close it has no triangle of the file near it (up to {:.1} mm away)",
            100.0 * invented,
            1e3 * most
        )));
    }
    let volume = mesh.volume();
    if (volume - implied).abs() > (VOLUME_TOLERANCE + MAX_FILLED_SHARE) * implied {
        return Ok(Some(format!(
            "rebuilt on {:.1} mm cells it has {:.2} cm3, its triangles imply {:.2}",
            1e3 * cell,
            1e6 * volume,
            1e6 * implied
        )));
    }
    Ok(None)
}

/// True if a simplified mesh follows the original one.
pub fn follows(fewer: &Mesh, mesh: &Mesh) -> bool {
    let extent = TriangleSoup { vertices: mesh.vertices().to_vec(), triangles: mesh.triangles().to_vec() }.extent();
    let limit = MAX_DEVIATIONS.0.max(MAX_DEVIATIONS.1 * extent);
    let [a, b] = [fewer, mesh].map(|mesh| (mesh.vertices(), mesh.triangles()));
    let near = |from: (&[Point3<f64>], &[[u32; 3]]), to: (&[Point3<f64>], &[[u32; 3]])| {
        surface(to.0, to.1).is_ok_and(|to| surface_deviation(from, &to, limit).1 == 0.0)
    };
    near(a, b) && near(b, a) && (fewer.volume() / mesh.volume() - 1.0).abs() < VOLUME_TOLERANCE
}

/// Compares a mended mesh with the triangles of its file, except those that were dropped.
pub fn check(kept: &TriangleSoup, mesh: &Mesh, repair: &mut RepairReport) -> Result<(), String> {
    let volume = mesh.volume();
    let made = TriangleSoup { vertices: mesh.vertices().to_vec(), triangles: mesh.triangles().to_vec() };
    let thickness = 2.0 * volume / made.area();
    if thickness < MIN_THICKNESS {
        return Err(format!(
            "it would enclose {:.3} cm3 with {:.0} cm2, {:.3} mm thick on average",
            1e6 * volume,
            1e4 * made.area(),
            1e3 * thickness
        ));
    }
    repair.volume = volume;
    let limit = match repair.rebuilt {
        Some(cell) => MAX_REBUILT_DEVIATION * cell,
        None => MAX_DEVIATIONS.0.max(MAX_DEVIATIONS.1 * made.extent()),
    };
    let distances =
        sample(&kept.vertices, &kept.triangles, SAMPLE_COUNT).into_iter().map(|point| mesh.signed_distance(&point).0);
    // Pieces that were dropped because they lie inside the solid are away from its surface.
    let distances = distances.map(|distance| if repair.enclosed > 0 { distance.max(0.0) } else { distance.abs() });
    let distances: Vec<f64> = distances.collect();
    let most = distances.iter().copied().fold(0.0, f64::max);
    let beyond = distances.iter().filter(|distance| **distance > limit).count() as f64 / distances.len() as f64;
    repair.max_deviation = most;
    if beyond > if repair.rebuilt.is_some() { MAX_OMITTED_SHARE } else { 0.0 } {
        return Err(format!(
            "mended, it is up to {:.2} mm from {:.1} % of the file's triangles; at most {:.2} mm is allowed",
            1e3 * most,
            100.0 * beyond,
            1e3 * limit
        ));
    }
    Ok(())
}
