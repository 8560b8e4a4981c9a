//! Probes from an octree: one traversal renders all probes, with a cut through the octree for each.

use crate::many_views::{ManyViews, NodeOwners, ViewList, ViewPoint};
use argus_gpu::Gpu;
use argus_sampler::plug::{
    BlurProbes, GBufferUse, LitScene, ProbeBytes, ProbeMethod, ProbePlaces, ProbePlanes, Resident,
};
use argus_scene::{Lighting, RenderError, Stage};
use glam::DVec3;

use crate::lit_octree::{LitOctree, map_settings, to_render_error};
use crate::passes::{NodeMaps, OwnNodes, ResampleProbes};

/// Most bytes of probes that are rendered at once: a few thousand small ones, or sixteen of the largest.
const MOST_BYTES: u64 = 64 << 20;

/// The octree of one scene on one device, and the programs that render probes from it.
pub(crate) struct OctreeProbes {
    octree: LitOctree,
    own_nodes: OwnNodes,
    resample: ResampleProbes,
    blur: BlurProbes,
    /// Kept across octrees, because its programs are reused.
    views: Option<ManyViews>,
}

impl OctreeProbes {
    pub(crate) fn new(gpu: &Gpu, resident: &Resident, g_buffer: GBufferUse, levels: u32) -> Self {
        Self {
            octree: LitOctree::new(gpu, resident, g_buffer, levels),
            own_nodes: OwnNodes::new(gpu),
            resample: ResampleProbes::new(gpu, resident.features, 1),
            blur: BlurProbes::new(gpu),
            views: None,
        }
    }
}

impl ProbeMethod for OctreeProbes {
    fn ready(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError> {
        Ok(self.octree.ready(scene, lighting, time_secs)?.unwrap_or_default())
    }

    fn render(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        places: &ProbePlaces,
        side: u32,
    ) -> Result<ProbeBytes, RenderError> {
        let gpu = scene.gpu;
        let mut bytes = ProbeBytes::default();
        let Some(octree) = self.octree.octree().cloned() else { return Ok(bytes) };
        let mut commands = gpu.commands("own nodes");
        let owners = self.octree.owners(gpu, &mut commands, &self.own_nodes, &places.probe_of_instance);
        commands.submit().wait()?;
        let owners =
            owners.ok_or_else(|| RenderError::Internal("the octree has no owners of nodes".to_owned()))?;
        let seen_from = |place: &DVec3| ViewPoint::everywhere(*place);
        let points: Vec<ViewPoint> = places.centers().iter().map(seen_from).collect();
        let eye = scene.eye(places.middle, lighting)?;
        let sky = (&eye.lighting, &scene.resident.environment);
        let most = (MOST_BYTES / ProbePlanes::bytes_of_map(side)).max(1) as usize;
        for (first, points) in (0..).step_by(most).zip(points.chunks(most)) {
            let list = ViewList::new(gpu, &octree.root, points)?;
            let own = NodeOwners { owners: owners.clone(), first };
            let kept = self.views.take();
            let traversed = ManyViews::reuse_or_new(kept, gpu, &octree, map_settings(side, &octree));
            let mut traversed = traversed.map_err(to_render_error)?;
            traversed.cull_own_nodes(own).map_err(to_render_error)?;
            traversed.render(&list).map_err(to_render_error)?;
            self.resample.set_arrays(gpu, traversed.maps().arrays.len());
            let planes = ProbePlanes::new(gpu, side, points.len() as u32);
            let missing = || RenderError::Internal("the octree was not lit".to_owned());
            let lit = self.octree.nodes().ok_or_else(missing)?;
            let maps =
                NodeMaps { octree: lit.octree, views: &traversed, surfels: lit.surfels, ends: lit.ends };
            let mut commands = gpu.commands("resample probes");
            self.resample.record(gpu, &mut commands, &maps, sky, &planes);
            self.blur.record(&mut commands, &planes);
            bytes.read(commands, &planes)?;
            self.views = Some(traversed);
        }
        Ok(bytes)
    }

    fn forget_pose(&mut self) {
        self.octree.forget_pose();
    }

    fn forget_light(&mut self) {
        self.octree.forget_light();
    }
}
