//! Training of the per-pixel network on labelled pixels, by plain back-propagation and Adam.
//!
//! The network is a perceptron with three hidden layers of [`HIDDEN_UNITS`] rectified units (ReLU). Its inputs are a
//! pixel's relative colour change and position, its outputs the x and y components of the normal. A few hundred
//! thousand pixels and a network this small need no tensor library.

use hand_model::pads::IMAGE_SIZE as N;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tactile_perception::network::NetworkKind;
use tactile_perception::{Network, TouchError};

/// Units per hidden layer.
const HIDDEN_UNITS: usize = 32;
/// Inputs that differ between pixels: three colours and the position.
const INPUT_COUNT: usize = 5;
/// Number of hidden layers.
const HIDDEN_LAYERS: usize = 3;
/// Batch size in pixels, number of epochs, and initial learning rate, which falls to zero along half a cosine.
const BATCH_SIZE: usize = 256;
pub const EPOCHS: usize = 24;
const LEARNING_RATE: f32 = 4e-3;
/// Squared error of a normal (about 0.2 degrees) below which the loss is quadratic.
const QUADRATIC_LOSS_LIMIT: f32 = 1e-5;
/// Decay rates of Adam's moments, and the smallest divisor (its epsilon).
const ADAM_DECAYS: [f32; 2] = [0.9, 0.999];
const ADAM_EPSILON: f32 = 1e-8;

/// A pixel with a known normal: one training sample.
#[derive(Debug, Clone, Copy)]
pub struct LabelledPixel {
    input: [f32; INPUT_COUNT],
    /// x and y components of the unit normal.
    normal: [f32; 2],
    weight: f32,
}

impl LabelledPixel {
    /// Creates a sample from pixel `i` of the pads' grid with its relative colour change and slopes.
    pub fn new(i: usize, change: [f32; 3], [gx, gy]: [f64; 2], weight: f32) -> Self {
        let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
        let place = |at: usize| (at as f32 + 0.5) / (0.5 * N as f32) - 1.0;
        let input = [change[0], change[1], change[2], place(i % N), -place(i / N)];
        Self { input, normal: [(gx * nz) as f32, (gy * nz) as f32], weight }
    }
}

/// Weights from one input to the units of a layer.
type WeightRow = [f32; HIDDEN_UNITS];

/// Weights by layer, input, then unit; the last row of a layer is the bias. The last layer uses two units.
#[derive(Clone)]
struct Weights {
    layers: Vec<Vec<WeightRow>>,
}

impl Weights {
    fn zeros() -> Self {
        let rows = |layer: usize| if layer == 0 { INPUT_COUNT + 1 } else { HIDDEN_UNITS + 1 };
        Self { layers: (0..=HIDDEN_LAYERS).map(|layer| vec![[0.0; HIDDEN_UNITS]; rows(layer)]).collect() }
    }

    /// Draws weights uniformly within +-sqrt(6 / inputs) (He et al. 2015), those of the last layer within a tenth of
    /// that; biases are 0.
    fn random(rng: &mut ChaCha8Rng) -> Self {
        let mut weights = Self::zeros();
        for (layer, rows) in weights.layers.iter_mut().enumerate() {
            let (inputs, last) = (rows.len() - 1, layer == HIDDEN_LAYERS);
            let bound = (6.0 / inputs as f32).sqrt() * if last { 0.1 } else { 1.0 };
            let units = if last { 2 } else { HIDDEN_UNITS };
            for row in &mut rows[..inputs] {
                row[..units].iter_mut().for_each(|weight| *weight = rng.random_range(-bound..bound));
            }
        }
        weights
    }

    /// Computes the values of each layer's units, rectified except for the last layer.
    fn forward(&self, input: &[f32; INPUT_COUNT]) -> [WeightRow; HIDDEN_LAYERS + 1] {
        let mut values = [[0.0; HIDDEN_UNITS]; HIDDEN_LAYERS + 1];
        for (layer, rows) in self.layers.iter().enumerate() {
            let mut sums = rows[rows.len() - 1];
            let mut add =
                |value: f32, row: &WeightRow| sums.iter_mut().zip(row).for_each(|(sum, weight)| *sum += value * weight);
            if layer == 0 {
                input.iter().zip(rows).for_each(|(value, row)| add(*value, row));
            } else {
                values[layer - 1]
                    .iter()
                    .zip(rows)
                    .filter(|(value, _)| **value != 0.0)
                    .for_each(|(value, row)| add(*value, row));
            }
            if layer < HIDDEN_LAYERS {
                sums.iter_mut().for_each(|sum| *sum = sum.max(0.0));
            }
            values[layer] = sums;
        }
        values
    }

