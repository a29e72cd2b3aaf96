//! Training of the network for photometric stereo: gradients by burn, Adam, a learning rate that halves every few
//! epochs, and a state that can be saved and resumed.

use burn::optim::{Adam, AdamConfig, AdamState, AdaptiveMomentumState, Optimizer};
use burn::tensor::activation::relu;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tactile_perception::network::{LayerShape, NetworkKind};
use tactile_perception::{Network, TouchError};

use super::samples::{Batch, TrainingSquare};

/// Squared error of a normal (about 0.2 degrees) below which the loss is quadratic.
const QUADRATIC_LOSS_LIMIT: f32 = 1e-5;

/// An error during training.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The saved training has another schedule.
    #[error("schedule of the saved training: found {found}, expected {expected}")]
    Schedule { found: String, expected: String },
    /// The weights make no valid network.
    #[error(transparent)]
    Network(#[from] TouchError),
    /// A value is infinite or not a number.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
}

/// Training schedule (hyperparameters).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingSchedule {
    pub kind: NetworkKind,
    pub epochs: usize,
    /// Batch size: samples per step.
    pub batch: usize,
    /// Initial learning rate.
    pub rate: f64,
    /// Epochs between halvings of the learning rate.
    pub halving: usize,
    /// Seed of the initial weights and of the order of samples.
    pub seed: u64,
}

/// A parameter with its Adam moments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameter {
    values: Vec<f32>,
    moments: [Vec<f32>; 2],
}

/// State of a training between two epochs, complete for resuming.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    pub schedule: TrainingSchedule,
    /// Mean loss of each epoch so far on the training samples and on the held-out ones: about the sine of the angular
    /// error.
    pub losses: Vec<[f64; 2]>,
    steps: usize,
    /// Weights and biases of each layer in turn.
    parameters: Vec<Parameter>,
}

impl Training {
    /// Creates the initial state: weights drawn uniformly within +-sqrt(6 / inputs) (He et al. 2015), those of the last
    /// layer within a tenth of that; biases 0.
    pub fn new(schedule: TrainingSchedule) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(schedule.seed);
        let mut parameters = Vec::new();
        let layers = schedule.kind.layers();
        for (n, (inputs, outputs, kernel)) in layers.iter().enumerate() {
            let count = inputs * kernel * kernel;
            let last = n + 1 == layers.len();
            let bound = (6.0 / count as f32).sqrt() * if last { 0.1 } else { 1.0 };
            let values = (0..count * outputs).map(|_| rng.random_range(-bound..bound)).collect();
            for values in [values, vec![0.0; *outputs]] {
                let zeros = vec![0.0; values.len()];
                parameters.push(Parameter { values, moments: [zeros.clone(), zeros] });
            }
        }
        Self { schedule, losses: Vec::new(), steps: 0, parameters }
    }

    /// Returns an error if the schedule differs from `schedule` in anything but the number of epochs, or if the
    /// parameters are invalid.
    pub fn check(&self, schedule: &TrainingSchedule) -> Result<(), TrainingError> {
        let same = TrainingSchedule { epochs: schedule.epochs, ..self.schedule.clone() };
        if same != *schedule {
            return Err(TrainingError::Schedule { found: format!("{same:?}"), expected: format!("{schedule:?}") });
        }
        self.network(String::new())?;
        Ok(())
    }

    pub fn is_finished(&self) -> bool {
        self.losses.len() >= self.schedule.epochs
    }

    /// Trains for one epoch over `samples`, and records the loss on `held_out`. `step` is called after every step.
    pub fn epoch(
        &mut self,
        samples: &[TrainingSquare],
        held_out: &[TrainingSquare],
        mut step: impl FnMut(),
    ) -> Result<(), TrainingError> {
        let epoch = self.losses.len();
        let mut rng = ChaCha8Rng::seed_from_u64(self.schedule.seed);
        rng.set_stream(1 + epoch as u64);
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.shuffle(&mut rng);
        let rate = self.schedule.rate * 0.5f64.powi((epoch / self.schedule.halving.max(1)) as i32);
        let adam = AdamConfig::new().with_beta_1(0.9).with_beta_2(0.999).with_epsilon(1e-7).build();
        let (mut sum, mut count) = (0.0, 0);
        for chosen in order.chunks(self.schedule.batch) {
            let chosen: Vec<&TrainingSquare> = chosen.iter().map(|&n| &samples[n]).collect();
            let phase = [rng.random_range(0..64), rng.random_range(0..64)];
            sum += self.step(&adam, rate, &Batch::new(self.schedule.kind, &chosen, phase))? * chosen.len() as f64;
            count += chosen.len();
            step();
        }
        let held = self.loss(held_out)?;
        self.losses.push([sum / count.max(1) as f64, held]);
        Ok(())
    }

    /// Computes the mean loss on samples.
    pub fn loss(&self, samples: &[TrainingSquare]) -> Result<f64, TrainingError> {
        let device = Device::flex();
        let (mut sum, mut count) = (0.0, 0);
        for chosen in samples.chunks(self.schedule.batch) {
            let chosen: Vec<&TrainingSquare> = chosen.iter().collect();
            let parameters: Vec<Tensor<1>> =
                self.parameters.iter().map(|parameter| tensor(&parameter.values, &device)).collect();
            let loss = loss(&parameters, &Batch::new(self.schedule.kind, &chosen, [0, 0]), self.schedule.kind, &device);
            sum += f64::from(scalar(loss)?) * chosen.len() as f64;
            count += chosen.len();
        }
        Ok(sum / count.max(1) as f64)
    }

    fn step(&mut self, adam: &Adam, rate: f64, batch: &Batch) -> Result<f64, TrainingError> {
        let (plain, tracked) = (Device::flex(), Device::flex().autodiff());
        let leaves: Vec<Tensor<1>> =
            self.parameters.iter().map(|p| tensor(&p.values, &tracked).require_grad()).collect();
        let loss = loss(&leaves, batch, self.schedule.kind, &tracked);
        let mut gradients = loss.backward();
        for (parameter, leaf) in self.parameters.iter_mut().zip(&leaves) {
            let gradient = leaf.grad_remove(&mut gradients).ok_or(TrainingError::NotFinite("a gradient"))?;
            let [first, second] = &parameter.moments;
            let moments = AdaptiveMomentumState::new(self.steps, tensor(first, &plain), tensor(second, &plain));
            let values = tensor(&parameter.values, &plain);
            let (values, state) = adam.step(rate, values, gradient, Some(AdamState::new(moments)));
            let momentum = state.ok_or(TrainingError::NotFinite("Adam's state"))?.momentum;
            parameter.values = numbers(values)?;
            parameter.moments = [numbers(momentum.moment_1)?, numbers(momentum.moment_2)?];
        }
        self.steps += 1;
        let loss = scalar(loss)?;
        if !loss.is_finite() {
            return Err(TrainingError::NotFinite("the training's loss"));
        }
        Ok(f64::from(loss))
    }

    /// Returns the current network.
    pub fn network(&self, recipe: String) -> Result<Network, TouchError> {
        let part = |odd: usize| self.parameters.iter().skip(odd).step_by(2).map(|p| p.values.clone()).collect();
        Network::new(self.schedule.kind, recipe, part(0), part(1))
    }
}

