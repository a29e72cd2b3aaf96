//! Force balance: the depth at which the gel bears a given force.

use crate::error::OpticsError;
use crate::foundation::GelFoundation;

/// Step (m) of the finite difference for the slope of a pressure law.
const SLOPE_STEP: f64 = 1e-8;

/// Solution of the force balance.
pub(super) struct ForceBalance {
    /// Displacement of the object into the pad, m.
    pub(super) shift: f64,
    /// Force that the gel bears there, N.
    pub(super) force: f64,
}

/// Solves the force balance by bracketed Newton iteration; `None` if nothing is above the pad.
pub(super) fn balance<'a>(
    maps: impl Iterator<Item = (&'a [f32], f64)>,
    gel: &GelFoundation,
    force: f64,
) -> Result<Option<ForceBalance>, OpticsError> {
    gel.check()?;
    let winkler = gel.exponent == 1.0 && gel.hardening == 0.0;
    let stiffness = gel.modulus / gel.thickness;
    let maps: Vec<(Vec<f32>, f64)> =
        maps.map(|(map, area)| (map.iter().copied().filter(|p| p.is_finite()).collect(), area)).collect();
    let all = || maps.iter().flat_map(|(map, _)| map);
    let (deepest, shallowest) =
        all().fold((f32::NEG_INFINITY, f32::INFINITY), |(most, least), &p| (most.max(p), least.min(p)));
    if !deepest.is_finite() {
        return Ok(None);
    }
    let limit = gel.thickness as f32;
    let evaluate = |shift: f64| {
        let shift = shift as f32;
        maps.iter().fold((0.0, 0.0), |(force, slope), (map, area)| {
            if !winkler {
                let bears = |shift: f64| area * map.iter().map(|&p| gel.pressure(f64::from(p) + shift)).sum::<f64>();
                let found = bears(f64::from(shift));
                return (force + found, slope + (bears(f64::from(shift) + SLOPE_STEP) - found) / SLOPE_STEP);
            }
            let weight = area * stiffness;
            let (mut sum, mut active) = (0.0f64, 0u32);
            for p in map {
                let depth = p + shift;
                sum += f64::from(depth.clamp(0.0, limit));
                active += u32::from(depth > 0.0 && depth < limit);
            }
            (force + weight * sum, slope + weight * f64::from(active))
        })
    };
    let (mut low, mut high) = (-f64::from(deepest), gel.thickness - f64::from(deepest));
    if evaluate(high).0 < force {
        low = high;
        high = gel.thickness - f64::from(shallowest) + 1e-6;
        let (most, _) = evaluate(high);
        if most <= force {
            return Ok(Some(ForceBalance { shift: high, force: most }));
        }
    }
    let mut shift = 0.5 * (low + high);
    for _ in 0..60 {
        let (found, slope) = evaluate(shift);
        if found > force {
            high = shift
        } else {
            low = shift
        }
        let newton = shift - (found - force) / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = (next - shift).abs();
        shift = next;
        if step < 1e-9 {
            break;
        }
    }
    Ok(Some(ForceBalance { shift, force: evaluate(shift).0 }))
}
