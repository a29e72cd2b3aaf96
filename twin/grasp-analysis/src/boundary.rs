//! The boundary between power and precision grasps: a support-vector classifier with a Gaussian kernel, with its
//! accuracy on its own training data, as the paper reports it, and on unseen objects.
//!
//! Nothing is tuned. Both classes have the same total weight (C = n / 2 n_class; otherwise the larger class dominates).
//! The kernel exp(-|x - y|2 / (d v)) is as wide as the data, for d coordinates of mean variance v.

use linfa::DatasetBase;
use linfa::traits::{Fit, Predict};
use linfa_svm::Svm;
use ndarray::{Array1, Array2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::Serialize;

/// Stopping tolerance of the solver.
const SOLVER_TOLERANCE: f64 = 1e-3;
/// Number of bootstrap resamples for the interval.
const RESAMPLE_COUNT: usize = 2000;

/// Fewest objects for which an interval is given, as for samples in the benchmark.
const MIN_OBJECTS: usize = 5;

/// Errors of fitting a boundary.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoundaryError {
    /// All grasps are of one class.
    #[error("classes: found {power} power and {precision} precision grasps, expected some of both")]
    OneClass { power: usize, precision: usize },
    #[error("support vectors: {0}")]
    Solver(String),
}

/// A fitted boundary. `true` stands for power.
#[derive(Debug)]
pub struct Boundary {
    svm: Svm<f64, bool>,
}

impl Boundary {
    /// Fits a boundary between the `points` that are `power` and the others.
    pub fn fit(points: &[Vec<f64>], power: &[bool]) -> Result<Self, BoundaryError> {
        let count = power.iter().filter(|power| **power).count();
        if count == 0 || count == power.len() {
            return Err(BoundaryError::OneClass { power: count, precision: power.len() - count });
        }
        let (n, width) = (points.len(), points.first().map_or(0, Vec::len));
        let records = Array2::from_shape_fn((n, width), |(row, column)| points[row][column]);
        let spread: f64 = (0..width).map(|column| records.column(column).var(0.0)).sum();
        let data = DatasetBase::new(records, Array1::from(power.to_vec()));
        let params = Svm::<f64, bool>::params()
            .eps(SOLVER_TOLERANCE)
            .pos_neg_weights(0.5 * n as f64 / count as f64, 0.5 * n as f64 / (n - count) as f64)
            .gaussian_kernel(spread.max(f64::MIN_POSITIVE));
        let svm = params.fit(&data).map_err(|error| BoundaryError::Solver(error.to_string()))?;
        Ok(Self { svm })
    }

    /// True if the point lies on the power side.
    pub fn is_power(&self, point: &[f64]) -> bool {
        self.svm.predict(Array1::from(point.to_vec()))
    }

    /// Returns the number of support vectors.
    pub fn support_vectors(&self) -> usize {
        self.svm.nsupport()
    }

    /// Computes the balanced accuracy: the mean of the two classes' accuracies, 0.5 for a constant answer.
    pub fn balanced_accuracy(&self, points: &[Vec<f64>], power: &[bool]) -> f64 {
        let of = |class: bool| {
            let own = points.iter().zip(power).filter(|(_, power)| **power == class);
            let (right, all) = own
                .fold((0, 0), |(right, all), (point, _)| (right + usize::from(self.is_power(point) == class), all + 1));
            right as f64 / (all as f64).max(1.0)
        };
        0.5 * (of(true) + of(false))
    }

    /// Returns the share of `points` on the correct side.
    pub fn accuracy(&self, points: &[Vec<f64>], power: &[bool]) -> f64 {
        let right = points.iter().zip(power).filter(|(point, power)| self.is_power(point) == **power).count();
        right as f64 / points.len().max(1) as f64
    }
}

/// Accuracy on held-out objects with a 95 % interval, and the figures to compare it with.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct HeldOutAccuracy {
    /// Share of correct answers on objects that were left out of the fit.
    pub accuracy: f64,
    /// 2.5 % and 97.5 % quantiles over resampled objects. `None` for fewer than five objects, or if all have the same
    /// share of correct answers.
    pub interval: Option<[f64; 2]>,
    /// Mean of the two classes' accuracies, 0.5 for a constant answer.
    pub balanced: f64,
    /// Share of the larger class: the accuracy of always answering it.
    pub majority: f64,
    /// Results by object: (object, correct answers, grasps).
    pub objects: Vec<(String, usize, usize)>,
}

