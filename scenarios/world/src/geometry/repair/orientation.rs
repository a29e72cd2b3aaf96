//! Consistent orientation of triangles: neighbours run along their common edge in opposite directions, and outer
//! surfaces face outwards.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::report::RepairReport;
use super::soup::{DisjointSets, HalfEdge, TriangleSoup};
use crate::geometry::mesh::Mesh;
use crate::geometry::winding::WindingTree;

/// Greatest number of edges that are split where surfaces touch.
const MAX_CROWDED_EDGES: usize = 1000;
/// Number of points of a surface that are tested for lying inside another.
const PROBE_COUNT: usize = 9;

/// A triangle's neighbour, with true if exactly one of the two must be flipped.
type Neighbour = (u32, bool);

/// Sorts an edge's triangles by their angle around it, counter-clockwise about the edge from its lower vertex.
fn sort_around_edge(soup: &TriangleSoup, uses: &[HalfEdge]) -> Vec<HalfEdge> {
    let (low, high) = uses[0].edge;
    let (from, to) = (soup.vertices[low as usize], soup.vertices[high as usize]);
    let axis = (to - from).normalize();
    let out = |side: &HalfEdge| {
        let third = soup.triangles[side.triangle as usize].into_iter().find(|index| *index != low && *index != high);
        let along = soup.vertices[third.unwrap_or(low) as usize] - from;
        along - axis * axis.dot(&along)
    };
    let first = out(&uses[0]).try_normalize(1e-12).unwrap_or_else(Vector3::x);
    let second = axis.cross(&first);
    let angle = |side: &HalfEdge| {
        let out = out(side);
        let angle = out.dot(&second).atan2(out.dot(&first));
        if angle < -1e-9 { angle + std::f64::consts::TAU } else { angle }
    };
    let mut sorted: Vec<(f64, HalfEdge)> = uses.iter().map(|side| (angle(side), *side)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    sorted.into_iter().map(|(_, side)| side).collect()
}

/// Returns the adjacency of triangles whose orientations must agree. If more than two triangles meet at an edge, those
/// next to each other around it bound the solid from either side.
fn neighbours(soup: &TriangleSoup, crowded: bool) -> Vec<Vec<Neighbour>> {
    let mut neighbours = vec![Vec::new(); soup.triangles.len()];
    let mut meet = |a: &HalfEdge, b: &HalfEdge| {
        let turned = a.forward == b.forward;
        neighbours[a.triangle as usize].push((b.triangle, turned));
        neighbours[b.triangle as usize].push((a.triangle, turned));
    };
    for uses in soup.half_edges().chunk_by(|a, b| a.edge == b.edge) {
        match uses {
            [a, b] => meet(a, b),
            _ if crowded && uses.len().is_multiple_of(2) => {
                let sorted = sort_around_edge(soup, uses);
                (0..sorted.len()).for_each(|n| meet(&sorted[n], &sorted[(n + 1) % sorted.len()]));
            }
            _ => {}
        }
    }
    neighbours
}

/// Flips triangles so that all neighbours agree. Each patch keeps the orientation of the larger part of its area. None
/// if no choice makes them agree.
pub fn orient_consistently(soup: &mut TriangleSoup, repair: &mut RepairReport) -> Option<()> {
    let turns = find_flips(soup, true).or_else(|| find_flips(soup, false))?;
    for (triangle, turn) in soup.triangles.iter_mut().zip(&turns) {
        if *turn {
            triangle.swap(1, 2);
        }
    }
    repair.flipped += turns.into_iter().filter(|turn| *turn).count();
    Some(())
}

fn find_flips(soup: &TriangleSoup, crowded: bool) -> Option<Vec<bool>> {
    let neighbours = neighbours(soup, crowded);
    let mut turn: Vec<Option<bool>> = vec![None; soup.triangles.len()];
    for start in 0..turn.len() {
        if turn[start].is_some() {
            continue;
        }
        turn[start] = Some(false);
        let (mut patch, mut next) = (vec![start], 0);
        while let Some(&at) = patch.get(next) {
            next += 1;
            for (other, differs) in &neighbours[at] {
                let wanted = turn[at].map(|turn| turn != *differs);
                match &mut turn[*other as usize] {
                    place @ None => {
                        *place = wanted;
                        patch.push(*other as usize);
                    }
                    known if *known != wanted => return None,
                    _ => {}
                }
            }
        }
        let area = |wanted: bool| -> f64 {
            let of = patch.iter().filter(|number| turn[**number] == Some(wanted));
            of.map(|number| soup.double_area(&soup.triangles[*number]).norm()).sum()
        };
        if area(true) > area(false) {
            patch.iter().for_each(|number| turn[*number] = turn[*number].map(|turn| !turn));
        }
    }
    Some(turn.into_iter().map(|turn| turn == Some(true)).collect())
}

/// True if every closed surface of a mesh has the orientation that [`orient_outwards`] would give it.
pub fn is_well_oriented(mesh: &Mesh) -> bool {
    let mut soup = TriangleSoup { vertices: mesh.vertices().to_vec(), triangles: mesh.triangles().to_vec() };
    if soup.components().1 == 1 {
        return true;
    }
    let mut repair = RepairReport::default();
    orient_outwards(&mut soup, &mut repair);
    repair.is_none()
}

/// Orients outer surfaces outwards. Inside another surface, one with the opposite orientation is a cavity and stays;
/// one with the same orientation is a solid within a solid and is dropped.
pub fn orient_outwards(soup: &mut TriangleSoup, repair: &mut RepairReport) {
    let (component, count) = soup.components();
    let pieces = soup.pieces(&component, count);
    let volumes: Vec<f64> = pieces.iter().map(volume).collect();
    let around = containers(&pieces);
    // The outermost surface around each piece determines the outer side.
    let outermost = |n: usize| around[n].iter().copied().find(|outer| around[*outer].is_empty()).unwrap_or(n);
    let turned: Vec<bool> = (0..count).map(|n| volumes[outermost(n)] < 0.0).collect();
    let swallowed: Vec<bool> = (0..count)
        .map(|n| {
            let faces_out = (volumes[n] < 0.0) == turned[n];
            let inside_cavities = around[n].iter().filter(|outer| (volumes[**outer] < 0.0) != turned[n]).count();
            let inside_solids = around[n].len() - inside_cavities;
            faces_out && inside_solids > inside_cavities
        })
        .collect();
    for (triangle, of) in soup.triangles.iter_mut().zip(&component) {
        if turned[*of] {
            triangle.swap(1, 2);
        }
    }
    // If everything faces inwards, it is flipped without a report, as in any closed mesh.
    if turned.iter().any(|turned| *turned) && !turned.iter().all(|turned| *turned) {
        repair.flipped += component.iter().filter(|of| turned[**of]).count();
    }
    repair.enclosed += swallowed.iter().filter(|inside| **inside).count();
    soup.retain(|number| !swallowed[component[number]]);
}

/// Returns for each piece the pieces that contain it.
fn containers(pieces: &[TriangleSoup]) -> Vec<Vec<usize>> {
    let bounds: Vec<_> = pieces.iter().map(bounds).collect();
    let around = |inner: usize| {
        let within = |outer: &usize| {
            let ((low, high), (least, most)) = (&bounds[inner], &bounds[*outer]);
            *outer != inner && (0..3).all(|axis| low[axis] >= least[axis] && high[axis] <= most[axis])
        };
        let own = &pieces[inner];
        let probes: Vec<Point3<f64>> = (own.triangles.iter().step_by(1 + own.triangles.len() / PROBE_COUNT))
            .map(|triangle| {
                Point3::from(own.corners(triangle).iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0)
            })
            .collect();
        let holds = |outer: &usize| {
            let winding = WindingTree::new(&pieces[*outer].vertices, &pieces[*outer].triangles);
            2 * probes.iter().filter(|probe| winding.winding_number(probe).abs() > 0.5).count() > probes.len()
        };
        (0..pieces.len()).filter(within).filter(holds).collect()
    };
    (0..pieces.len()).map(around).collect()
}

fn bounds(soup: &TriangleSoup) -> (Vector3<f64>, Vector3<f64>) {
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let used = soup.triangles.iter().flatten().map(|index| soup.vertices[*index as usize].coords);
    used.fold(start, |(low, high), at| (low.inf(&at), high.sup(&at)))
}

/// Returns the signed volume by the divergence theorem about the centroid of the triangles, m3. For a surface with
/// small holes, it is close to that of the closed one.
pub fn volume(soup: &TriangleSoup) -> f64 {
    let (mut middle, mut total) = (Vector3::zeros(), 0.0);
    for triangle in &soup.triangles {
        let [a, b, c] = soup.corners(triangle);
        let area = soup.double_area(triangle).norm();
        middle += (a.coords + b.coords + c.coords) * (area / 3.0);
        total += area;
    }
    let middle = Point3::from(middle / f64::max(total, f64::MIN_POSITIVE));
    let part = |triangle: &[u32; 3]| {
        let [a, b, c] = soup.corners(triangle).map(|corner| corner - middle);
        a.dot(&b.cross(&c)) / 6.0
    };
    soup.triangles.iter().map(part).sum()
}

/// Separates surfaces that touch along an edge by giving each its own copy of the edge. Where four or more triangles
/// meet, those with only air between them stay together.
pub fn separate_touching(soup: &mut TriangleSoup) {
    let sides = soup.half_edges();
    if sides.chunk_by(|a, b| a.edge == b.edge).all(|uses| uses.len() == 2) {
        return;
    }
    let corner_at = |triangles: &[[u32; 3]], side: &HalfEdge, vertex: u32| {
        let place = triangles[side.triangle as usize].iter().position(|index| *index == vertex).unwrap_or(0);
        3 * side.triangle + place as u32
    };
    let mut union = DisjointSets::new(3 * soup.triangles.len());
    let mut join = |a: &HalfEdge, b: &HalfEdge| {
        for vertex in [a.edge.0, a.edge.1] {
            union.merge(corner_at(&soup.triangles, a, vertex), corner_at(&soup.triangles, b, vertex));
        }
    };
    for uses in sides.chunk_by(|a, b| a.edge == b.edge) {
        let sorted = if uses.len() == 2 { uses.to_vec() } else { sort_around_edge(soup, uses) };
        for (n, side) in sorted.iter().enumerate().filter(|(_, side)| side.forward) {
            // The outside of a triangle that runs forward is on the side of increasing angle.
            let next = (1..sorted.len()).map(|k| &sorted[(n + k) % sorted.len()]).find(|other| !other.forward);
            next.into_iter().for_each(|next| join(side, next));
        }
    }
    let mut copies: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut taken = vec![false; soup.vertices.len()];
    for corner in 0..3 * soup.triangles.len() as u32 {
        let root = union.root(corner);
        let index = soup.triangles[corner as usize / 3][corner as usize % 3];
        let copy = *copies.entry((index, root)).or_insert_with(|| {
            if !std::mem::replace(&mut taken[index as usize], true) {
                return index;
            }
            soup.vertices.push(soup.vertices[index as usize]);
            soup.vertices.len() as u32 - 1
        });
        soup.triangles[corner as usize / 3][corner as usize % 3] = copy;
    }
    split_crowded_edges(soup);
}

/// Splits edges that touching surfaces still share because they are connected at both ends: each surface gets its own
/// midpoint of the edge.
fn split_crowded_edges(soup: &mut TriangleSoup) {
    for _ in 0..MAX_CROWDED_EDGES {
        let sides = soup.half_edges();
        let Some(uses) = sides.chunk_by(|a, b| a.edge == b.edge).find(|uses| uses.len() > 2) else { return };
        let sorted = sort_around_edge(soup, uses);
        let (low, high) = uses[0].edge;
        let middle = nalgebra::center(&soup.vertices[low as usize], &soup.vertices[high as usize]);
        for (n, side) in sorted.iter().enumerate().filter(|(_, side)| side.forward) {
            let next = (1..sorted.len()).map(|k| &sorted[(n + k) % sorted.len()]).find(|other| !other.forward);
            soup.vertices.push(middle);
            let own = soup.vertices.len() as u32 - 1;
            for cut in next.into_iter().chain([side]) {
                let triangle = soup.triangles[cut.triangle as usize];
                let [to_low, to_high] =
                    [low, high].map(|end| triangle.map(|index| if index == end { own } else { index }));
                soup.triangles[cut.triangle as usize] = to_low;
                soup.triangles.push(to_high);
            }
        }
    }
}
