//! Light by rays: lights, sky and emitting triangles with what blocks them, and indirect light by paths.
//!
//! Shading leaves *guides* of the visible surfaces. This stage casts rays from each to the lights, the sky and emitters,
//! and adds what arrives to the surfaces' radiance. The definition is the reference's (`scene/src/reference/light.rs`).
//! Samples, direct views, lists of pixels and leaves of octrees all pass through here.
//!
//! Neighbouring texels cast different rays ([`pattern`]) and share what they found within a surface ([`filter`]), so that
//! few rays a texel suffice. Which rays a texel casts depends on its place in its image alone.
//!
//! # Steps of a tile
//!
//! 1. [`texels`]: reads guides back and finds where rays begin.
//! 2. [`shadows`]: the share of each light that each texel sees.
//! 3. [`sky`] and [`emitters`]: irradiance of the sky, and of emitting triangles.
//! 4. [`paths`]: indirect irradiance, if it is found by paths. Or [`cells`]: that and the sky's, from cells on surfaces.
//! 5. `passes/add_direct.rs`: adds the light, and the reflection of lights and sky on glossy surfaces of views.
//!
//! On a GPU, [`device`] does steps 1 to 3 for images, all but the emitters. Then nothing is read back, unless emitters or
//! indirect light ask for it.

mod cells;
pub(crate) mod device;
mod emitters;
mod filter;
mod paths;
mod pattern;
mod shadows;
mod sky;
mod texels;

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::effects::SHARED_STAGE;
use argus_scene::texture::{MipChain, mip_chains};
use argus_scene::{AlphaMode, LightEffects, Lighting, Material, RenderError, Scene, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::LightKnobs;
use crate::light_rays::{CullMode, LightRays, LightRaysAbout};
use crate::packets::PacketTracer;
use crate::passes::{AddDirect, SkyFrom, TileContext};
use crate::resident::{Features, upload};
use crate::scratch::Guides;
use crate::timing;
use cells::{CellLight, Eye};
use device::{DeviceLight, LitTile};
use emitters::Emitters;
use shadows::VisibilityWords;
use sky::SkyIrradiance;
use texels::Texels;

pub(crate) use cells::CellUse;
pub(crate) use paths::PathLight;
pub use paths::PathReport;
pub(crate) use texels::{Texel, texel as texel_of_guides};

/// The direct light of one scene on one device.
pub(crate) struct DirectLight {
    tracing: Arc<LightTracing>,
    /// Traces rays of tiles to lights and to the sky; `None` if the CPU does.
    device: Option<DeviceLight>,
    /// Texels of an image cast one of so many of their rays.
    ray_divisor: u32,
    features: Features,
    add: AddDirect,
}

/// All that rays to lights, sky and emitters need. A thread that prepares indirect light shares it.
#[derive(Clone)]
pub(crate) struct LightTracing {
    effects: LightEffects,
    knobs: LightKnobs,
    rays: LightRays,
    emitters: Emitters,
    /// The scene's textures, if any is of emission.
    emission: Vec<MipChain>,
    sky: SkyIrradiance,
    lighting: Lighting,
}

/// Which of a tile's texels know one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Neighbours {
    /// An image, whose first texel has these coordinates in the whole image.
    Image([u32; 2]),
    /// Texels that have nothing to do with one another: each casts so many rays to the sky, and to emitters.
    None { rays: usize },
}

/// Bits of an `array<vec4f>`: irradiance / π, and the shares of lights and sky that are seen, a byte each.
pub(crate) type Arriving = [f32; 4];

