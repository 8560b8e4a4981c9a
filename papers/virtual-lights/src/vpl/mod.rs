//! Instant radiosity: indirect diffuse light from virtual point lights (VPLs). Glowing particles are omnidirectional VPLs
//! without a surface.
//!
//! Once a pose, paths from the lights leave VPLs on surfaces ([`paths`]), a tree groups them ([`tree`]), and each gets a
//! shadow map ([`MapSource`]). Per tile, groups that cannot light a block are culled, each sub-sample gathers from some
//! of the rest, a filter along surfaces shares the result, and the light is added to radiance. It is paid when samples
//! are rendered, once for all their views.
//!
//! # Steps
//!
//! Once a pose: paths from lights and emissive surfaces leave VPLs, traced on the CPU as single f64 rays
//! (`packets/single.rs`). A tree over position and normal groups them. Each VPL gets a dual paraboloid map: by one ray a
//! texel (*exact*), by splatted points (*imperfect*), or from an octree of the scene, shared by neighbouring VPLs
//! (*megaviews*) or not (*manylods*).
//!
//! Once a tile: shading writes position, normal and albedo of each sub-sample (the *G-buffer*). Groups of VPLs that cannot
//! light a block of 16×16 are culled and the rest are weighted; with `--vpl-groups` only some are drawn. Each sub-sample
//! draws VPLs by weight, with another offset than its neighbours. A cross-bilateral filter then shares the gathered
//! light.
//!
//! Each approximation is a setting of `VplSettings` with a row in `argus-lab study method virtual-lights`, against a path-traced reference
//! (`scene/src/reference/indirect.rs`).

mod emitters;
mod from_octree;
mod maps;
pub(crate) mod paths;
mod sequence;
#[cfg(test)]
mod tests;
mod tree;

use std::sync::Arc;
use std::time::Instant;

use crate::layout;
use crate::layout::vpl::MOST_GROUPS;
use argus_gpu::{Commands, Gpu, wgpu};
use argus_megaviews::hierarchy::Octree;
use argus_sampler::plug::{
    Frame, IndirectMethod, LightInputs, PacketTracer, Placement, Scratch, Surfaces, TileContext, upload,
};
use argus_scene::indirect::{MapSource, VplSettings};
use argus_scene::{Bounds, Indirect, Lighting, RenderError, Scene, Stage};
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};

use crate::passes::{
    AdoptMaps, CullVpls, FilterIndirect, Gather, Gathered, Imperfect, IndirectScratch, Maps, blocks,
};
use emitters::Emitters;
use paths::Vpl;

// As many as users may ask for.
const _: () = assert!(MOST_GROUPS == argus_scene::indirect::MOST_VPL_GROUPS, "one number of groups");

/// Report on a scene's indirect light by VPLs.
#[derive(Debug, Clone, PartialEq)]
pub struct VplReport {
    /// Number of VPLs.
    pub vpls: usize,
    /// Total flux, watts.
    pub flux: Vec3,
    /// Bytes of their maps.
    pub map_bytes: u64,
    /// Milliseconds of tracing the paths.
    pub trace_ms: f64,
    /// Milliseconds of building the tree.
    pub tree_ms: f64,
    /// Milliseconds of rendering the maps, without the scene's octree.
    pub maps_ms: f64,
    /// Milliseconds of building the scene's octree, if maps are made from it. Rebuilt only if the scene moves.
    pub octree_ms: f64,
    /// Share of groups of VPLs that were culled, over all blocks of 16×16 sub-samples with surfaces. NaN before the first
    /// tile.
    pub culled: f64,
}

/// The indirect light of one scene on one device.
pub(crate) struct Radiosity {
    settings: VplSettings,
    surfaces: Surfaces,
    bounds: Bounds,
    passes: Passes,
    /// Octree of the posed scene and its number of levels, if maps are made from it.
    octree: Option<(u32, Arc<Octree>)>,
    /// Buffers of the most recently used sizes.
    scratch: Vec<IndirectScratch>,
    lit: Option<Lit>,
}

impl IndirectMethod for Radiosity {
    fn set_settings(&mut self, settings: Indirect) -> bool {
        let Indirect::Vpl(settings) = settings else { return false };
        self.settings = settings;
        self.lit = None;
        true
    }

    fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]) {
        self.surfaces.place(scene, placements);
        self.octree = None;
        self.lit = None;
    }

    fn ready(&mut self, inputs: &LightInputs<'_>, _: &mut Scratch) -> Result<Vec<Stage>, RenderError> {
        self.ready_at(inputs)
    }

    fn add(&mut self, frame: &mut Frame<'_>, _: Option<&[u8]>) -> Result<(), RenderError> {
        self.record(&mut frame.commands, &frame.context);
        Ok(())
    }
}

