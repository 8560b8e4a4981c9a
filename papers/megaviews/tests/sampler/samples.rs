//! Samples that come from maps of an octree, against rays, against samples from triangles and against themselves.

use std::sync::Arc;

use argus_sampler::{GpuSampler, Indirect, MapSource, SamplerSettings, VplSettings};
use argus_scene::reference::Tracer;
use argus_scene::rig::Rig;
use argus_scene::{
    Camera, Cancel, Material, MegaViews, PlaneKind, RenderError, Sample, SampleCamera, SampleId, SampleJob,
    SampleSetInfo, Sampler, Sampling, Scene, Texture, TextureRef,
};
use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};
use image::RgbImage;

use crate::common::*;

const FACE: u32 = 64;
const KNOBS: MegaViews = MegaViews { map_side: 256, levels: 7, block: 1 };

/// A textured floor, a wall, a smooth ball and a glowing quad; all of it is seen from both sides.
fn scene() -> Scene {
    let mut scene = empty_scene();
    let rgba: Vec<u8> =
        (0..32u32 * 32)
            .flat_map(|i| {
                if (i % 32 / 8 + i / 32 / 8) % 2 == 0 { [220, 60, 40, 255] } else { [240, 240, 200, 255] }
            })
            .collect();
    scene.textures = vec![Texture {
        name: "checks".to_owned(),
        width: 32,
        height: 32,
        rgba: rgba.into(),
        srgb: true,
        wrap: [argus_scene::material::Wrap::Repeat; 2],
        filter: argus_scene::material::Filter::Linear,
    }];
    let white = Material { base_color: Vec4::ONE, ..Material::default() };
    scene.materials = vec![
        Material { base_color_texture: Some(TextureRef::new(0)), ..white.clone() },
        Material { base_color: Vec4::new(0.3, 0.5, 0.9, 1.0), ..white.clone() },
        Material { emissive: Vec3::new(0.9, 0.6, 0.1), ..white },
    ];
    for material in &mut scene.materials {
        (material.double_sided, material.roughness, material.metallic) = (true, 1.0, 0.0);
    }
    let at = DAffine3::from_translation;
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1.0, 0), DAffine3::IDENTITY);
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 2.0, 1.0, 1), at(DVec3::new(0.0, 2.0, -3.5)));
    place(&mut scene, ball(1, 24), at(DVec3::new(1.3, 1.0, -1.2)));
    place(
        &mut scene,
        quad(Vec3::ZERO, Vec3::X * 0.5, Vec3::Y * 0.5, 1.0, 2),
        at(DVec3::new(-1.5, 1.2, -2.0)),
    );
    scene
}

fn rig() -> Rig {
    Rig::Cell { origin: DVec3::new(0.1, 1.3, 0.9), spacing: 0.8, face: FACE }
}

/// An order for the corners of the cell about a place.
fn job(scene: &Scene, sampling: Sampling, about: DVec3, count: usize) -> SampleJob {
    let indices = rig().nearest(&Camera::look_at(about, about + DVec3::X), count);
    let first = sample_job(scene, rig(), indices[0], true);
    let info = SampleSetInfo { sampling, ..(*first.info).clone() };
    let ids = indices.into_iter().map(|index| SampleId { camera: index, ..first.ids[0] }).collect();
    SampleJob::new(Arc::new(info), ids, true)
}

fn middle() -> DVec3 {
    DVec3::new(0.12, 1.32, 0.92)
}

fn samples(sampler: &mut GpuSampler, job: &SampleJob) -> Vec<Sample> {
    let samples = sampler.render_samples(&specified(sampler, job), &Cancel::new());
    samples.into_iter().map(|sample| sample.expect("renders")).collect()
}

fn bytes_of(sample: &Sample) -> [Vec<u8>; 2] {
    [PlaneKind::Radiance, PlaneKind::InverseRange].map(|kind| host_bytes(sample, kind))
}

