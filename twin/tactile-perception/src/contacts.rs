//! Height map to contact patches: position, force and surface of each contact on the gel.
//!
//! The gel bulges smoothly around a contact beyond its rim. A pixel is *raised* where the height is above the noise, and
//! *in contact* where it is above a fraction of its patch's peak; the two thresholds act as a hysteresis. Points on the
//! object's surface are taken only from the upper, inner part of a patch, where the gel lies against the object. The
//! normal force is computed from the whole raised area, because smoothing redistributes the indented volume but preserves
//! it.

use hand_model::pads::{IMAGE_SIZE as N, Pad, PadCamera};
use hand_model::parameters::Gel;
use nalgebra::{Point3, Vector2, Vector3};

/// Thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactOptions {
    /// Height above which the gel counts as raised, m.
    pub raised: f32,
    /// Peak height that a patch must reach, m.
    pub peak: f32,
    /// Fraction of the peak above which a raised pixel is in contact.
    pub contact_fraction: f32,
    /// Fraction of the peak above which surface points are taken.
    pub inner_fraction: f32,
    /// Least number of contact pixels of a patch.
    pub min_pixels: usize,
    /// Largest number of surface points of a patch.
    pub max_points: usize,
}

impl Default for ContactOptions {
    fn default() -> Self {
        Self { raised: 4e-5, peak: 8e-5, contact_fraction: 0.35, inner_fraction: 0.5, min_pixels: 12, max_points: 60 }
    }
}

/// A point on the object's surface as a pad feels it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Position of the point, m, pad frame.
    pub point: Point3<f64>,
    /// Unit vector out of the object, pad frame: it points into the pad.
    pub normal: Vector3<f64>,
}

/// A connected contact on one camera's image.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactPatch {
    /// Index of the camera that sees it.
    pub camera: usize,
    /// Contact area, m2.
    pub area: f64,
    /// Centre of pressure on the deformed surface, m, pad frame.
    pub centroid: Point3<f64>,
    /// Principal axes of the contact area in the pad's plane, longer first, unit vectors.
    pub axes: [Vector2<f64>; 2],
    /// Standard deviation of the area along `axes`, m.
    pub extent: [f64; 2],
    /// Mean of the object's outward normals weighted by pressure, unit vector, pad frame.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
    /// Largest indentation, m.
    pub peak: f64,
    /// Points on the object in the inner part of the contact, on an even grid.
    pub points: Vec<SurfacePoint>,
    /// True if another part of the hand presses here, and no object: see [`crate::self_contact`].
    pub self_contact: bool,
}

/// Slope of the indentation at a pixel over two pixels to each side, pad frame.
fn slope(height: &[f32], column: usize, row: usize, (dx, dy): (f64, f64)) -> (f64, f64) {
    let (left, right) = (column.saturating_sub(2), (column + 2).min(N - 1));
    let (up, down) = (row.saturating_sub(2), (row + 2).min(N - 1));
    (
        f64::from(height[row * N + right] - height[row * N + left]) / ((right - left) as f64 * dx),
        f64::from(height[up * N + column] - height[down * N + column]) / ((down - up) as f64 * dy),
    )
}

/// Height map of one camera, with the camera's pad.
#[derive(Clone, Copy)]
struct View<'a> {
    pad: &'a Pad,
    camera_index: usize,
    camera: &'a PadCamera,
    /// Height map, m, row-major.
    height: &'a [f32],
}

/// Point on the object's surface at a contact pixel.
fn surface_point(View { pad, camera, height, .. }: View, column: usize, row: usize) -> SurfacePoint {
    const DIFFERENCE_STEP: f64 = 1e-4;
    let (x, y) = camera.pixel_center(column, row);
    let (gx, gy) = slope(height, column, row, camera.pixel_size());
    let sx = (pad.surface_height(x + DIFFERENCE_STEP, y) - pad.surface_height(x - DIFFERENCE_STEP, y))
        / (2.0 * DIFFERENCE_STEP);
    let sy = (pad.surface_height(x, y + DIFFERENCE_STEP) - pad.surface_height(x, y - DIFFERENCE_STEP))
        / (2.0 * DIFFERENCE_STEP);
    SurfacePoint {
        point: Point3::new(x, y, pad.surface_height(x, y) - f64::from(height[row * N + column])),
        normal: Vector3::new(sx - gx, sy - gy, -1.0).normalize(),
    }
}

