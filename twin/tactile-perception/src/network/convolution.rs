//! Convolution layers on zero-padded planes, computed in blocks that fit into registers.

/// Number of output planes that are computed together.
const OUTPUT_BLOCK: usize = 4;
/// Number of pixels of a row that are computed together.
const LANES: usize = 8;

/// Planes of numbers, row-major, each with a border of one zero on every side.
#[derive(Debug, Clone)]
pub struct Planes {
    count: usize,
    height: usize,
    width: usize,
    /// Row pitch: the width, the border, and padding for the last lanes.
    pitch: usize,
    data: Vec<f32>,
}

impl Planes {
    fn zero(count: usize, height: usize, width: usize) -> Self {
        let pitch = width.next_multiple_of(LANES) + LANES;
        Self { count, height, width, pitch, data: vec![0.0; count * (height + 2) * pitch] }
    }

    /// Planes from a function of plane, row and column.
    pub fn from_fn(count: usize, height: usize, width: usize, f: impl Fn(usize, usize, usize) -> f32) -> Self {
        let mut planes = Self::zero(count, height, width);
        for plane in 0..count {
            for row in 0..height {
                let start = planes.index(plane, row as isize) + 1;
                for column in 0..width {
                    planes.data[start + column] = f(plane, row, column);
                }
            }
        }
        planes
    }

    /// Index of the start of a row (-1 to height), including its border.
    fn index(&self, plane: usize, row: isize) -> usize {
        (plane * (self.height + 2) + (row + 1) as usize) * self.pitch
    }

    /// Value at a position of a plane.
    pub fn at(&self, plane: usize, row: usize, column: usize) -> f32 {
        self.data[self.index(plane, row as isize) + 1 + column]
    }

    /// Doubles width and height by repeating every value.
    pub fn upsampled(&self) -> Self {
        Self::from_fn(self.count, 2 * self.height, 2 * self.width, |plane, row, column| {
            self.at(plane, row / 2, column / 2)
        })
    }

    /// Adds planes of the same size.
    pub fn add(&mut self, other: &Self) {
        for (value, other) in self.data.iter_mut().zip(&other.data) {
            *value += other;
        }
    }

    /// Values of a row for each of the three kernel columns, each at least `width / stride` long.
    fn taps(&self, plane: usize, row: isize, stride: usize, scratch: &mut [Vec<f32>; 3]) {
        let line = &self.data[self.index(plane, row)..self.index(plane, row) + self.pitch];
        for (shift, tap) in scratch.iter_mut().enumerate() {
            for (k, value) in tap.iter_mut().enumerate() {
                *value = line.get(k * stride + shift).copied().unwrap_or(0.0);
            }
        }
    }
}

/// Weights of a layer, laid out by block of outputs, input, row, column, output in the block.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    inputs: usize,
    outputs: usize,
    kernel: usize,
    weights: Vec<[f32; OUTPUT_BLOCK]>,
    biases: Vec<f32>,
}

impl Layer {
    /// A layer of `weights` by output, input, row, column.
    pub(crate) fn new(inputs: usize, outputs: usize, kernel: usize, weights: &[f32], biases: &[f32]) -> Self {
        let area = kernel * kernel;
        let mut laid = Vec::new();
        for block in 0..outputs.div_ceil(OUTPUT_BLOCK) {
            for tap in 0..inputs * area {
                laid.push(std::array::from_fn(|k| {
                    let output = block * OUTPUT_BLOCK + k;
                    if output < outputs { weights[output * inputs * area + tap] } else { 0.0 }
                }));
            }
        }
        Self { inputs, outputs, kernel, weights: laid, biases: biases.to_vec() }
    }

