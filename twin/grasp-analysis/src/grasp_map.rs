//! Map of grasps by their contacts, with the boundary between power and precision grasps.
//!
//! The method is that of the paper's supplement. Contact maps are normalised and reduced to six principal components.
//! Farthest-point sampling takes 1,000 grasps, t-SNE places them in the plane, and a support-vector machine draws the
//! boundary. The accuracy on the training data is given together with the accuracy on objects left out.

use std::fmt::Write as _;

use hand_model::Hand;
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::Point3;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

use crate::boundary::{Boundary, BoundaryError, HeldOutAccuracy, held_out};
use crate::classification::Classification;
use crate::contact_map::{HAND_POINT_COUNT, contact_map, hand_points, normalize};
use crate::embedding::{EmbeddingError, farthest_points, pca, tsne};
use dexterous_grasping::taxonomy::Category;

/// Number of principal components kept.
const COMPONENT_COUNT: usize = 6;
const PERPLEXITY: f64 = 30.0;
const ITERATION_COUNT: usize = 1000;

/// Errors of making a map.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// Error of the projection.
    #[error(transparent)]
    Embedding(#[from] EmbeddingError),
    #[error(transparent)]
    Boundary(#[from] BoundaryError),
}

/// Boundaries of one map.
#[derive(Debug, Serialize, JsonSchema)]
struct SeedFigures {
    /// Seed of the map.
    seed: u64,
    /// Boundary in the plane of the map.
    map: FittedBoundary,
    /// Boundary in the space of the principal components.
    components: FittedBoundary,
}

/// Figures of all maps, as written to `map.json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct MapFigures {
    grasps: usize,
    /// Number of grasps on a map.
    sampled: usize,
    /// Number of points of a contact map.
    points: usize,
    /// Share of the variance that each principal component explains.
    explained: Vec<f64>,
    /// Number of power grasps.
    power: usize,
    /// Number of precision grasps.
    precision: usize,
    /// Number of intermediate grasps.
    intermediate: usize,
    /// Smallest and largest accuracy on the training set of a map, over the seeds.
    training_over_seeds: [f64; 2],
    seeds: Vec<SeedFigures>,
}

/// Settings of the maps.
#[derive(Debug, Clone, Copy)]
pub struct MapSettings {
    /// Maximum number of grasps on a map.
    pub max_grasps: usize,
    /// Number of maps, each from its own seed.
    pub maps: u64,
    /// First seed.
    pub seed: u64,
}

/// Fitted boundary in one space.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct FittedBoundary {
    /// Accuracy on the points it was fitted to.
    pub training: f64,
    /// Balanced accuracy on those points: the mean over both classes.
    pub training_balanced: f64,
    pub support_vectors: usize,
    /// Accuracy on objects left out.
    pub held_out: HeldOutAccuracy,
}

/// Map of one seed.
pub struct GraspMap {
    /// Indices of the grasps on the map.
    pub sampled: Vec<usize>,
    /// Positions of these grasps on the map, in the same order.
    pub positions: Vec<[f64; 2]>,
    /// Boundary in the plane of the map.
    pub boundary: Boundary,
    /// Accuracy of that boundary.
    pub plane: FittedBoundary,
    /// Accuracy of the boundary in the space of the components.
    pub components: FittedBoundary,
}

/// Maps of a set of grasps.
pub struct GraspMaps {
    /// Share of the variance that each component explains.
    pub explained: Vec<f64>,
    /// One map per seed.
    pub maps: Vec<GraspMap>,
}

/// Returns an error unless there are grasps of both broad types, power and precision. A boundary needs both.
pub fn check_both_classes(classification: &Classification) -> Result<(), BoundaryError> {
    let [power, precision] = [Category::Power, Category::Precision].map(|category| classification.count(category));
    if power == 0 || precision == 0 {
        return Err(BoundaryError::OneClass { power, precision });
    }
    Ok(())
}

/// Computes the normalised contact maps of all grasps. `distance` returns the signed distance, m, of a point in the
/// object's frame to the object with the given index.
pub fn contact_maps(
    hand: &Hand,
    classification: &Classification,
    distance: impl Fn(usize, &Point3<f64>) -> f64 + Sync,
    progress: &ProgressBar,
) -> Vec<Vec<f64>> {
    let points = hand_points(hand);
    progress.set_length(classification.grasps.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} contact maps [{elapsed} < {eta}]") {
        progress.set_style(style);
    }
    let mut maps: Vec<Vec<f64>> = classification
        .grasps
        .par_iter()
        .map(|grasp| {
            progress.inc(1);
            contact_map(hand, &points, &grasp.grasp, |point| distance(grasp.object, point))
        })
        .collect();
    progress.finish_and_clear();
    normalize(&mut maps);
    maps
}

