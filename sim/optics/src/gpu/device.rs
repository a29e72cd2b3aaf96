//! Selection of a GPU, and its compute pipelines.

use wgpu::{Adapter, BindGroupLayout, ComputePipeline, Device, DeviceType, Queue};

use crate::error::OpticsError;

/// Largest number of an elastomer's kernels; limited by the size of a sensor's header.
pub(super) const MAX_KERNELS: usize = 9;

/// Device and pipelines.
#[derive(Debug)]
pub(super) struct Gpu {
    pub(super) name: String,
    pub(super) device: Device,
    pub(super) queue: Queue,
    pub(super) layout: BindGroupLayout,
    /// One pipeline per kernel.
    pub(super) smooth_columns: Vec<ComputePipeline>,
    pub(super) smooth_rows: Vec<ComputePipeline>,
    pub(super) cast_shadows: ComputePipeline,
    pub(super) expose: ComputePipeline,
}

/// Selects the best adapter: a discrete GPU before an integrated one. A software adapter (`DeviceType::Cpu`) is slower
/// than the CPU backend, so it is used only on request (`software`), for tests.
fn find_adapter(software: bool) -> Result<Adapter, OpticsError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let all = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    let names: Vec<String> = all
        .iter()
        .map(Adapter::get_info)
        .map(|info| match info.device_type {
            DeviceType::Cpu => format!("{} (a CPU, not counted as a GPU)", info.name),
            _ => info.name,
        })
        .collect();
    let rank = |adapter: &Adapter| match adapter.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu | DeviceType::Other => 2,
        DeviceType::Cpu => 3,
    };
    let wanted = |adapter: &Adapter| (rank(adapter) == 3) == software;
    all.into_iter().filter(wanted).min_by_key(rank).ok_or_else(|| {
        let found = if names.is_empty() { "no Vulkan adapter".to_owned() } else { names.join(", ") };
        OpticsError::Gpu(format!("found {found}; expected a {}", if software { "software adapter" } else { "GPU" }))
    })
}

impl Gpu {
    /// Opens the best adapter and builds the pipelines for elastomers of up to `kernels` kernels.
    pub(super) fn open(software: bool, kernels: usize) -> Result<Self, OpticsError> {
        if kernels > MAX_KERNELS {
            return Err(OpticsError::Gpu(format!("found {kernels} smoothing kernels; expected at most {MAX_KERNELS}")));
        }
        let adapter = find_adapter(software)?;
        let name = adapter.get_info().name;
        let fault = |what: String| OpticsError::Gpu(format!("{name}: {what}"));
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        }))
        .map_err(|error| fault(error.to_string()))?;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::include_wgsl!("optics.wgsl"));
        let writable = [false, false, false, true, true, true];
        let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..)
            .zip(writable)
            .map(|(binding, writable)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: !writable },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("optics"), entries: &entries });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("optics"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let stage = |entry: &str, kernel: usize| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("kernel", kernel as f64)],
                    zero_initialize_workgroup_memory: false,
                },
                cache: None,
            })
        };
        let smooth_columns = (0..kernels).map(|k| stage("smooth_columns", k)).collect();
        let smooth_rows = (0..kernels).map(|k| stage("smooth_rows", k)).collect();
        let (cast_shadows, expose) = (stage("cast_shadows", 0), stage("expose", 0));
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(fault(error.to_string()));
        }
        Ok(Self { name, device, queue, layout, smooth_columns, smooth_rows, cast_shadows, expose })
    }
}