impl DirectLight {
    /// The direct light of a scene at the pose of a tracer.
    ///
    /// # Errors
    /// [`RenderError::Internal`] for a scene with too many triangles to trace.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Scene,
        features: Features,
        tracer: &PacketTracer,
        (effects, knobs): (LightEffects, LightKnobs),
        (lighting, time_secs): (&Lighting, f64),
    ) -> Result<Self, RenderError> {
        let rays = LightRays::new(tracer, CullMode::None).ok_or_else(too_large)?;
        let device = device::chosen(gpu, features, tracer, &rays, knobs.tracer)?;
        let lit = Self::with_rays(gpu, scene, features, rays, (effects, knobs), (lighting, time_secs));
        Ok(Self { device, ..lit })
    }

    /// Direct light that is found by these rays.
    fn with_rays(
        gpu: &Gpu,
        scene: &Scene,
        features: Features,
        rays: LightRays,
        (effects, knobs): (LightEffects, LightKnobs),
        (lighting, time_secs): (&Lighting, f64),
    ) -> Self {
        let emission = emission_textures(scene, effects);
        let tracing = LightTracing {
            effects,
            knobs,
            rays,
            emitters: emitters_at(scene, &emission, effects, time_secs),
            emission,
            sky: SkyIrradiance::new(&lighting.sky),
            lighting: lighting.clone(),
        };
        let add = AddDirect::new(gpu, features);
        Self { tracing: Arc::new(tracing), device: None, ray_divisor: 1, features, add }
    }

    /// Reads alpha and transmission from another tracer's scene, whose triangles are the same.
    pub(crate) fn share_textures(&mut self, tracer: &PacketTracer) {
        Arc::make_mut(&mut self.tracing).rays.share_textures(tracer);
    }

    /// The direct light of the same triangles in another scene's light, without building trees again.
    pub(crate) fn of_scene(
        self,
        gpu: &Gpu,
        scene: &Scene,
        features: Features,
        tracer: &PacketTracer,
        settings: (LightEffects, LightKnobs),
        at: (&Lighting, f64),
    ) -> Self {
        let mut rays = Arc::unwrap_or_clone(self.tracing).rays;
        rays.share_textures(tracer);
        let device = self.device.map(|device| device.with_features(gpu, features));
        let lit = Self { device, ..Self::with_rays(gpu, scene, features, rays, settings, at) };
        // Programs that were used are compiled.
        if self.features == features { Self { add: self.add, ..lit } } else { lit }
    }

    /// Takes over the pose of a tracer.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn pose(
        &mut self,
        gpu: &Arc<Gpu>,
        scene: &Scene,
        tracer: &PacketTracer,
        time_secs: f64,
    ) -> Result<(), RenderError> {
        if let Some(device) = &mut self.device {
            device.pose(gpu, tracer)?;
        }
        let tracing = Arc::make_mut(&mut self.tracing);
        tracing.emitters = emitters_at(scene, &tracing.emission, tracing.effects, time_secs);
        tracing.rays.pose(tracer).ok_or_else(too_large)
    }

    /// Changes the rays.
    pub(crate) fn set_knobs(&mut self, knobs: LightKnobs) {
        Arc::make_mut(&mut self.tracing).knobs = knobs;
    }

    /// Changes the effects of later images, at a pose. Emission stays off if it needs textures that are not held. Returns whether
    /// that is possible: not while another thread uses the rays.
    pub(crate) fn set_effects(&mut self, scene: &Scene, effects: LightEffects, time_secs: f64) -> bool {
        let Some(tracing) = Arc::get_mut(&mut self.tracing) else { return false };
        let lacks_textures = reads_textures(scene) && tracing.emission.len() < scene.textures.len();
        let emitters = effects.emitters && !lacks_textures;
        tracing.effects = LightEffects { emitters, ..effects };
        tracing.emitters = emitters_at(scene, &tracing.emission, tracing.effects, time_secs);
        true
    }

    /// Has texels of images cast one of so many of their rays.
    pub(crate) fn divide_rays(&mut self, divisor: u32) {
        self.ray_divisor = divisor;
    }

    /// What rays need, to be shared.
    pub(crate) fn tracing(&self) -> &Arc<LightTracing> {
        &self.tracing
    }

    /// Changes lights and sky.
    pub(crate) fn relight(&mut self, lighting: &Lighting) {
        if self.tracing.lighting == *lighting {
            return;
        }
        let tracing = Arc::make_mut(&mut self.tracing);
        if tracing.lighting.sky != lighting.sky {
            tracing.sky = SkyIrradiance::new(&lighting.sky);
        }
        tracing.lighting = lighting.clone();
    }

    /// Adds direct light to what `commands` shade. `is_view` adds the reflection of lights and sky on glossy surfaces
    /// towards the eye, too; `paths` are indirect light to be added; with `uses_cells` it may be
    /// looked up in light cells. Returns the commands that later passes are recorded
    /// into, and [`Arriving`] of each texel.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn add(
        &self,
        mut commands: Commands,
        context: &TileContext<'_>,
        neighbours: Neighbours,
        (paths, uses_cells, is_view): (Option<&PathLight>, bool, bool),
        stages: &mut Vec<Stage>,
    ) -> Result<(Commands, Option<wgpu::Buffer>), RenderError> {
        let Some(guides) = &context.targets.guides else { return Ok((commands, None)) };
        let gpu: &Arc<Gpu> = context.gpu;
        let tracing = self.tracing.as_ref();
        let tile = match (&self.device, neighbours) {
            (Some(device), Neighbours::Image(first)) => Some(device.begin(context, guides, first)?),
            _ => None,
        };
        let Some(tile) = tile else {
            let found =
                self.on_cpu(commands, (context, guides), neighbours, (paths, uses_cells), None, stages)?;
            let arriving = upload(gpu, "arriving light", &found.arriving, wgpu::BufferUsages::STORAGE)?;
            let mut commands = gpu.commands("add direct light");
            self.add.record(&mut commands, context, guides, &arriving, is_view);
            return Ok((commands, Some(arriving)));
        };
        tile.lights(&mut commands, tracing);
        let (mut rest, mut has_cells) = (None, false);
        if paths.is_some() || tracing.emitters.any() {
            let tile = Some(&tile);
            let found =
                self.on_cpu(commands, (context, guides), neighbours, (paths, uses_cells), tile, stages)?;
            rest = Some(upload(gpu, "light of the CPU", &found.arriving, wgpu::BufferUsages::STORAGE)?);
            has_cells = found.has_cells;
            commands = gpu.commands("add direct light");
        }
        let sky = match tracing.effects.sky_visibility && !tracing.sky.is_black() {
            _ if has_cells => SkyFrom::Rest,
            true => SkyFrom::Rays,
            false => SkyFrom::Open,
        };
        if sky == SkyFrom::Rays {
            tile.sky(&mut commands, &tracing.lighting.sky, tracing.knobs.divided(self.ray_divisor));
        }
        let arriving = tile.sum(&mut commands, tracing, sky, rest.as_ref());
        self.add.record(&mut commands, context, guides, &arriving, is_view);
        Ok((commands, Some(arriving)))
    }

    /// Reads the guides of a tile back, and finds the light that arrives. With `on_device` lights are found there, and the sky
    /// unless it is looked up in light cells.
    fn on_cpu(
        &self,
        mut commands: Commands,
        (context, guides): (&TileContext<'_>, &Guides),
        neighbours: Neighbours,
        (paths, uses_cells): (Option<&PathLight>, bool),
        on_device: Option<&LitTile<'_>>,
        stages: &mut Vec<Stage>,
    ) -> Result<FoundOnCpu, RenderError> {
        let size = context.tile.sub_samples();
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 16;
        let pending =
            [&guides.surfaces, &guides.materials].map(|buffer| commands.read_buffer(buffer, 0..bytes));
        let mut finished = commands.submit().wait()?;
        timing::add(stages, std::mem::take(&mut finished.stages));
        let begin = Instant::now();
        let [surfaces, materials] = pending.map(|pending| finished.take(pending));
        let eye = context.eye.position;
        let tracing = self.tracing.as_ref();
        let about = tracing.rays.about(eye);
        let texels = Texels::new(&surfaces, &materials, size, neighbours, &about);
        let mut traced = Vec::new();
        let knobs = tracing.knobs.divided(self.ray_divisor);
        let is_glossy = self.features.specular;
        let lookup = Instant::now();
        let from_cells = paths.filter(|_| uses_cells && tracing.effects.sky_visibility).and_then(|paths| {
            let pixel = context.tile.pixel_angle();
            paths.look_up(tracing, &texels, Eye { position: eye, about: &about, pixel })
        });
        if uses_cells && paths.is_some_and(|paths| paths.cells().is_some()) {
            timing::add_since(&mut traced, "look up light cells", lookup);
        }
        let cells = from_cells.as_deref();
        let parts =
            Parts { lights: on_device.is_none(), sky: on_device.is_none() || cells.is_some(), is_glossy };
        let mut arriving = tracing.arriving((&texels, knobs), &about, eye, parts, cells, &mut traced);
        // What no effect alone accounts for.
        let rest = begin.elapsed().as_secs_f64() * 1e3 - traced.iter().map(|stage| stage.ms).sum::<f64>();
        timing::add(stages, vec![Stage::new(SHARED_STAGE, rest.max(0.0))]);
        timing::add(stages, traced);
        let begin = Instant::now();
        let by_rays = paths.filter(|_| from_cells.is_none());
        if let Some(indirect) =
            by_rays.and_then(|paths| paths.irradiance_over_pi(&texels, &about, eye, self.ray_divisor))
        {
            arriving.par_iter_mut().zip(&indirect).for_each(|([r, g, b, _], indirect)| {
                (*r, *g, *b) = (*r + indirect.x, *g + indirect.y, *b + indirect.z);
            });
            timing::add_since(stages, "gather paths", begin);
        }
        Ok(FoundOnCpu { arriving, has_cells: from_cells.is_some() })
    }
}

