//! Compute passes and the text of their shaders.

use super::{GpuDevice, GpuError, kinds::Kind};
use crate::constants;

/// Source of the kernel that finds nearest spheres. It needs [`NEARER`] or another type of their pair.
pub(super) const NEAREST: &str = include_str!("../../shaders/nearest.wgsl");
/// Source of the nearest pair of spheres, without the spheres themselves.
pub(super) const NEARER: &str = include_str!("../../shaders/nearer.wgsl");
/// Source of the kernel that finds bounds. It needs [`NEARER`], [`NEAREST`] and the constants of a [`Kind`].
pub(super) const BOUNDS: &str = include_str!("../../shaders/bounds.wgsl");

/// Joins constants and files into one shader for a kind of primitive pairs.
pub(super) fn shader_of_kind<'a>(kind: Kind, files: impl IntoIterator<Item = &'a str>) -> String {
    kind.constants() + &shader(files)
}

/// Joins constants and files into one shader, because WGSL has no modules.
pub(super) fn shader<'a>(files: impl IntoIterator<Item = &'a str>) -> String {
    let mut text = String::new();
    for (name, value) in [
        ("CONTACT_ROUNDING", constants::CONTACT_ROUNDING),
        ("CHORD_TOLERANCE", constants::CULLING_CHORD_TOLERANCE),
        ("FINE_CHORD_TOLERANCE", constants::CHORD_TOLERANCE),
        ("SHORTEST_ADVANCE", constants::SHORTEST_ADVANCE),
        ("EPSILON", f32::EPSILON),
        ("MAX", f32::MAX),
    ] {
        // This format prints the shortest digits that give the same bits.
        text += &format!("const {name}: f32 = {value:e}f;\n");
    }
    for (name, value) in [
        ("MAX_LINKS", constants::MAX_LINKS),
        ("MAX_ADVANCES", constants::MAX_ADVANCES),
        ("MAX_CHORDS", constants::MAX_CULLING_CHORDS),
        ("MAX_ITERATIONS", constants::MAX_ITERATIONS),
    ] {
        text += &format!("const {name}: u32 = {value}u;\n");
    }
    for file in files {
        text.push_str(file);
    }
    text
}

/// Returns the entry point of a pass from its label, which may also name a kind of primitive pairs, after a colon.
pub(crate) fn entry_point(label: &str) -> &str {
    label.split_once(':').map_or(label, |(entry_point, _)| entry_point)
}

/// A pipeline and the layout of its bindings.
pub(crate) struct Pass {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Pass {
    /// Creates a pass from the text of its shader.
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
                entry_point: Some(entry_point(label)),
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
