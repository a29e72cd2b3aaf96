//! Training samples: squares cut from labelled presses.

use hand_model::pads::IMAGE_SIZE as N;
use rand::{Rng, RngExt};
use tactile_perception::calibration::slope;
use tactile_perception::colour_change::{Region, whole_change};
use tactile_perception::network::{NetworkInput, NetworkKind, model_normals};
use tactile_perception::{CalibrationPress, PhotometricModel};

/// Side of a square, pixels.
pub const SQUARE_SIDE: usize = 48;
/// Weight of a pixel without contact relative to one in contact.
const LEVEL_WEIGHT: f32 = 0.15;
/// Subsampling of the perceptron: it uses every n-th pixel of a row and of a column.
const PERCEPTRON_STRIDE: usize = 4;

/// A labelled square of an image.
#[derive(Debug, Clone)]
pub struct TrainingSquare {
    configuration: char,
    row: usize,
    column: usize,
    pixels: Vec<Pixel>,
}

/// A labelled pixel; normals are given by their x and y components.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    /// Relative colour change.
    change: [f32; 3],
    /// Normal according to the photometric model.
    read: [f32; 2],
    truth: [f32; 2],
    weight: f32,
}

/// Cuts `count` squares around the contact of a press with pixels of size `pixel` (dx, dy; m); none without contact.
pub fn cut_squares(
    press: &CalibrationPress,
    (configuration, model): (char, &PhotometricModel),
    pixel: (f64, f64),
    count: usize,
    rng: &mut impl Rng,
) -> Vec<TrainingSquare> {
    let touched: Vec<usize> = (0..press.indentation.len()).filter(|&i| press.indentation[i] > 0.0).collect();
    if touched.is_empty() {
        return Vec::new();
    }
    let change = whole_change(&press.image, &press.background);
    let begin = |at: usize| at.saturating_sub(SQUARE_SIDE / 2).clamp(1, N - 1 - SQUARE_SIDE);
    (0..count)
        .map(|_| {
            let middle = touched[rng.random_range(0..touched.len())];
            let (row, column) = (begin(middle / N), begin(middle % N));
            let region = Region {
                row_begin: row,
                row_end: row + SQUARE_SIDE,
                column_begin: column,
                column_end: column + SQUARE_SIDE,
            };
            let read = model_normals(&change, model, region);
            let pixels = read.into_iter().enumerate().map(|(k, read)| {
                let i = (row + k / SQUARE_SIDE) * N + column + k % SQUARE_SIDE;
                let (gx, gy) = slope(&press.indentation, i, pixel);
                let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
                let weight = if press.indentation[i] > 0.0 { 1.0 } else { LEVEL_WEIGHT };
                Pixel { change: change[i], read, truth: [(gx * nz) as f32, (gy * nz) as f32], weight }
            });
            TrainingSquare { configuration, row, column, pixels: pixels.collect() }
        })
        .collect()
}

#[cfg(test)]
impl TrainingSquare {
    /// Returns a square whose true normals are a quarter of the red change of the pixel to the right, so that a single
    /// pixel carries no information on its own normal.
    pub(super) fn synthetic_square(rng: &mut impl Rng) -> Self {
        let red: Vec<f32> = (0..SQUARE_SIDE * SQUARE_SIDE).map(|_| rng.random_range(-1.0..1.0)).collect();
        let pixels = (0..SQUARE_SIDE * SQUARE_SIDE).map(|k| {
            let right = if (k + 1) % SQUARE_SIDE == 0 { 0.0 } else { 0.25 * red[k + 1] };
            Pixel { change: [red[k], 0.0, 0.0], read: [0.0; 2], truth: [right, 0.0], weight: 1.0 }
        });
        Self { configuration: 'a', row: 96, column: 96, pixels: pixels.collect() }
    }
}

/// Batch: samples laid out for a network, as planes by sample, plane, row, column.
pub(super) struct Batch {
    pub count: usize,
    /// Sides of the input planes, and of the planes of targets and weights.
    pub sides: [usize; 2],
    pub inputs: Vec<f32>,
    /// Target outputs, as many planes as the network has.
    pub targets: Vec<f32>,
    /// Weights of the pixels, half as many planes.
    pub weights: Vec<f32>,
}

impl Batch {
    /// Lays out `samples` for `kind`; the perceptron's grid of pixels is offset by `phase`.
    pub fn new(kind: NetworkKind, samples: &[&TrainingSquare], phase: [usize; 2]) -> Self {
        let stride = if kind == NetworkKind::PerPixel { PERCEPTRON_STRIDE } else { 1 };
        let (side, fold) = (SQUARE_SIDE / stride, kind.output_block_side());
        let folded = side / fold;
        let mut batch = Self {
            count: samples.len(),
            sides: [side, folded],
            inputs: Vec::with_capacity(samples.len() * kind.inputs() * side * side),
            targets: Vec::with_capacity(2 * samples.len() * side * side),
            weights: Vec::with_capacity(samples.len() * side * side),
        };
        let pixel = |k: usize| k * stride;
        for sample in samples {
            let change: Vec<[f32; 3]> = sample.pixels.iter().map(|pixel| pixel.change).collect();
            let read: Vec<[f32; 2]> = sample.pixels.iter().map(|pixel| pixel.read).collect();
            let sight = SampleInput { sample, change: &change, read: &read };
            for plane in 0..kind.inputs() {
                for k in 0..side * side {
                    let (row, column) = (pixel(k / side) + phase[0] % stride, pixel(k % side) + phase[1] % stride);
                    batch.inputs.push(sight.input(kind, plane, row, column));
                }
            }
            let at = |cell: usize, within: usize| {
                let (row, column) = (cell / folded * fold + within / fold, cell % folded * fold + within % fold);
                (pixel(row) + phase[0] % stride) * SQUARE_SIDE + pixel(column) + phase[1] % stride
            };
            for plane in 0..2 * fold * fold {
                let (axis, within) = (plane / (fold * fold), plane % (fold * fold));
                for cell in 0..folded * folded {
                    let Pixel { read, truth, weight, .. } = sample.pixels[at(cell, within)];
                    let start = if kind == NetworkKind::EncoderDecoder { read[axis] } else { 0.0 };
                    batch.targets.push(truth[axis] - start);
                    if axis == 0 {
                        batch.weights.push(weight);
                    }
                }
            }
        }
        batch
    }
}

/// Network inputs of a sample, as [`NetworkInput`] provides them for the image it was cut from.
struct SampleInput<'a> {
    sample: &'a TrainingSquare,
    change: &'a [[f32; 3]],
    read: &'a [[f32; 2]],
}

impl SampleInput<'_> {
    fn input(&self, kind: NetworkKind, plane: usize, row: usize, column: usize) -> f32 {
        if plane < 3 {
            return self.change[row * SQUARE_SIDE + column][plane];
        }
        let TrainingSquare { row: top, column: left, configuration, .. } = *self.sample;
        let region =
            Region { row_begin: top, row_end: top + SQUARE_SIDE, column_begin: left, column_end: left + SQUARE_SIDE };
        NetworkInput { change: &[], model_normals: self.read, configuration, region }.input(kind, plane, row, column)
    }
}
