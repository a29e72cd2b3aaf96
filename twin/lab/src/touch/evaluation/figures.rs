//! Results of the evaluation as JSON.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::Serialize;
use statistics::percentile;

use super::{ChangedOptics, TouchEvaluation, of_method, step_latencies};
use crate::touch::networks::{METHOD_IN_USE, NormalMethod};
use crate::touch::normals::{NormalErrors, RealRow, RealSource};
use crate::touch::poses::{
    Causes, ErrorPercentiles, MedianP95, PoseEvaluation, PoseSource, SymmetryClass, causes, error_percentiles,
};

/// Errors of normals.
#[derive(Serialize, JsonSchema)]
struct Normals<'a> {
    /// Method for normals used in trials.
    method: NormalMethod,
    /// Errors on shapes that were not trained on.
    unseen_shapes: Option<NormalErrors>,
    /// Errors on presses of a real sensor.
    real: Option<NormalErrors>,
    unseen_shapes_by_method: BTreeMap<&'static str, NormalErrors>,
    real_by_method: Option<&'a [RealRow]>,
    real_source: Option<&'a RealSource>,
}

/// Errors of the in-hand poses of a group of grasps.
#[derive(Serialize, JsonSchema)]
struct Poses {
    #[serde(flatten)]
    touch: ErrorPercentiles,
    /// Shares of the grasps: truth in the 95 % region, large errors, and their causes.
    causes: Causes,
    /// Errors of the planned pose (the prior).
    prior: ErrorPercentiles,
    /// Errors of the estimate from servos and contact points only.
    points_only: ErrorPercentiles,
}

/// Errors of in-hand poses by class of object.
#[derive(Serialize, JsonSchema)]
struct PosesByClass {
    all: Poses,
    /// Objects with full rotational symmetry.
    ball: Poses,
    /// Objects with an axis of rotational symmetry.
    round: Poses,
    /// Objects with discrete rotational symmetry.
    #[serde(rename = "box")]
    cuboid: Poses,
    /// Objects without rotational symmetry.
    irregular: Poses,
    /// One entry per object.
    objects: BTreeMap<String, Poses>,
}

/// Latency of a step on this machine, ms.
#[derive(Serialize, JsonSchema)]
struct Latency {
    /// Median.
    p50: Option<f64>,
    /// 99th percentile.
    p99: Option<f64>,
}

/// Results of the evaluation.
#[derive(Serialize, JsonSchema)]
pub struct TouchEvaluationFigures<'a> {
    /// Seed of all random numbers.
    seed: u64,
    grasps: usize,
    normals: Normals<'a>,
    /// Root-mean-square error of heights, um.
    height_rms_um: Option<f64>,
    pose: PosesByClass,
    /// Ratio of position error to stated standard deviation.
    error_over_sigma: MedianP95,
    /// Latency of images, of the pose, and of both together, on this machine, ms.
    latency_ms: BTreeMap<&'static str, Latency>,
    /// Results under changes of the optics that are not in the training data.
    changed: &'a [ChangedOptics],
}

impl TouchEvaluation {
    /// Collects the results.
    pub fn figures(&self, seed: u64) -> TouchEvaluationFigures<'_> {
        let rows = self.as_built();
        let ratios: Vec<f64> = self.felt.iter().map(|felt| felt.ratio).collect();
        let latency = |times: &[f64]| Latency { p50: percentile(times, 50.0), p99: percentile(times, 99.0) };
        TouchEvaluationFigures {
            seed,
            grasps: self.felt.len(),
            normals: normals(rows, self.real.as_ref()),
            height_rms_um: of_method(rows, METHOD_IN_USE).and_then(|row| row.height_rms_um),
            pose: poses_by_class(&self.felt),
            error_over_sigma: MedianP95::of(&ratios),
            latency_ms: step_latencies(&self.felt).into_iter().map(|(name, times)| (name, latency(&times))).collect(),
            changed: &self.changed,
        }
    }
}

fn normals<'a>(rows: &[(NormalMethod, NormalErrors)], real: Option<&'a (RealSource, Vec<RealRow>)>) -> Normals<'a> {
    let best = real.and_then(|(_, real)| real.iter().find(|row| row.method == METHOD_IN_USE && !row.simulated));
    Normals {
        method: METHOD_IN_USE,
        unseen_shapes: of_method(rows, METHOD_IN_USE),
        real: best.map(|row| row.error),
        unseen_shapes_by_method: rows.iter().map(|(method, measured)| (method.name(), *measured)).collect(),
        real_by_method: real.map(|(_, rows)| rows.as_slice()),
        real_source: real.map(|(source, _)| source),
    }
}

fn poses(felt: &[PoseEvaluation], pick: &dyn Fn(&PoseEvaluation) -> bool) -> Poses {
    Poses {
        touch: error_percentiles(felt, PoseSource::Touch, pick),
        causes: causes(felt, pick),
        prior: error_percentiles(felt, PoseSource::Prior, pick),
        points_only: error_percentiles(felt, PoseSource::Points, pick),
    }
}

fn poses_by_class(felt: &[PoseEvaluation]) -> PosesByClass {
    let of = |class: SymmetryClass| poses(felt, &|felt| felt.class == class);
    let objects: BTreeSet<&str> = felt.iter().map(|felt| felt.object.as_str()).collect();
    PosesByClass {
        all: poses(felt, &|_| true),
        ball: of(SymmetryClass::Ball),
        round: of(SymmetryClass::Round),
        cuboid: of(SymmetryClass::Box),
        irregular: of(SymmetryClass::Irregular),
        objects: objects.into_iter().map(|name| (name.to_owned(), poses(felt, &|felt| felt.object == name))).collect(),
    }
}
