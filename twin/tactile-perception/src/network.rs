//! Photometric stereo by a neural network that also uses a pixel's surroundings.
//!
//! A small encoder-decoder takes the relative colour change, the normal that the pad's [`PhotometricModel`] predicts from
//! each pixel alone, and the pixel's position. It outputs a correction of that normal: at rims, in cast shadows and for
//! ambiguous colours the surroundings carry information. The photometric model conditions the network on the pad, so that
//! one network serves all pads.
//!
//! ```text
//! 7 planes --3x3/2--> 12 --3x3/2--> 20 --3x3--> 20 --1x1--> 12, enlarged, + 12 --3x3--> 12 --1x1--> 2 x (2 x 2) --> 2 planes
//! ```
//! The per-pixel perceptron (colour change, position and configuration in, normal out) is the usual baseline. Every
//! hidden layer is followed by a rectifier. Inference is plain arithmetic on the CPU; networks are
//! trained elsewhere.

pub mod convolution;

use std::path::Path;

use convolution::{Layer, Planes};
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use serde::{Deserialize, Serialize};

use crate::PIXELS;
use crate::calibration::{PhotometricModel, gradient_from_normal, limit_slope};
use crate::colour_change::{ImageChange, Region, StereoOptions, colour_change, find_change};
use crate::error::TouchError;
use crate::photometric_stereo::Gradients;

const VERSION: u32 = 1;
/// Sensor configurations, in the order of the perceptron's input planes.
const CONFIGURATIONS: [char; 6] = ['a', 'b', 'c', 'd', 'e', 'f'];

/// Network architectures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkKind {
    /// Uses the surroundings and corrects the photometric model.
    EncoderDecoder,
    /// Uses one pixel; the usual baseline.
    PerPixel,
}

/// Number of input planes, number of output planes, and kernel size of a layer.
pub type LayerShape = (usize, usize, usize);

impl NetworkKind {
    /// Layers, from input to output.
    pub fn layers(self) -> &'static [LayerShape] {
        match self {
            Self::EncoderDecoder => &[(7, 12, 3), (12, 20, 3), (20, 20, 3), (20, 12, 1), (12, 12, 3), (12, 8, 1)],
            Self::PerPixel => &[(11, 32, 1), (32, 32, 1), (32, 32, 1), (32, 2, 1)],
        }
    }

    /// Number of input planes.
    pub fn inputs(self) -> usize {
        self.layers()[0].0
    }

    /// Side of the square of pixels that one position of the last layer predicts.
    pub fn output_block_side(self) -> usize {
        match self {
            Self::EncoderDecoder => 2,
            Self::PerPixel => 1,
        }
    }
}

/// Trained weights and their origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Version of the file format.
    version: u32,
    /// Architecture, which determines the number of weights.
    pub kind: NetworkKind,
    /// Command, seed and data of the training.
    pub recipe: String,
    /// The photometric model it was trained with, if not one of the hand's calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conditioning: Option<PhotometricModel>,
    /// For each layer, weights by output, input, row, column.
    weights: Vec<Vec<f32>>,
    /// For each layer, biases by output.
    biases: Vec<Vec<f32>>,
}

impl Network {
    /// A network from the weights and biases of its layers.
    pub fn new(
        kind: NetworkKind,
        recipe: String,
        weights: Vec<Vec<f32>>,
        biases: Vec<Vec<f32>>,
    ) -> Result<Self, TouchError> {
        let network = Self { version: VERSION, kind, recipe, conditioning: None, weights, biases };
        network.check().map(|()| network)
    }

    fn check(&self) -> Result<(), TouchError> {
        let layers = self.kind.layers();
        for (what, found) in
            [("weight tables of a network", self.weights.len()), ("bias tables of a network", self.biases.len())]
        {
            if found != layers.len() {
                return Err(TouchError::Size { what, found, expected: layers.len() });
            }
        }
        for ((inputs, outputs, kernel), (weights, biases)) in layers.iter().zip(self.weights.iter().zip(&self.biases)) {
            for (what, found, expected) in [
                ("weights of a layer", weights.len(), inputs * outputs * kernel * kernel),
                ("biases of a layer", biases.len(), *outputs),
            ] {
                if found != expected {
                    return Err(TouchError::Size { what, found, expected });
                }
            }
            if !weights.iter().chain(biases).all(|value| value.is_finite()) {
                return Err(TouchError::NotFinite("a network's weight"));
            }
        }
        Ok(())
    }

