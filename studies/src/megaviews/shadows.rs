//! How often maps err about shadow: points of the scene's surfaces asked of views' maps and of rays in f64.

use anyhow::Result;
use argus_gpu::many_views::ViewPoint;
use argus_scene::paraboloid;
use argus_scene::reference::Tracer;
use glam::DVec3;

/// Views asked, and points asked of each.
const VIEWS: usize = 48;
const POINTS: usize = 64;

/// Points that views may see or not.
pub(super) struct Shadows<'a> {
    tracer: &'a Tracer,
    views: &'a [ViewPoint],
    /// Edge of the octree's cells, metres.
    cell: f64,
}

impl<'a> Shadows<'a> {
    pub(super) fn new(tracer: &'a Tracer, views: &'a [ViewPoint], cell: f64) -> Self {
        Self { tracer, views, cell }
    }

    /// The share of points, on other views' surfaces and in what a view looks at, of which a map says otherwise than
    /// a ray. `map` gives the texels of one of the first `count` views. A point is in shadow where the map's range is
    /// shorter than its own by more than two cells and 5%.
    pub(super) fn wrong(&self, count: usize, map: impl Fn(usize) -> Result<Vec<[u32; 2]>>) -> Result<f64> {
        let (mut asked, mut wrong) = (0u32, 0u32);
        let stride = |n: usize, of: usize| (of / n.max(1)).max(1);
        for view in (0..count).step_by(stride(VIEWS, count)).take(VIEWS) {
            let texels = map(view)?;
            let side = ((texels.len() / 2) as f64).sqrt() as u32;
            let eye = &self.views[view];
            for at in (0..self.views.len()).step_by(stride(POINTS, self.views.len())).take(POINTS) {
                let to = self.views[at].position - eye.position;
                let range = to.length();
                let faces =
                    to.dot(eye.direction) > 0.05 * range && to.dot(self.views[at].direction) < -0.05 * range;
                if !(range > 4.0 * self.cell && faces) {
                    continue;
                }
                let texel = paraboloid::texel_of(to, side) as usize;
                let inverse = f64::from(f32::from_bits(texels[texel][0]));
                let told = inverse > 0.0 && 1.0 / inverse < range * 0.95 - 2.0 * self.cell;
                asked += 1;
                wrong += u32::from(told != self.is_blocked(eye, to));
            }
        }
        Ok(if asked == 0 { f64::NAN } else { f64::from(wrong) / f64::from(asked) })
    }

    /// Whether a surface lies between a view and a point.
    fn is_blocked(&self, eye: &ViewPoint, to: DVec3) -> bool {
        let origin = eye.position + eye.direction * 1e-3 * self.cell;
        let range = to.length();
        self.tracer.trace(origin, to).is_some_and(|hit| hit.range < range - 0.1 * self.cell)
    }
}
