//! The evaluation as JSON.

use std::collections::BTreeSet;

use crate::touch::networks::{IN_USE, Method};
use anyhow::{Result, bail};
use serde_json::{Map, Value, json};
use statistics::percentile;

use super::{TouchEvaluation, of_method, steps};
use crate::touch::normals::{Measured, RealRow, RealSource};
use crate::touch::poses::{Class, FeltGrasp, PoseSource, causes, spread};

/// Everything measured.
pub fn to_json(found: &TouchEvaluation, seed: u64) -> Result<Value> {
    let rows = found.as_built();
    let ratios: Vec<f64> = found.felt.iter().map(|felt| felt.ratio).collect();
    Ok(json!({
        "seed": seed,
        "grasps": found.felt.len(),
        "normals": normals(rows, found.real.as_ref()),
        "height_rms_um": of_method(rows, IN_USE).and_then(|row| row.height_rms_um),
        "pose": poses(&found.felt)?,
        "error_over_sigma": {"median": percentile(&ratios, 50.0), "p95": percentile(&ratios, 95.0)},
        "latency_ms": latency(&found.felt),
        "changed": serde_json::to_value(&found.changed)?,
    }))
}

fn normals(rows: &[(Method, Measured)], real: Option<&(RealSource, Vec<RealRow>)>) -> Value {
    let best = real.and_then(|(_, real)| real.iter().find(|row| row.method == IN_USE && !row.simulated));
    let methods: Map<String, Value> =
        rows.iter().map(|(method, measured)| (method.name().into(), json!(measured))).collect();
    json!({
        "method": IN_USE,
        "unseen_shapes": of_method(rows, IN_USE),
        "real": best.map(|row| row.error),
        "unseen_shapes_by_method": methods,
        "real_by_method": real.map(|(_, rows)| rows),
        "real_source": real.map(|(source, _)| source),
    })
}

fn poses(felt: &[FeltGrasp]) -> Result<Value> {
    let all = |pick: &dyn Fn(&FeltGrasp) -> bool| -> Result<Value> {
        let touch = serde_json::to_value(spread(felt, PoseSource::Touch, pick))?;
        let Value::Object(mut row) = touch else { bail!("a row is an object") };
        row.insert("causes".into(), serde_json::to_value(causes(felt, pick))?);
        row.insert("plan".into(), serde_json::to_value(spread(felt, PoseSource::Plan, pick))?);
        row.insert("points_only".into(), serde_json::to_value(spread(felt, PoseSource::Points, pick))?);
        Ok(Value::Object(row))
    };
    let mut rows = Map::new();
    rows.insert("all".into(), all(&|_| true)?);
    for class in Class::ALL {
        rows.insert(class.name().into(), all(&|felt| felt.class == class)?);
    }
    let objects: BTreeSet<&str> = felt.iter().map(|felt| felt.object.as_str()).collect();
    let objects: Result<Map<_, _>> =
        objects.into_iter().map(|name| Ok((name.to_owned(), all(&|felt| felt.object == name)?))).collect();
    rows.insert("objects".into(), Value::Object(objects?));
    Ok(Value::Object(rows))
}

fn latency(felt: &[FeltGrasp]) -> Value {
    let rows = steps(felt).map(|(name, times)| {
        (name.to_owned(), json!({"p50": percentile(&times, 50.0), "p99": percentile(&times, 99.0)}))
    });
    Value::Object(rows.into_iter().collect())
}
