//! Light that a sampler makes beside views: its next level, and light cells.

use std::time::Duration;

use argus_scene::CellReport;
use tracing::{info, warn};

use super::Renderer;
use crate::worker::queue::Background;

/// Length of a slice in which light cells are filled: one step more is below the longest slice of background work.
const FILL_SLICE: Duration = Duration::from_millis(15);

impl Renderer {
    /// Has the sampler prepare the next level of light beside other work, and notes which level is ready. It begins once
    /// the cost of views is known: it would take cores from the first view and from the measurement.
    pub(super) fn prepare_light(&mut self) {
        if self.measures_direct {
            return;
        }
        let (true, Some(next), true) = (self.light_rises, self.light.next(), self.sampler.is_some()) else {
            self.light_rises = false;
            return;
        };
        let Some(set) = self.set.clone() else { return };
        let ready = self.guarded(|own| Ok(vec![own.sampler()?.prepare_light(&set, next)]));
        match ready.and_then(|mut ready| ready.pop().unwrap_or(Ok(false))) {
            Ok(false) => {}
            Ok(true) => {
                info!(light = %next, "better light is ready");
                self.light = next;
                self.queue.set_light(next);
            }
            Err(error) => {
                warn!(%error, light = %next, "light cannot be prepared, views stay without it");
                self.light_rises = false;
            }
        }
    }

    /// Queues the filling of light cells, once views lacked some.
    pub(super) fn seek_cells(&mut self) {
        let is_due = self.report_cells().is_some_and(|cells| cells.is_due);
        if is_due && !std::mem::replace(&mut self.fills_light, is_due) {
            self.queue.push_background(Background::FillLight);
        }
    }

    /// Notes what the sampler's light cells are, for reports.
    fn report_cells(&self) -> Option<CellReport> {
        let cells = self.sampler.as_ref().and_then(|sampler| sampler.light_cells());
        self.health.has_cells(cells, self.sampler.as_ref().and_then(|sampler| sampler.cell_pages()));
        cells
    }

    /// Fills light cells for a slice, and queues the rest behind other background work.
    pub(super) fn fill_light(&mut self) {
        let refines = self.queue.is_idle();
        let filled = self.guarded(|own| Ok(vec![Ok(own.sampler()?.fill_light(FILL_SLICE, refines))]));
        self.report_cells();
        match filled {
            Ok(more) => {
                self.fills_light = more.into_iter().any(|more| more.unwrap_or(false));
                if self.fills_light {
                    self.queue.push_background(Background::FillLight);
                }
            }
            Err(error) => {
                self.fills_light = false;
                warn!(%error, "light cells cannot be filled");
            }
        }
    }
}
