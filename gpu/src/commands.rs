//! Records passes in the order in which they run. Each call names what it reads and writes.

use std::ops::Range;
use std::sync::Arc;

use crate::bindings::{Bindable, Bound};
use crate::readback::{self, Copy};
use crate::timing::Timings;
use crate::{ComputePipeline, Finished, Gpu, GpuError, PendingReadback, RenderPipeline, quirks};

/// A submission that is being recorded.
///
/// A call names its row in the timing table, then binds resources by their WGSL names, then gives its extent. Bindings
/// are checked against the program: a missing or misspelt name panics with the name of the pass.
#[derive(Debug)]
pub struct Commands {
    gpu: Arc<Gpu>,
    encoder: wgpu::CommandEncoder,
    timings: Timings,
    /// Buffers and textures that are copied to the readback buffer after all passes.
    sources: Vec<Source>,
    faults_before: u64,
}

#[derive(Debug)]
enum Source {
    Buffer { buffer: wgpu::Buffer, range: Range<u64> },
    Texture { texture: wgpu::Texture, layer: u32 },
}

/// A submission that the GPU executes.
#[derive(Debug)]
pub struct Submitted {
    gpu: Arc<Gpu>,
    index: wgpu::SubmissionIndex,
    buffer: Option<wgpu::Buffer>,
    copies: Vec<Copy>,
    timings: Timings,
    timestamps: Option<Copy>,
    faults_before: u64,
}

/// A colour attachment and its load operation.
#[derive(Debug)]
pub struct ColorTarget<'a> {
    /// The attachment.
    pub view: &'a wgpu::TextureView,
    /// Clear value; `None` keeps the content.
    pub clear: Option<wgpu::Color>,
}

/// A depth attachment with reversed Z.
#[derive(Debug)]
pub struct DepthTarget<'a> {
    /// The attachment.
    pub view: &'a wgpu::TextureView,
    /// Whether it is first cleared to 0, which is infinitely far.
    pub clear: bool,
}

impl Gpu {
    /// Starts recording a submission.
    pub fn commands(self: &Arc<Self>, label: &str) -> Commands {
        let encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        let timings = Timings::new(self);
        let faults_before = self.fault_count();
        Commands { gpu: Arc::clone(self), encoder, timings, sources: Vec::new(), faults_before }
    }
}

impl Commands {
    /// A compute pass of one dispatch. `name` is its row in the timing table.
    pub fn compute<'a>(&'a mut self, name: &'a str, pipeline: &'a ComputePipeline) -> ComputeCall<'a> {
        let bound = Bound::new(&pipeline.label, pipeline.entry.bindings);
        ComputeCall { to: To::PassOfItsOwn { commands: self, name }, pipeline, bound, immediates: &[] }
    }

    /// A compute pass of several dispatches, each with its own bindings. `name` is its row in the timing table.
    pub fn compute_pass(&mut self, name: &str) -> ComputePass<'_> {
        let pass = self.begin_compute(name);
        ComputePass { gpu: &self.gpu, pass }
    }

    fn begin_compute(&mut self, name: &str) -> wgpu::ComputePass<'static> {
        let pair = self.timings.pass(&self.gpu, name);
        let pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes: pair.map(|pair| wgpu::ComputePassTimestampWrites {
                query_set: pair.queries,
                beginning_of_pass_write_index: Some(pair.begin),
                end_of_pass_write_index: Some(pair.begin + 1),
            }),
        });
        pass.forget_lifetime()
    }

    /// A render pass. `name` is its row in the timing table.
    pub fn render(
        &mut self,
        name: &str,
        colors: &[ColorTarget<'_>],
        depth: Option<DepthTarget<'_>>,
    ) -> RenderPass<'_> {
        let attachments: Vec<_> = colors
            .iter()
            .map(|target| {
                let load = target.clear.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear);
                Some(wgpu::RenderPassColorAttachment {
                    view: target.view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                })
            })
            .collect();
        let pair = self.timings.pass(&self.gpu, name);
        let pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(name),
            color_attachments: &attachments,
            depth_stencil_attachment: depth.map(|target| wgpu::RenderPassDepthStencilAttachment {
                view: target.view,
                depth_ops: Some(wgpu::Operations {
                    load: if target.clear { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load },
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: pair.map(|pair| wgpu::RenderPassTimestampWrites {
                query_set: pair.queries,
                beginning_of_pass_write_index: Some(pair.begin),
                end_of_pass_write_index: Some(pair.begin + 1),
            }),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        RenderPass { gpu: &self.gpu, pass }
    }

    /// Clears a buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) -> &mut Self {
        self.encoder.clear_buffer(buffer, 0, None);
        self
    }

    /// The command encoder, for copies between resources.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        &mut self.encoder
    }

    /// Reads back bytes of a buffer (usage `COPY_SRC`). The offset must be a multiple of 4; the length is rounded up to
    /// one.
    pub fn read_buffer(&mut self, buffer: &wgpu::Buffer, range: Range<u64>) -> PendingReadback {
        self.sources.push(Source::Buffer { buffer: buffer.clone(), range });
        PendingReadback(self.sources.len() - 1)
    }

    /// Reads back a texture's first mip level (usage `COPY_SRC`), rows tightly packed.
    pub fn read_texture(&mut self, texture: &wgpu::Texture) -> PendingReadback {
        self.read_layer(texture, 0)
    }

    /// Reads back one layer of a texture array, rows tightly packed.
    pub fn read_layer(&mut self, texture: &wgpu::Texture, layer: u32) -> PendingReadback {
        self.sources.push(Source::Texture { texture: texture.clone(), layer });
        PendingReadback(self.sources.len() - 1)
    }

    /// Submits the passes and returns at once.
    pub fn submit(mut self) -> Submitted {
        let mut copies = Vec::with_capacity(self.sources.len());
        let mut end = 0;
        for source in &self.sources {
            let copy = source.layout(end);
            end = (copy.offset + copy.size()).next_multiple_of(256);
            copies.push(copy);
        }
        let resolved = self.timings.resolve(&self.gpu, &mut self.encoder);
        let timestamps = resolved.as_ref().map(|buffer| {
            let copy = Copy { offset: end, row: buffer.size(), pitch: buffer.size(), rows: 1 };
            end += copy.size();
            copy
        });
        let buffer = (end > 0).then(|| self.gpu.readback.take(&self.gpu.device, end));
        if let Some(buffer) = &buffer {
            for (source, copy) in self.sources.iter().zip(&copies) {
                source.record(&mut self.encoder, buffer, copy);
            }
            if let (Some(resolved), Some(copy)) = (&resolved, &timestamps) {
                self.encoder.copy_buffer_to_buffer(resolved, 0, buffer, copy.offset, copy.row);
            }
        }
        let index = self.gpu.queue.submit([self.encoder.finish()]);
        self.gpu.submissions.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Submitted {
            gpu: self.gpu,
            index,
            buffer,
            copies,
            timings: self.timings,
            timestamps,
            faults_before: self.faults_before,
        }
    }
}

