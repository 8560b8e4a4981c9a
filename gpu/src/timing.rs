//! Times passes with timestamp queries.

use argus_scene::Stage;

use crate::Gpu;

/// Most passes of one [`crate::Commands`] that are timed.
const MAX_PASSES: u32 = 2048;

/// Timestamps around the passes of one submission.
#[derive(Debug)]
pub(crate) struct Timings {
    queries: Option<wgpu::QuerySet>,
    names: Vec<String>,
    period_ns: f32,
}

/// The two timestamps of a pass.
pub(crate) struct Pair<'a> {
    pub(crate) queries: &'a wgpu::QuerySet,
    pub(crate) begin: u32,
}

impl Timings {
    /// No query set yet; the first pass creates it.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { queries: None, names: Vec::new(), period_ns: gpu.queue.get_timestamp_period() }
    }

    /// The queries of a pass; `None` if the device cannot time it.
    pub(crate) fn pass(&mut self, gpu: &Gpu, name: &str) -> Option<Pair<'_>> {
        if !gpu.has_timestamps() || self.names.len() as u32 >= MAX_PASSES {
            return None;
        }
        let begin = 2 * self.names.len() as u32;
        self.names.push(name.to_owned());
        let queries = self.queries.get_or_insert_with(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass timings"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MAX_PASSES,
            })
        });
        Some(Pair { queries, begin })
    }

    /// Copies the timestamps into a buffer; `None` if no pass was timed.
    pub(crate) fn resolve(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) -> Option<wgpu::Buffer> {
        let queries = self.queries.as_ref()?;
        let count = 2 * self.names.len() as u32;
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let buffer = gpu.buffer("pass timings", u64::from(count) * 8, usage);
        encoder.resolve_query_set(queries, 0..count, &buffer, 0);
        Some(buffer)
    }

    /// Name and milliseconds of each pass, in order.
    pub(crate) fn passes<'a>(&'a self, timestamps: &'a [u8]) -> impl Iterator<Item = (&'a str, f64)> {
        self.names.iter().zip(timestamps.chunks_exact(16)).map(|(name, pair)| {
            let at = |i: usize| u64::from_le_bytes(pair[i..i + 8].try_into().unwrap_or_default());
            // Never negative: quirk `odd-timestamps`.
            let ms = at(8).saturating_sub(at(0)) as f64 * f64::from(self.period_ns) * 1e-6;
            (name.as_str(), ms)
        })
    }

    /// One row for each name, in order of first appearance. Passes of one name are summed.
    pub(crate) fn stages(&self, timestamps: &[u8]) -> Vec<Stage> {
        let mut stages: Vec<Stage> = Vec::new();
        for (name, ms) in self.passes(timestamps) {
            match stages.iter_mut().find(|s| s.name == name) {
                Some(stage) => stage.ms += ms,
                None => stages.push(Stage::new(name.to_owned(), ms)),
            }
        }
        stages
    }
}