impl GraspMaps {
    /// Computes maps of the grasps of `classification`, whose contact maps are `contacts`.
    pub fn compute(
        classification: &Classification,
        contacts: &[Vec<f64>],
        settings: &MapSettings,
    ) -> Result<Self, MapError> {
        let found = pca(contacts, COMPONENT_COUNT, settings.seed)?;
        let maps = (0..settings.maps)
            .into_par_iter()
            .map(|n| compute_map(classification, contacts, &found.scores, settings.max_grasps, settings.seed + n))
            .collect::<Result<_, _>>()?;
        Ok(Self { explained: found.explained, maps })
    }

    /// Returns the lowest and highest training accuracy in the plane over the seeds.
    fn training(&self) -> (f64, f64) {
        self.maps
            .iter()
            .map(|map| map.plane.training)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    }

    /// Returns the figures. The seeds count up from `seed`.
    pub fn figures(&self, classification: &Classification, seed: u64) -> MapFigures {
        let seeds = (seed..).zip(&self.maps);
        let (low, high) = self.training();
        MapFigures {
            grasps: classification.grasps.len(),
            sampled: self.maps.first().map_or(0, |map| map.sampled.len()),
            points: HAND_POINT_COUNT,
            explained: self.explained.clone(),
            power: classification.count(Category::Power),
            precision: classification.count(Category::Precision),
            intermediate: classification.count(Category::Intermediate),
            training_over_seeds: [low, high],
            seeds: seeds
                .map(|(seed, map)| SeedFigures { seed, map: map.plane.clone(), components: map.components.clone() })
                .collect(),
        }
    }

    /// Formats the figures as text. `grasps` is the number of all grasps.
    pub fn text(&self, grasps: usize) -> String {
        let Some(first) = self.maps.first() else { return String::new() };
        let explained: f64 = self.explained.iter().sum();
        let mut text = format!(
            "{} of {grasps} grasps; six components explain {:.1} % of the variance\n",
            first.sampled.len(),
            100.0 * explained
        );
        for (name, fitted) in [("t-SNE map", &first.plane), ("six components", &first.components)] {
            let out = &fitted.held_out;
            let interval = out
                .interval
                .map_or_else(String::new, |[low, high]| format!(" [{:.2}, {:.2}]", 100.0 * low, 100.0 * high));
            let _ = writeln!(
                text,
                "{name:15} training {:.2} % (paper 81.54 % on its map), balanced {:.2} %; objects left out {:.2} %{interval}, balanced {:.2} %; \
                 the larger class alone {:.2} %; {} support vectors",
                100.0 * fitted.training,
                100.0 * fitted.training_balanced,
                100.0 * out.accuracy,
                100.0 * out.balanced,
                100.0 * out.majority,
                fitted.support_vectors
            );
        }
        let (low, high) = self.training();
        let seeds = self.maps.len();
        let _ = writeln!(
            text,
            "training accuracy on the map over {seeds} seeds: {:.2} to {:.2} %",
            100.0 * low,
            100.0 * high
        );
        text
    }
}

fn compute_map(
    classification: &Classification,
    contacts: &[Vec<f64>],
    scores: &[Vec<f64>],
    most: usize,
    seed: u64,
) -> Result<GraspMap, MapError> {
    let first = seed as usize % contacts.len();
    let sampled = farthest_points(contacts, most, first);
    let rows: Vec<Vec<f64>> = sampled.iter().map(|row| scores[*row].clone()).collect();
    // A small set of grasps needs a lower perplexity.
    let perplexity = PERPLEXITY.min((sampled.len() as f64 - 1.0) / 3.5);
    let places = tsne(&rows, perplexity, ITERATION_COUNT, seed)?;
    let category = |row: usize| classification.category(&classification.grasps[row]);
    let of_two: Vec<usize> = (0..sampled.len()).filter(|k| category(sampled[*k]) != Category::Intermediate).collect();
    let power: Vec<bool> = of_two.iter().map(|k| category(sampled[*k]) == Category::Power).collect();
    let object = |k: &usize| classification.object(&classification.grasps[sampled[*k]]);
    let objects: Vec<&str> = of_two.iter().map(object).collect();
    let fit = |points: Vec<Vec<f64>>| -> Result<(Boundary, FittedBoundary), MapError> {
        let boundary = Boundary::fit(&points, &power)?;
        let fitted = FittedBoundary {
            training: boundary.accuracy(&points, &power),
            training_balanced: boundary.balanced_accuracy(&points, &power),
            support_vectors: boundary.support_vectors(),
            held_out: held_out(&points, &power, &objects, seed)?,
        };
        Ok((boundary, fitted))
    };
    let (boundary, plane) = fit(of_two.iter().map(|k| places[*k].to_vec()).collect())?;
    let (_, components) = fit(of_two.iter().map(|k| rows[*k].clone()).collect())?;
    Ok(GraspMap { sampled, positions: places, boundary, plane, components })
}