/// Light of a tile that was found on the CPU.
struct FoundOnCpu {
    arriving: Vec<Arriving>,
    /// Whether the sky and indirect light were looked up in light cells.
    has_cells: bool,
}

/// Which parts of the light are found on the CPU.
#[derive(Clone, Copy)]
struct Parts {
    lights: bool,
    sky: bool,
    /// Whether surfaces are glossy, which ask for the lights that they see.
    is_glossy: bool,
}

impl LightTracing {
    /// Irradiance / π of the lights at texels, as far as they are seen. `each` takes over every light's number, its
    /// irradiance / π if nothing blocked it, and the share that is seen. Times of shadow rays are added to `stages`.
    fn of_lights(
        &self,
        texels: &Texels,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        stages: &mut Vec<Stage>,
        mut each: impl FnMut(usize, &[Vec3], &[f32]),
    ) -> Vec<Vec3> {
        let effects = self.effects;
        let mut irradiance_over_pi = vec![Vec3::ZERO; texels.all.len()];
        for (index, light) in self.lighting.lights.iter().enumerate() {
            if !shadows::reaches(light, texels, eye) {
                continue;
            }
            let lit = shadows::incident_at(light, texels, eye);
            let shares = match effects.shadows {
                true => {
                    let rays = shadows::ShadowRays { light, texels, lit: &lit, about, eye };
                    rays.seen_shares(effects.soft_shadows, stages)
                }
                false => vec![1.0; texels.all.len()],
            };
            irradiance_over_pi
                .par_iter_mut()
                .zip(&lit)
                .zip(&shares)
                .for_each(|((sum, lit), share)| *sum += *lit * *share);
            each(index, &lit, &shares);
        }
        irradiance_over_pi
    }

