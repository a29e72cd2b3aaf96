//! Report of a repair, as numbers and as text.

use std::fmt;

/// Greatest share of the surface that may be filled where it has holes.
pub(super) const MAX_FILLED_SHARE: f64 = 0.1;

/// Repairs of a file's triangles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RepairReport {
    /// Number of vertices merged with another in the same place.
    pub welded: usize,
    /// Number of triangles without an area.
    pub degenerate: usize,
    /// Number of duplicate triangles, and of flaps on edges that were closed without them.
    pub duplicates: usize,
    /// Number of triangles flipped.
    pub flipped: usize,
    /// Number of loose scraps dropped.
    pub scraps: usize,
    /// Number of closed surfaces dropped because they lie inside the solid.
    pub enclosed: usize,
    /// Number of holes closed.
    pub holes: usize,
    /// Share of the surface that fills the holes.
    pub filled_share: f64,
    /// Cell size of the grid on which open surfaces were rebuilt, m.
    pub rebuilt: Option<f64>,
    /// Number of triangles before and after the simplification of a mesh with very many.
    pub simplified: Option<(usize, usize)>,
    /// Greatest distance of the file's triangles from the result, m.
    pub max_deviation: f64,
    /// Volume of the result, m3.
    pub volume: f64,
}

impl RepairReport {
    /// True if the mesh is unchanged from the file.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

fn count_text(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

impl fmt::Display for RepairReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut done = Vec::new();
        let mut tell = |count: usize, one: &str, many: &str, what: &str| {
            if count > 0 {
                done.push(format!("{} {what}", count_text(count, one, many)));
            }
        };
        tell(self.welded, "vertex", "vertices", "merged with others in the same place");
        tell(self.degenerate, "triangle", "triangles", "without an area left out");
        tell(self.duplicates, "duplicate triangle", "duplicate triangles", "left out");
        tell(self.flipped, "triangle", "triangles", "flipped");
        tell(self.scraps, "loose scrap", "loose scraps", "left out");
        tell(self.enclosed, "surface", "surfaces", "inside the solid left out");
        if self.holes > 0 {
            let share = 100.0 * self.filled_share;
            done.push(format!("{} closed, {share:.1} % of the surface", count_text(self.holes, "hole", "holes")));
        }
        if let Some(cell) = self.rebuilt {
            done.push(format!("open parts rebuilt with the winding number's sign on {:.1} mm cells", 1e3 * cell));
        }
        if let Some((before, after)) = self.simplified {
            done.push(format!("{before} triangles made {after}"));
        }
        let (off, volume) = (1e3 * self.max_deviation, 1e6 * self.volume);
        write!(out, "mended: {}; within {off:.2} mm of the file's triangles, {volume:.1} cm3", done.join(", "))
    }
}
