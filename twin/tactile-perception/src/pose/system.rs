//! Accumulation of residuals into a cost or normal equations, and the kinematics they share.

use hand_model::Hand;
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};

/// Loss function of a residual, which is given in standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Loss {
    /// Half the square.
    Square,
    /// Quadratic up to this many standard deviations, linear beyond (Huber).
    Huber(f64),
}

impl Loss {
    fn cost(self, residual: f64) -> f64 {
        match self {
            Self::Huber(k) if residual.abs() > k => k * (residual.abs() - 0.5 * k),
            Self::Square | Self::Huber(_) => 0.5 * residual * residual,
        }
    }

    /// Weight of the squared residual with the same slope.
    fn weight(self, residual: f64) -> f64 {
        match self {
            Self::Square => 1.0,
            Self::Huber(k) => (k / residual.abs()).min(1.0),
        }
    }
}

/// Receives residuals: the scaled residual, its loss, the columns with non-zero derivatives (ascending), and a closure
/// that adds the derivative to a row.
pub(super) trait ResidualSink {
    fn add(&mut self, residual: f64, loss: Loss, columns: &[usize], row: &dyn Fn(&mut [f64]));
    fn wants_rows(&self) -> bool;
}

/// Sums the robust cost.
pub(super) struct Cost(pub f64);

impl ResidualSink for Cost {
    fn add(&mut self, residual: f64, loss: Loss, _: &[usize], _: &dyn Fn(&mut [f64])) {
        self.0 += loss.cost(residual);
    }
    fn wants_rows(&self) -> bool {
        false
    }
}

/// Builds the normal equations, and sums the robust cost as [`Cost`] does.
pub(super) struct NormalEquations {
    pub cost: f64,
    /// Lower triangle only, which is all that a Cholesky factorisation reads.
    pub hessian: DMatrix<f64>,
    pub gradient: DVector<f64>,
    row: Vec<f64>,
    /// Columns of fixed parameters.
    held: std::ops::Range<usize>,
}

impl NormalEquations {
    pub(crate) fn new(columns: usize, held: std::ops::Range<usize>) -> Self {
        Self {
            cost: 0.0,
            hessian: DMatrix::zeros(columns, columns),
            gradient: DVector::zeros(columns),
            row: vec![0.0; columns],
            held,
        }
    }
}

impl ResidualSink for NormalEquations {
    fn add(&mut self, residual: f64, loss: Loss, columns: &[usize], row: &dyn Fn(&mut [f64])) {
        self.cost += loss.cost(residual);
        let size = self.row.len();
        row(&mut self.row);
        let weight = loss.weight(residual);
        let hessian = self.hessian.as_mut_slice();
        for (n, &i) in columns.iter().enumerate() {
            if self.held.contains(&i) {
                continue;
            }
            let a = weight * self.row[i];
            self.gradient[i] += a * residual;
            let below = &mut hessian[i * size..(i + 1) * size];
            for &j in &columns[n..] {
                below[j] += if self.held.contains(&j) { 0.0 } else { a * self.row[j] };
            }
        }
        for &i in columns {
            self.row[i] = 0.0;
        }
    }
    fn wants_rows(&self) -> bool {
        true
    }
}

/// Link poses and joint axes at a posture, palm frame.
pub(super) struct Kinematics<'a> {
    pub links: Vec<Isometry3<f64>>,
    pub axes: Vec<Vector3<f64>>,
    chains: &'a [Vec<usize>],
}

impl<'a> Kinematics<'a> {
    /// `chains` holds the joints from the palm to each link.
    pub(crate) fn new(hand: &Hand, chains: &'a [Vec<usize>], q: &[f64]) -> Self {
        let links = hand.tree.forward(q);
        let axes = links.iter().zip(&hand.tree.joints).map(|(link, joint)| link * joint.axis.into_inner()).collect();
        Self { links, axes, chains }
    }
    pub(crate) fn pose(&self, link: Option<usize>) -> Isometry3<f64> {
        link.map_or(Isometry3::identity(), |link| self.links[link])
    }
    pub(crate) fn chain(&self, link: Option<usize>) -> &'a [usize] {
        link.map_or(&[], |link| &self.chains[link])
    }
    pub(crate) fn origin(&self, joint: usize) -> Vector3<f64> {
        self.links[joint].translation.vector
    }
}

/// Returns at most `most` of `items`, evenly spread.
pub(super) fn evenly_spaced<T: Copy>(items: &[T], most: usize) -> Vec<T> {
    let count = items.len().min(most);
    (0..count).map(|k| items[(2 * k + 1) * items.len() / (2 * count)]).collect()
}
