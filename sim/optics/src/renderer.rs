//! Rendering of many images at once, on one of two backends: the CPU, or a GPU through wgpu (cargo feature `gpu`).
//!
//! Both run the same algorithm on the same sensors. CPU images are bit-identical on every machine and for any number of
//! threads; GPU images differ by rounding, by at most one grey level on nearly all pixels.

use std::sync::Arc;

use hand_model::robot::TactileImage;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use crate::error::OpticsError;
use crate::indentation::IndentationMap;
use crate::sensor::Sensor;

/// One image to render.
#[derive(Debug, Clone, Copy)]
pub struct RenderJob<'a> {
    /// Index of the renderer's sensor.
    pub sensor: usize,
    /// The indentation under which the sensor is seen.
    pub indentation: &'a IndentationMap,
    /// Seed of the read-out noise.
    pub noise_seed: u64,
    /// Factor on all grey levels except the noise: 1 is the sensor as calibrated.
    pub brightness: f32,
}

/// Renders images of a fixed set of sensors.
pub trait Renderer: Send + Sync + std::fmt::Debug {
    /// Returns the name of the device, for messages.
    fn device(&self) -> String;

    /// Returns the sensors, in the order of [`RenderJob::sensor`].
    fn sensors(&self) -> &[Sensor];

    /// Renders one image per job, in order. Returns an error if a job names a sensor that does not exist, or if the
    /// device fails.
    fn render(&self, jobs: &[RenderJob<'_>]) -> Result<Vec<TactileImage>, OpticsError>;
}

/// Renders on the CPU, images in parallel.
///
/// ```
/// use std::sync::Arc;
///
/// use tactile_optics::hand_model::Hand;
/// use tactile_optics::{CpuRenderer, IndentationMap, RenderJob, Renderer, Sensor};
///
/// let hand = Hand::ftac();
/// let sensor = Sensor::nominal(&hand.pads[0], &hand.cameras[0]);
/// let renderer = CpuRenderer::new(Arc::new(vec![sensor]));
/// let indentation = IndentationMap::idle();
/// let job = RenderJob { sensor: 0, indentation: &indentation, noise_seed: 1, brightness: 1.0 };
/// let images = renderer.render(&[job, RenderJob { noise_seed: 2, ..job }, job])?;
/// assert!(images[0] == images[2] && images[0] != images[1]);
/// assert!(renderer.render(&[RenderJob { sensor: 1, ..job }]).is_err());
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct CpuRenderer {
    sensors: Arc<Vec<Sensor>>,
}

impl CpuRenderer {
    /// Creates a renderer of these sensors, without a check or a copy.
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

    fn render(&self, jobs: &[RenderJob<'_>]) -> Result<Vec<TactileImage>, OpticsError> {
        jobs.par_iter()
            .map(|job| {
                let sensor = sensor_of(&self.sensors, job)?;
                Ok(sensor.render_with_brightness(
                    job.indentation,
                    job.brightness,
                    &mut ChaCha8Rng::seed_from_u64(job.noise_seed),
                ))
            })
            .collect()
    }
}

/// Returns the sensor that a job names.
pub(crate) fn sensor_of<'a>(sensors: &'a [Sensor], job: &RenderJob<'_>) -> Result<&'a Sensor, OpticsError> {
    sensors.get(job.sensor).ok_or(OpticsError::NoSensor { found: job.sensor, count: sensors.len() })
}
