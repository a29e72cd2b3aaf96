//! The GPU backend: image formation as compute shaders, for all pads of many hands at once.
//!
//! Each stage (smoothing along columns and rows for every kernel, cast shadows, exposure) is one dispatch over all images
//! of a batch. Maps are only as large as the contact and its shadows require. Data that does not depend on the contact
//! (lamps, response tables, backgrounds, noise) is uploaded once. Each batch in flight has buffers of its own, so that
//! one is packed or copied back while the GPU renders another, of the same call or of another thread's.

mod device;
mod layout;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hand_model::robot::TactileImage;
use rayon::prelude::*;
use wgpu::{Buffer, BufferUsages, ComputePass, ComputePipeline};

use crate::error::OpticsError;
use crate::gpu::device::Gpu;
use crate::gpu::layout::{Batch, JOB_WORDS};
use crate::indentation::PIXEL_COUNT;
use crate::renderer::{RenderJob, Renderer};
use crate::sensor::Sensor;

/// Size of an image, bytes.
const IMAGE_BYTES: usize = 3 * PIXEL_COUNT;
/// Number of lines per workgroup of the smoothing.
const LINES_PER_WORKGROUP: usize = 8;
/// Number of images of a batch.
const BATCH_IMAGES: usize = 256;
/// Largest buffer of a batch, bytes.
const MAX_BATCH_BYTES: u64 = 512 << 20;

/// Renderer of tactile images on a GPU, through wgpu.
#[derive(Debug)]
pub struct GpuRenderer {
    gpu: Gpu,
    sensors: Arc<Vec<Sensor>>,
    /// Index of each sensor's first parameter.
    starts: Vec<usize>,
    constants: Buffer,
    shadows: bool,
    /// Buffers that no batch uses at present.
    idle_buffers: Mutex<Vec<Buffers>>,
}

/// Buffers of a batch.
#[derive(Debug)]
struct Buffers {
    jobs: Buffer,
    object_depths: Buffer,
    depth: Buffer,
    share: Buffer,
    bytes: Buffer,
    read: Buffer,
}

impl GpuRenderer {
    /// Creates a renderer of these sensors on the best GPU. Without one, the error names the adapters found.
    pub fn new(sensors: Arc<Vec<Sensor>>) -> Result<Self, OpticsError> {
        Self::open(sensors, false)
    }

    /// Like [`Self::new`], on a software adapter: for tests of the shaders; slower than the CPU backend.
    pub fn on_software(sensors: Arc<Vec<Sensor>>) -> Result<Self, OpticsError> {
        Self::open(sensors, true)
    }

