//! A room, its octree, and frames of maps.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong
#![allow(dead_code, reason = "each test binary uses a part")]

use std::sync::Arc;

use argus_megaviews::hierarchy::{Octree, OctreeBuilder, RootCube, Triangle, stream};
use argus_megaviews::many_views::{FrameStats, ManyViews, Settings, Texel, ViewList, ViewPoint};
use glam::{DVec3, Vec3};
use rand::rngs::SmallRng;
use rand::{Rng as _, SeedableRng as _};

use crate::device::{gpu, read};

pub(crate) fn quad(corner: DVec3, u: DVec3, v: DVec3) -> [Triangle; 2] {
    let color = Vec3::splat(0.5);
    let [a, b, c, d] = [corner, corner + u, corner + v, corner + u + v];
    [Triangle { corners: [a, b, c], color }, Triangle { corners: [b, d, c], color }]
}

/// A room of 8 m with a few blocks in it.
pub(crate) fn room() -> Vec<Triangle> {
    let boxes = [
        (DVec3::ZERO, DVec3::splat(8.0)),
        (DVec3::new(1.0, 0.0, 1.5), DVec3::new(1.5, 3.0, 1.0)),
        (DVec3::new(4.7, 0.0, 4.1), DVec3::new(0.3, 5.0, 2.2)),
        (DVec3::new(2.1, 4.2, 5.0), DVec3::new(1.7, 0.2, 1.1)),
    ];
    let sides = |(low, size): (DVec3, DVec3)| {
        let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
        [(low, x, y), (low, y, z), (low, z, x), (low + z, x, y), (low + x, y, z), (low + y, z, x)]
    };
    boxes.into_iter().flat_map(sides).flat_map(|(corner, u, v)| quad(corner, u, v)).collect()
}

pub(crate) fn octree_of(triangles: &[Triangle], depth: u32) -> Arc<Octree> {
    let root = RootCube::around(&stream::bounds(triangles.iter().copied()));
    Arc::new(OctreeBuilder::new(&gpu()).build(root, depth, triangles.iter().copied()).unwrap())
}

/// Points in the room that look anywhere, by fields of view from narrow to everything, half of them close together.
pub(crate) fn scattered(count: usize, seed: u64) -> Vec<ViewPoint> {
    let mut random = SmallRng::seed_from_u64(seed);
    let mut point = move || DVec3::new(random.random(), random.random(), random.random());
    (0..count)
        .map(|i| {
            let spread = if i % 2 == 0 { 8.0 } else { 0.7 };
            let position = DVec3::new(0.0, 1.0, 0.0) * f64::from(u8::from(spread < 8.0)) + point() * spread;
            let half_fov =
                [0.1, 0.5, 1.0, std::f64::consts::FRAC_PI_2, 2.0, 3.0, std::f64::consts::PI][i % 7];
            ViewPoint { position, direction: point() - 0.5, half_fov }
        })
        .collect()
}

/// A frame, read back: for each view, the texels of its map.
pub(crate) struct Frame {
    pub(crate) many: ManyViews,
    pub(crate) stats: FrameStats,
    pub(crate) map_of_view: Vec<u32>,
    /// Bits of inverse range and node of each texel of each map.
    pub(crate) maps: Vec<Vec<[u32; 2]>>,
}

impl Frame {
    pub(crate) fn new(octree: &Arc<Octree>, settings: Settings, views: &[ViewPoint]) -> Self {
        let mut many = ManyViews::new(&gpu(), Arc::clone(octree), settings).unwrap();
        let list = ViewList::new(&gpu(), &octree.root, views).unwrap();
        let stats = many.render(&list).unwrap();
        let maps = (0..stats.maps).map(|map| many.maps().read(&gpu(), map).unwrap()).collect();
        let map_of_view = read(many.map_of_view(), views.len());
        Self { many, stats, map_of_view, maps }
    }

    /// The map of a view.
    pub(crate) fn of(&self, view: usize) -> &[[u32; 2]] {
        &self.maps[self.map_of_view[view] as usize]
    }
}

/// Settings whose texels name their node, with an octree over the views as deep as the scene's.
pub(crate) fn wide(depth: u32, side: u32, sharing: bool) -> Settings {
    Settings {
        side,
        sharing,
        view_depth: Some(depth),
        falls_back: false,
        texel: Texel::RangeAndNode,
        disc: Settings::COVERING,
        shared_disc: Settings::COVERING,
        ..Settings::default()
    }
}