struct Passes {
    cull: CullVpls,
    filter: FilterIndirect,
}

/// VPLs at one time.
struct Lit {
    lighting: Lighting,
    /// Seconds. Ignored without particles.
    time_secs: f64,
    vpls: wgpu::Buffer,
    nodes: wgpu::Buffer,
    groups: usize,
    maps: Maps,
    gather: Gather,
    /// Number of blocks with surfaces, and of groups that they kept.
    kept: wgpu::Buffer,
    report: VplReport,
}

/// Most points of the pool for imperfect maps.
const MOST_POINTS: u64 = 1 << 20;

/// Most cells by which an octree's maps may lie in front of the surface.
const CELLS_BEFORE: f64 = 1.5;

/// Tiles whose buffers are kept: one of samples, one of views.
const KEPT: usize = 2;

impl Radiosity {
    /// The radiosity of a scene with these instances.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        placements: &[Placement],
        settings: VplSettings,
    ) -> Self {
        let passes = Passes { cull: CullVpls::new(gpu), filter: FilterIndirect::new(gpu) };
        let surfaces = Surfaces::new(scene, placements);
        let bounds = scene.bounds();
        Self { settings, surfaces, bounds, passes, octree: None, scratch: Vec::new(), lit: None }
    }

    /// Traces VPLs and renders their maps, unless they are up to date for this time and these lights.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the maps exceed what the device can bind.
    fn ready_at(&mut self, inputs: &LightInputs<'_>) -> Result<Vec<Stage>, RenderError> {
        let LightInputs { gpu, tracer, lighting, time_secs, .. } = *inputs;
        let drifts = self.settings.particles > 0;
        let is_now = |lit: &Lit| lit.lighting == *lighting && (!drifts || lit.time_secs == time_secs);
        if self.lit.as_ref().is_some_and(is_now) {
            return Ok(Vec::new());
        }
        let begin = Instant::now();
        let emitters = Emitters::new(lighting, &self.surfaces, self.bounds);
        let mut vpls = paths::trace(tracer, &self.surfaces, &emitters, &self.settings, self.bounds);
        vpls.extend(particles(&self.settings, self.bounds, time_secs));
        let trace_ms = elapsed_ms(begin);

        let begin = Instant::now();
        let nodes = tree::build(&mut vpls, MOST_GROUPS.ilog2(), self.bounds.size().length());
        let tree_ms = elapsed_ms(begin);

        let from_octree = matches!(self.settings.maps, MapSource::MegaViews | MapSource::ManyLods);
        let levels = self.settings.levels;
        if self.octree.as_ref().is_some_and(|(had, _)| !from_octree || *had != levels) {
            self.octree = None;
        }
        if from_octree && !vpls.is_empty() && self.octree.is_none() {
            self.octree = Some((levels, from_octree::octree(gpu, &self.surfaces, self.bounds, levels)?));
        }

        let begin = Instant::now();
        let storage = wgpu::BufferUsages::STORAGE;
        let root = self.bounds.center();
        let data: Vec<layout::Vpl> = vpls.iter().map(|vpl| vpl_about(vpl, root)).collect();
        let vpl_buffer = upload(gpu, "VPLs", &data, storage)?;
        let node_data: Vec<layout::VplNode> = nodes.iter().map(|node| node_about(node, root)).collect();
        let maps = self.maps(gpu, tracer, &vpls, &vpl_buffer)?;
        let maps_ms = elapsed_ms(begin);
        let counted = storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let report = VplReport {
            vpls: vpls.len(),
            flux: paths::total_flux(&vpls),
            map_bytes: maps.bytes(),
            octree_ms: self.octree.as_ref().map_or(0.0, |(_, octree)| octree.times.total_ms),
            trace_ms,
            tree_ms,
            maps_ms,
            culled: f64::NAN,
        };
        self.lit = Some(Lit {
            lighting: lighting.clone(),
            time_secs,
            vpls: vpl_buffer,
            nodes: upload(gpu, "groups of VPLs", &node_data, storage)?,
            groups: nodes.iter().filter(|node| node.leaf).count(),
            gather: Gather::new(gpu, self.settings.maps != MapSource::Unshadowed && !vpls.is_empty(), &maps),
            maps,
            kept: gpu.upload("kept groups", &[0u32; 2], counted),
            report,
        });
        Ok(vec![
            Stage::new("trace VPLs", trace_ms),
            Stage::new("group VPLs", tree_ms),
            Stage::new("maps of VPLs", maps_ms),
        ])
    }

    fn maps(
        &self,
        gpu: &Arc<Gpu>,
        tracer: &PacketTracer,
        vpls: &[Vpl],
        vpl_buffer: &wgpu::Buffer,
    ) -> Result<Maps, RenderError> {
        let storage = wgpu::BufferUsages::STORAGE;
        let source = self.settings.maps;
        let side = self.settings.map_side;
        let bytes = vpls.len() as u64 * 8 * u64::from(side) * u64::from(side);
        let array = match source {
            MapSource::Unshadowed => None,
            _ if vpls.is_empty() => None,
            MapSource::MegaViews | MapSource::ManyLods => return self.maps_from_octree(gpu, vpls),
            MapSource::Exact => {
                fits(gpu, vpls.len(), side, bytes)?;
                Some(upload(gpu, "maps of VPLs", &maps::exact(tracer, vpls, side), storage)?)
            }
            MapSource::Imperfect => {
                fits(gpu, vpls.len(), side, bytes)?;
                let pool = (u64::from(self.settings.points) * 64).min(MOST_POINTS) as u32;
                let points = maps::surface_points(&self.surfaces, self.bounds, pool, self.settings.seed);
                let points = upload(gpu, "surface points", &points, storage)?;
                let maps = gpu.buffer("maps of VPLs", bytes, storage);
                let parameters = layout::Imperfect {
                    side,
                    points: self.settings.points,
                    count: vpls.len() as u32,
                    seed: self.settings.seed,
                    ..layout::Imperfect::zeroed()
                };
                let mut commands = gpu.commands("imperfect maps");
                Imperfect::new(gpu).record(gpu, &mut commands, [vpl_buffer, &points, &maps], parameters);
                commands.submit().wait()?;
                Some(maps)
            }
        };
        let root = self.bounds.center();
        let eye = |(map, vpl): (u32, &Vpl)| {
            let [x, y, z] = (vpl.position - root).as_vec3().to_array().map(f32::to_bits);
            [x, y, z, map]
        };
        let eyes: Vec<[u32; 4]> = (0..).zip(vpls).map(eye).collect();
        let none = || gpu.upload("no maps", &[f32::MAX.to_bits()], storage);
        Ok(Maps {
            arrays: vec![array.unwrap_or_else(none)],
            shift: 31,
            inverse: false,
            slack: 0.0,
            eyes: upload(gpu, "eyes of VPLs", &eyes, storage)?,
        })
    }

    fn maps_from_octree(&self, gpu: &Arc<Gpu>, vpls: &[Vpl]) -> Result<Maps, RenderError> {
        let Some((_, octree)) = &self.octree else {
            return Err(RenderError::Internal("the octree was not built".to_owned()));
        };
        let views = from_octree::render(gpu, octree, vpls, &self.settings)?;
        let eyes = gpu.buffer("eyes of VPLs", vpls.len() as u64 * 16, wgpu::BufferUsages::STORAGE);
        let parameters = layout::AdoptMaps {
            octree_from_root: (octree.root.origin - self.bounds.center()).as_vec3().to_array(),
            edge: octree.root.edge as f32,
            count: vpls.len() as u32,
            ..layout::AdoptMaps::zeroed()
        };
        let mut commands = gpu.commands("adopt maps");
        AdoptMaps::new(gpu).record(gpu, &mut commands, &views, parameters, &eyes);
        commands.submit().wait()?;
        let maps = views.maps();
        // A surface may be anywhere in its cell.
        let cell = octree.root.edge * (-f64::from(octree.depth)).exp2();
        let (arrays, shift) = (maps.arrays.clone(), maps.shift);
        Ok(Maps { arrays, shift, inverse: true, slack: CELLS_BEFORE * cell, eyes })
    }

    /// Buffers for a tile of `size` sub-samples.
    fn scratch(&mut self, gpu: &Gpu, size: [u32; 2]) -> IndirectScratch {
        let kept = self.scratch.iter().position(|s| s.size() == size);
        let scratch = match kept {
            Some(index) => self.scratch.remove(index),
            None => IndirectScratch::new(gpu, size),
        };
        self.scratch.insert(0, scratch.clone());
        self.scratch.truncate(KEPT);
        scratch
    }

    /// Adds the indirect light of a shaded tile.
    fn record(&mut self, commands: &mut Commands, context: &TileContext<'_>) {
        if self.lit.as_ref().is_none_or(|lit| lit.report.vpls == 0) {
            return;
        }
        let scratch = self.scratch(context.gpu, context.tile.sub_samples());
        let (Some(lit), Some(g_buffer)) = (&self.lit, &context.targets.g_buffer) else { return };
        let diagonal = self.bounds.size().length();
        let settings = &self.settings;
        let is_list = context.places.is_some();
        // Listed pixels have no neighbours to filter with, so each draws as many VPLs as a square of neighbours.
        let samples = if is_list && settings.filter > 0 {
            settings.samples.saturating_mul(16)
        } else {
            settings.samples
        };
        let gathering = layout::Gathering {
            root_from_eye: (context.eye.position - self.bounds.center()).as_vec3().to_array(),
            samples,
            blocks: blocks(scratch.size()),
            size: scratch.size(),
            origin: context.tile.begin.map(|texels| texels * context.tile.side),
            map_side: settings.map_side,
            map_shift: lit.maps.shift,
            reach: if is_list { 0 } else { settings.filter },
            least_distance: (settings.clamp * diagonal).max(1e-6) as f32,
            cutoff: if settings.cutoff > 0.0 { (settings.cutoff * diagonal) as f32 } else { 3e38 },
            bias: settings.bias as f32,
            slack: lit.maps.slack as f32,
            culls: u32::from(settings.cull),
            weighs: u32::from(settings.weigh),
            kept_groups: settings.groups,
        };
        let gathering = context.gpu.upload("gathering", &[gathering], wgpu::BufferUsages::UNIFORM);
        let gathered = Gathered { scratch: &scratch, g_buffer, gathering };
        self.passes.cull.record(commands, &gathered, &lit.nodes, &lit.kept);
        lit.gather.record(commands, &gathered, &lit.vpls, &lit.maps);
        self.passes.filter.record(commands, &gathered, &context.targets.shaded);
    }

    /// Report with the culling since the last call. `None` before the first light.
    pub(crate) fn report(&self, gpu: &Arc<Gpu>) -> Result<Option<VplReport>, RenderError> {
        let Some(lit) = &self.lit else { return Ok(None) };
        let mut commands = gpu.commands("read kept groups");
        let pending = commands.read_buffer(&lit.kept, 0..8);
        let bytes = commands.submit().wait()?.take(pending);
        let mut commands = gpu.commands("forget kept groups");
        commands.clear(&lit.kept);
        commands.submit().wait()?;
        let [blocks, kept]: [u32; 2] = bytemuck::pod_read_unaligned(&bytes[..8]);
        let culled = 1.0 - f64::from(kept) / (f64::from(blocks) * lit.groups as f64);
        Ok(Some(VplReport { culled, ..lit.report.clone() }))
    }
}

