//! The pixels that a fit uses: in and around the presses, and in the background.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::calibration::folder::PressFolder;
use crate::calibration::photo::Photo;

/// A pixel of an image, with grey levels from 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelSample {
    /// Index of the press.
    pub(crate) press: usize,
    /// Column and row, pixels.
    pub(crate) place: [f64; 2],
    /// Value in the press image.
    pub(crate) value: [f64; 3],
    /// Value in the background.
    pub(crate) background: [f64; 3],
}

/// The visible circle of a press.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PressCircle {
    pub(crate) center: [f64; 2],
    pub(crate) radius: f64,
    /// Radius of the ball, m.
    pub(crate) ball: f64,
}

/// All data of a fit. Samples are in the order of the presses.
#[derive(Debug, Clone)]
pub(crate) struct FitSamples {
    pub(crate) size: [usize; 2],
    pub(crate) marks: Vec<PressCircle>,
    pub(crate) touched: Vec<PixelSample>,
    /// Pixels of the background; `press` and `value` are unused.
    pub(crate) flat: Vec<PixelSample>,
    /// Values of each image of a single lamp at the `flat` pixels, grey levels from 0 to 1.
    pub(crate) single_lamp_values: Vec<Vec<[f64; 3]>>,
}

impl FitSamples {
    /// Samples about `per_press` pixels from a square of `reach` visible radii around each press, and `flat` pixels of
    /// the background.
    pub(crate) fn draw(
        folder: &PressFolder,
        background: &[f32],
        per_press: usize,
        flat: usize,
        reach: f64,
        seed: u64,
    ) -> Self {
        let (w, h) = (folder.background.width, folder.background.height);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut uniform = move || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
        let grey = |place: [f64; 2]| -> [f64; 3] {
            let at = 3 * (place[1] as usize * w + place[0] as usize);
            std::array::from_fn(|c| f64::from(background[at + c]) / 255.0)
        };
        let (mut marks, mut touched) = (Vec::new(), Vec::new());
        for (press, found) in folder.presses.iter().enumerate() {
            marks.push(PressCircle { center: found.center, radius: found.radius, ball: 0.5 * found.diameter });
            for _ in 0..per_press {
                let mut draw = |middle: f64| (middle + (2.0 * uniform() - 1.0) * reach * found.radius).round();
                let place = [draw(found.center[0]), draw(found.center[1])];
                if (0.0..w as f64).contains(&place[0]) && (0.0..h as f64).contains(&place[1]) {
                    let pixel = found.photo.pixel(place[0] as usize, place[1] as usize);
                    let seen = pixel.map(|value| f64::from(value) / 255.0);
                    touched.push(PixelSample { press, place, value: seen, background: grey(place) });
                }
            }
        }
        let flat: Vec<PixelSample> = (0..flat)
            .map(|_| [(uniform() * w as f64).floor(), (uniform() * h as f64).floor()])
            .map(|place| PixelSample { press: 0, place, value: [0.0; 3], background: grey(place) })
            .collect();
        let shown = |photo: &Photo| -> Vec<[f64; 3]> {
            let places = flat.iter().map(|sample| sample.place);
            places
                .map(|[column, row]| photo.pixel(column as usize, row as usize).map(|grey| f64::from(grey) / 255.0))
                .collect()
        };
        let alone = folder.lamps.iter().map(shown).collect();
        Self { size: [w, h], marks, touched, flat, single_lamp_values: alone }
    }

    /// Returns every pixel within `reach` visible radii of one press.
    pub(crate) fn around(mark: PressCircle, size: [usize; 2], background: &[f32], reach: f64) -> Self {
        let limit = reach * mark.radius;
        let range = |middle: f64, end: usize| {
            ((middle - limit).max(0.0) as usize).min(end)..((middle + limit + 1.0).max(0.0) as usize).min(end)
        };
        let mut touched = Vec::new();
        for row in range(mark.center[1], size[1]) {
            for column in range(mark.center[0], size[0]) {
                let place = [column as f64, row as f64];
                if (place[0] - mark.center[0]).hypot(place[1] - mark.center[1]) < limit {
                    let at = 3 * (row * size[0] + column);
                    let background = std::array::from_fn(|c| f64::from(background[at + c]) / 255.0);
                    touched.push(PixelSample { press: 0, place, value: [0.0; 3], background });
                }
            }
        }
        Self { size, marks: vec![mark], touched, flat: Vec::new(), single_lamp_values: Vec::new() }
    }
}

/// Distance from a press (in visible radii) beyond which a pixel counts as untouched.
pub(crate) const UNTOUCHED_RADII: f64 = 2.5;

/// Estimates the standard deviation of one frame's noise (grey levels) from untouched pixels of consecutive presses.
pub(crate) fn estimate_noise(folder: &PressFolder) -> Option<f64> {
    let width = folder.background.width;
    let (mut squares, mut count) = (0.0, 0.0);
    for pair in folder.presses.windows(2) {
        for pixel in (0..folder.background.rgb.len() / 3).step_by(7) {
            let (column, row) = ((pixel % width) as f64, (pixel / width) as f64);
            if pair.iter().all(|p| (p.center[0] - column).hypot(p.center[1] - row) > UNTOUCHED_RADII * p.radius) {
                for at in 3 * pixel..3 * pixel + 3 {
                    let difference = f64::from(pair[0].photo.rgb[at]) - f64::from(pair[1].photo.rgb[at]);
                    squares += difference * difference;
                    count += 1.0;
                }
            }
        }
    }
    (count > 0.0).then(|| (0.5 * squares / count).sqrt())
}
