//! Seams: edges of the surface that coincide without sharing their vertices.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::report::RepairReport;
use super::soup::{DisjointSets, TriangleSoup};

/// Distance below which vertices of open edges are merged, relative to the mesh's extent.
const WELD_TOLERANCE: f64 = 1e-4;
/// Greatest number of pairs of open edges and open vertices that are compared.
const MAX_PAIRS: usize = 200_000_000;

/// Returns the edges that are not shared by exactly two triangles, and their vertices in order.
fn open_edges(soup: &TriangleSoup) -> (Vec<(u32, u32)>, Vec<u32>) {
    let edges: Vec<(u32, u32)> = soup
        .half_edges()
        .chunk_by(|a, b| a.edge == b.edge)
        .filter(|uses| uses.len() != 2)
        .map(|uses| uses[0].edge)
        .collect();
    let mut vertices: Vec<u32> = edges.iter().flat_map(|(low, high)| [*low, *high]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    (edges, vertices)
}

/// Closes seams: merges open vertices that nearly coincide, and splits edges at vertices that lie on them.
pub fn close_seams(soup: &mut TriangleSoup, repair: &mut RepairReport) {
    let (edges, vertices) = open_edges(soup);
    if edges.is_empty() {
        return;
    }
    let tolerance = WELD_TOLERANCE * soup.extent();
    weld_near(soup, &vertices, tolerance, repair);
    // A split edge may lie beside a triangle that is split later.
    for _ in 0..3 {
        let (edges, vertices) = open_edges(soup);
        if edges.is_empty()
            || edges.len() * vertices.len() > MAX_PAIRS
            || split_at_vertices(soup, &edges, &vertices, tolerance) == 0
        {
            return;
        }
        soup.drop_degenerate(repair);
        soup.drop_duplicates(repair);
    }
}

fn weld_near(soup: &mut TriangleSoup, vertices: &[u32], tolerance: f64, repair: &mut RepairReport) {
    let cell = |at: &Point3<f64>| [at.x, at.y, at.z].map(|part| (part / tolerance).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut union = DisjointSets::new(soup.vertices.len());
    for &vertex in vertices {
        let at = soup.vertices[vertex as usize];
        let [x, y, z] = cell(&at);
        for (dx, dy, dz) in (-1..=1).flat_map(|dx| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dz| (dx, dy, dz)))) {
            for other in cells.get(&[x + dx, y + dy, z + dz]).into_iter().flatten() {
                if (soup.vertices[*other as usize] - at).norm() <= tolerance {
                    union.merge(vertex, *other);
                }
            }
        }
        cells.entry([x, y, z]).or_default().push(vertex);
    }
    let target: Vec<u32> = (0..soup.vertices.len() as u32).map(|vertex| union.root(vertex)).collect();
    soup.renumber(&target, repair);
}

/// Splits triangles at open vertices that lie on their open edges. Returns the number of edges split.
fn split_at_vertices(soup: &mut TriangleSoup, edges: &[(u32, u32)], vertices: &[u32], tolerance: f64) -> usize {
    let mut on: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    for &(low, high) in edges {
        let (from, to) = (soup.vertices[low as usize], soup.vertices[high as usize]);
        let along: Vector3<f64> = to - from;
        let length = along.norm();
        let place = |vertex: u32| {
            let out = soup.vertices[vertex as usize] - from;
            let share = out.dot(&along) / (length * length);
            let off = (out - along * share).norm();
            let inside = share * length > tolerance && (1.0 - share) * length > tolerance;
            (inside && off <= tolerance && vertex != low && vertex != high).then_some((share, vertex))
        };
        let mut between: Vec<(f64, u32)> = vertices.iter().filter_map(|vertex| place(*vertex)).collect();
        if !between.is_empty() {
            between.sort_by(|a, b| a.0.total_cmp(&b.0));
            on.insert((low, high), between.into_iter().map(|(_, vertex)| vertex).collect());
        }
    }
    let mut triangles = Vec::with_capacity(soup.triangles.len());
    let mut open = std::mem::take(&mut soup.triangles);
    open.reverse();
    while let Some(triangle) = open.pop() {
        let cut = (0..3).find_map(|corner| {
            let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
            let between = on.get(&(from.min(to), from.max(to)))?;
            let third = triangle[(corner + 2) % 3];
            (!between.contains(&third)).then(|| (from, to, third, between.clone()))
        });
        match cut {
            Some((from, to, third, mut between)) => {
                if from > to {
                    between.reverse();
                }
                let mut at = from;
                for next in between.into_iter().chain([to]) {
                    open.push([at, next, third]);
                    at = next;
                }
            }
            None => triangles.push(triangle),
        }
    }
    soup.triangles = triangles;
    on.len()
}
