//! The option `--tactile`: renderer of a simulated hand's tactile images.

use std::sync::Arc;

use clap::ValueEnum;
use sim::tactile::TactileBoard;
use tactile_optics::{CpuRenderer, GpuRenderer, Renderer, Sensor};

/// Backend that renders tactile images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TactileBackend {
    /// CPU: bit-identical on every machine.
    Cpu,
    /// GPU if there is one, else the CPU; nearly all pixels differ from the CPU's by one grey level at most.
    Gpu,
}

impl TactileBackend {
    /// Returns the board on this backend. Prints the rendering device on stderr, unless it is the default.
    pub fn select_renderer(self, board: TactileBoard) -> TactileBoard {
        match self {
            Self::Cpu => board,
            Self::Gpu => {
                let renderer = renderer(Arc::new(board.sensors().to_vec()));
                eprintln!("tactile images: {}", renderer.device());
                TactileBoard::with_renderer(renderer)
            }
        }
    }
}

/// Returns the GPU renderer of these sensors, or the CPU's with a note if there is no GPU.
fn renderer(sensors: Arc<Vec<Sensor>>) -> Arc<dyn Renderer> {
    match GpuRenderer::new(sensors.clone()) {
        Ok(gpu) => Arc::new(gpu),
        Err(error) => {
            eprintln!("--tactile gpu: {error}");
            Arc::new(CpuRenderer::new(sensors))
        }
    }
}
