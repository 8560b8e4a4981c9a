//! Pipelines with the reflection of their programs.

use std::collections::BTreeSet;

use argus_shaders::{Binding, EntryPoint, Program};

use crate::{Gpu, quirks};

/// A compute pipeline with the reflection of its entry point.
#[derive(Debug, Clone)]
pub struct ComputePipeline {
    pub(crate) raw: wgpu::ComputePipeline,
    pub(crate) entry: &'static EntryPoint,
    pub(crate) layouts: Vec<(u32, wgpu::BindGroupLayout)>,
    /// `user/stem:entry point`, for messages.
    pub(crate) label: String,
}

/// A render pipeline: triangle lists, one sample, reversed Z.
#[derive(Debug, Clone)]
pub struct RenderPipelineDesc<'a> {
    /// Program of both entry points.
    pub program: &'static Program,
    /// Vertex entry point.
    pub vertex: &'a str,
    /// Fragment entry point; `None` for depth only.
    pub fragment: Option<&'a str>,
    /// Vertex buffers by slot.
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    /// Formats of the colour targets, without blending.
    pub targets: &'a [wgpu::TextureFormat],
    /// Depth format. The greater depth (reversed Z: the nearer fragment) passes and is written.
    pub depth: Option<wgpu::TextureFormat>,
    /// Winding of front faces and which face is culled.
    pub primitive: wgpu::PrimitiveState,
    /// Values for the `override`s of the fragment's program; see [`Gpu::compute_pipeline_with`].
    pub constants: &'a [(&'a str, f64)],
}

/// A render pipeline with the reflection of its entry points.
#[derive(Debug, Clone)]
pub struct RenderPipeline {
    pub(crate) raw: wgpu::RenderPipeline,
    pub(crate) bindings: Vec<Binding>,
    pub(crate) layouts: Vec<(u32, wgpu::BindGroupLayout)>,
    pub(crate) label: String,
}

impl ComputePipeline {
    /// Invocations of a workgroup, as the WGSL declares them.
    pub fn workgroup_size(&self) -> [u32; 3] {
        self.entry.workgroup_size
    }
}

impl Gpu {
    /// A pipeline for a compute entry point.
    ///
    /// # Panics
    /// If the program has no such entry point (a typo).
    pub fn compute_pipeline(&self, program: &'static Program, entry: &str) -> ComputePipeline {
        self.compute_pipeline_with(program, entry, &[])
    }

    /// A pipeline with values for the program's `override`s. Constants are folded, branches on
    /// uniforms may not be: `both-sides` in [`quirks`].
    ///
    /// # Panics
    /// If the program has no such entry point (a typo).
    pub fn compute_pipeline_with(
        &self,
        program: &'static Program,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        self.compute_pipeline_of(&self.module(program), program, entry, constants)
    }

    /// A pipeline like [`Self::compute_pipeline_with`] without the checks of indices and the counters of loops that wgpu adds.
    /// What they cost: `runtime-checks` in [`quirks`].
    ///
    /// # Safety
    /// Every loop of the program must end, and every index must be within its array.
    ///
    /// # Panics
    /// If the program has no such entry point (a typo).
    pub unsafe fn compute_pipeline_unchecked(
        &self,
        program: &'static Program,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        // SAFETY: the caller vouches for loops and indices.
        let module =
            unsafe { self.device.create_shader_module_trusted(descriptor(program), quirks::UNCHECKED()) };
        self.compute_pipeline_of(&module, program, entry, constants)
    }

    fn compute_pipeline_of(
        &self,
        module: &wgpu::ShaderModule,
        program: &'static Program,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        let entry = program.entry_point(entry);
        let label = format!("{}:{}", program.label, entry.name);
        let raw = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(&label),
            layout: None,
            module,
            entry_point: Some(entry.name),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                zero_initialize_workgroup_memory: quirks::ZEROES_WORKGROUP_MEMORY,
            },
            cache: None,
        });
        let layouts = groups(entry.bindings).into_iter().map(|g| (g, raw.get_bind_group_layout(g))).collect();
        ComputePipeline { raw, entry, layouts, label }
    }

    /// A pipeline for a vertex and a fragment entry point.
    ///
    /// # Panics
    /// If the program lacks one of the entry points (a typo).
    pub fn render_pipeline(&self, desc: &RenderPipelineDesc<'_>) -> RenderPipeline {
        let vertex = desc.program.entry_point(desc.vertex);
        let fragment = desc.fragment.map(|name| desc.program.entry_point(name));
        let label = format!("{}:{}", desc.program.label, fragment.map_or(vertex.name, |f| f.name));
        let module = self.module(desc.program);
        let buffers: Vec<_> = desc.buffers.iter().cloned().map(Some).collect();
        let targets: Vec<_> = desc
            .targets
            .iter()
            .map(|&format| {
                Some(wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL })
            })
            .collect();
        let raw = self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(&label),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(vertex.name),
                compilation_options: Default::default(),
                buffers: &buffers,
            },
            primitive: desc.primitive,
            depth_stencil: desc.depth.map(|format| wgpu::DepthStencilState {
                format,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: fragment.map(|fragment| wgpu::FragmentState {
                module: &module,
                entry_point: Some(fragment.name),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: desc.constants,
                    ..Default::default()
                },
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        });
        let mut bindings: Vec<Binding> = vertex.bindings.to_vec();
        for binding in fragment.map_or(&[][..], |f| f.bindings) {
            if bindings.iter().all(|b| b.name != binding.name) {
                bindings.push(*binding);
            }
        }
        let layouts = groups(&bindings).into_iter().map(|g| (g, raw.get_bind_group_layout(g))).collect();
        RenderPipeline { raw, bindings, layouts, label }
    }

    fn module(&self, program: &Program) -> wgpu::ShaderModule {
        self.device.create_shader_module(descriptor(program))
    }
}

fn descriptor(program: &Program) -> wgpu::ShaderModuleDescriptor<'_> {
    wgpu::ShaderModuleDescriptor {
        label: Some(program.label),
        source: wgpu::ShaderSource::Wgsl(program.source.into()),
    }
}

/// The bind groups of some bindings, ascending.
fn groups(bindings: &[Binding]) -> BTreeSet<u32> {
    bindings.iter().map(|b| b.group).collect()
}
