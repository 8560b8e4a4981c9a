//! The frame, top to bottom. Each function here is a list of stages; a stage records into the frame's commands.
//!
//! Where the CPU waits for the device, the list shows it: it reads buffers back, or submits and waits. The CPU then uses what it
//! read, and later stages record new commands. A direct view whose light the device finds waits nowhere before its image, unless
//! it has reflections, transparent layers, or light cells that may lack.
//!
//! | list | what it renders |
//! |---|---|
//! | [`part`] | a part of a view or sample |
//! | [`begin_list`], [`end_list`] | a list of pixels, beside lists of other views |
//! | [`surfaces`] | what a part's rays see, or one of its layers |
//! | [`reflections`], [`follow_rays`] | what reflective surfaces of a view show |
//! | [`points`] | points on surfaces: of reflections, and of reflection probes |
//! | [`light`] | light by rays and between surfaces, for all of these |

mod layers;
mod part;
mod points;
mod reflections;
mod resolve;
mod shade;
mod visibility;

use std::time::Instant;

use argus_gpu::wgpu;
use argus_scene::reflection::BOUNCES;
use argus_scene::{RenderError, Stage};
use bytes::Bytes;
use glam::Vec3;
use rayon::prelude::*;

pub(crate) use self::part::{Part, PartJob, PartOutput, RenderedPart};
pub(crate) use self::points::PointShading;
use self::points::PointsOnDevice;
pub(crate) use self::reflections::ViewReflecting;
pub(crate) use self::shade::SurfaceProgram;
use crate::frame::{BegunRead, Frame, check_wanted};
use crate::indirect::{IndirectLight, Lights};
use crate::point_shading::{GBufferTexel, Points, ShadedPoints};
use crate::reflected_light::{Bounces, Met, Paths, ReflectionSource};
use crate::resident::upload;
use crate::scratch::Extras;
use crate::timing;

/// Renders a part of a view or sample.
///
/// # Errors
/// [`RenderError::Cancelled`], or the errors of the device.
pub(crate) fn part(mut frame: Frame<'_>, job: &mut PartJob<'_>) -> Result<RenderedPart, RenderError> {
    visibility::find(&mut frame, job)?;
    if let Some(buffer) = visibility::unfinished(&frame, job) {
        let [unfinished] = frame.read_back([(&buffer, 4)], "render part")?;
        visibility::complete(&mut frame, job, &unfinished)?;
    }
    if job.output.is_shaded() {
        if let PartOutput::Texels(_) = job.output {
            frame.context.cast_texels();
        }
        surfaces(&mut frame, job)?;
        if let (Some(blend), false) = (job.blend, job.layers.is_empty()) {
            // Layers are blended over what is behind them, the hindmost first.
            frame.submit_and_wait("blend")?;
            let place = layers::place(&frame, job);
            for image in place.images(job.layers) {
                check_wanted(job.cancel)?;
                let mut layer = layers::begin(&mut frame, job, &place, &image);
                surfaces(&mut layer, job)?;
                layers::blend(&mut layer, job, blend, &place, &image);
                layer.finish()?;
            }
        }
    }
    Ok(resolve::image(frame, job))
}

/// Begins a list of pixels: finds what they see, and shades it. What the CPU needs for its light is being read when this returns, so
/// that the device works at several lists at once. `None` if nothing is read.
///
/// # Errors
/// The errors of the device.
pub(crate) fn begin_list(frame: &mut Frame<'_>, job: &PartJob<'_>) -> Result<Option<BegunRead>, RenderError> {
    visibility::find(frame, job)?;
    if !job.output.is_shaded() {
        return Ok(None);
    }
    shade::visible(frame, &job.programs);
    let Some(g_buffer) = frame.context.targets.g_buffer.clone() else { return Ok(None) };
    let (count, reflectors) = (frame.sub_samples(), frame.context.targets.reflectors.clone());
    let mut buffers = vec![(&g_buffer.surfaces, count * 16), (&g_buffer.materials, count * 16)];
    buffers
        .extend(reflectors.as_ref().filter(|_| job.reflecting.is_some()).map(|buffer| (buffer, count * 4)));
    Ok(Some(frame.begin_read(&buffers, "render colour")))
}