fn tensor(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device)
}

fn numbers(tensor: Tensor<1>) -> Result<Vec<f32>, TrainingError> {
    tensor.into_data().try_into_vec().map_err(|_| TrainingError::NotFinite("a tensor"))
}

fn scalar(loss: Tensor<1>) -> Result<f32, TrainingError> {
    numbers(loss)?.first().copied().ok_or(TrainingError::NotFinite("the loss"))
}

/// Computes the output of the layers for planes by sample, plane, row, column.
fn output(parameters: &[Tensor<1>], kind: NetworkKind, inputs: Tensor<4>) -> Tensor<4> {
    let run = |n: usize, x: Tensor<4>, stride: usize| {
        let (inputs, outputs, kernel): LayerShape = kind.layers()[n];
        let weights = parameters[2 * n].clone().reshape([outputs, inputs, kernel, kernel]);
        let reach = kernel / 2;
        let options = ConvOptions::new([stride, stride], [reach, reach], [1, 1], 1);
        conv2d(x, weights, Some(parameters[2 * n + 1].clone()), options)
    };
    match kind {
        NetworkKind::EncoderDecoder => {
            let half = relu(run(0, inputs, 2));
            let quarter = relu(run(1, half.clone(), 2));
            let lifted = enlarged(run(3, relu(run(2, quarter, 1)), 1)) + half;
            run(5, relu(run(4, lifted, 1)), 1)
        }
        NetworkKind::PerPixel => {
            let last = kind.layers().len() - 1;
            run(last, (0..last).fold(inputs, |x, n| relu(run(n, x, 1))), 1)
        }
    }
}

/// Upsamples by two in width and height (nearest neighbour): every value appears four times.
fn enlarged(x: Tensor<4>) -> Tensor<4> {
    let [samples, planes, height, width] = x.dims();
    let x: Tensor<6> = x.reshape([samples, planes, height, 1, width, 1]);
    x.repeat(&[1, 1, 1, 2, 1, 2]).reshape([samples, planes, 2 * height, 2 * width])
}

