//! Results of the evaluation as JSON.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::Serialize;
use statistics::percentile;

use super::{ChangedOptics, TouchEvaluation, of_method, steps};
use crate::touch::networks::{IN_USE, Method};
use crate::touch::normals::{Measured, RealRow, RealSource};
use crate::touch::poses::{Causes, Class, FeltGrasp, MedianP95, PoseSource, Spread, causes, spread};

/// Errors of normals.
#[derive(Serialize, JsonSchema)]
struct Normals<'a> {
    /// Method that trials use for normals.
    method: Method,
    /// Errors on shapes that were not trained on.
    unseen_shapes: Option<Measured>,
    /// Errors on presses of a real sensor.
    real: Option<Measured>,
    unseen_shapes_by_method: BTreeMap<&'static str, Measured>,
    real_by_method: Option<&'a [RealRow]>,
    real_source: Option<&'a RealSource>,
}

/// Errors of the in-hand poses of a group of grasps.
#[derive(Serialize, JsonSchema)]
struct Poses {
    #[serde(flatten)]
    touch: Spread,
    /// Shares of the grasps: truth in the 95 % region, large errors, and their causes.
    causes: Causes,
    /// Errors of the plan's prior.
    plan: Spread,
    /// Errors of the estimate from servos and felt points alone.
    points_only: Spread,
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
pub struct Figures<'a> {
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
    /// Results under changes of the optics that touch was not trained on.
    changed: &'a [ChangedOptics],
}

impl TouchEvaluation {
    /// Collects the results.
    pub fn figures(&self, seed: u64) -> Figures<'_> {
        let rows = self.as_built();
        let ratios: Vec<f64> = self.felt.iter().map(|felt| felt.ratio).collect();
        let latency = |times: &[f64]| Latency { p50: percentile(times, 50.0), p99: percentile(times, 99.0) };
        Figures {
            seed,
            grasps: self.felt.len(),
            normals: normals(rows, self.real.as_ref()),
            height_rms_um: of_method(rows, IN_USE).and_then(|row| row.height_rms_um),
            pose: poses_by_class(&self.felt),
            error_over_sigma: MedianP95::of(&ratios),
            latency_ms: steps(&self.felt).into_iter().map(|(name, times)| (name, latency(&times))).collect(),
            changed: &self.changed,
        }
    }
}

fn normals<'a>(rows: &[(Method, Measured)], real: Option<&'a (RealSource, Vec<RealRow>)>) -> Normals<'a> {
    let best = real.and_then(|(_, real)| real.iter().find(|row| row.method == IN_USE && !row.simulated));
    Normals {
        method: IN_USE,
        unseen_shapes: of_method(rows, IN_USE),
        real: best.map(|row| row.error),
        unseen_shapes_by_method: rows.iter().map(|(method, measured)| (method.name(), *measured)).collect(),
        real_by_method: real.map(|(_, rows)| rows.as_slice()),
        real_source: real.map(|(source, _)| source),
    }
}

fn poses(felt: &[FeltGrasp], pick: &dyn Fn(&FeltGrasp) -> bool) -> Poses {
    Poses {
        touch: spread(felt, PoseSource::Touch, pick),
        causes: causes(felt, pick),
        plan: spread(felt, PoseSource::Plan, pick),
        points_only: spread(felt, PoseSource::Points, pick),
    }
}

fn poses_by_class(felt: &[FeltGrasp]) -> PosesByClass {
    let of = |class: Class| poses(felt, &|felt| felt.class == class);
    let objects: BTreeSet<&str> = felt.iter().map(|felt| felt.object.as_str()).collect();
    PosesByClass {
        all: poses(felt, &|_| true),
        ball: of(Class::Ball),
        round: of(Class::Round),
        cuboid: of(Class::Box),
        irregular: of(Class::Irregular),
        objects: objects.into_iter().map(|name| (name.to_owned(), poses(felt, &|felt| felt.object == name))).collect(),
    }
}