/// Completes a list of pixels that was begun.
///
/// # Errors
/// The errors of the device.
pub(crate) fn end_list(
    mut frame: Frame<'_>,
    job: &mut PartJob<'_>,
    begun: Option<BegunRead>,
) -> Result<RenderedPart, RenderError> {
    if let Some(begun) = begun {
        let read = frame.end_read(begun)?;
        let g_buffer = [0, 1].map(|i| read.get(i).cloned().unwrap_or_default());
        light_from(&mut frame, job.lights, Some(&g_buffer))?;
        if let (Some(reflecting), Some(words)) = (&mut job.reflecting, read.get(2)) {
            let [surfaces, materials] = g_buffer;
            reflections_from(&mut frame, reflecting, job.lights, &[surfaces, materials, words.clone()])?;
        }
    }
    Ok(resolve::image(frame, job))
}

/// Shades and lights what is visible.
fn surfaces(frame: &mut Frame<'_>, job: &mut PartJob<'_>) -> Result<(), RenderError> {
    shade::visible(frame, &job.programs);
    // First, so that what lights the view's own pixels is known when points of reflections are lit.
    light(frame, job.lights)?;
    if let Some(reflecting) = &mut job.reflecting {
        reflections(frame, reflecting, job.lights)?;
    }
    Ok(())
}

/// Adds what reflective surfaces of a view show, by rays that start where the device saw them.
fn reflections(
    frame: &mut Frame<'_>,
    reflecting: &mut ViewReflecting<'_>,
    lights: &mut Lights,
) -> Result<(), RenderError> {
    let (Some(g_buffer), Some(reflectors)) =
        (frame.context.targets.g_buffer.clone(), frame.context.targets.reflectors.clone())
    else {
        return Ok(());
    };
    let count = frame.sub_samples();
    let buffers =
        [(&g_buffer.surfaces, count * 16), (&g_buffer.materials, count * 16), (&reflectors, count * 4)];
    let read = frame.read_back(buffers, "render colour")?;
    reflections_from(frame, reflecting, lights, &read)
}

/// Adds what reflective surfaces show, by surfaces, materials and numbers of reflectors that were read back.
fn reflections_from(
    frame: &mut Frame<'_>,
    reflecting: &mut ViewReflecting<'_>,
    lights: &mut Lights,
    read: &[Bytes; 3],
) -> Result<(), RenderError> {
    let (Some(g_buffer), Some(reflectors)) =
        (frame.context.targets.g_buffer.clone(), frame.context.targets.reflectors.clone())
    else {
        return Ok(());
    };
    let count = frame.sub_samples();
    let begin = Instant::now();
    let lobes = reflections::lobes(frame, reflecting, read);
    if lobes.rays.is_empty() {
        timing::add_since(frame.stages, "find reflections", begin);
        return Ok(());
    }
    let (bounces, mut shading) = reflections::ways(frame, reflecting, lights);
    let paths = Paths::of_rays(&lobes.rays);
    let mut shaded = Vec::new();
    let met = meet(&bounces, &paths, &shading, &mut shaded)?;
    let arriving = follow_rays(&bounces, paths, met, &mut shading, &mut shaded)?;
    let arriving = lobes.gather(&arriving, count as usize);
    let arriving = upload(frame.context.gpu, "arriving reflections", &arriving, wgpu::BufferUsages::STORAGE)?;
    timing::add_with_rest(frame.stages, "find reflections", begin, shaded);
    let Frame { commands, context, .. } = frame;
    reflecting.programs.add.record(commands, context, &g_buffer, &reflectors, &arriving);
    Ok(())
}

/// Radiance that arrives along first rays, of which is known what they met. Each bounce shades what rays met, and reads it back.
///
/// # Errors
/// [`RenderError::Cancelled`], or the errors of the device.
pub(crate) fn follow_rays(
    bounces: &Bounces<'_>,
    mut paths: Paths,
    mut met: Met,
    shading: &mut PointShading<'_>,
    stages: &mut Vec<Stage>,
) -> Result<Vec<Vec3>, RenderError> {
    for bounce in 1..=BOUNCES {
        let mut shaded = ShadedPoints::default();
        if !met.points.all.is_empty() {
            let goes_on = bounces.go_on(&met, bounce);
            let (radiance, g_buffer) = points(shading, &met.points, goes_on, stages)?;
            let mut commands = shading.gpu.commands("read radiance of points");
            let pending = commands.read_buffer(&radiance, 0..radiance.size());
            shaded = ShadedPoints::new(&commands.submit().wait()?.take(pending), g_buffer);
        }
        bounces.follow(&mut paths, &met, &shaded);
        if paths.have_ended() {
            break;
        }
        met = meet(bounces, &paths, shading, stages)?;
    }
    Ok(paths.arriving)
}

