//! Holes of a consistently oriented surface.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::soup::{HalfEdge, MIN_DOUBLE_AREA, TriangleSoup};

/// Greatest number of edges of a loop for an optimal triangulation, whose cost is cubic; longer loops are closed by a
/// fan around their centre.
const MAX_LOOP_EDGES: usize = 80;

/// Returns the missing half-edges: for each edge used more often in one direction, one entry per excess use, in the
/// direction that a missing triangle would have.
fn missing_half_edges(sides: &[HalfEdge]) -> Vec<(u32, u32)> {
    let mut missing = Vec::new();
    for uses in sides.chunk_by(|a, b| a.edge == b.edge) {
        let (low, high) = uses[0].edge;
        let forward = uses.iter().filter(|side| side.forward).count();
        let backward = uses.len() - forward;
        missing.extend((backward..forward).map(|_| (high, low)));
        missing.extend((forward..backward).map(|_| (low, high)));
    }
    missing
}

/// True if every edge is used equally often in both directions.
pub fn is_closed(soup: &TriangleSoup) -> bool {
    missing_half_edges(&soup.half_edges()).is_empty()
}

/// Returns the rims of the holes, each in the direction of the missing triangles.
pub fn rims(soup: &TriangleSoup) -> Vec<Vec<u32>> {
    let mut onward: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (from, to) in missing_half_edges(&soup.half_edges()) {
        onward.entry(from).or_default().push(to);
    }
    let mut rims = Vec::new();
    while let Some((&start, _)) = onward.first_key_value() {
        let mut path = vec![start];
        // As many edges begin at a vertex as end there, so a walk ends where it began.
        while let Some(next) = path.last().and_then(|at| onward.get_mut(at)).and_then(Vec::pop) {
            match path.iter().position(|vertex| *vertex == next) {
                Some(place) => {
                    rims.push(path.split_off(place));
                    path.push(next);
                }
                None => path.push(next),
            }
        }
        onward.retain(|_, ends| !ends.is_empty());
    }
    rims.retain(|rim| rim.len() >= 3);
    rims
}

/// Returns triangles that close the hole inside a rim with the least area, and the additional vertex they need, if any.
pub fn fill(soup: &TriangleSoup, rim: &[u32]) -> (Vec<[u32; 3]>, Option<Point3<f64>>) {
    let at: Vec<Point3<f64>> = rim.iter().map(|index| soup.vertices[*index as usize]).collect();
    if rim.len() <= MAX_LOOP_EDGES
        && let Some(cut) = min_area_triangulation(&at)
    {
        return (cut.into_iter().map(|corners| corners.map(|n| rim[n])).collect(), None);
    }
    let middle = Point3::from(at.iter().map(|point| point.coords).sum::<Vector3<f64>>() / at.len() as f64);
    let hub = soup.vertices.len() as u32;
    let fan = (0..rim.len()).map(|n| [rim[n], rim[(n + 1) % rim.len()], hub]).collect();
    (fan, Some(middle))
}

/// Returns the triangulation of a polygon with the least area (Barequet & Sharir 1995); none if every triangulation has
/// a triangle without an area.
fn min_area_triangulation(at: &[Point3<f64>]) -> Option<Vec<[usize; 3]>> {
    let count = at.len();
    let area = |a: usize, b: usize, c: usize| {
        let double = (at[b] - at[a]).cross(&(at[c] - at[a])).norm();
        if double < MIN_DOUBLE_AREA { f64::INFINITY } else { 0.5 * double }
    };
    let mut least = vec![vec![(0.0, 0); count]; count];
    for width in 2..count {
        for from in 0..count - width {
            let to = from + width;
            let choices = (from + 1..to).map(|by| (least[from][by].0 + least[by][to].0 + area(from, by, to), by));
            least[from][to] = choices.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, from));
        }
    }
    if !least[0][count - 1].0.is_finite() {
        return None;
    }
    let (mut triangles, mut open) = (Vec::new(), vec![(0, count - 1)]);
    while let Some((from, to)) = open.pop() {
        if to - from < 2 {
            continue;
        }
        let by = least[from][to].1;
        triangles.push([from, by, to]);
        open.extend([(from, by), (by, to)]);
    }
    Some(triangles)
}
