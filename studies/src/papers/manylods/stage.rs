//! The scene with its hierarchies and views.

use std::sync::Arc;

use anyhow::{Result, ensure};
use argus_gpu::Gpu;
use argus_manylods::{CutMethod, CutSettings, CutStats, CutTree, SphereBuilder, SphereHierarchy};
use argus_megaviews::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle, stream};
use argus_megaviews::many_views::ViewPoint;
use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Pose, Scene};

use super::options::Options;
use crate::papers::megaviews::shadows::Shadows;
use crate::papers::megaviews::{Placement, default_light, placement};

/// The kinds of tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tree {
    Balls,
    Octree,
}

impl Tree {
    pub(super) const ALL: [Self; 2] = [Self::Balls, Self::Octree];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Balls => "balls",
            Self::Octree => "octree",
        }
    }
}

/// One scene, ready to be measured.
pub(super) struct Stage<'a> {
    pub(super) gpu: &'a Arc<Gpu>,
    pub(super) options: &'a Options,
    pub(super) scene: &'a Arc<Scene>,
    pub(super) bounds: Bounds,
    pub(super) root: RootCube,
    pub(super) triangles: Vec<Triangle>,
    pub(super) octree: Octree,
    pub(super) builder: SphereBuilder,
    pub(super) balls: SphereHierarchy,
    pub(super) tracer: Tracer,
    pub(super) views: Vec<ViewPoint>,
}

impl<'a> Stage<'a> {
    pub(super) fn new(gpu: &'a Arc<Gpu>, scene: &'a Arc<Scene>, options: &'a Options) -> Result<Self> {
        let pose: Pose = scene.at(0.0);
        let triangles: Vec<Triangle> = stream::triangles(scene, &pose).collect();
        // The bounds include every pose of an animated scene, and the bent poses of a still one.
        let mut bounds = stream::bounds(triangles.iter().copied());
        if scene.is_animated() {
            bounds.extend(scene.bounds().min);
            bounds.extend(scene.bounds().max);
        }
        let root = RootCube::around(&bounds);
        let builder = SphereBuilder::new(gpu);
        let balls = builder.build(root, options.ball_levels, &triangles)?;
        let octree = OctreeBuilder::new(gpu).build(root, options.levels, triangles.iter().copied())?;
        let tracer = Tracer::new(Arc::clone(scene));
        let emitter = options.light.unwrap_or_else(|| default_light(&pose, &bounds));
        let (count, seed) = (options.views as usize, 1);
        let views = placement::place(&tracer, &pose, &bounds, &emitter, Placement::SingleBounce, count, seed);
        ensure!(views.len() == count, "light from {emitter:?} reaches {} points only: move it", views.len());
        Ok(Self { gpu, options, scene, bounds, root, triangles, octree, builder, balls, tracer, views })
    }

    pub(super) fn tree(&self, tree: Tree) -> Result<CutTree> {
        Ok(match tree {
            Tree::Balls => CutTree::of_spheres(&self.balls),
            Tree::Octree => CutTree::of_octree(self.gpu, &self.octree)?,
        })
    }

    pub(super) fn settings(&self, method: CutMethod, threshold: f32) -> CutSettings {
        CutSettings {
            method,
            side: self.options.resolution,
            threshold,
            lag: self.options.lag,
            ..CutSettings::default()
        }
    }

    /// The length in metres to which motions are relative.
    pub(super) fn extent(&self) -> f64 {
        self.bounds.size().max_element()
    }

    pub(super) fn shadows(&self) -> Shadows<'_> {
        Shadows::new(&self.tracer, &self.views, self.octree.root.edge / f64::from(1u32 << self.octree.depth))
    }
}

/// Renders frames after a first one that finds the memory they need; `None` if the device has too little.
pub(super) fn frames(
    rounds: usize,
    mut render: impl FnMut() -> Result<CutStats, HierarchyError>,
) -> Result<Option<Vec<CutStats>>, HierarchyError> {
    match render() {
        Err(HierarchyError::TooLarge { .. }) => Ok(None),
        first => first.and_then(|_| (0..rounds.max(1)).map(|_| render()).collect::<Result<_, _>>().map(Some)),
    }
}
