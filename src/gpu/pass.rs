//! Compute passes and the text of their shaders.

use super::{GpuDevice, GpuError};
use crate::constants;

/// Source of the kernels on pairs of primitives, in order.
pub(super) const KERNELS: &[&str] = &[
    include_str!("../../shaders/primitive.wgsl"),
    include_str!("../../shaders/nearest.wgsl"),
    include_str!("../../shaders/separation.wgsl"),
    include_str!("../../shaders/time_of_impact.wgsl"),
];

/// Joins constants and files into one shader, because WGSL has no modules.
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
        // This format prints the shortest digits that give the same bits.
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

/// A pipeline and the layout of its bindings.
pub(crate) struct Pass {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Pass {
    /// Creates a pass from the text of its shader. The label is the name of the entry point.
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

    /// Creates a pass from a pipeline whose layout was derived from the shader.
    pub fn of(label: &'static str, pipeline: wgpu::ComputePipeline) -> Self {
        Self { label, layout: pipeline.get_bind_group_layout(0), pipeline }
    }

    /// Creates a bind group of these buffers, which are given with their binding numbers.
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

    /// Sets pipeline and bind group of a compute pass.
    pub(super) fn set(&self, pass: &mut wgpu::ComputePass, group: &wgpu::BindGroup) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
    }
}
