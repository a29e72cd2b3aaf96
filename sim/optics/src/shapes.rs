//! Twenty test shapes: those of the tactile shape set that the paper used (Gomes et al. 2021, without the cone).
//!
//! A shape is the height of its lowest points over a pad's plane, as [`press`](crate::press) takes it, with its features
//! towards the pad. The original files are not available, so the shapes are modelled by name at the set's scale of about
//! 10 mm.

use std::f64::consts::TAU;

/// Name and `z_object(x, y)`, m.
pub type TestShape = (&'static str, fn(f64, f64) -> Option<f64>);

/// The shapes, sorted by name.
pub const TEST_SHAPES: [TestShape; 20] = [
    ("cross_lines", |x, y| flat(bar(x, y, 0.8, 5.0) || bar(y, x, 0.8, 5.0))),
    ("curved_surface", |x, y| bar(x, y, 5.0, 5.0).then(|| 1e-3 * (1e3 * x).powi(2) / 16.0)),
    ("cylinder", |x, y| flat(radius(x, y) < 4.0)),
    ("cylinder_shell", |x, y| flat((3.2..4.4).contains(&radius(x, y)))),
    ("cylinder_side", |x, y| if bar(x, y, 4.0, 5.0) { lying_height(1e3 * x, 4.0) } else { None }),
    ("dot_in", |x, y| flat((1.5..4.5).contains(&radius(x, y)))),
    ("dots", |x, y| {
        let nearest = |v: f64| 1e3 * v - 3.0 * (1e3 * v / 3.0).round().clamp(-1.0, 1.0);
        lying_height(nearest(x).hypot(nearest(y)), 1.1)
    }),
    ("flat_slab", |x, y| flat(bar(x, y, 2.5, 5.0))),
    ("hexagon", |x, y| flat((0..6).all(|k| side(x, y, f64::from(k) / 6.0) < 3.8))),
    ("line", |x, y| flat(bar(x, y, 0.8, 5.0))),
    ("moon", |x, y| flat(radius(x, y) < 4.2 && radius(x - 2e-3, y) > 3.2)),
    ("pacman", |x, y| flat(radius(x, y) < 4.2 && y.atan2(x).abs() > 0.6)),
    ("parallel_lines", |x, y| flat([-3e-3, 0.0, 3e-3].iter().any(|at| bar(x - at, y, 0.6, 4.5)))),
    ("prism", |x, y| bar(x, y, 4.0, 5.0).then(|| 0.7 * x.abs())),
    ("random", |x, y| {
        let (u, v) = (1e3 * x, 1e3 * y);
        let bumps = (1.7 * u + 0.4 * v).sin() + (0.9 * u - 1.9 * v + 1.0).sin() + (2.3 * v + 0.5 * u + 2.0).sin();
        bar(x, y, 4.5, 4.5).then_some(0.2e-3 * (3.0 - bumps))
    }),
    ("sphere", |x, y| lying_height(radius(x, y), 4.0)),
    ("sphere2", |x, y| lying_height(radius(x, y), 7.0)),
    ("torus", |x, y| lying_height(radius(x, y) - 3.4, 1.0)),
    ("triangle", |x, y| flat((0..3).all(|k| side(x, y, f64::from(k) / 3.0 + 0.25) < 2.3))),
    ("wave1", |x, y| bar(x, y, 5.0, 4.5).then(|| 0.4e-3 * (1.0 - (TAU * 1e3 * x / 3.5).cos()))),
];

fn flat(inside: bool) -> Option<f64> {
    inside.then_some(0.0)
}

/// Computes the distance from the centre, mm.
fn radius(x: f64, y: f64) -> f64 {
    1e3 * x.hypot(y)
}

/// True if the point is in a rectangle of these half sizes, mm.
fn bar(x: f64, y: f64, half_x: f64, half_y: f64) -> bool {
    1e3 * x.abs() < half_x && 1e3 * y.abs() < half_y
}

/// Computes the coordinate (mm) along the direction at `turn` (fraction of a full turn).
fn side(x: f64, y: f64, turn: f64) -> f64 {
    let (sin, cos) = (TAU * turn).sin_cos();
    1e3 * (cos * x + sin * y)
}

/// Computes the height (m) of a ball or a lying rod of radius `r` at distance `off` from its centre, both mm.
fn lying_height(off: f64, r: f64) -> Option<f64> {
    let inside = r * r - off * off;
    (inside > 0.0).then(|| 1e-3 * (r - inside.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_shape_is_about_a_centimetre_and_touches_the_plane() {
        for (name, shape) in TEST_SHAPES {
            let (mut lowest, mut across) = (f64::INFINITY, 0.0f64);
            for at in 0..161 * 161 {
                let (x, y) = (1e-4 * f64::from(at % 161 - 80), 1e-4 * f64::from(at / 161 - 80));
                if let Some(z) = shape(x, y) {
                    assert!(z >= 0.0, "{name}");
                    lowest = lowest.min(z);
                    across = across.max(x.abs().max(y.abs()));
                }
            }
            assert!(lowest < 0.25e-3 && (3e-3..7.1e-3).contains(&across), "{name}: {lowest} {across}");
        }
    }
}
