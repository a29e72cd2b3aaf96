//! Embedding of high-dimensional vectors in a plane: principal components, farthest-point sampling, t-SNE.

use linfa::traits::Transformer;
use linfa_tsne::TSneParams;
use nalgebra::{DMatrix, DVector};
use ndarray::Array2;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EmbeddingError {
    /// An argument does not fit the data.
    #[error("{field}: found {found}, expected {expected}")]
    Argument { field: &'static str, found: String, expected: String },
    #[error("t-SNE: {0}")]
    Tsne(String),
}

/// Additional vectors in the subspace iteration, which speed up the convergence of the last requested component.
const EXTRA_VECTORS: usize = 6;
/// Maximum number of iterations. The variances converge to 1e-10 long before.
const MAX_ITERATIONS: usize = 300;

/// The leading principal components.
#[derive(Debug, Clone)]
pub struct Pca {
    /// Coordinates of each row along the components, largest variance first.
    pub scores: Vec<Vec<f64>>,
    /// Share of the total variance explained by each component.
    pub explained: Vec<f64>,
}

/// Computes the first `count` principal components of `rows` by subspace iteration from a seeded start.
pub fn pca(rows: &[Vec<f64>], count: usize, seed: u64) -> Result<Pca, EmbeddingError> {
    let (n, width) = (rows.len(), rows.first().map_or(0, Vec::len));
    if count == 0 || count > width.min(n.saturating_sub(1)) {
        return Err(EmbeddingError::Argument {
            field: "components",
            found: count.to_string(),
            expected: format!("1 to {} for {n} rows of {width}", width.min(n.saturating_sub(1))),
        });
    }
    let mut data = DMatrix::from_fn(n, width, |row, column| rows[row][column]);
    for mut column in data.column_iter_mut() {
        let mean = column.mean();
        column.add_scalar_mut(-mean);
    }
    let whole = data.norm_squared();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let carried = (count + EXTRA_VECTORS).min(width);
    let mut basis = DMatrix::from_fn(width, carried, |_, _| rng.random_range(-1.0..1.0_f64)).qr().q();
    let mut last = DVector::<f64>::zeros(carried);
    let transposed = data.transpose();
    for _ in 0..MAX_ITERATIONS {
        let scores: DMatrix<f64> = &data * &basis;
        // Rotate the basis so that the scores are uncorrelated, largest variance first.
        let moments: DMatrix<f64> = scores.transpose() * &scores;
        let eigen = moments.symmetric_eigen();
        let mut order: Vec<usize> = (0..carried).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let turn = DMatrix::from_fn(carried, carried, |row, column| eigen.eigenvectors[(row, order[column])]);
        let values = DVector::from_fn(carried, |row, _| eigen.eigenvalues[order[row]].max(0.0));
        basis = &basis * turn;
        let settled = (0..count).all(|k| (values[k] - last[k]).abs() <= 1e-10 * values[0]);
        last = values;
        if settled {
            break;
        }
        basis = (&transposed * (&data * &basis)).qr().q();
    }
    // A component's sign is arbitrary: its largest coordinate is made positive.
    for mut column in basis.column_iter_mut() {
        if column[column.iamax()] < 0.0 {
            column.neg_mut();
        }
    }
    let scores: DMatrix<f64> = &data * basis.columns(0, count);
    Ok(Pca {
        scores: scores.row_iter().map(|row| row.iter().copied().collect()).collect(),
        explained: (0..count).map(|k| if whole > 0.0 { last[k] / whole } else { 0.0 }).collect(),
    })
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Selects rows by farthest-point sampling: indices of up to `count` rows, starting with `first`, each with the largest
/// distance from those before it (the first of equals).
pub fn farthest_points(rows: &[Vec<f64>], count: usize, first: usize) -> Vec<usize> {
    let mut chosen = Vec::new();
    let mut distance = vec![f64::INFINITY; rows.len()];
    let mut next = first;
    while chosen.len() < count.min(rows.len()) {
        chosen.push(next);
        distance[next] = -1.0;
        let here = &rows[next];
        let mut best = (f64::NEG_INFINITY, 0);
        for (n, row) in rows.iter().enumerate() {
            if distance[n] >= 0.0 {
                distance[n] = distance[n].min(squared(here, row));
            }
            if distance[n] > best.0 {
                best = (distance[n], n);
            }
        }
        next = best.1;
    }
    chosen
}

/// Computes a t-SNE map of `rows` into the plane. `linfa-tsne` always starts from the same small random positions, so
/// the seed permutes their assignment to the rows.
pub fn tsne(rows: &[Vec<f64>], perplexity: f64, iterations: usize, seed: u64) -> Result<Vec<[f64; 2]>, EmbeddingError> {
    let (n, width) = (rows.len(), rows.first().map_or(0, Vec::len));
    if width < 2 || (n.saturating_sub(1) as f64) < 3.0 * perplexity {
        return Err(EmbeddingError::Argument {
            field: "rows",
            found: format!("{n} of width {width}"),
            expected: format!("more than {:.0} of width 2 or more", 3.0 * perplexity),
        });
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let data = Array2::from_shape_fn((n, width), |(row, column)| rows[order[row]][column]);
    let params = TSneParams::embedding_size(2).perplexity(perplexity).approx_threshold(0.5).max_iter(iterations);
    let map: Array2<f64> = params.transform(data).map_err(|error| EmbeddingError::Tsne(error.to_string()))?;
    let mut placed = vec![[0.0; 2]; n];
    for (row, &original) in order.iter().enumerate() {
        placed[original] = [map[(row, 0)], map[(row, 1)]];
    }
    if placed.iter().flatten().any(|x| !x.is_finite()) {
        return Err(EmbeddingError::Tsne("positions that are no numbers (do all rows coincide?)".into()));
    }
    Ok(placed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(n: usize, width: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n)
            .map(|_| (0..width).map(|k| rng.random_range(-1.0..1.0) * (1.0 + 3.0 / (k + 1) as f64)).collect())
            .collect()
    }

    /// Subspace iteration finds the components of a full singular value decomposition.
    #[test]
    fn components_of_a_small_cloud() {
        let rows = cloud(40, 12, 1);
        let found = pca(&rows, 3, 5).expect("enough rows");
        let mut data = DMatrix::from_fn(40, 12, |row, column| rows[row][column]);
        for mut column in data.column_iter_mut() {
            let mean = column.mean();
            column.add_scalar_mut(-mean);
        }
        let exact = data.clone().svd(false, true);
        let whole: f64 = exact.singular_values.iter().map(|s| s * s).sum();
        let mut values: Vec<f64> = exact.singular_values.iter().map(|s| s * s / whole).collect();
        values.sort_by(|a, b| b.total_cmp(a));
        for k in 0..3 {
            assert!((found.explained[k] - values[k]).abs() < 1e-8, "{k}");
            let spread: f64 = found.scores.iter().map(|row| row[k] * row[k]).sum();
            assert!((spread / whole - values[k]).abs() < 1e-6);
        }
    }

    #[test]
    fn another_start_gives_the_same_components() {
        let rows = cloud(60, 20, 2);
        let (a, b) = (pca(&rows, 4, 1).expect("fine"), pca(&rows, 4, 2).expect("fine"));
        for (x, y) in a.scores.iter().flatten().zip(b.scores.iter().flatten()) {
            assert!((x - y).abs() < 1e-3, "{x} {y}");
        }
        assert!(pca(&rows, 21, 1).is_err() && pca(&rows[..3], 3, 1).is_err());
    }

    #[test]
    fn farthest_points_spread_out() {
        let rows: Vec<Vec<f64>> = (0..=10).map(|x| vec![f64::from(x)]).collect();
        assert_eq!(farthest_points(&rows, 3, 0), [0, 10, 5]);
        let all = farthest_points(&rows, 50, 4);
        assert_eq!(all.len(), 11, "no more than there are, none twice: {all:?}");
    }

    /// Two far clouds stay apart on the map, and a seed gives the same map again.
    #[test]
    fn two_clouds_stay_two() {
        let mut rows = cloud(40, 5, 3);
        rows.extend(cloud(40, 5, 4).into_iter().map(|row| row.iter().map(|x| x + 40.0).collect()));
        let map = tsne(&rows, 8.0, 400, 9).expect("enough rows");
        let center = |part: &[[f64; 2]]| [0, 1].map(|k| part.iter().map(|p| p[k]).sum::<f64>() / part.len() as f64);
        let (a, b) = (center(&map[..40]), center(&map[40..]));
        for (n, p) in map.iter().enumerate() {
            let (own, other) = if n < 40 { (a, b) } else { (b, a) };
            assert!(squared(p, &own) < squared(p, &other), "{n}");
        }
        assert_eq!(map, tsne(&rows, 8.0, 400, 9).expect("enough rows"));
        assert!(tsne(&rows[..10], 8.0, 100, 1).is_err());
    }
}
