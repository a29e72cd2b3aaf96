//! A repair in numbers and in words.

use std::fmt;

/// Share of the surface that may be closed anew where it has holes.
pub(super) const MOST_FILLED: f64 = 0.1;

/// What was done to the triangles of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Repair {
    /// Vertices that lay in the place of another.
    pub welded: usize,
    /// Triangles without an area.
    pub empty: usize,
    /// Triangles that stood twice, or hung from an edge that was closed without them.
    pub doubled: usize,
    /// Triangles turned over.
    pub turned: usize,
    /// Loose scraps left out.
    pub scraps: usize,
    /// Closed surfaces left out because they lie inside of the solid.
    pub swallowed: usize,
    /// Holes closed.
    pub holes: usize,
    /// Share of the surface that closes them.
    pub filled: f64,
    /// Cell of the grid on which open surfaces were rebuilt, m.
    pub rebuilt: Option<f64>,
    /// Triangles before and after a mesh of very many was made coarser.
    pub coarser: Option<(usize, usize)>,
    /// How far the file's triangles lie from the result at most, m.
    pub off: f64,
    /// Volume of the result, m3.
    pub volume: f64,
}

impl Repair {
    /// Whether the mesh is as it was in the file.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

impl fmt::Display for Repair {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut done = Vec::new();
        let mut tell = |count: usize, one: &str, many: &str, what: &str| {
            if count > 0 {
                done.push(format!("{} {what}", counted(count, one, many)));
            }
        };
        tell(self.welded, "vertex", "vertices", "joined with others in the same place");
        tell(self.empty, "triangle", "triangles", "without an area left out");
        tell(self.doubled, "doubled triangle", "doubled triangles", "left out");
        tell(self.turned, "triangle", "triangles", "turned over");
        tell(self.scraps, "loose scrap", "loose scraps", "left out");
        tell(self.swallowed, "surface", "surfaces", "inside of the solid left out");
        if self.holes > 0 {
            let share = 100.0 * self.filled;
            done.push(format!("{} closed, {share:.1} % of the surface", counted(self.holes, "hole", "holes")));
        }
        if let Some(cell) = self.rebuilt {
            done.push(format!("what was open rebuilt with the winding number's sign on {:.1} mm cells", 1e3 * cell));
        }
        if let Some((before, after)) = self.coarser {
            done.push(format!("{before} triangles made {after}"));
        }
        let (off, volume) = (1e3 * self.off, 1e6 * self.volume);
        write!(out, "mended: {}; within {off:.2} mm of the file's triangles, {volume:.1} cm3", done.join(", "))
    }
}
