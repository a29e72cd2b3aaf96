//! The disconnectivity tree (Becker and Karplus 1997) by its exact rule: two minima join at the lowest energy over
//! which a path connects them (minimax). Merging by increasing barrier is single linkage, and the merges are the tree.

use schemars::JsonSchema;
use serde::Serialize;

/// A merge of two branches. Branches 0..n are the minima, n + k is merge k.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct BranchMerge {
    /// Energy at which the branches join.
    pub height: f64,
    pub branches: [usize; 2],
}

/// A tree, or several trees without a known path between them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DisconnectivityTree {
    /// Energies of the minima.
    pub energies: Vec<f64>,
    /// Merges by increasing height.
    pub merges: Vec<BranchMerge>,
    /// Branches that never merge.
    pub roots: Vec<usize>,
    /// Minima from left to right, so that no branches cross. The lower side of each merge comes first.
    pub order: Vec<usize>,
}

/// Builds the tree of minima with `energies` from `barriers` (a, b, energy of the pass).
pub fn tree(energies: &[f64], barriers: &[(usize, usize, f64)]) -> DisconnectivityTree {
    let n = energies.len();
    let mut sorted = barriers.to_vec();
    sorted.sort_by(|a, b| a.2.total_cmp(&b.2).then((a.0, a.1).cmp(&(b.0, b.1))));
    let mut group: Vec<usize> = (0..n).collect();
    let mut branch: Vec<usize> = (0..n).collect();
    let mut merges: Vec<BranchMerge> = Vec::new();
    // Lowest energy of each branch.
    let mut lowest = energies.to_vec();
    for (a, b, height) in sorted {
        let (a, b) = (find_root(&mut group, a), find_root(&mut group, b));
        if a == b {
            continue;
        }
        let mut branches = [branch[a], branch[b]];
        branches.sort_by(|a, b| lowest[*a].total_cmp(&lowest[*b]).then(a.cmp(b)));
        lowest.push(lowest[branches[0]]);
        group[a] = b;
        branch[b] = n + merges.len();
        merges.push(BranchMerge { height, branches });
    }
    let mut roots: Vec<usize> = (0..n).filter(|x| find_root(&mut group, *x) == *x).map(|x| branch[x]).collect();
    roots.sort_by(|a, b| lowest[*a].total_cmp(&lowest[*b]).then(a.cmp(b)));
    let mut order = Vec::with_capacity(n);
    let mut open: Vec<usize> = roots.iter().rev().copied().collect();
    while let Some(next) = open.pop() {
        if next < n {
            order.push(next);
        } else {
            let [first, second] = merges[next - n].branches;
            open.extend([second, first]);
        }
    }
    DisconnectivityTree { energies: energies.to_vec(), merges, roots, order }
}

fn find_root(group: &mut [usize], mut x: usize) -> usize {
    while group[x] != x {
        group[x] = group[group[x]];
        x = group[x];
    }
    x
}

impl DisconnectivityTree {
    /// Returns the energy of the lowest known path between two minima, if there is one.
    pub fn minimax(&self, a: usize, b: usize) -> Option<f64> {
        if a == b {
            return Some(self.energies[a]);
        }
        let n = self.energies.len();
        let mut at = [a, b];
        for (k, merge) in self.merges.iter().enumerate() {
            let held = at.map(|x| merge.branches.contains(&x));
            if held == [true, true] {
                return Some(merge.height);
            }
            for (x, held) in at.iter_mut().zip(held) {
                if held {
                    *x = n + k;
                }
            }
        }
        None
    }

    /// Returns the horizontal position of every branch: minima in order at 0, 1, 2..., and a merge halfway between its
    /// two branches.
    pub fn horizontal_positions(&self) -> Vec<f64> {
        let n = self.energies.len();
        let mut places = vec![0.0; n + self.merges.len()];
        for (place, minimum) in self.order.iter().enumerate() {
            places[*minimum] = place as f64;
        }
        for (k, merge) in self.merges.iter().enumerate() {
            places[n + k] = 0.5 * (places[merge.branches[0]] + places[merge.branches[1]]);
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn three_minima() {
        let found = tree(&[0.0, -1.0, 0.5], &[(0, 1, 2.0), (1, 2, 3.0), (0, 2, 1.5)]);
        assert_eq!(found.merges[0], BranchMerge { height: 1.5, branches: [0, 2] });
        assert_eq!(found.merges[1], BranchMerge { height: 2.0, branches: [1, 3] });
        assert_eq!(found.order, [1, 0, 2]);
        assert_eq!(found.minimax(1, 2), Some(2.0), "over 0, although 3.0 is the direct pass");
    }

    #[test]
    fn islands_stay_apart() {
        let found = tree(&[0.0, 1.0, 2.0], &[(0, 1, 3.0)]);
        assert_eq!((found.roots.len(), found.minimax(0, 2)), (2, None));
        assert_eq!(found.order.len(), 3);
    }

    proptest! {
        /// The tree's merges are the minimax energies of the graph, compared with Floyd-Warshall with max in place of
        /// the sum.
        #[test]
        fn joins_are_minimax(
            edges in proptest::collection::vec((0usize..7, 0usize..7, 1.0..9.0_f64), 0..20),
        ) {
            let energies = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
            let found = tree(&energies, &edges);
            let mut way = [[f64::INFINITY; 7]; 7];
            for &(a, b, height) in &edges {
                way[a][b] = way[a][b].min(height);
                way[b][a] = way[a][b];
            }
            for k in 0..7 {
                for a in 0..7 {
                    for b in 0..7 {
                        way[a][b] = way[a][b].min(way[a][k].max(way[k][b]));
                    }
                }
            }
            for (a, row) in way.iter().enumerate() {
                for (b, lowest) in row.iter().enumerate().filter(|(b, _)| *b != a) {
                    prop_assert_eq!(found.minimax(a, b).unwrap_or(f64::INFINITY), *lowest);
                }
            }
        }
    }
}
