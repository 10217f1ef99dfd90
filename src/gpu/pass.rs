//! Compute passes and the text of their shaders.

use super::{GpuDevice, GpuError};
use crate::constants;

/// What all shaders of pairs of primitives share, in order.
pub(super) const KERNELS: &[&str] = &[
    include_str!("../../shaders/primitive.wgsl"),
    include_str!("../../shaders/nearest.wgsl"),
    include_str!("../../shaders/separation.wgsl"),
    include_str!("../../shaders/time_of_impact.wgsl"),
];

/// Constants, then some files: WGSL knows no modules.
pub(super) fn shader(files: &[&str]) -> String {
    let mut text = String::new();
    let numbers = [
        ("CONTACT_ROUNDING", constants::CONTACT_ROUNDING),
        ("TOUCH_ROUNDING", constants::TOUCH_ROUNDING),
        ("DISTANCE_ROUNDING", constants::DISTANCE_ROUNDING),
        ("NEAR_TOUCH", constants::NEAR_TOUCH),
        ("TILT_ROUNDING", constants::TILT_ROUNDING),
        ("TIME_TOLERANCE", constants::TIME_TOLERANCE),
        ("FIRST_TRIAL", constants::FIRST_TRIAL),
        ("SHORTEST_TRIAL", constants::SHORTEST_TRIAL),
        ("CHORD_TOLERANCE", constants::CULLING_CHORD_TOLERANCE),
        ("FINE_CHORD_TOLERANCE", constants::CHORD_TOLERANCE),
        ("ILL_CONDITIONED", constants::ILL_CONDITIONED),
        ("EPSILON", f32::EPSILON),
        ("MAX", f32::MAX),
    ];
    for (name, value) in numbers {
        // The shortest digits that give the same bits.
        text += &format!("const {name}: f32 = {value:e}f;\n");
    }
    for (name, value) in [
        ("MAX_ADVANCES", constants::MAX_ADVANCES),
        ("MAX_ROUNDS", constants::MAX_ROUNDS),
        ("MAX_CHORDS", constants::MAX_CULLING_CHORDS),
    ] {
        text += &format!("const {name}: u32 = {value}u;\n");
    }
    for file in files {
        text.push_str(file);
    }
    text
}

/// An entry point and the layout of what it binds.
pub(crate) struct Pass {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Pass {
    /// A pass whose shader is the `text`, with the label as the name of its entry point.
    pub(super) fn new(gpu: &GpuDevice, label: &'static str, text: String) -> Result<Self, GpuError> {
        gpu.checked(format_args!("the pass `{label}`"), |device| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(text.into()),
            });
            let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(label),
                layout: None,
                module: &module,
                entry_point: Some(label),
                compilation_options: Default::default(),
                cache: None,
            });
            Self::of(label, pipeline)
        })
    }

    /// A pass of a pipeline without a layout of its own.
    pub fn of(label: &'static str, pipeline: wgpu::ComputePipeline) -> Self {
        Self { label, layout: pipeline.get_bind_group_layout(0), pipeline }
    }

    /// The buffers that it binds, with their numbers.
    pub(super) fn bind(&self, gpu: &GpuDevice, buffers: &[(u32, wgpu::BufferBinding)]) -> wgpu::BindGroup {
        let entries: Vec<_> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: wgpu::BindingResource::Buffer(buffer.clone()),
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.layout,
            entries: &entries,
        })
    }

    /// Sets the pass up within a compute pass.
    pub(super) fn set(&self, pass: &mut wgpu::ComputePass, group: &wgpu::BindGroup) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
    }
}
