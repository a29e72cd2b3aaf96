//! `--tactile`: where a simulated hand's tactile images are rendered.

use std::sync::Arc;

use clap::ValueEnum;
use optics::{CpuRenderer, GpuRenderer, Renderer, Sensor};
use sim::tactile::TactileBoard;

/// Which backend renders tactile images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TactileBackend {
    /// The CPU: the same bits on every machine.
    Cpu,
    /// A GPU where there is one, else the CPU; images differ from the CPU's by a grey level at most on nearly all pixels.
    Gpu,
}

impl TactileBackend {
    /// The board on this backend; says on stderr what renders, unless it is the default.
    pub fn board(self, board: TactileBoard) -> TactileBoard {
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

/// The GPU's renderer of these sensors, or the CPU's where there is no GPU, which is said.
fn renderer(sensors: Arc<Vec<Sensor>>) -> Arc<dyn Renderer> {
    match GpuRenderer::new(sensors.clone()) {
        Ok(gpu) => Arc::new(gpu),
        Err(error) => {
            eprintln!("--tactile gpu: {error}");
            Arc::new(CpuRenderer::new(sensors))
        }
    }
}
