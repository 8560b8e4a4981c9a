//! Maps of single views on the CPU, in f64 (ManyLoDs, basic cuts).

use argus_megaviews::hierarchy::Octree;
use argus_megaviews::many_views::{Settings, ViewPoint};
use argus_scene::paraboloid::{ParaboloidPosition, center_of};
use glam::{DVec2, DVec3};

use crate::device::read;

/// An octree, read back; positions are world space.
pub(crate) struct Nodes {
    pub(crate) means: Vec<DVec3>,
    children: Vec<std::ops::Range<usize>>,
    levels: Vec<[u32; 2]>,
    depth: u32,
    edge: f64,
    origin: DVec3,
}

impl Nodes {
    pub(crate) fn of(octree: &Octree) -> Self {
        let words: Vec<[u32; 4]> = read(&octree.nodes, octree.node_count() as usize);
        let mean = |w: &[u32; 4]| DVec3::from_array([0, 1, 2].map(|i| f64::from(f32::from_bits(w[i]))));
        let first = |w: &[u32; 4]| (w[3] >> 8) as usize;
        Self {
            means: words.iter().map(|w| octree.root.world_from_unit(mean(w))).collect(),
            children: words.iter().map(|w| first(w)..first(w) + (w[3] & 255).count_ones() as usize).collect(),
            levels: octree.levels.clone(),
            depth: octree.depth,
            edge: octree.root.edge,
            origin: octree.root.origin,
        }
    }

    fn level(&self, node: usize) -> u32 {
        let holds = |range: &[u32; 2]| (range[0]..range[0] + range[1]).contains(&(node as u32));
        self.levels.iter().position(holds).unwrap() as u32
    }

    /// Center and half edge of a node's cell.
    pub(crate) fn cell(&self, node: usize) -> (DVec3, f64) {
        let size = self.edge / f64::from(1u32 << self.level(node));
        (((self.means[node] - self.origin) / size).floor() * size + self.origin + 0.5 * size, 0.5 * size)
    }

    /// Whether a view sees a part of the ball around a node's cell.
    pub(crate) fn is_seen(&self, node: usize, view: &ViewPoint) -> bool {
        let (center, half) = self.cell(node);
        let (to, radius) = (center - view.position, half * 3f64.sqrt());
        let range = to.length();
        range <= radius || to.angle_between(view.direction) - (radius / range).asin() <= view.half_fov
    }

    /// The map of one view that looks everywhere: bits of inverse range and node of each texel.
    pub(crate) fn map(&self, view: &ViewPoint, settings: &Settings) -> Vec<[u32; 2]> {
        let mut map = vec![[0, 0]; (2 * settings.side * settings.side) as usize];
        self.visit(self.means.len() - 1, view, settings, &mut map);
        map
    }

    fn visit(&self, node: usize, view: &ViewPoint, settings: &Settings, map: &mut [[u32; 2]]) {
        let (center, half) = self.cell(node);
        let radius = half * 3f64.sqrt();
        let side = f64::from(settings.side);
        // The size in texels of a ball of that radius.
        let size = |to: DVec3| {
            let range = to.length();
            let sine = radius / range;
            side * sine / (to.x.abs() / range + (1.0 - sine * sine).max(0.0).sqrt())
        };
        let to = center - view.position;
        let small = to.length() > radius && size(to) < f64::from(settings.threshold);
        if !small && self.level(node) < self.depth {
            return self.children[node].clone().for_each(|child| self.visit(child, view, settings, map));
        }
        let to_mean = self.means[node] - view.position;
        let value = [(1.0 / to_mean.length()) as f32, 0.0].map(f32::to_bits)[0];
        let mut put = |texel: usize| map[texel] = map[texel].max([value, node as u32]);
        if to_mean.length() > radius && size(to_mean) <= f64::from(settings.threshold) {
            let at = ParaboloidPosition::of(to_mean, settings.side);
            let cell = at.at.floor().min(DVec2::splat(side - 1.0));
            if sample(cell, side).distance(at.at / side * 2.0 - 1.0)
                <= f64::from(settings.disc) * size(to_mean) / side
            {
                put(((f64::from(at.hemisphere) * side + cell.y) * side + cell.x) as usize);
            }
            return;
        }
        for texel in 0..2 * settings.side * settings.side {
            let ray = ray(texel, settings.side);
            let (one, other) = ((to - half) / ray, (to + half) / ray);
            let (begin, end) = (one.min(other).max_element(), one.max(other).min_element());
            if end >= begin.max(0.0) {
                put(texel as usize);
            }
        }
    }
}

/// The point of a hemisphere's plane that stands for a texel.
fn sample(cell: DVec2, side: f64) -> DVec2 {
    let p = (cell + 0.5) / side * 2.0 - 1.0;
    let beyond = p.length_squared() / (1.0 - 0.5 / side).powi(2);
    p * if beyond > 1.0 { (1.5 - 0.5 * beyond).max(0.3) } else { 1.0 }
}

/// The direction that stands for a texel: of its centre, or of a point inside the rim where that lies beyond.
pub(crate) fn ray(texel: u32, side: u32) -> DVec3 {
    let row = texel / side;
    let cell = DVec2::new(f64::from(texel % side), f64::from(row % side));
    let p = sample(cell, f64::from(side));
    let x = 1.0 - p.length_squared();
    let ray = DVec3::new(if row >= side { -x } else { x }, 2.0 * p.x, 2.0 * p.y).normalize();
    debug_assert!(
        p != (cell + 0.5) / f64::from(side) * 2.0 - 1.0 || ray.distance(center_of(texel, side)) < 1e-9
    );
    ray
}