    /// Light that arrives at texels about an eye; where surfaces are glossy, also which lights they see. A stage is added for
    /// each effect that casts rays.
    fn arriving(
        &self,
        (texels, knobs): (&Texels, LightKnobs),
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        parts: Parts,
        cells: Option<&[CellLight]>,
        stages: &mut Vec<Stage>,
    ) -> Vec<Arriving> {
        let effects = self.effects;
        // Only gloss asks which lights are seen.
        let mut words = parts.is_glossy.then(|| VisibilityWords::new(&self.lighting, texels.all.len()));
        let add = |index: usize, lit: &[Vec3], shares: &[f32]| {
            if let Some(words) = &mut words {
                words.add(index, lit, shares);
            }
        };
        let irradiance_over_pi = match parts.lights {
            true => self.of_lights(texels, about, eye, stages, add),
            false => vec![Vec3::ZERO; texels.all.len()],
        };
        let begin = Instant::now();
        let casts = parts.sky && cells.is_none();
        let sky = match casts && effects.sky_visibility && !self.sky.is_black() {
            true => Some(sky::seen_share(&self.lighting.sky, texels, about, knobs)),
            false => None,
        };
        if sky.is_some() {
            timing::add_since(stages, "trace sky", begin);
        }
        let begin = Instant::now();
        let emitted = self.emitters.irradiance_over_pi(texels, about, eye, knobs);
        if emitted.is_some() {
            timing::add_since(stages, "trace emitters", begin);
        }
        let texel = |index: usize| {
            let texel = &texels.all[index];
            if !texel.exists {
                return [0.0; 4];
            }
            let seen = match (cells, &sky) {
                (Some(cells), _) => cells[index].sky,
                (None, Some(sky)) => sky[index],
                (None, None) => Vec3::ONE,
            };
            // Without rays to the sky, the sky is what shading says: see `shading::sky_ambient`.
            let open = match cells.is_some() || sky.is_some() {
                _ if !parts.sky => Vec3::ZERO,
                true => self.sky.irradiance_over_pi(texel.normal),
                false => argus_scene::shading::sky_ambient(&self.lighting.sky, texel.normal),
            };
            let emitted = emitted.as_ref().map_or(Vec3::ZERO, |emitted| emitted[index]);
            let indirect = cells.map_or(Vec3::ZERO, |cells| cells[index].indirect);
            let sum = irradiance_over_pi[index] + open * seen + emitted + indirect;
            let word = words.as_ref().map_or(u32::MAX, |words| words.word(index, seen.element_sum() / 3.0));
            [sum.x, sum.y, sum.z, f32::from_bits(word)]
        };
        (0..texels.all.len()).into_par_iter().map(texel).collect()
    }
}

fn too_large() -> RenderError {
    RenderError::Internal("the scene has too many triangles to trace light in".to_owned())
}

/// The textures that [`emitters_at`] reads.
fn emission_textures(scene: &Scene, effects: LightEffects) -> Vec<MipChain> {
    if effects.emitters && reads_textures(scene) { mip_chains(scene) } else { Vec::new() }
}

/// Whether the light of emitters depends on textures.
fn reads_textures(scene: &Scene) -> bool {
    let is_read = |m: &Material| m.emissive_texture.is_some() || m.alpha == AlphaMode::Blend;
    scene.materials.iter().any(|m| m.emissive != Vec3::ZERO && is_read(m))
}

fn emitters_at(scene: &Scene, textures: &[MipChain], effects: LightEffects, time_secs: f64) -> Emitters {
    if !effects.emitters {
        return Emitters::new(Vec::new());
    }
    Emitters::new(argus_scene::emitters::emitters(scene, &scene.at(time_secs).instances, textures))
}