    /// Adds a pixel's part of the loss's gradient, and returns its part of the loss.
    fn add_gradient(&self, pixel: &LabelledPixel, share: f32, gradient: &mut Self) -> f32 {
        let values = self.forward(&pixel.input);
        let off = [values[HIDDEN_LAYERS][0] - pixel.normal[0], values[HIDDEN_LAYERS][1] - pixel.normal[1]];
        let length = (off[0] * off[0] + off[1] * off[1] + QUADRATIC_LOSS_LIMIT).sqrt();
        let mut back = [0.0; HIDDEN_UNITS];
        for (back, off) in back.iter_mut().zip(off) {
            *back = share * pixel.weight * off / length;
        }
        for layer in (0..=HIDDEN_LAYERS).rev() {
            let (rows, sums) = (&self.layers[layer], &mut gradient.layers[layer]);
            let inputs = rows.len() - 1;
            let add = |sum: &mut WeightRow, value: f32, back: &WeightRow| {
                sum.iter_mut().zip(back).for_each(|(sum, back)| *sum += value * back);
            };
            add(&mut sums[inputs], 1.0, &back);
            if layer == 0 {
                pixel.input.iter().zip(sums).for_each(|(value, sum)| add(sum, *value, &back));
                break;
            }
            let mut before = [0.0; HIDDEN_UNITS];
            for (i, value) in values[layer - 1].iter().enumerate().filter(|(_, value)| **value > 0.0) {
                add(&mut sums[i], *value, &back);
                before[i] = dot(&rows[i], &back);
            }
            back = before;
        }
        share * pixel.weight * length
    }

    fn each(&mut self) -> impl Iterator<Item = &mut f32> {
        self.layers.iter_mut().flatten().flatten()
    }
}

/// Computes a dot product in eight partial sums, for which a processor has vector instructions.
fn dot(a: &WeightRow, b: &WeightRow) -> f32 {
    let mut sums = [0.0f32; 8];
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

/// Trains on pixels; the result is the same for the same seed. `pass` is called after each of [`EPOCHS`] epochs.
pub fn train(pixels: &[LabelledPixel], seed: u64, recipe: String, pass: impl Fn()) -> Result<Network, TouchError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut weights = Weights::random(&mut rng);
    let (mut first, mut second) = (Weights::zeros(), Weights::zeros());
    let mut order: Vec<usize> = (0..pixels.len()).collect();
    let steps = (EPOCHS * pixels.len().div_ceil(BATCH_SIZE)).max(1);
    let (mut step, mut decayed) = (0, [1.0f32; 2]);
    for _ in 0..EPOCHS {
        order.shuffle(&mut rng);
        for chosen in order.chunks(BATCH_SIZE) {
            let total: f32 = chosen.iter().map(|&n| pixels[n].weight).sum();
            let mut gradient = Weights::zeros();
            let share = 1.0 / total.max(f32::MIN_POSITIVE);
            for &n in chosen {
                weights.add_gradient(&pixels[n], share, &mut gradient);
            }
            let rate = 0.5 * LEARNING_RATE * (1.0 + (std::f32::consts::PI * step as f32 / steps as f32).cos());
            step += 1;
            decayed.iter_mut().zip(ADAM_DECAYS).for_each(|(decayed, decay)| *decayed *= decay);
            let moments = first.each().zip(second.each());
            for ((weight, gradient), (first, second)) in weights.each().zip(gradient.each()).zip(moments) {
                *first = ADAM_DECAYS[0] * *first + (1.0 - ADAM_DECAYS[0]) * *gradient;
                *second = ADAM_DECAYS[1] * *second + (1.0 - ADAM_DECAYS[1]) * *gradient * *gradient;
                let divisor = (*second / (1.0 - decayed[1])).sqrt() + ADAM_EPSILON;
                *weight -= rate * *first / (1.0 - decayed[0]) / divisor;
            }
        }
        pass();
    }
    network(&weights, recipe)
}

