//! Many images at once, on one of two backends: the CPU, or a GPU through wgpu (cargo feature `gpu`).
//!
//! Both run the same algorithm on the same sensors. Images of the CPU are the same bits on every machine and for any number of threads;
//! those of a GPU differ from them by its rounding, a grey level at most on nearly all pixels.

use std::sync::Arc;

use hand_model::robot::TactileImage;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use crate::error::OpticsError;
use crate::indentation::IndentationMap;
use crate::sensor::Sensor;

/// One image to make.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// Which of the renderer's sensors.
    pub sensor: usize,
    /// What presses into it.
    pub indentation: &'a IndentationMap,
    /// Seed of the read-out noise.
    pub noise: u64,
}

/// Renders images of a fixed set of sensors.
pub trait Renderer: Send + Sync + std::fmt::Debug {
    /// What it runs on, for people.
    fn device(&self) -> String;

    /// The sensors, as [`Job::sensor`] counts them.
    fn sensors(&self) -> &[Sensor];

    /// One image a job, in their order. Fails if a job names no sensor, or if the device fails.
    fn render(&self, jobs: &[Job<'_>]) -> Result<Vec<TactileImage>, OpticsError>;
}

/// Renders on the CPU, an image a thread.
#[derive(Debug, Clone)]
pub struct CpuRenderer {
    sensors: Arc<Vec<Sensor>>,
}

impl CpuRenderer {
    /// A renderer of these sensors.
    pub fn new(sensors: Arc<Vec<Sensor>>) -> Self {
        Self { sensors }
    }
}

impl Renderer for CpuRenderer {
    fn device(&self) -> String {
        "CPU".into()
    }

    fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    fn render(&self, jobs: &[Job<'_>]) -> Result<Vec<TactileImage>, OpticsError> {
        jobs.par_iter()
            .map(|job| {
                let sensor = sensor_of(&self.sensors, job)?;
                Ok(sensor.render(job.indentation, &mut ChaCha8Rng::seed_from_u64(job.noise)))
            })
            .collect()
    }
}

/// The sensor a job names.
pub(crate) fn sensor_of<'a>(sensors: &'a [Sensor], job: &Job<'_>) -> Result<&'a Sensor, OpticsError> {
    sensors.get(job.sensor).ok_or(OpticsError::NoSensor { found: job.sensor, count: sensors.len() })
}