/// The direction through the middle of each texel, row by row.
fn directions(camera: &SampleCamera) -> Vec<DVec3> {
    let [width, height] = camera.size();
    let mut all = vec![DVec3::ZERO; (width * height) as usize];
    for face in camera.faces() {
        for y in 0..face.size[1] {
            for x in 0..face.size[0] {
                let ndc =
                    (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / f64::from(face.size[0]) * 2.0 - 1.0;
                let at = DVec2::new(ndc.x, -ndc.y) * face.tan_half_fov;
                let place = (face.offset[1] + y) * width + face.offset[0] + x;
                all[place as usize] = (face.view_from_world.transpose() * at.extend(-1.0)).normalize();
            }
        }
    }
    all
}

/// What a sample's radiance looks like.
fn picture(sample: &Sample, exposure: f32) -> RgbImage {
    let [width, height] = sample.camera.size();
    let texels = radiance_of(sample);
    let rgb =
        texels.into_iter().flat_map(|c| argus_scene::tone::display_from_radiance(c, exposure)).collect();
    RgbImage::from_raw(width, height, rgb).expect("three bytes a texel")
}

#[test]
fn texels_are_within_a_cell_of_where_rays_end_and_look_like_those_of_triangles() {
    let scene = Arc::new(scene());
    let tracer = Tracer::new(scene.clone());
    let mut sampler = sampler(&scene);
    let mapped = samples(&mut sampler, &job(&scene, Sampling::MegaViews(KNOBS), middle(), 1)).remove(0);
    let exact = samples(&mut sampler, &job(&scene, Sampling::Triangles, middle(), 1)).remove(0);
    assert_eq!(mapped.camera, exact.camera);
    assert_eq!(mapped.planes.len(), 2, "no planes for reflections");

    let cell = scene.bounds().size().max_element() * (-f64::from(KNOBS.levels)).exp2();
    let inverse = floats(&host_bytes(&mapped, PlaneKind::InverseRange));
    let directions = directions(&mapped.camera);
    let near = directions.iter().zip(&inverse).filter(|(direction, inverse)| {
        let truth = tracer.trace(mapped.camera.center(), **direction).map(|hit| hit.range);
        match (truth, **inverse > 0.0) {
            (None, seen) => !seen,
            (Some(range), true) => (range - f64::from(1.0 / **inverse)).abs() <= cell,
            (Some(_), false) => false,
        }
    });
    let share = near.count() as f64 / inverse.len() as f64;
    assert!(share >= 0.95, "{share} of all texels are within a cell");
    assert!(inverse.iter().all(|r| r.is_finite() && *r >= 0.0));

    let exposure = scene.lighting.exposure;
    let [mapped, exact] = [&mapped, &exact].map(|sample| picture(sample, exposure));
    let compared = argus_scene::metrics::compare(&exact, &mapped).expect("equal sizes");
    flip("megaviews", &mapped, &exact);
    // Measured: 26 dB; edges are as jagged as cells.
    assert!(compared.psnr_db >= 23.0, "PSNR {} dB, {share} near", compared.psnr_db);
}

#[test]
fn a_sample_is_the_same_alone_in_a_batch_and_after_others() {
    let scene = Arc::new(scene());
    for block in [1, 2] {
        let sampling = Sampling::MegaViews(MegaViews { map_side: 64, levels: 6, block });
        let all = job(&scene, sampling, DVec3::new(0.5, 1.7, 1.3), 8);
        let mut one = sampler(&scene);
        let together = samples(&mut one, &all);
        let stored: Vec<_> = together.iter().map(bytes_of).collect();
        assert!(
            stored.iter().enumerate().all(|(i, bytes)| !stored[..i].contains(bytes)),
            "each sees its own"
        );
        let mut other = sampler(&scene);
        for (id, bytes) in all.ids.iter().zip(&stored).rev().step_by(3) {
            let alone = SampleJob { ids: vec![*id], ..all.clone() };
            assert!(bytes_of(&samples(&mut other, &alone)[0]) == *bytes, "sample {id}, blocks of {block}");
        }
        let shuffled = SampleJob { ids: all.ids.iter().rev().take(3).copied().collect(), ..all.clone() };
        let again: Vec<_> = samples(&mut one, &shuffled).iter().map(bytes_of).collect();
        assert!(again.iter().eq(stored.iter().rev().take(3)), "blocks of {block}");
    }
}

#[test]
fn what_light_adds_is_kept_and_what_cannot_be_is_refused_by_name() {
    let scene = Arc::new(scene());
    let sampling = Sampling::MegaViews(MegaViews { map_side: 64, levels: 6, block: 1 });
    let job = job(&scene, sampling, middle(), 1);
    let vpl = VplSettings { vpls: 64, samples: 16, maps: MapSource::Unshadowed, ..VplSettings::default() };
    let settings = SamplerSettings { indirect: Indirect::Vpl(vpl), ..SamplerSettings::default() };
    let mean = |sample: &Sample| radiance_of(sample).iter().map(|c| c.element_sum()).sum::<f32>();
    let dark = mean(&samples(&mut sampler(&scene), &job)[0]);
    let lit = mean(&samples(&mut sampler_with(&scene, settings), &job)[0]);
    assert!(lit > 1.01 * dark, "{lit} {dark}");

    let mut sampler = sampler(&scene);
    let mut refused = |info: SampleSetInfo| {
        let job = SampleJob { info: Arc::new(info), ..job.clone() };
        match sampler.render_samples(&job, &Cancel::new()).remove(0) {
            Err(RenderError::Invalid(at)) => at.field,
            other => panic!("must be refused by field: {:?}", other.map(|sample| sample.id)),
        }
    };
    let tiles = corner_rig(scene.bounds(), [40, 30]);
    assert_eq!(refused(SampleSetInfo { rig: tiles, ..(*job.info).clone() }), "sampling");
    let deep = Sampling::MegaViews(MegaViews { levels: 11, ..KNOBS });
    assert_eq!(refused(SampleSetInfo { sampling: deep, ..(*job.info).clone() }), "sampling.levels");

    // What the rig does not have fails alone.
    let bad = SampleId { camera: u64::MAX, ..job.ids[0] };
    let ids = vec![bad, job.ids[0]];
    let results = sampler.render_samples(&SampleJob { ids, ..job.clone() }, &Cancel::new());
    assert!(matches!(&results[0], Err(RenderError::Invalid(at)) if at.field == "sample.index"));
    assert!(results[1].is_ok());
}

#[test]
fn an_empty_scene_is_all_sky() {
    let scene = Arc::new(empty_scene());
    let mut sampler = sampler(&scene);
    let [mapped, exact] = [Sampling::MegaViews(KNOBS), Sampling::Triangles]
        .map(|sampling| bytes_of(&samples(&mut sampler, &job(&scene, sampling, middle(), 1))[0]));
    assert!(mapped == exact);
    let [radiance, inverse_range] = mapped;
    assert!(inverse_range.iter().all(|byte| *byte == 0), "nothing is anywhere");
    assert!(radiance.iter().any(|byte| *byte != 0), "but the sky");
}