/// Returns the network with these weights, by output, then input. Inputs for the hand's other sensors get zero weights.
fn network(weights: &Weights, recipe: String) -> Result<Network, TouchError> {
    let layers = NetworkKind::PerPixel.layers();
    let table = |(rows, (inputs, units, _)): (&Vec<WeightRow>, &(usize, usize, usize))| -> Vec<f32> {
        let known = rows.len() - 1;
        let weight = |unit: usize, input: usize| if input < known { rows[input][unit] } else { 0.0 };
        (0..*units).flat_map(|unit| (0..*inputs).map(move |input| weight(unit, input))).collect()
    };
    let tables = weights.layers.iter().zip(layers).map(table).collect();
    let biases = weights.layers.iter().zip(layers).map(|(rows, (_, units, _))| rows[rows.len() - 1][..*units].to_vec());
    Network::new(NetworkKind::PerPixel, recipe, tables, biases.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels() -> Vec<LabelledPixel> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let pixel = |_| {
            let slope: [f64; 2] = [rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8)];
            let i = rng.random_range(0..N * N);
            // Colours under three lamps whose directions of light turn with the position.
            let turn = (i % N) as f64 / N as f64;
            let change = [0.0, 2.1, 4.2].map(|lamp: f64| {
                let (sin, cos) = (lamp + turn).sin_cos();
                (0.5 * (slope[0] * cos + slope[1] * sin)) as f32
            });
            LabelledPixel::new(i, change, slope, 1.0)
        };
        (0..12_000).map(pixel).collect()
    }

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let (pixels, mut weights) = (pixels(), Weights::random(&mut ChaCha8Rng::seed_from_u64(1)));
        let mut gradient = Weights::zeros();
        weights.add_gradient(&pixels[0], 0.7, &mut gradient);
        for (layer, row, unit) in
            [(0, 3, 5), (0, INPUT_COUNT, 7), (1, 11, 2), (2, 30, 30), (3, 9, 1), (3, HIDDEN_UNITS, 0)]
        {
            let mut at = |by: f32| {
                weights.layers[layer][row][unit] += by;
                let loss = weights.add_gradient(&pixels[0], 0.7, &mut Weights::zeros());
                weights.layers[layer][row][unit] -= by;
                f64::from(loss)
            };
            let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
            let found = f64::from(gradient.layers[layer][row][unit]);
            assert!((slope - found).abs() < 2e-3 + 0.02 * slope.abs(), "{layer} {row} {unit}: {slope} {found}");
        }
    }

    #[test]
    fn colours_become_normals_the_same_with_the_same_seed() {
        let pixels = pixels();
        let off = |weights: &Weights| {
            let each = pixels.iter().map(|pixel| {
                let found = weights.forward(&pixel.input)[HIDDEN_LAYERS];
                (found[0] - pixel.normal[0]).hypot(found[1] - pixel.normal[1])
            });
            each.sum::<f32>() / pixels.len() as f32
        };
        let found = train(&pixels, 3, String::new(), || {}).expect("trained");
        assert_eq!(found, train(&pixels, 3, String::new(), || {}).expect("trained"));
        let before = off(&Weights::random(&mut ChaCha8Rng::seed_from_u64(3)));
        // The network's own file holds the trained weights.
        let text = serde_json::to_string(&found).expect("text");
        let file: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let mut after = Weights::zeros();
        for (layer, rows) in after.layers.iter_mut().enumerate() {
            let (inputs, units, _) = NetworkKind::PerPixel.layers()[layer];
            let known = rows.len() - 1;
            for unit in 0..units {
                for (input, row) in rows[..known].iter_mut().enumerate() {
                    row[unit] = file["weights"][layer][unit * inputs + input].as_f64().expect("a weight") as f32;
                }
                rows[known][unit] = file["biases"][layer][unit].as_f64().expect("a bias") as f32;
            }
        }
        let after = off(&after);
        assert!(after < 0.03 && after < 0.1 * before, "{before} {after}");
    }
}