/// Finds the contact patches in one camera's height map (m, `IMAGE_SIZE` squared), strongest first.
pub fn find_contacts(
    pad: &Pad,
    camera_index: usize,
    camera: &PadCamera,
    gel: Gel,
    height: &[f32],
    options: &ContactOptions,
) -> Vec<ContactPatch> {
    let mut label = vec![0u32; height.len()];
    let mut patches = Vec::new();
    let mut next = 1;
    for start in 0..height.len() {
        if label[start] != 0 || height[start] <= options.raised {
            continue;
        }
        let hill = flood_fill(height, &mut label, start, next, options.raised);
        next += 1;
        let top = hill.iter().map(|&i| height[i]).fold(0.0, f32::max);
        if top < options.peak {
            continue;
        }
        // Within a hill, each connected summit above the contact level is a contact. The volume of the whole hill is
        // divided between them.
        let level = options.raised.max(options.contact_fraction * top);
        let summits = summits(height, &mut label, &mut next, &hill, level, options.min_pixels);
        let volume = |pixels: &[usize]| pixels.iter().map(|&i| f64::from(height[i])).sum::<f64>();
        let share = volume(&hill) / summits.iter().map(|summit| volume(summit)).sum::<f64>();
        for summit in &summits {
            patches.push(describe(View { pad, camera_index, camera, height }, gel, summit, share, options));
        }
    }
    patches.sort_by(|a, b| b.force.total_cmp(&a.force));
    patches
}

/// Finds and marks with `mark` the pixels connected to `start` above `level`.
fn flood_fill(height: &[f32], label: &mut [u32], start: usize, mark: u32, level: f32) -> Vec<usize> {
    let mut found = vec![start];
    label[start] = mark;
    let mut done = 0;
    while done < found.len() {
        let i = found[done];
        done += 1;
        let (column, row) = (i % N, i / N);
        let neighbours = [
            (column > 0).then(|| i - 1),
            (column + 1 < N).then(|| i + 1),
            (row > 0).then(|| i - N),
            (row + 1 < N).then(|| i + N),
        ];
        for j in neighbours.into_iter().flatten() {
            if label[j] != mark && height[j] > level {
                label[j] = mark;
                found.push(j);
            }
        }
    }
    found
}

/// Finds the connected parts of a hill above `level`.
fn summits(
    height: &[f32],
    label: &mut [u32],
    next: &mut u32,
    hill: &[usize],
    level: f32,
    least: usize,
) -> Vec<Vec<usize>> {
    let first = *next;
    let mut summits = Vec::new();
    for &start in hill {
        if label[start] < first && height[start] > level {
            let summit = flood_fill(height, label, start, *next, level);
            *next += 1;
            if summit.len() >= least {
                summits.push(summit);
            }
        }
    }
    summits
}