/// What rays meet. The device traces many of them where it is the faster one.
///
/// # Errors
/// The errors of the device.
fn meet(
    bounces: &Bounces<'_>,
    paths: &Paths,
    shading: &PointShading<'_>,
    stages: &mut Vec<Stage>,
) -> Result<Met, RenderError> {
    let first = match (bounces.by, &shading.lights.direct) {
        (ReflectionSource::Rays(_), Some(direct)) => {
            direct.see(shading.gpu, bounces.eye, (paths.len(), || paths.of_sight()), stages)?
        }
        _ => None,
    };
    Ok(bounces.meet(paths, first.as_deref()))
}

/// Shades points. Returns their radiance on the device, a word of rgb9e5 each, and their texels of the G-buffer if they are asked for.
///
/// # Errors
/// [`RenderError::Cancelled`], or the errors of the device.
pub(crate) fn points(
    shading: &mut PointShading<'_>,
    points: &Points,
    wants_g_buffer: bool,
    stages: &mut Vec<Stage>,
) -> Result<(wgpu::Buffer, Vec<GBufferTexel>), RenderError> {
    let begin = Instant::now();
    let on_device = PointsOnDevice::new(shading.gpu, points)?;
    let extras = Extras { g_buffer: wants_g_buffer || shading.lights.any(), ..Extras::default() };
    let (mut of_light, mut g_buffer) = (Vec::new(), Vec::new());
    for chunk in points.chunks(shading.gpu) {
        check_wanted(shading.cancel)?;
        let mut frame = shading.begin(&chunk, points.sharing(), extras, &mut of_light);
        shading.programs.record(&mut frame.commands, &frame.context, &chunk.chunk, &on_device.points);
        frame.footprint = chunk.footprint(&points.all);
        light(&mut frame, shading.lights)?;
        shading.programs.keep(&mut frame.commands, &frame.context, &chunk.chunk, &on_device.radiance);
        let kept = frame.context.targets.g_buffer.as_ref().filter(|_| wants_g_buffer);
        let bytes = 0..frame.sub_samples() * 16;
        let pending = kept.map(|kept| {
            [&kept.surfaces, &kept.materials].map(|buffer| frame.commands.read_buffer(buffer, bytes.clone()))
        });
        let mut finished = frame.commands.submit().wait()?;
        if let Some(pending) = pending {
            g_buffer.par_extend(chunk.g_buffer(&pending.map(|pending| finished.take(pending))));
        }
    }
    timing::add_with_rest(stages, "shade points", begin, of_light);
    Ok((on_device.radiance, g_buffer))
}

/// Adds the light that arrives at what was shaded: of lights, sky and emitters by rays, and of other surfaces.
///
/// # Errors
/// The errors of the device.
pub(crate) fn light(frame: &mut Frame<'_>, lights: &mut Lights) -> Result<(), RenderError> {
    light_from(frame, lights, None)
}

/// Adds the light that arrives at what was shaded. The CPU finds it by surfaces and materials that were read back, if there are any.
fn light_from(
    frame: &mut Frame<'_>,
    lights: &mut Lights,
    read: Option<&[Bytes; 2]>,
) -> Result<(), RenderError> {
    let Lights { direct, indirect } = lights;
    if let (Some(direct), Some(g_buffer)) = (direct, frame.context.targets.g_buffer.clone()) {
        let paths = indirect.as_ref().and_then(IndirectLight::paths);
        // Where the device traces faster, it does so for the neighbours of an image. Then nothing is read back here, but which
        // light cells lack, and that only where some may.
        let tile = if read.is_some() { None } else { direct.begin(frame, &g_buffer, paths)? };
        if let Some(tile) = direct.look_up_cells(frame, tile, paths)? {
            direct.trace(frame, tile, paths);
        } else {
            let read = match read {
                Some(read) => read.clone(),
                None => frame.read_g_buffer(&g_buffer, "add direct light")?,
            };
            let mut found = direct.on_cpu(frame, &read, paths);
            found.look_up_cells();
            found.trace_lights();
            found.trace_sky();
            found.trace_emitters();
            found.gather_paths();
            frame.arriving = Some(found.upload(frame)?);
        }
        direct.add(frame, &g_buffer);
    }
    if let Some(IndirectLight::Method(method)) = indirect {
        match method.choose(frame)? {
            Some(buffer) => {
                let [read] = frame.read_back([(&buffer, buffer.size())], "add indirect light")?;
                method.add(frame, Some(&read))?;
            }
            None => method.add(frame, None)?,
        }
    }
    Ok(())
}