    /// Applies the layer with a stride of 1 or 2, which must divide the sides. `rectify` sets negative values to 0.
    pub(crate) fn run(&self, planes: &Planes, stride: usize, rectify: bool) -> Planes {
        let (height, width) = (planes.height / stride, planes.width / stride);
        let mut out = Planes::zero(self.outputs, height, width);
        let padded = width.next_multiple_of(LANES);
        let reach = self.kernel / 2;
        let taps = self.inputs * self.kernel * self.kernel;
        // The inputs of one output row, tap by tap.
        let mut rows = vec![0.0f32; taps * padded];
        let mut scratch: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; padded]);
        for row in 0..height {
            for input in 0..self.inputs {
                for ky in 0..self.kernel {
                    let line = (row * stride + ky) as isize - reach as isize;
                    planes.taps(input, line, stride, &mut scratch);
                    for kx in 0..self.kernel {
                        let tap = (input * self.kernel + ky) * self.kernel + kx;
                        // A kernel of one column sits on the middle tap.
                        let shift = if self.kernel == 1 { 1 } else { kx };
                        rows[tap * padded..(tap + 1) * padded].copy_from_slice(&scratch[shift]);
                    }
                }
            }
            for block in 0..self.outputs.div_ceil(OUTPUT_BLOCK) {
                let weights = &self.weights[block * taps..(block + 1) * taps];
                for chunk in 0..padded / LANES {
                    let mut sums = [[0.0f32; LANES]; OUTPUT_BLOCK];
                    for (weight, line) in weights.iter().zip(rows.chunks_exact(padded)) {
                        let values: &[f32] = &line[chunk * LANES..(chunk + 1) * LANES];
                        for (sum, weight) in sums.iter_mut().zip(weight) {
                            for (sum, value) in sum.iter_mut().zip(values) {
                                *sum += weight * value;
                            }
                        }
                    }
                    for (k, sum) in sums.iter().enumerate() {
                        let output = block * OUTPUT_BLOCK + k;
                        if output >= self.outputs {
                            break;
                        }
                        let start = out.index(output, row as isize) + 1 + chunk * LANES;
                        let room = LANES.min(width - chunk * LANES);
                        for (value, sum) in out.data[start..start + room].iter_mut().zip(sum) {
                            let sum = sum + self.biases[output];
                            *value = if rectify { sum.max(0.0) } else { sum };
                        }
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(k: usize) -> f32 {
        ((k * 7919) % 101) as f32 / 50.0 - 1.0
    }

    /// The layer agrees with the explicit sum.
    #[test]
    fn layers_are_sums_over_the_neighbourhood() {
        for (inputs, outputs, kernel, stride) in [(3, 5, 3, 1), (2, 4, 3, 2), (5, 8, 1, 1)] {
            let (height, width) = (8, 12);
            let planes = Planes::from_fn(inputs, height, width, |p, r, c| value(p * 1000 + r * 50 + c));
            let weights: Vec<f32> = (0..inputs * outputs * kernel * kernel).map(|k| value(k + 17)).collect();
            let biases: Vec<f32> = (0..outputs).map(|k| value(k + 5)).collect();
            let out = Layer::new(inputs, outputs, kernel, &weights, &biases).run(&planes, stride, true);
            for (o, bias) in biases.iter().enumerate() {
                for r in 0..height / stride {
                    for c in 0..width / stride {
                        let mut sum = *bias;
                        for i in 0..inputs {
                            for ky in 0..kernel {
                                for kx in 0..kernel {
                                    let (y, x) = (r * stride + ky, c * stride + kx);
                                    let (y, x) = (y.wrapping_sub(kernel / 2), x.wrapping_sub(kernel / 2));
                                    if y < height && x < width {
                                        let at = ((o * inputs + i) * kernel + ky) * kernel + kx;
                                        sum += weights[at] * planes.at(i, y, x);
                                    }
                                }
                            }
                        }
                        let found = out.at(o, r, c);
                        assert!((found - sum.max(0.0)).abs() < 1e-4, "{o} {r} {c}: {found} {sum}");
                    }
                }
            }
        }
    }

    #[test]
    fn enlarging_repeats() {
        let planes = Planes::from_fn(1, 2, 3, |_, r, c| (10 * r + c) as f32);
        let large = planes.upsampled();
        assert_eq!((large.at(0, 3, 5), large.at(0, 0, 1), large.at(0, 2, 2)), (12.0, 0.0, 11.0));
    }
}