    /// Reads a network from JSON text; `path` is for messages.
    pub fn parse(text: &str, path: &Path) -> Result<Self, TouchError> {
        let fault = |message: String| TouchError::NetworkFormat { path: path.into(), message };
        let network: Self = serde_json::from_str(text).map_err(|error| fault(error.to_string()))?;
        if network.version != VERSION {
            return Err(fault(format!("version {}, expected {VERSION}", network.version)));
        }
        network.check().map_err(|error| fault(error.to_string()))?;
        Ok(network)
    }

    /// Reads a network file.
    pub fn read(path: &Path) -> Result<Self, TouchError> {
        let text =
            ftac_platform::file::read_text(path).map_err(|source| TouchError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Prepares the weights for evaluation.
    pub fn prepare(&self) -> PreparedNetwork {
        let layers = self.kind.layers().iter().zip(self.weights.iter().zip(&self.biases));
        PreparedNetwork {
            kind: self.kind,
            layers: layers
                .map(|((inputs, outputs, kernel), (weights, biases))| {
                    Layer::new(*inputs, *outputs, *kernel, weights, biases)
                })
                .collect(),
        }
    }
}

/// A network with its weights laid out for inference.
#[derive(Debug, Clone)]
pub struct PreparedNetwork {
    kind: NetworkKind,
    layers: Vec<Layer>,
}

impl PreparedNetwork {
    /// Computes [`gradients`](crate::photometric_stereo::gradients) with the network; `model` is the photometric model
    /// of the pad's `configuration`. `None` if the pad is untouched.
    pub fn gradients(
        &self,
        image: &TactileImage,
        background: &TactileImage,
        (configuration, model): (char, &PhotometricModel),
        options: &StereoOptions,
    ) -> Option<Gradients> {
        let ImageChange { region, gain } = find_change(image, background, options)?;
        let region = multiple_of_four(region);
        let change = colour_change(image, background, ImageChange { region, gain });
        let (mut gx, mut gy) = (vec![0.0; PIXELS], vec![0.0; PIXELS]);
        let width = region.column_end - region.column_begin;
        for (k, normal) in self.normals(&change, configuration, model, region).into_iter().enumerate() {
            let i = (region.row_begin + k / width) * N + region.column_begin + k % width;
            [gx[i], gy[i]] = gradient_from_normal(normal);
        }
        Some(Gradients { gx, gy, region })
    }

    /// x and y components of the normal for every pixel of `region`, whose sides are multiples of 4.
    pub(crate) fn normals(
        &self,
        change: &[[f32; 3]],
        configuration: char,
        model: &PhotometricModel,
        region: Region,
    ) -> Vec<[f32; 2]> {
        let (width, height) = (region.column_end - region.column_begin, region.row_end - region.row_begin);
        let read = model_normals(change, model, region);
        let sight = NetworkInput { change, model_normals: &read, configuration, region };
        let planes = Planes::from_fn(self.kind.inputs(), height, width, |plane, row, column| {
            sight.input(self.kind, plane, row, column)
        });
        let out = self.output(&planes);
        let fold = self.kind.output_block_side();
        let mut normals = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let start = sight.initial_normal(self.kind, row, column);
                let at = |axis: usize| {
                    let plane = fold * fold * axis + fold * (row % fold) + column % fold;
                    start[axis] + out.at(plane, row / fold, column / fold)
                };
                normals.push(limit_slope([at(0), at(1)]));
            }
        }
        normals
    }

    /// Evaluates the network on input planes and returns the planes of the last layer.
    pub fn output(&self, planes: &Planes) -> Planes {
        match (self.kind, self.layers.as_slice()) {
            (NetworkKind::EncoderDecoder, [down, further, middle, up, decode, last]) => {
                let half = down.run(planes, 2, true);
                let quarter = further.run(&half, 2, true);
                let mut lifted = up.run(&middle.run(&quarter, 1, true), 1, false).upsampled();
                lifted.add(&half);
                last.run(&decode.run(&lifted, 1, true), 1, false)
            }
            (_, layers) => {
                let mut planes = planes.clone();
                for (k, layer) in layers.iter().enumerate() {
                    planes = layer.run(&planes, 1, k + 1 < layers.len());
                }
                planes
            }
        }
    }
}