/// Leaves out each object in turn, fits to the others and counts correct answers on it. The interval is a bootstrap
/// over objects, because grasps of one object are correlated.
pub fn held_out(
    points: &[Vec<f64>],
    power: &[bool],
    objects: &[&str],
    seed: u64,
) -> Result<HeldOutAccuracy, BoundaryError> {
    let mut names: Vec<&str> = objects.to_vec();
    names.sort_unstable();
    names.dedup();
    let mut found = Vec::new();
    // Correct and total answers, for precision, then power.
    let mut by_class = [[0usize; 2]; 2];
    for name in &names {
        let pick = |inside: bool| (0..points.len()).filter(move |n| (objects[*n] == *name) == inside);
        let train: Vec<Vec<f64>> = pick(false).map(|n| points[n].clone()).collect();
        let boundary = Boundary::fit(&train, &pick(false).map(|n| power[n]).collect::<Vec<_>>())?;
        let (mut right, mut of) = (0, 0);
        for n in pick(true) {
            let good = usize::from(boundary.is_power(&points[n]) == power[n]);
            right += good;
            of += 1;
            let class = &mut by_class[usize::from(power[n])];
            class[0] += good;
            class[1] += 1;
        }
        found.push(((*name).to_owned(), right, of));
    }
    let share = |picked: &mut dyn Iterator<Item = &(String, usize, usize)>| {
        let (right, of) = picked.fold((0, 0), |(right, of), object| (right + object.1, of + object.2));
        right as f64 / of.max(1) as f64
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut resampled: Vec<f64> = (0..RESAMPLE_COUNT)
        .map(|_| share(&mut (0..found.len()).map(|_| &found[rng.random_range(0..found.len())])))
        .collect();
    resampled.sort_by(f64::total_cmp);
    let [low, high] = [resampled[RESAMPLE_COUNT / 40], resampled[RESAMPLE_COUNT - 1 - RESAMPLE_COUNT / 40]];
    let most = by_class[0][1].max(by_class[1][1]) as f64 / points.len().max(1) as f64;
    Ok(HeldOutAccuracy {
        accuracy: share(&mut found.iter()),
        interval: (found.len() >= MIN_OBJECTS && high > low).then_some([low, high]),
        balanced: by_class.iter().map(|[right, of]| *right as f64 / (*of).max(1) as f64).sum::<f64>() / 2.0,
        majority: most,
        objects: found,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk of power in a ring of precision grasps: not linearly separable, but separable with the kernel.
    fn ring(n: usize, seed: u64) -> (Vec<Vec<f64>>, Vec<bool>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n)
            .map(|k| {
                let power = k % 2 == 0;
                let radius = if power { rng.random_range(0.0..1.0) } else { rng.random_range(2.0..3.0) };
                let angle = rng.random_range(0.0..std::f64::consts::TAU);
                (vec![radius * f64::cos(angle), radius * f64::sin(angle)], power)
            })
            .unzip()
    }

    #[test]
    fn a_ring_around_a_disk() {
        let (points, power) = ring(200, 1);
        let boundary = Boundary::fit(&points, &power).expect("two classes");
        assert!(boundary.accuracy(&points, &power) > 0.99 && boundary.balanced_accuracy(&points, &power) > 0.99);
        let (others, their) = ring(200, 2);
        assert!(boundary.accuracy(&others, &their) > 0.98);
        assert!(boundary.is_power(&[0.0, 0.0]) && !boundary.is_power(&[2.5, 0.0]) && boundary.support_vectors() < 200);
    }

    /// If the class follows from the object only, training accuracy is high and held-out accuracy is not.
    #[test]
    fn memorised_objects_do_not_generalise() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
        let (mut points, mut power, mut objects) = (Vec::new(), Vec::new(), Vec::new());
        for (k, name) in names.iter().enumerate() {
            for _ in 0..20 {
                let place = 10.0 * k as f64;
                points.push(vec![place + rng.random_range(0.0..1.0), rng.random_range(0.0..1.0)]);
                power.push(k % 2 == 0);
                objects.push(*name);
            }
        }
        let out = held_out(&points, &power, &objects, 1).expect("two classes");
        assert!(out.accuracy < 0.4, "{out:?}");
        assert!(out.interval.is_none_or(|[low, high]| low <= out.accuracy && out.accuracy <= high), "{out:?}");
        let few: Vec<&str> = objects.iter().map(|name| if *name < "d" { *name } else { "d" }).collect();
        let out = held_out(&points, &power, &few, 1).expect("two classes");
        assert_eq!((out.objects.len(), out.interval), (4, None), "no interval comes out of four objects");
        assert_eq!(out.majority, 0.5);
        let (points, power) = ring(160, 4);
        let good = held_out(&points, &power, &objects, 1).expect("two classes");
        assert!(good.accuracy > 0.97 && good.balanced > 0.97, "{good:?}");
    }

    /// The accuracy of a small class is not sacrificed to a large class around it.
    #[test]
    fn few_against_many() {
        let (points, power) = ring(400, 5);
        let keep = |n: &usize| !power[*n] || n.is_multiple_of(20);
        let few: Vec<Vec<f64>> = (0..400).filter(keep).map(|n| vec![0.5 * points[n][0], 0.5 * points[n][1]]).collect();
        let classes: Vec<bool> = (0..400).filter(keep).map(|n| power[n]).collect();
        let boundary = Boundary::fit(&few, &classes).expect("two classes");
        assert!(boundary.balanced_accuracy(&few, &classes) > 0.95);
    }

    #[test]
    fn one_class_is_refused() {
        let error = Boundary::fit(&[vec![0.0, 0.0], vec![1.0, 0.0]], &[true, true]).expect_err("one class");
        assert_eq!(error, BoundaryError::OneClass { power: 2, precision: 0 });
        assert!(error.to_string().contains("some of both"));
    }
}
