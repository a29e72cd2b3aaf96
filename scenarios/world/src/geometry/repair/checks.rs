//! What a mended mesh has to agree with: the triangles that it was made from, and the volume that they imply.

use nalgebra::Point3;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::orientation;
use super::report::{MOST_FILLED, Repair};
use super::soup::Soup;
use crate::geometry::mesh::{Mesh, to_parry};
use crate::geometry::tessellation::sample;

/// Points at which two surfaces are compared.
const SAMPLES: usize = 4000;
/// How far a mesh that was not rebuilt may lie from its file's triangles, m, and as a share of its extent where that is more.
const OFF: (f64, f64) = (3e-4, 2e-3);
/// How far one that was rebuilt may lie from them, in cells.
const REBUILT_OFF: f64 = 0.75;
/// Share of the file's triangles that a rebuilt surface may leave out.
const MOST_LOST: f64 = 0.005;
/// Share of the volume by which a result may differ from what the triangles imply, beside what holes leave open.
const VOLUME: f64 = 0.02;
/// A solid is thicker than this, m: twice its volume over its surface.
const THINNEST: f64 = 5e-5;
/// Nodes of the finest grid.
const MOST_NODES: f64 = 3e6;

/// How far `points` of one surface lie from another, m: the largest distance, and the share of them beyond `limit`.
fn apart(from: (&[Point3<f64>], &[[u32; 3]]), to: &TriMesh, limit: f64) -> (f64, f64) {
    let points = sample(from.0, from.1, SAMPLES);
    let distances: Vec<f64> = points.iter().map(|point| to.distance_to_local_point(to_parry(point), false)).collect();
    let beyond = distances.iter().filter(|distance| **distance > limit).count();
    (distances.iter().copied().fold(0.0, f64::max), beyond as f64 / distances.len() as f64)
}

fn surface(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<TriMesh, String> {
    TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).map_err(|error| error.to_string())
}

/// Rebuilds open triangles on a grid, with finer cells where it does not follow them; gives the mesh and the cell, m.
pub fn rebuilt(open: &Soup) -> Result<(Mesh, f64), String> {
    let (vertices, triangles) = open.compact();
    let file = surface(&vertices, &triangles)?;
    let implied = orientation::volume(open).abs();
    let mut cell = Mesh::rebuilding_cell(&vertices);
    loop {
        let mesh = Mesh::rebuilt(&vertices, &triangles, cell).map_err(|error| error.to_string())?;
        let fault = differs(&mesh, (&vertices, &triangles), &file, cell, implied);
        let nodes = Mesh::rebuilding_nodes(&vertices, 0.5 * cell);
        match fault {
            Ok(None) => return Ok((mesh, cell)),
            Ok(Some(_)) if nodes <= MOST_NODES => cell *= 0.5,
            Ok(Some(reason)) | Err(reason) => return Err(reason),
        }
    }
}

/// What a rebuilt mesh and its triangles disagree on, if anything.
fn differs(
    mesh: &Mesh,
    file: (&[Point3<f64>], &[[u32; 3]]),
    original: &TriMesh,
    cell: f64,
    implied: f64,
) -> Result<Option<String>, String> {
    let limit = REBUILT_OFF * cell;
    let (most, lost) = apart(file, &surface(mesh.vertices(), mesh.triangles())?, limit);
    if lost > MOST_LOST || most > 3.0 * cell {
        return Ok(Some(format!(
            "rebuilt on {:.1} mm cells it leaves {:.1} % of the file's triangles out, by up to {:.1} mm",
            1e3 * cell,
            100.0 * lost,
            1e3 * most
        )));
    }
    let (most, invented) = apart((mesh.vertices(), mesh.triangles()), original, limit);
    if invented > MOST_FILLED {
        return Ok(Some(format!(
            "{:.0} % of the surface that would close it has no triangle of the file near it (up to {:.1} mm away)",
            100.0 * invented,
            1e3 * most
        )));
    }
    let volume = mesh.volume();
    if (volume - implied).abs() > (VOLUME + MOST_FILLED) * implied {
        return Ok(Some(format!(
            "rebuilt on {:.1} mm cells it has {:.2} cm3, its triangles imply {:.2}",
            1e3 * cell,
            1e6 * volume,
            1e6 * implied
        )));
    }
    Ok(None)
}

/// Whether a mesh of fewer triangles follows the one that it was made of.
pub fn follows(fewer: &Mesh, mesh: &Mesh) -> bool {
    let extent = Soup { vertices: mesh.vertices().to_vec(), triangles: mesh.triangles().to_vec() }.extent();
    let limit = OFF.0.max(OFF.1 * extent);
    let [a, b] = [fewer, mesh].map(|mesh| (mesh.vertices(), mesh.triangles()));
    let near = |from: (&[Point3<f64>], &[[u32; 3]]), to: (&[Point3<f64>], &[[u32; 3]])| {
        surface(to.0, to.1).is_ok_and(|to| apart(from, &to, limit).1 == 0.0)
    };
    near(a, b) && near(b, a) && (fewer.volume() / mesh.volume() - 1.0).abs() < VOLUME
}

/// Compares a mended mesh with the triangles of its file, but for those that were left out.
pub fn check(kept: &Soup, mesh: &Mesh, repair: &mut Repair) -> Result<(), String> {
    let volume = mesh.volume();
    let made = Soup { vertices: mesh.vertices().to_vec(), triangles: mesh.triangles().to_vec() };
    let thickness = 2.0 * volume / made.area();
    if thickness < THINNEST {
        return Err(format!(
            "it would enclose {:.3} cm3 with {:.0} cm2, {:.3} mm thick in the mean",
            1e6 * volume,
            1e4 * made.area(),
            1e3 * thickness
        ));
    }
    repair.volume = volume;
    let limit = match repair.rebuilt {
        Some(cell) => REBUILT_OFF * cell,
        None => OFF.0.max(OFF.1 * made.extent()),
    };
    let distances =
        sample(&kept.vertices, &kept.triangles, SAMPLES).into_iter().map(|point| mesh.signed_distance(&point).0);
    // What was left out because it lies inside of the solid is away from its surface.
    let distances = distances.map(|distance| if repair.swallowed > 0 { distance.max(0.0) } else { distance.abs() });
    let distances: Vec<f64> = distances.collect();
    let most = distances.iter().copied().fold(0.0, f64::max);
    let beyond = distances.iter().filter(|distance| **distance > limit).count() as f64 / distances.len() as f64;
    repair.off = most;
    if beyond > if repair.rebuilt.is_some() { MOST_LOST } else { 0.0 } {
        return Err(format!(
            "mended, it lies up to {:.2} mm from {:.1} % of the file's triangles, at most {:.2} mm may be",
            1e3 * most,
            100.0 * beyond,
            1e3 * limit
        ));
    }
    Ok(())
}
