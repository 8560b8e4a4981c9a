//! Shadow errors of maps: points on the scene's surfaces are looked up in views' maps and traced by f64 rays.

use anyhow::Result;
use argus_megaviews::many_views::ViewPoint;
use argus_scene::paraboloid;
use argus_scene::reference::Tracer;
use glam::DVec3;

/// Views whose maps are judged, and points tested per view.
const VIEWS: usize = 96;
const POINTS: usize = 96;

/// Shares of all tested points, 0–1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wrong {
    /// In shadow by the map but lit by the ray: a value in the map is too near.
    pub(crate) shadowed: f64,
    /// Lit by the map but in shadow by the ray: a surface is missing in the map.
    pub(crate) lit: f64,
}

impl Wrong {
    /// Both kinds of error together.
    pub(crate) fn wrong(self) -> f64 {
        self.shadowed + self.lit
    }
}

/// The tests of a scene's views.
pub(crate) struct Shadows<'a> {
    tracer: &'a Tracer,
    views: &'a [ViewPoint],
    /// Edge of an octree cell in metres.
    cell: f64,
}

impl<'a> Shadows<'a> {
    pub(crate) fn new(tracer: &'a Tracer, views: &'a [ViewPoint], cell: f64) -> Self {
        Self { tracer, views, cell }
    }

    /// Indices of the views whose maps are judged.
    pub(crate) fn asked(&self) -> Vec<usize> {
        spread(VIEWS, self.views.len())
    }

    /// Like [`Self::errors`], both kinds together.
    pub(crate) fn wrong(&self, map: impl Fn(usize) -> Result<(Vec<[u32; 2]>, DVec3)>) -> Result<f64> {
        Ok(self.errors(map)?.wrong())
    }

    /// Compares maps with rays over points on other views' surfaces that face the view. `map` gives the texels of the
    /// nth judged view and the point from which its map was rendered. A point counts as in shadow if the map's range
    /// is shorter than its own by more than two cells and 5%.
    pub(crate) fn errors(&self, map: impl Fn(usize) -> Result<(Vec<[u32; 2]>, DVec3)>) -> Result<Wrong> {
        let (mut asked, mut shadowed, mut lit) = (0u32, 0u32, 0u32);
        for (nth, view) in self.asked().into_iter().enumerate() {
            let (texels, middle) = map(nth)?;
            let side = ((texels.len() / 2) as f64).sqrt() as u32;
            let eye = &self.views[view];
            for at in spread(POINTS, self.views.len()) {
                let to = self.views[at].position - eye.position;
                let range = to.length();
                let faces =
                    to.dot(eye.direction) > 0.05 * range && to.dot(self.views[at].direction) < -0.05 * range;
                if !(range > 4.0 * self.cell && faces) {
                    continue;
                }
                // As the map sees it: views of a leaf share one map, rendered from their middle.
                let in_map = self.views[at].position - middle;
                let inverse =
                    f64::from(f32::from_bits(texels[paraboloid::texel_of(in_map, side) as usize][0]));
                let told = inverse > 0.0 && 1.0 / inverse < in_map.length() * 0.95 - 2.0 * self.cell;
                asked += 1;
                let blocked = self.is_blocked(eye, to);
                shadowed += u32::from(told && !blocked);
                lit += u32::from(!told && blocked);
            }
        }
        let share = |of: u32| if asked == 0 { f64::NAN } else { f64::from(of) / f64::from(asked) };
        Ok(Wrong { shadowed: share(shadowed), lit: share(lit) })
    }

    /// Whether a surface lies between a view and a point.
    fn is_blocked(&self, eye: &ViewPoint, to: DVec3) -> bool {
        let origin = eye.position + eye.direction * 1e-3 * self.cell;
        let range = to.length();
        self.tracer.trace(origin, to).is_some_and(|hit| hit.range < range - 0.1 * self.cell)
    }
}

/// At most `most` of `count` indices, evenly spread.
fn spread(most: usize, count: usize) -> Vec<usize> {
    (0..most.min(count)).map(|i| i * count / most.min(count)).collect()
}
