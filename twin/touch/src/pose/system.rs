//! What residuals are poured into, and the kinematics they share.

use hand_model::Hand;
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};

/// Receives residuals: scaled residual, Huber or not, and a closure that writes the derivative row.
pub(super) trait Sink {
    fn add(&mut self, residual: f64, huber: Option<f64>, row: &dyn Fn(&mut [f64]));
    fn wants_rows(&self) -> bool;
}

/// Sums the robust cost.
pub(super) struct Cost(pub f64);

impl Sink for Cost {
    fn add(&mut self, residual: f64, huber: Option<f64>, _: &dyn Fn(&mut [f64])) {
        self.0 += match huber {
            Some(k) if residual.abs() > k => k * (residual.abs() - 0.5 * k),
            _ => 0.5 * residual * residual,
        };
    }
    fn wants_rows(&self) -> bool {
        false
    }
}

/// Builds the normal equations.
pub(super) struct Normal {
    pub hessian: DMatrix<f64>,
    pub gradient: DVector<f64>,
    pub row: Vec<f64>,
    /// Columns that are held.
    pub held: std::ops::Range<usize>,
}

impl Sink for Normal {
    fn add(&mut self, residual: f64, huber: Option<f64>, row: &dyn Fn(&mut [f64])) {
        self.row.fill(0.0);
        row(&mut self.row);
        self.row[self.held.clone()].fill(0.0);
        let weight = huber.map_or(1.0, |k| (k / residual.abs()).min(1.0));
        for (i, &a) in self.row.iter().enumerate() {
            if a == 0.0 {
                continue;
            }
            self.gradient[i] += weight * a * residual;
            for (j, &b) in self.row.iter().enumerate() {
                self.hessian[(i, j)] += weight * a * b;
            }
        }
    }
    fn wants_rows(&self) -> bool {
        true
    }
}

/// Link poses and joint axes at a posture, palm frame.
pub(super) struct Kinematics {
    pub links: Vec<Isometry3<f64>>,
    pub axes: Vec<Vector3<f64>>,
    pub chains: Vec<Vec<usize>>,
}

impl Kinematics {
    pub fn new(hand: &Hand, q: &[f64]) -> Self {
        let links = hand.tree.forward(q);
        let axes = links.iter().zip(&hand.tree.joints).map(|(link, joint)| link * joint.axis.into_inner()).collect();
        Self { links, axes, chains: (0..hand.tree.len()).map(|link| hand.tree.chain(link)).collect() }
    }
    pub fn pose(&self, link: Option<usize>) -> Isometry3<f64> {
        link.map_or(Isometry3::identity(), |link| self.links[link])
    }
    pub fn chain(&self, link: Option<usize>) -> &[usize] {
        link.map_or(&[], |link| &self.chains[link])
    }
    pub fn origin(&self, joint: usize) -> Vector3<f64> {
        self.links[joint].translation.vector
    }
}

/// At most `most` of `items`, evenly spread.
pub(super) fn evenly<T: Copy>(items: &[T], most: usize) -> Vec<T> {
    let count = items.len().min(most);
    (0..count).map(|k| items[(2 * k + 1) * items.len() / (2 * count)]).collect()
}