/// Describes the patch of one contact. `share` scales the volume over `pixels` up to that of the bulge around them.
fn describe(view: View, gel: Gel, pixels: &[usize], share: f64, options: &ContactOptions) -> ContactPatch {
    let View { camera_index, camera, height, .. } = view;
    let (dx, dy) = camera.pixel_size();
    let at = |i: usize| camera.pixel_center(i % N, i / N);
    let count = pixels.len() as f64;
    let (mut mean, mut pressure_centre, mut normal) = (Vector2::zeros(), Vector3::zeros(), Vector3::zeros());
    let (mut volume, mut peak) = (0.0, 0.0f32);
    for &i in pixels {
        let (x, y) = at(i);
        let h = f64::from(height[i]);
        let surface = surface_point(view, i % N, i / N);
        mean += Vector2::new(x, y) / count;
        pressure_centre += surface.point.coords * h;
        normal += surface.normal * h;
        volume += h;
        peak = peak.max(height[i]);
    }
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for &i in pixels {
        let (x, y) = at(i);
        let d = Vector2::new(x, y) - mean;
        xx += d.x * d.x / count;
        xy += d.x * d.y / count;
        yy += d.y * d.y / count;
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let (half_sum, half_difference) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    let long = Vector2::new(angle.cos(), angle.sin());
    // Every n-th inner pixel along rows and columns: an even, deterministic subsample.
    let inner = |i: &&usize| height[**i] >= options.inner_fraction * peak;
    let inner_count = pixels.iter().filter(inner).count();
    let mut stride = ((inner_count as f64 / options.max_points.max(1) as f64).sqrt().ceil() as usize).max(1);
    let on_grid = |stride: usize| {
        let mut chosen: Vec<usize> = pixels
            .iter()
            .filter(inner)
            .copied()
            .filter(|i| (i % N).is_multiple_of(stride) && (i / N).is_multiple_of(stride))
            .collect();
        chosen.sort_unstable();
        chosen
    };
    let mut chosen = on_grid(stride);
    while chosen.len() > options.max_points {
        stride += 1;
        chosen = on_grid(stride);
    }
    if chosen.is_empty() {
        chosen = pixels.iter().filter(inner).copied().take(1).collect();
    }
    ContactPatch {
        camera: camera_index,
        area: count * dx * dy,
        centroid: Point3::from(pressure_centre / volume),
        axes: [long, Vector2::new(-long.y, long.x)],
        extent: [(half_sum + half_difference).sqrt(), (half_sum - half_difference).max(0.0).sqrt()],
        normal: normal.normalize(),
        force: gel.stiffness * volume * share * dx * dy,
        peak: f64::from(peak),
        points: chosen.into_iter().map(|i| surface_point(view, i % N, i / N)).collect(),
        self_contact: false,
    }
}

/// Points of the pad's surface (pad frame) on an even grid of `nx` by `ny` over the camera's view where nothing
/// presses; all of them if `height` is `None`. The object cannot be at these points.
pub fn contact_free_points(
    pad: &Pad,
    camera: &PadCamera,
    height: Option<&[f32]>,
    raised: f32,
    nx: usize,
    ny: usize,
) -> Vec<Point3<f64>> {
    let mut points = Vec::with_capacity(nx * ny);
    for j in 0..ny {
        for i in 0..nx {
            let (column, row) = ((2 * i + 1) * N / (2 * nx), (2 * j + 1) * N / (2 * ny));
            if height.is_some_and(|height| height[row * N + column] > raised) {
                continue;
            }
            let (x, y) = camera.pixel_center(column, row);
            points.push(Point3::new(x, y, pad.surface_height(x, y)));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::Hand;

    /// Indentation by balls (x, y, depth) of radius `r`.
    fn balls(camera: &PadCamera, pad: &Pad, r: f64, balls: &[(f64, f64, f64)]) -> Vec<f32> {
        (0..N * N)
            .map(|i| {
                let (x, y) = camera.pixel_center(i % N, i / N);
                let s = pad.surface_height(x, y);
                balls
                    .iter()
                    .map(|(bx, by, depth)| {
                        let d2 = (x - bx).powi(2) + (y - by).powi(2);
                        if d2 < r * r { (s - (r - depth - (r * r - d2).sqrt())).max(0.0) } else { 0.0 }
                    })
                    .fold(0.0, f64::max) as f32
            })
            .collect()
    }

    #[test]
    fn ball_gives_patch_force_and_normals() {
        let hand = Hand::ftac();
        let pad = &hand.pads[hand.find_pad("index_distal").expect("pad")];
        let camera = &hand.cameras[pad.cameras[0]];
        let (r, depth) = (0.01, 0.0008);
        let height = balls(camera, pad, r, &[(0.001, 0.004, depth)]);
        let patches = find_contacts(pad, pad.cameras[0], camera, hand.gel(), &height, &ContactOptions::default());
        assert_eq!(patches.len(), 1);
        let patch = &patches[0];
        assert!((patch.centroid - Point3::new(0.001, 0.004, -0.0005)).xy().norm() < 5e-5, "{:?}", patch.centroid);
        // Volume of the cap times the stiffness of the foundation.
        let truth = hand.gel().stiffness * std::f64::consts::PI * depth * depth * (r - depth / 3.0);
        assert!((patch.force / truth - 1.0).abs() < 0.03, "{} {truth}", patch.force);
        assert!((20..=60).contains(&patch.points.len()), "{}", patch.points.len());
        let centre = Point3::new(0.001, 0.004, r - depth);
        for point in &patch.points {
            let out = point.point - centre;
            assert!((out.norm() - r).abs() < 2e-5);
            assert!(out.normalize().dot(&point.normal) > 0.9995);
        }
    }

    #[test]
    fn two_balls_two_patches() {
        let hand = Hand::ftac();
        let pad = &hand.pads[hand.find_pad("index_distal").expect("pad")];
        let camera = &hand.cameras[pad.cameras[0]];
        let height = balls(camera, pad, 0.006, &[(0.0, 0.009, 0.0006), (0.0, -0.007, 0.0003)]);
        let patches = find_contacts(pad, pad.cameras[0], camera, hand.gel(), &height, &ContactOptions::default());
        assert_eq!(patches.len(), 2);
        assert!(patches[0].centroid.y > 0.008 && patches[1].centroid.y < -0.006);
        let clear = contact_free_points(pad, camera, Some(&height), 4e-5, 8, 12);
        assert!(clear.len() > 70 && clear.len() < 94, "{}", clear.len());
    }
}