/// The photometric model's normals in `region`, row-major.
pub fn model_normals(change: &[[f32; 3]], model: &PhotometricModel, region: Region) -> Vec<[f32; 2]> {
    let mut normals = Vec::new();
    for row in region.row_begin..region.row_end {
        let line = &change[row * N + region.column_begin..row * N + region.column_end];
        model.row(row).normals(region.column_begin, line, |_, normal| normals.push(normal));
    }
    normals
}

/// The inputs of a network in a region of an image.
pub struct NetworkInput<'a> {
    /// Relative colour change of the whole image.
    pub change: &'a [[f32; 3]],
    /// The photometric model's normals in the region.
    pub model_normals: &'a [[f32; 2]],
    /// Letter of the sensor configuration.
    pub configuration: char,
    /// Region in which the gradients are computed.
    pub region: Region,
}

impl NetworkInput<'_> {
    /// Value of an input plane at a pixel of the region.
    pub fn input(&self, kind: NetworkKind, plane: usize, row: usize, column: usize) -> f32 {
        let (at_row, at_column) = (self.region.row_begin + row, self.region.column_begin + column);
        let place = |at: usize| (at as f32 + 0.5) / (0.5 * N as f32) - 1.0;
        let width = self.region.column_end - self.region.column_begin;
        match (plane, kind) {
            (0..3, _) => self.change[at_row * N + at_column][plane],
            (3, _) => place(at_column),
            (4, _) => -place(at_row),
            (_, NetworkKind::EncoderDecoder) => self.model_normals[row * width + column][plane - 5],
            (_, NetworkKind::PerPixel) => f32::from(CONFIGURATIONS[plane - 5] == self.configuration),
        }
    }

    /// Normal to which the network's output is added.
    pub fn initial_normal(&self, kind: NetworkKind, row: usize, column: usize) -> [f32; 2] {
        match kind {
            NetworkKind::EncoderDecoder => {
                self.model_normals[row * (self.region.column_end - self.region.column_begin) + column]
            }
            NetworkKind::PerPixel => [0.0; 2],
        }
    }
}

/// Extends the region to multiples of 4.
fn multiple_of_four(region: Region) -> Region {
    let (down, up) = (|at: usize| at / 4 * 4, |at: usize| at.next_multiple_of(4).min(N));
    Region {
        column_begin: down(region.column_begin),
        column_end: up(region.column_end),
        row_begin: down(region.row_begin),
        row_end: up(region.row_end),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_network_files_are_errors() {
        let path = Path::new("network.json");
        let kind = NetworkKind::PerPixel;
        let tables = |f: &dyn Fn(&LayerShape) -> usize| -> Vec<Vec<f32>> {
            kind.layers().iter().map(|layer| vec![0.5; f(layer)]).collect()
        };
        let (weights, biases) = (tables(&|(i, o, k)| i * o * k * k), tables(&|layer| layer.1));
        let good = Network::new(kind, "by hand".into(), weights.clone(), biases.clone()).unwrap();
        let text = serde_json::to_string(&good).unwrap();
        assert_eq!(Network::parse(&text, path).unwrap(), good);
        let fault = |text: &str| Network::parse(text, path).unwrap_err().to_string();
        assert!(fault("{}").contains("network.json: not a network: missing field"));
        let other = text.replace("\"version\":1", "\"version\":9");
        assert!(fault(&other).ends_with("version 9, expected 1"));
        let mut short = weights.clone();
        short[1].pop();
        let error = Network::new(kind, String::new(), short, biases.clone()).unwrap_err().to_string();
        assert_eq!(error, "weights of a layer: found 1023, expected 1024");
        let mut broken = weights;
        broken[0][3] = f32::NAN;
        assert!(Network::new(kind, String::new(), broken, biases).is_err());
    }
}