/// Fails if maps of that many bytes cannot be bound.
fn fits(gpu: &Gpu, vpls: usize, side: u32, bytes: u64) -> Result<(), RenderError> {
    let limits = gpu.device.limits();
    let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
    if bytes <= most {
        return Ok(());
    }
    let (mib, most) = (bytes.div_ceil(1 << 20), most >> 20);
    Err(RenderError::OutOfMemory(format!(
        "maps of {vpls} VPLs with {side}² texels take {mib} MiB, and this device binds at most {most} MiB"
    )))
}

/// Particles as VPLs.
fn particles(settings: &VplSettings, bounds: Bounds, time_secs: f64) -> impl Iterator<Item = Vpl> {
    let all = argus_scene::particles::glowing(&bounds, settings.particles, settings.seed, time_secs);
    all.into_iter().map(|p| Vpl { position: p.position, normal: Vec3::ZERO, flux: p.flux, bounces: 0 })
}

fn vpl_about(vpl: &Vpl, root: DVec3) -> layout::Vpl {
    // A surface emits by the cosine (π in total), a particle into the whole sphere (4π).
    let solid_angle = if vpl.normal == Vec3::ZERO { 4.0 } else { 1.0 } * std::f32::consts::PI;
    layout::Vpl {
        position: (vpl.position - root).as_vec3().to_array(),
        normal: vpl.normal.to_array(),
        intensity: (vpl.flux * (std::f32::consts::FRAC_1_PI / solid_angle)).to_array(),
        ..layout::Vpl::zeroed()
    }
}

fn node_about(node: &tree::Node, root: DVec3) -> layout::VplNode {
    layout::VplNode {
        center: (node.center - root).as_vec3().to_array(),
        radius: node.radius as f32,
        axis: node.axis.as_vec3().to_array(),
        cosine: node.cosine as f32,
        first: node.first,
        count: node.count,
        skip: node.skip,
        leaf: u32::from(node.leaf),
        power: (node.power * (std::f64::consts::PI * std::f64::consts::PI).recip()) as f32,
        ..layout::VplNode::zeroed()
    }
}

fn elapsed_ms(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
}