impl Submitted {
    /// Waits for the GPU and returns the results.
    ///
    /// # Errors
    /// The device was lost, ran out of memory, or rejected a command.
    pub fn wait(self) -> Result<Finished, GpuError> {
        let Self { gpu, index, buffer, copies, timings, timestamps, faults_before } = self;
        readback::collect(&gpu, index, buffer, &copies, &timings, timestamps, faults_before)
    }
}

impl Source {
    fn layout(&self, offset: u64) -> Copy {
        match self {
            Self::Buffer { range, .. } => {
                let row = (range.end - range.start).next_multiple_of(4);
                Copy { offset, row, pitch: row, rows: 1 }
            }
            Self::Texture { texture, .. } => {
                let texel = u64::from(texture.format().block_copy_size(None).unwrap_or(4));
                let row = u64::from(texture.width()) * texel;
                let pitch = row.next_multiple_of(u64::from(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT));
                Copy { offset, row, pitch, rows: u64::from(texture.height()) }
            }
        }
    }

    fn record(&self, encoder: &mut wgpu::CommandEncoder, to: &wgpu::Buffer, copy: &Copy) {
        match self {
            Self::Buffer { buffer, range } => {
                encoder.copy_buffer_to_buffer(buffer, range.start, to, copy.offset, copy.row);
            }
            Self::Texture { texture, layer } => encoder.copy_texture_to_buffer(
                wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y: 0, z: *layer },
                    aspect: wgpu::TextureAspect::All,
                },
                wgpu::TexelCopyBufferInfo {
                    buffer: to,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: copy.offset,
                        bytes_per_row: Some(copy.pitch as u32),
                        rows_per_image: None,
                    },
                },
                wgpu::Extent3d { width: texture.width(), height: texture.height(), depth_or_array_layers: 1 },
            ),
        }
    }
}

/// A compute pass of several dispatches.
pub struct ComputePass<'a> {
    gpu: &'a Gpu,
    pass: wgpu::ComputePass<'static>,
}

impl ComputePass<'_> {
    /// A dispatch with its own bindings.
    pub fn call<'b>(&'b mut self, pipeline: &'b ComputePipeline) -> ComputeCall<'b> {
        let bound = Bound::new(&pipeline.label, pipeline.entry.bindings);
        let to = To::Pass { gpu: self.gpu, pass: &mut self.pass };
        ComputeCall { to, pipeline, bound, immediates: &[] }
    }
}

/// Where a dispatch is recorded.
enum To<'a> {
    PassOfItsOwn { commands: &'a mut Commands, name: &'a str },
    Pass { gpu: &'a Gpu, pass: &'a mut wgpu::ComputePass<'static> },
}

/// A dispatch that is being described. Giving its extent records it.
#[must_use = "a compute call is recorded by its dispatch"]
pub struct ComputeCall<'a> {
    to: To<'a>,
    pipeline: &'a ComputePipeline,
    bound: Bound<'a>,
    immediates: &'a [u8],
}

impl<'a> ComputeCall<'a> {
    /// Binds a resource that the pass reads.
    pub fn read(mut self, name: &str, resource: &'a (impl Bindable + ?Sized)) -> Self {
        self.bound.bind(name, false, resource.resource());
        self
    }

