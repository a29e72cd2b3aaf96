//! Repair of a file's triangles into a closed mesh, with the least change: sound parts stay as they are, to the bit.
//!
//! The steps are, in order: merge vertices in one place; drop triangles without an area, duplicates and flaps; close
//! seams; orient neighbours consistently; drop loose scraps and close small holes. Only pieces that are still open are
//! rebuilt on a grid. The result is compared with the file's triangles and refused if they do not imply its surface or
//! volume.

mod checks;
mod holes;
mod orientation;
mod report;
mod seams;
mod soup;

use nalgebra::Point3;

use self::report::MAX_FILLED_SHARE;
pub use self::report::RepairReport;
use self::soup::TriangleSoup;
use super::mesh::{GeometryError, Mesh};

/// Greatest share of the surface that dropped scraps may make up together.
const MAX_SCRAP_SHARE: f64 = 0.01;
/// Number of triangles above which a mesh is simplified: its distance field and convex parts would take minutes.
pub const MAX_TRIANGLES: usize = 40_000;

/// Returns the error for a fault and the reason why it was not mended.
fn repair_error(fault: &str, reason: impl Into<String>) -> GeometryError {
    GeometryError::NotRepaired { fault: fault.into(), reason: reason.into() }
}

impl Mesh {
    /// Returns the closed mesh that the triangles form, or are meant to form, in metres, with a report of the repairs.
    pub fn repaired(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(Self, RepairReport), GeometryError> {
        let fault = match Self::new(vertices.to_vec(), triangles.to_vec()) {
            Ok(mesh) if triangles.len() <= MAX_TRIANGLES && orientation::is_well_oriented(&mesh) => {
                return Ok((mesh, RepairReport::default()));
            }
            Ok(_) => "closed surfaces that face in- and outwards".to_owned(),
            Err(error @ GeometryError::ImplausibleSize { .. }) => return Err(error),
            Err(error) => error.to_string(),
        };
        let usable =
            |index: &u32| vertices.get(*index as usize).is_some_and(|at| at.iter().all(|part| part.is_finite()));
        if !triangles.iter().flatten().all(usable) {
            return Err(repair_error(&fault, "a triangle's corner is not finite"));
        }
        let mut repair = RepairReport::default();
        let mut soup = TriangleSoup { vertices: vertices.to_vec(), triangles: triangles.to_vec() };
        soup.weld(&mut repair);
        if soup.triangles.len() < 4 {
            return Err(repair_error(&fault, format!("only {} triangles have an area", soup.triangles.len())));
        }
        if soup.extent() > super::mesh::MAX_EXTENT {
            return Err(GeometryError::ImplausibleSize { found: soup.extent() });
        }
        soup.drop_duplicates(&mut repair);
        seams::close_seams(&mut soup, &mut repair);
        soup.drop_flaps(&mut repair);
        if orientation::orient_consistently(&mut soup, &mut repair).is_none() {
            return Err(repair_error(&fault, "its triangles have no consistent orientation, as on a Moebius strip"));
        }
        drop_scraps(&mut soup, &mut repair);
        let kept = soup.clone();
        fill_holes(&mut soup, &mut repair);
        rebuild_open(&mut soup, &mut repair).map_err(|reason| repair_error(&fault, reason))?;
        orientation::separate_touching(&mut soup);
        orientation::orient_outwards(&mut soup, &mut repair);
        let (vertices, triangles) = soup.compact();
        let mesh = Self::new(vertices, triangles).map_err(|error| repair_error(&fault, error.to_string()))?;
        let mesh = simplify_large(mesh, &mut repair).map_err(|error| repair_error(&fault, error.to_string()))?;
        checks::check(&kept, &mesh, &mut repair).map_err(|reason| repair_error(&fault, reason))?;
        Ok((mesh, repair))
    }
}

/// Drops open pieces whose share of the surface is negligible.
fn drop_scraps(soup: &mut TriangleSoup, repair: &mut RepairReport) {
    let (component, count) = soup.components();
    if count < 2 {
        return;
    }
    let pieces = soup.pieces(&component, count);
    let areas: Vec<f64> = pieces.iter().map(TriangleSoup::area).collect();
    let total: f64 = areas.iter().sum();
    let mut open: Vec<usize> = (0..count).filter(|n| areas[*n] < MAX_SCRAP_SHARE * total).collect();
    open.retain(|n| !holes::is_closed(&pieces[*n]));
    if open.is_empty() || open.iter().map(|n| areas[*n]).sum::<f64>() > MAX_SCRAP_SHARE * total {
        return;
    }
    repair.scraps += open.len();
    soup.retain(|number| !open.contains(&component[number]));
}

/// Closes holes if all of them together are a small part of the surface.
fn fill_holes(soup: &mut TriangleSoup, repair: &mut RepairReport) {
    let rims = holes::rims(soup);
    if rims.is_empty() {
        return;
    }
    let area = soup.area();
    let mut closed = soup.clone();
    for rim in &rims {
        let (fill, hub) = holes::fill(&closed, rim);
        closed.vertices.extend(hub);
        closed.triangles.extend(fill);
    }
    let filled = closed.area() - area;
    if filled <= MAX_FILLED_SHARE * area {
        *soup = closed;
        repair.holes = rims.len();
        repair.filled_share = filled / area;
    }
}

/// Rebuilds the open pieces, all in one, and leaves the closed ones as they are.
fn rebuild_open(soup: &mut TriangleSoup, repair: &mut RepairReport) -> Result<(), String> {
    let (component, count) = soup.components();
    let pieces = soup.pieces(&component, count);
    let open: Vec<bool> = pieces.iter().map(|piece| !holes::is_closed(piece)).collect();
    if !open.contains(&true) {
        return Ok(());
    }
    let broken = TriangleSoup {
        vertices: soup.vertices.clone(),
        triangles: (soup.triangles.iter().zip(&component))
            .filter(|(_, of)| open[**of])
            .map(|(triangle, _)| *triangle)
            .collect(),
    };
    let (mesh, cell) = checks::rebuilt(&broken)?;
    repair.rebuilt = Some(cell);
    soup.retain(|number| !open[component[number]]);
    let first = soup.vertices.len() as u32;
    soup.vertices.extend(mesh.vertices());
    soup.triangles.extend(mesh.triangles().iter().map(|triangle| triangle.map(|index| index + first)));
    Ok(())
}

/// Returns the mesh itself or, if it has very many triangles, a simplified one with just enough triangles to follow it.
fn simplify_large(mesh: Mesh, repair: &mut RepairReport) -> Result<Mesh, GeometryError> {
    let before = mesh.triangles().len();
    let mut target = MAX_TRIANGLES;
    while target < before {
        let (vertices, triangles) = super::simplify::simplify(mesh.vertices(), mesh.triangles(), target);
        let fewer = Mesh::new(vertices, triangles)?;
        if checks::follows(&fewer, &mesh) {
            repair.simplified = Some((before, fewer.triangles().len()));
            return Ok(fewer);
        }
        target *= 2;
    }
    Ok(mesh)
}

#[cfg(test)]
pub(in crate::geometry) mod tests;
