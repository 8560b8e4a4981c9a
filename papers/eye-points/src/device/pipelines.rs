//! The pipelines of cutting and of lookups.

use argus_gpu::{ComputePipeline, Gpu};

use crate::programs::{POINTS_CUT, POINTS_LOOKUP};

/// Those of `shaders/points_cut.wgsl`.
#[derive(Debug)]
pub(super) struct Cutting {
    pub(super) count_sides: ComputePipeline,
    pub(super) write_sides: ComputePipeline,
    pub(super) judge: ComputePipeline,
    pub(super) divide: ComputePipeline,
    pub(super) count_kept: ComputePipeline,
    pub(super) make_pieces: ComputePipeline,
}

/// Those of `shaders/points_lookup.wgsl`.
#[derive(Debug)]
pub(super) struct LookupPipelines {
    pub(super) taps: ComputePipeline,
    pub(super) rays: ComputePipeline,
    pub(super) count: ComputePipeline,
    pub(super) list: ComputePipeline,
    pub(super) points: ComputePipeline,
    pub(super) slots: ComputePipeline,
    pub(super) mirror: ComputePipeline,
}

impl Cutting {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&POINTS_CUT, entry);
        Self {
            count_sides: pipeline("count_sides"),
            write_sides: pipeline("write_sides"),
            judge: pipeline("judge"),
            divide: pipeline("divide"),
            count_kept: pipeline("count_kept"),
            make_pieces: pipeline("make_pieces"),
        }
    }
}

impl LookupPipelines {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&POINTS_LOOKUP, entry);
        Self {
            taps: pipeline("request_taps"),
            rays: pipeline("request_rays"),
            count: pipeline("count_requests"),
            list: pipeline("list_requests"),
            points: pipeline("find_points"),
            slots: pipeline("find_slots"),
            mirror: pipeline("mirror"),
        }
    }
}