    /// Binds a resource that the pass writes, or reads and writes.
    pub fn write(mut self, name: &str, resource: &'a (impl Bindable + ?Sized)) -> Self {
        self.bound.bind(name, true, resource.resource());
        self
    }

    /// Sets the program's `var<immediate>`.
    pub fn immediates(mut self, bytes: &'a [u8]) -> Self {
        self.immediates = bytes;
        self
    }

    /// Dispatches at least that many invocations, rounded up to workgroups. The program must check bounds.
    pub fn dispatch_threads(self, threads: [u32; 3]) {
        let size = self.pipeline.workgroup_size();
        let groups = [0, 1, 2].map(|i| threads[i].div_ceil(size[i]));
        self.dispatch(groups);
    }

    /// Dispatches that many workgroups. Records nothing if any dimension is 0.
    pub fn dispatch(self, groups: [u32; 3]) {
        if groups.contains(&0) {
            return;
        }
        self.record(|pass| pass.dispatch_workgroups(groups[0], groups[1], groups[2]));
    }

    /// Dispatches at least that many invocations in workgroups of 64. Workgroups are spread over two dimensions
    /// ([`quirks::MAX_WORKGROUPS`]). The program computes its index with `shared/linear.wgsl` and must check bounds.
    pub fn dispatch_linear(self, invocations: u64) {
        debug_assert_eq!(self.pipeline.workgroup_size(), [64, 1, 1], "{}", self.pipeline.label);
        let groups = invocations.div_ceil(64);
        let across = groups.min(quirks::WORKGROUPS_ACROSS);
        self.dispatch([across as u32, groups.div_ceil(across.max(1)) as u32, 1]);
    }

    /// Dispatches the number of workgroups that is in `buffer` (three u32).
    pub fn dispatch_indirect(self, buffer: &wgpu::Buffer, offset: u64) {
        self.record(|pass| pass.dispatch_workgroups_indirect(buffer, offset));
    }

    /// Sets the bindings and calls `dispatches` with wgpu's pass, for dispatches that differ only in immediates.
    pub fn each(self, dispatches: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        self.record(dispatches);
    }

    fn record(self, dispatch: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        let Self { to, pipeline, bound, immediates } = self;
        let mut own;
        let (gpu, pass) = match to {
            To::PassOfItsOwn { commands, name } => {
                own = commands.begin_compute(name);
                (&*commands.gpu, &mut own)
            }
            To::Pass { gpu, pass } => (gpu, pass),
        };
        let groups = bound.groups(gpu, &pipeline.layouts);
        pass.set_pipeline(&pipeline.raw);
        for (group, bind_group) in &groups {
            pass.set_bind_group(*group, bind_group, &[]);
        }
        if !immediates.is_empty() {
            pass.set_immediates(0, immediates);
        }
        dispatch(pass);
    }
}

/// A render pass.
pub struct RenderPass<'a> {
    gpu: &'a Gpu,
    pass: wgpu::RenderPass<'a>,
}

impl<'a> RenderPass<'a> {
    /// Sets viewport and scissor: x, y, width, height in pixels.
    pub fn viewport(&mut self, x: u32, y: u32, width: u32, height: u32) -> &mut Self {
        self.pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        self.pass.set_scissor_rect(x, y, width, height);
        self
    }

    /// A draw call with its own bindings.
    pub fn draw<'b>(&'b mut self, pipeline: &'b RenderPipeline) -> DrawCall<'b, 'a> {
        self.pass.set_pipeline(&pipeline.raw);
        DrawCall {
            gpu: self.gpu,
            pass: &mut self.pass,
            pipeline,
            bound: Bound::new(&pipeline.label, &pipeline.bindings),
        }
    }
}

/// A draw call that is being described. Bind resources first, then set buffers and draw ranges.
pub struct DrawCall<'b, 'a> {
    gpu: &'b Gpu,
    pass: &'b mut wgpu::RenderPass<'a>,
    pipeline: &'b RenderPipeline,
    bound: Bound<'b>,
}

impl<'b, 'a> DrawCall<'b, 'a> {
    /// Binds a resource that the draw reads.
    pub fn read(mut self, name: &str, resource: &'b (impl Bindable + ?Sized)) -> Self {
        self.bound.bind(name, false, resource.resource());
        self
    }

    /// Binds a resource that the draw writes, beside its targets.
    pub fn write(mut self, name: &str, resource: &'b (impl Bindable + ?Sized)) -> Self {
        self.bound.bind(name, true, resource.resource());
        self
    }

    /// Sets the bind groups and returns wgpu's pass, for vertex buffers, immediates and draws.
    pub fn begin(self) -> &'b mut wgpu::RenderPass<'a> {
        for (group, bind_group) in &self.bound.groups(self.gpu, &self.pipeline.layouts) {
            self.pass.set_bind_group(*group, bind_group, &[]);
        }
        self.pass
    }

    /// Draws vertices without vertex buffers, such as a full-screen triangle.
    pub fn vertices(self, vertices: Range<u32>, instances: Range<u32>) {
        self.begin().draw(vertices, instances);
    }
}
