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

/// Returns the brightness factor of each pixel. `depth` (m towards the eye, rows of `width`) is minus infinity for the
/// background; a pixel is `pixel` m wide.
pub fn shading(depth: &[f64], width: usize, pixel: f64) -> Vec<f64> {
    let height = depth.len() / width.max(1);
    // Offsets of the sampled neighbours in one half of the circle, pixels, with their radii, m.
    let offsets: Vec<(isize, isize, f64)> = SAMPLE_RADII
        .iter()
        .flat_map(|radius| {
            let reach = (radius / pixel).max(1.0);
            (0..DIRECTION_COUNT).map(move |n| {
                let (sin, cos) = (std::f64::consts::PI * (n as f64 + 0.5) / DIRECTION_COUNT as f64).sin_cos();
                ((reach * cos).round() as isize, (reach * sin).round() as isize, *radius)
            })
        })
        .collect();
    // With a margin of background no neighbour is outside, and a row is a loop without branches.
    let margin = offsets.iter().map(|(dx, dy, _)| dx.unsigned_abs().max(dy.unsigned_abs())).max().unwrap_or(0);
    let row_length = width + 2 * margin;
    let mut padded = vec![f64::NEG_INFINITY; row_length * (height + 2 * margin)];
    for (y, row) in depth.chunks_exact(width.max(1)).enumerate() {
        padded[(y + margin) * row_length + margin..][..width].copy_from_slice(row);
    }
    let mut factors = Vec::with_capacity(depth.len());
    let mut hidden = vec![0.0; width];
    for y in 0..height {
        let first = (y + margin) * row_length + margin;
        let row = |shift: isize| &padded[first.wrapping_add_signed(shift)..][..width];
        let here = row(0);
        hidden.fill(0.0);
        for (dx, dy, radius) in &offsets {
            let shift = dy * row_length as isize + dx;
            for (((hidden, here), one), other) in hidden.iter_mut().zip(here).zip(row(shift)).zip(row(-shift)) {
                let step = |near: f64| ((near - here) / radius).clamp(-MAX_DEPTH_DIFFERENCE, MAX_DEPTH_DIFFERENCE);
                let mean = 0.5 * (step(*one) + step(*other));
                *hidden += ((mean - OCCLUSION_THRESHOLD) / (0.5 * MAX_DEPTH_DIFFERENCE)).clamp(0.0, 1.0);
            }
        }
        factors.extend(hidden.iter().zip(here).map(|(hidden, here)| {
            let hidden = hidden / offsets.len() as f64;
            if *here == f64::NEG_INFINITY { 1.0 } else { 1.0 - MAX_OCCLUSION_LOSS * (2.2 * hidden).min(1.0) }
        }));
    }
    factors
}

/// Returns the brightness factor of a pixel by its outline: it is lower where a neighbour is much farther away. `depth`
/// is as in [`shading`].
pub fn outline(depth: &[f64], width: usize, index: usize) -> f64 {
    let (column, here) = (index % width, depth[index]);
    let farther = |near: Option<&f64>| here - near.copied().unwrap_or(f64::NEG_INFINITY) > OUTLINE_DEPTH_STEP;
    let beside = [
        (column > 0).then(|| &depth[index - 1]),
        (column + 1 < width).then(|| &depth[index + 1]),
        index.checked_sub(width).map(|above| &depth[above]),
        depth.get(index + width),
    ];
    if here > f64::NEG_INFINITY && beside.into_iter().any(farther) { 1.0 - OUTLINE_LOSS } else { 1.0 }
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
        let outlines: Vec<f64> = (row..row + size).map(|index| outline(&depth, size, index)).collect();
        assert_eq!((outlines[1], outlines[4], outlines[5], outlines[31]), (1.0, 1.0 - OUTLINE_LOSS, 1.0, 1.0));
        assert_eq!(outlines[size - 1], 1.0 - OUTLINE_LOSS, "the picture's edge");
    }
}
