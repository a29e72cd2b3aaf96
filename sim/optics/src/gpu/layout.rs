//! Layout of sensors and jobs in the GPU's buffers. `optics.wgsl` reads these buffers with the same constants.

use hand_model::pads::IMAGE_SIZE;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::error::OpticsError;
use crate::indentation::PIXEL_COUNT;
use crate::noise::ReadOutNoise;
use crate::renderer::{RenderJob, sensor_of};
use crate::sensor::Sensor;

/// Number of words of one job: a header of 16, then each row's start in the noise table.
pub(super) const JOB_WORDS: usize = 256;
const JOB_HEADER_WORDS: usize = 16;
/// Number of floats of a sensor's header and of a lamp.
const SENSOR_HEADER_FLOATS: usize = 32;
const LAMP_FLOATS: usize = 12;
/// Number of pixels along a shadow cell's side.
const SHADOW_CELL_PIXELS: usize = 2;

/// Packs the parameters of all sensors; also returns the index of each sensor's first.
pub(super) fn pack_sensors(sensors: &[Sensor]) -> (Vec<f32>, Vec<usize>) {
    let mut all = Vec::new();
    let mut starts = Vec::with_capacity(sensors.len());
    for sensor in sensors {
        starts.push(all.len());
        let (model, camera) = (sensor.model(), sensor.camera());
        let ((x0, y0), (dx, dy)) = (camera.pixel_center(0, 0), camera.pixel_size());
        let mut header = [0.0f32; SENSOR_HEADER_FLOATS];
        let position = model.camera.position;
        let geometry =
            [position.x, position.y, position.z, dx, dy, x0, y0, model.reflectance.a(), model.reflectance.b()];
        header.iter_mut().zip(geometry).for_each(|(slot, value)| *slot = value as f32);
        header.iter_mut().skip(9).zip(model.ambient).for_each(|(slot, value)| *slot = value as f32);
        header[12] = model.lamps.len() as f32;
        header[13] = model.elastomer.kernels.len() as f32;
        let radii = model.elastomer.radii((dx, dy)).into_iter().flat_map(|(rx, ry)| [rx, ry]);
        header.iter_mut().skip(14).zip(radii).for_each(|(slot, radius)| *slot = radius as f32);
        all.extend(header);
        for (lamp, power) in model.lamps.iter().zip(sensor.lamp_powers()) {
            let (p, d) = (lamp.position, lamp.direction);
            let geometry = [p.x, p.y, p.z, d.x, d.y, d.z, lamp.mu].map(|value| value as f32);
            let mut words = [0.0f32; LAMP_FLOATS];
            words.iter_mut().zip(geometry.into_iter().chain(power)).for_each(|(slot, value)| *slot = value);
            words[10] = lamp.size as f32;
            all.extend(words);
        }
        for table in sensor.responses() {
            all.extend(table.values());
        }
        all.extend(sensor.noise_table());
        all.extend(sensor.background_grey());
        all.extend(sensor.correction());
    }
    (all, starts)
}

/// Data of the jobs that are rendered in one pass.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) jobs: Vec<u32>,
    /// The objects' own depths, with the jobs' rectangles one after the other.
    pub(super) object_depths: Vec<f32>,
    /// Number of floats for the shadows.
    pub(super) shadow_floats: usize,
    pub(super) count: usize,
    /// Largest width and height of a rectangle, and largest number of lamps.
    pub(super) max_sizes: [usize; 3],
}

impl Batch {
    /// Packs as many jobs as fit into buffers of `limit` bytes, at least one.
    pub(super) fn pack(
        jobs: &[RenderJob<'_>],
        sensors: &[Sensor],
        starts: &[usize],
        shadows: bool,
        limit: usize,
    ) -> Result<Self, OpticsError> {
        let mut batch = Self::default();
        let most_jobs = (limit / (3 * PIXEL_COUNT)).clamp(1, 65_535);
        for job in jobs.iter().take(most_jobs) {
            let sensor = sensor_of(sensors, job)?;
            let rectangle = sensor.gel_rectangle(job.indentation);
            let lamps = sensor.model().lamps.len();
            let (width, height) = rectangle.map_or((0, 0), |area| (area.width(), area.height()));
            let share = lamps * width.div_ceil(SHADOW_CELL_PIXELS) * height.div_ceil(SHADOW_CELL_PIXELS);
            let full = 4 * (batch.object_depths.len() + width * height).max(batch.shadow_floats + share) > limit;
            if full && batch.count > 0 {
                break;
            }
            let mut words = [0u32; JOB_WORDS];
            let (left, top) = rectangle.map_or((0, 0), |area| (area.left, area.top));
            let header =
                [starts[job.sensor], left, top, width, height, batch.object_depths.len(), batch.shadow_floats, lamps];
            words.iter_mut().zip(header).for_each(|(slot, value)| *slot = value as u32);
            words[8] = u32::from(shadows);
            words[9] = job.brightness.to_bits();
            let mut rng = ChaCha8Rng::seed_from_u64(job.noise_seed);
            words[JOB_HEADER_WORDS..JOB_HEADER_WORDS + IMAGE_SIZE]
                .fill_with(|| ReadOutNoise::random_start(&mut rng) as u32);
            batch.jobs.extend(words);
            if let Some(area) = rectangle {
                batch.object_depths.extend(job.indentation.crop(&area));
            }
            batch.shadow_floats += share;
            batch.count += 1;
            batch.max_sizes =
                [batch.max_sizes[0].max(width), batch.max_sizes[1].max(height), batch.max_sizes[2].max(lamps)];
        }
        Ok(batch)
    }
}