/// Computes the loss: weighted mean length of the difference of normals (x and y components).
fn loss(parameters: &[Tensor<1>], batch: &Batch, kind: NetworkKind, device: &Device) -> Tensor<1> {
    let [side, folded] = batch.sides;
    let planes = kind.output_block_side() * kind.output_block_side();
    let tensor = |values: &[f32], planes: usize, side: usize| -> Tensor<4> {
        Tensor::from_data(TensorData::new(values.to_vec(), [batch.count, planes, side, side]), device)
    };
    let output = output(parameters, kind, tensor(&batch.inputs, kind.inputs(), side));
    let off = output - tensor(&batch.targets, 2 * planes, folded);
    let squared = off.clone() * off;
    let length =
        (squared.clone().narrow(1, 0, planes) + squared.narrow(1, planes, planes) + QUADRATIC_LOSS_LIMIT).sqrt();
    let total: f32 = batch.weights.iter().sum();
    (length * tensor(&batch.weights, planes, folded)).sum() / total.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_perception::network::convolution::Planes;

    fn schedule(kind: NetworkKind) -> TrainingSchedule {
        TrainingSchedule { kind, epochs: 2, batch: 4, rate: 0.01, halving: 5, seed: 3 }
    }

    /// The plain-CPU layers agree with burn's.
    #[test]
    fn inference_is_what_burn_computes() {
        for kind in [NetworkKind::EncoderDecoder, NetworkKind::PerPixel] {
            let training = Training::new(schedule(kind));
            let (height, width) = (12, 20);
            let value = |plane: usize, row: usize, column: usize| {
                ((plane * 7919 + row * 104_729 + column * 31) % 997) as f32 / 500.0 - 1.0
            };
            let planes = Planes::from_fn(kind.inputs(), height, width, value);
            let own = training.network(String::new()).unwrap().prepare().output(&planes);
            let device = Device::flex();
            let parameters: Vec<Tensor<1>> = training.parameters.iter().map(|p| tensor(&p.values, &device)).collect();
            let mut values = Vec::new();
            for at in 0..kind.inputs() * height * width {
                values.push(value(at / (height * width), at / width % height, at % width));
            }
            let inputs = Tensor::from_data(TensorData::new(values, [1, kind.inputs(), height, width]), &device);
            let burn = output(&parameters, kind, inputs);
            let [_, outputs, rows, columns] = burn.dims();
            let burn: Vec<f32> = burn.into_data().try_into_vec().unwrap();
            for (at, burn) in burn.into_iter().enumerate() {
                let own = own.at(at / (rows * columns), at / columns % rows, at % columns);
                assert!((own - burn).abs() < 1e-4, "{kind:?} of {outputs} planes at {at}: {own} {burn}");
            }
        }
    }

    fn synthetic_squares(seed: u64, count: usize) -> Vec<TrainingSquare> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| TrainingSquare::synthetic_square(&mut rng)).collect()
    }

    /// The network learns from a pixel's surroundings; the perceptron cannot.
    #[test]
    fn surroundings_are_learnt_from() {
        let (samples, held_out) = (synthetic_squares(1, 12), synthetic_squares(2, 4));
        let lost = |kind| {
            let mut training = Training::new(TrainingSchedule { epochs: 14, batch: 3, ..schedule(kind) });
            let before = training.loss(&held_out).unwrap();
            while !training.is_finished() {
                training.epoch(&samples, &held_out, || {}).unwrap();
            }
            training.losses[13][1] / before
        };
        let (network, perceptron) = (lost(NetworkKind::EncoderDecoder), lost(NetworkKind::PerPixel));
        assert!(network < 0.5 && network < 0.5 * perceptron, "{network} {perceptron}");
    }

    /// A training that is saved as text after an epoch and read again ends with the same weights.
    #[test]
    fn a_resumed_training_ends_the_same() {
        let samples = synthetic_squares(1, 6);
        let mut whole = Training::new(schedule(NetworkKind::EncoderDecoder));
        whole.epoch(&samples, &samples[..1], || {}).unwrap();
        let mut resumed: Training = serde_json::from_str(&serde_json::to_string(&whole).unwrap()).unwrap();
        resumed.check(&schedule(NetworkKind::EncoderDecoder)).unwrap();
        let other = TrainingSchedule { seed: 4, ..schedule(NetworkKind::EncoderDecoder) };
        assert!(resumed.check(&other).unwrap_err().to_string().contains("seed: 4"));
        for training in [&mut whole, &mut resumed] {
            training.epoch(&samples, &samples[..1], || {}).unwrap();
        }
        assert_eq!(whole, resumed);
    }
}
