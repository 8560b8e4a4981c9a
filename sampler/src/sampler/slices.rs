//! Direct views in slices, between which other work runs.

use std::time::{Duration, Instant};

use argus_scene::{Cancel, Images, RenderError, SurfaceLight, ViewJob};

use super::gpu_sampler::GpuSampler;
use super::ready_scene::{BetweenTiles, ReadyScene};
use crate::light::CellUse;
use crate::stages::{Part, PartOutput};

/// Time of a slice. It ends before the band that would exceed it, as far as the last band tells.
const SLICE: Duration = Duration::from_millis(20);

/// The slices of a direct view: one or more of its bands each.
pub(super) struct Slices<'a> {
    between: BetweenTiles<'a>,
    /// The view as its plan names it.
    view: &'a ViewJob,
    /// Light of sky and surfaces that all bands so far can have, if the plan leaves it open.
    agreed: Option<SurfaceLight>,
    /// Start of the present slice.
    began: Instant,
}

impl<'a> Slices<'a> {
    pub(super) fn new(view: &'a ViewJob, between: BetweenTiles<'a>) -> Self {
        Self { between, view, agreed: None, began: Instant::now() }
    }

    /// Renders the bands of a pass. A band is rendered again if a later one lacks its light. `place` gets the pixels of each.
    ///
    /// # Errors
    /// Those of [`GpuSampler::render_image`].
    pub(super) fn render(
        &mut self,
        sampler: &mut GpuSampler,
        scene: &mut ReadyScene,
        bands: &[Part],
        output: PartOutput<'_>,
        cancel: &Cancel,
        mut place: impl FnMut(&Part, Images),
    ) -> Result<(), RenderError> {
        let must_agree = output.is_shaded() && sampler.must_agree(self.view);
        let mut lit: Vec<Option<SurfaceLight>> = vec![None; bands.len()];
        let mut is_done = vec![false; bands.len()];
        while let Some(next) = is_done.iter().position(|done| !done) {
            let began = Instant::now();
            if must_agree {
                scene.cells = asked(self.agreed);
                sampler.begin_cells(scene.cells);
            }
            sampler.render_image(scene, &bands[next..=next], output, cancel, &mut place)?;
            is_done[next] = true;
            if must_agree {
                let found = sampler.surface_light();
                let agreed = self.agreed.map_or(found, |agreed| common(agreed, found));
                (lit[next], self.agreed) = (Some(found), Some(agreed));
                is_done.iter_mut().zip(&lit).for_each(|(done, lit)| *done &= *lit == self.agreed);
            }
            let done = is_done.iter().filter(|done| **done).count();
            if self.began.elapsed() + began.elapsed() > SLICE && done < bands.len() {
                sampler.run_between(scene, self.between, done as f64 / bands.len() as f64)?;
                self.began = Instant::now();
            }
        }
        Ok(())
    }

    /// The view with the light that its bands agreed on.
    pub(super) fn says_light(self, view: &ViewJob) -> ViewJob {
        let light = self.agreed.or(view.plan.light());
        ViewJob { plan: view.plan.clone().with_light(light), ..view.clone() }
    }
}

/// What the next band asks for.
fn asked(agreed: Option<SurfaceLight>) -> CellUse {
    match agreed {
        None => CellUse::Held { rays: u32::MAX, reflected: true },
        Some(SurfaceLight::Cells { rays, reflected }) => CellUse::Held { rays, reflected },
        Some(SurfaceLight::Rays | SurfaceLight::OlderCells { .. }) => CellUse::Later,
    }
}

/// The best light that two bands can both have without a fill.
fn common(one: SurfaceLight, other: SurfaceLight) -> SurfaceLight {
    use SurfaceLight::Cells;
    match (one, other) {
        (Cells { rays: a, reflected: c }, Cells { rays: b, reflected: d }) => {
            Cells { rays: a.min(b), reflected: c && d }
        }
        _ => SurfaceLight::Rays,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_agree_on_the_light_that_each_of_them_has() {
        let cells = |rays, reflected| SurfaceLight::Cells { rays, reflected };
        assert_eq!(common(cells(64, true), cells(16, true)), cells(16, true));
        assert_eq!(common(cells(16, false), cells(256, true)), cells(16, false));
        assert_eq!(common(cells(64, true), SurfaceLight::Rays), SurfaceLight::Rays);
        assert_eq!(asked(Some(SurfaceLight::Rays)), CellUse::Later);
        assert_eq!(asked(Some(cells(16, false))), CellUse::Held { rays: 16, reflected: false });
    }
}
