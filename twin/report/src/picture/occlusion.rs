//! Soft shadows in corners and dark outlines, from the depth buffer only ("screen-space ambient occlusion", Crytek
//! 2007).

/// Radii (m) at which neighbours are sampled, and number of directions.
const SAMPLE_RADII: [f64; 3] = [0.002, 0.005, 0.010];
const DIRECTION_COUNT: usize = 5;
/// Occlusion threshold, as a share of the radius. A pixel is occluded if the mean of two opposite neighbours is nearer
/// than it by more than this; on a plane it is not.
const OCCLUSION_THRESHOLD: f64 = 0.10;
/// Limit of a neighbour's depth difference, radii.
const MAX_DEPTH_DIFFERENCE: f64 = 1.2;
/// Share of the brightness lost by a fully surrounded pixel, and by one on an outline.
const MAX_OCCLUSION_LOSS: f64 = 0.62;
const OUTLINE_LOSS: f64 = 0.35;
/// Depth step that makes an outline, m.
const OUTLINE_DEPTH_STEP: f64 = 0.004;

/// Returns the brightness factor of each pixel. `depth` (m towards the eye, row-major, square) is minus infinity for
/// the background; a pixel is `pixel` m wide.
pub fn shading(depth: &[f64], size: usize, pixel: f64) -> Vec<f64> {
    let at = |x: i64, y: i64| {
        let inside = |v: i64| (0..size as i64).contains(&v);
        if inside(x) && inside(y) { depth[y as usize * size + x as usize] } else { f64::NEG_INFINITY }
    };
    let directions: Vec<(f64, f64)> = (0..DIRECTION_COUNT)
        .map(|n| (std::f64::consts::PI * (n as f64 + 0.5) / DIRECTION_COUNT as f64).sin_cos())
        .collect();
    let one = |index: usize| {
        let (x, y, here) = ((index % size) as i64, (index / size) as i64, depth[index]);
        if here == f64::NEG_INFINITY {
            return 1.0;
        }
        let mut hidden = 0.0;
        for radius in SAMPLE_RADII {
            let reach = (radius / pixel).max(1.0);
            for (sin, cos) in &directions {
                let (dx, dy) = ((reach * cos).round() as i64, (reach * sin).round() as i64);
                let step = |sign: i64| {
                    ((at(x + sign * dx, y + sign * dy) - here) / radius)
                        .clamp(-MAX_DEPTH_DIFFERENCE, MAX_DEPTH_DIFFERENCE)
                };
                hidden +=
                    ((0.5 * (step(1) + step(-1)) - OCCLUSION_THRESHOLD) / (0.5 * MAX_DEPTH_DIFFERENCE)).clamp(0.0, 1.0);
            }
        }
        let hidden = hidden / (SAMPLE_RADII.len() * DIRECTION_COUNT) as f64;
        let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dy)| at(x + dx, y + dy));
        let outline = beside.iter().any(|near| here - near > OUTLINE_DEPTH_STEP);
        (1.0 - MAX_OCCLUSION_LOSS * (2.2 * hidden).min(1.0)) * if outline { 1.0 - OUTLINE_LOSS } else { 1.0 }
    };
    (0..depth.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corner between a floor and a step towards the eye is darker than the open floor; the background keeps its
    /// brightness.
    #[test]
    fn corners_are_darker() {
        let (size, pixel) = (64, 5e-4);
        let depth: Vec<f64> = (0..size * size)
            .map(|n| match n % size {
                0..4 => f64::NEG_INFINITY,
                4..32 => 0.0,
                _ => 0.003,
            })
            .collect();
        let shade = shading(&depth, size, pixel);
        let row = 32 * size;
        assert!(shade[row + 30] < 0.85 && shade[row + 12] > 0.99, "{} {}", shade[row + 30], shade[row + 12]);
        assert_eq!(shade[row + 1], 1.0);
        assert!((shade[row + 4] - (1.0 - OUTLINE_LOSS)).abs() < 0.2, "outline {}", shade[row + 4]);
    }
}
