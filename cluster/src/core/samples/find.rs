//! Sources of the samples of a dispatched view.

use argus_scene::SampleId;

use super::Samples;
use super::directory::{Directory, Inputs};
use crate::core::event::{Source, WorkerId};
use crate::core::time::Uptime;
use crate::core::workers::Workers;

/// How much a view depends on a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::core) enum Access {
    /// The view can do without it: it is fetched from a holder, or omitted.
    Dispensable,
    /// It is rendered if no worker holds it.
    Needed,
}

impl Samples {
    /// Where a worker finds the samples of a view, and how many of them must be rendered for it.
    pub(in crate::core) fn find(
        &mut self,
        reader: WorkerId,
        wanted: &[(SampleId, Access)],
        workers: &Workers,
        now: Uptime,
    ) -> (Vec<Source>, u64) {
        let mut to_render = 0;
        let mut source = |&(id, access): &(SampleId, Access)| {
            let inputs = Inputs { workers, locations: &self.locations };
            match access {
                Access::Dispensable => Directory::among_holders(id, reader, inputs),
                Access::Needed => {
                    let (source, is_new) = self.directory.locate(id, reader, inputs, &mut self.trees, now);
                    to_render += u64::from(is_new);
                    source
                }
            }
        };
        let sources = wanted.iter().map(&mut source).collect();
        (sources, to_render)
    }
}