    fn open(sensors: Arc<Vec<Sensor>>, software: bool) -> Result<Self, OpticsError> {
        let kernels = sensors.iter().map(|sensor| sensor.model().elastomer.kernels.len()).max().unwrap_or(0);
        let gpu = Gpu::open(software, kernels)?;
        let (numbers, starts) = layout::pack_sensors(&sensors);
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        let size = 4 * numbers.len().max(1) as u64;
        if size > limit {
            return Err(OpticsError::Gpu(format!(
                "{}: {} sensors need {} MB; it binds at most {} MB",
                gpu.name,
                sensors.len(),
                size >> 20,
                limit >> 20
            )));
        }
        let constants = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("sensors"),
            size,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&constants, 0, bytemuck::cast_slice(&numbers));
        Ok(Self { gpu, sensors, starts, constants, shadows: true, idle_buffers: Mutex::default() })
    }

    /// Returns the same renderer without cast shadows.
    pub fn without_shadows(self) -> Self {
        Self { shadows: false, ..self }
    }

    fn render_batch(&self, batch: &Batch) -> Result<Vec<TactileImage>, OpticsError> {
        let fault = |what: String| OpticsError::Gpu(format!("{}: {what}", self.gpu.name));
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let buffers = self.buffers_for(batch).or_else(|_| {
            // Those of other sizes may fill the memory.
            self.idle().clear();
            self.buffers_for(batch)
        })?;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        queue.write_buffer(&buffers.jobs, 0, bytemuck::cast_slice(&batch.jobs));
        queue.write_buffer(&buffers.object_depths, 0, bytemuck::cast_slice(&batch.object_depths));
        let bound =
            [&self.constants, &buffers.jobs, &buffers.object_depths, &buffers.depth, &buffers.share, &buffers.bytes];
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(bound)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("batch"),
            layout: &self.gpu.layout,
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("batch") });
        if !batch.object_depths.is_empty() {
            encoder.copy_buffer_to_buffer(
                &buffers.object_depths,
                0,
                &buffers.depth,
                0,
                4 * batch.object_depths.len() as u64,
            );
        }
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &group, &[]);
            let count = batch.count as u32;
            let stage = |pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, across: usize| {
                if across > 0 {
                    pass.set_pipeline(pipeline);
                    pass.dispatch_workgroups(across as u32, count, 1);
                }
            };
            let [width, height, lamps] = batch.max_sizes;
            for (columns, rows) in self.gpu.smooth_columns.iter().zip(&self.gpu.smooth_rows) {
                stage(&mut pass, columns, width.div_ceil(LINES_PER_WORKGROUP));
                stage(&mut pass, rows, height.div_ceil(LINES_PER_WORKGROUP));
            }
            if self.shadows && width > 0 {
                stage(&mut pass, &self.gpu.cast_shadows, lamps);
            }
            stage(&mut pass, &self.gpu.expose, hand_model::pads::IMAGE_SIZE);
        }
        let size = (batch.count * IMAGE_BYTES) as u64;
        encoder.copy_buffer_to_buffer(&buffers.bytes, 0, &buffers.read, 0, size);
        let submission = queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        buffers.read.map_async(wgpu::MapMode::Read, 0..size, move |result| {
            // The receiver outlives the wait below.
            let _ = sender.send(result);
        });
        let done = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        device.poll(done).map_err(|error| fault(error.to_string()))?;
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(fault(error.to_string()));
        }
        receiver.recv().map_err(|error| fault(error.to_string()))?.map_err(|error| fault(error.to_string()))?;
        let images = {
            let view = buffers.read.get_mapped_range(0..size).map_err(|error| fault(error.to_string()))?;
            view.chunks_exact(IMAGE_BYTES).map(|rgb| TactileImage { rgb: rgb.to_vec() }).collect()
        };
        buffers.read.unmap();
        self.idle().push(buffers);
        Ok(images)
    }

    /// Locks the buffers that no batch uses. The list is valid even if another thread panicked while holding the lock.
    fn idle(&self) -> MutexGuard<'_, Vec<Buffers>> {
        self.idle_buffers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns buffers large enough for a batch: idle ones if they suffice. Returns an error if the memory does not.
    fn buffers_for(&self, batch: &Batch) -> Result<Buffers, OpticsError> {
        let needs = [
            4 * JOB_WORDS * batch.count,
            4 * batch.object_depths.len(),
            4 * batch.shadow_floats,
            IMAGE_BYTES * batch.count,
        ];
        let [jobs, own, share, bytes] = needs.map(|bytes| bytes.max(16) as u64);
        let large = |buffers: &Buffers| {
            buffers.jobs.size() >= jobs
                && buffers.object_depths.size() >= own
                && buffers.share.size() >= share
                && buffers.bytes.size() >= bytes
        };
        // The last one is too small at times: it is dropped, so that the list does not fill with small ones.
        let idle = self.idle().pop();
        if let Some(buffers) = idle.filter(large) {
            return Ok(buffers);
        }
        let device = &self.gpu.device;
        let make = |label: &str, size: u64, usage: BufferUsages| {
            let label = Some(label);
            device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
        };
        let (storage, to, from) = (BufferUsages::STORAGE, BufferUsages::COPY_DST, BufferUsages::COPY_SRC);
        let memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffers = Buffers {
            jobs: make("jobs", jobs, storage | to),
            object_depths: make("own", own, storage | to | from),
            depth: make("depth", own, storage | to),
            share: make("share", share, storage),
            bytes: make("bytes", bytes, storage | from),
            read: make("read", bytes, BufferUsages::MAP_READ | to),
        };
        match pollster::block_on(memory.pop()) {
            None => Ok(buffers),
            Some(error) => Err(OpticsError::Gpu(format!("{}: {error}", self.gpu.name))),
        }
    }
}

impl Renderer for GpuRenderer {
    fn device(&self) -> String {
        self.gpu.name.clone()
    }

    fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    fn render(&self, jobs: &[RenderJob<'_>]) -> Result<Vec<TactileImage>, OpticsError> {
        let limits = self.gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(MAX_BATCH_BYTES) as usize;
        let batches = |jobs: &[RenderJob<'_>]| -> Result<Vec<TactileImage>, OpticsError> {
            let mut images = Vec::with_capacity(jobs.len());
            while images.len() < jobs.len() {
                let batch = Batch::pack(&jobs[images.len()..], &self.sensors, &self.starts, self.shadows, limit)?;
                images.extend(self.render_batch(&batch)?);
            }
            Ok(images)
        };
        if jobs.len() <= BATCH_IMAGES {
            // On the caller's thread: a thread of the pool would only wait for the GPU.
            return batches(jobs);
        }
        let images: Result<Vec<_>, _> = jobs.par_chunks(BATCH_IMAGES).map(batches).collect();
        Ok(images?.into_iter().flatten().collect())
    }
}
