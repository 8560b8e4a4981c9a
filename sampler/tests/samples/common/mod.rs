//! What the tests of this folder share.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::sync::{Arc, OnceLock};

use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::reference::{ReferenceImage, Tracer};
use argus_scene::rig::Rig;
use argus_scene::{
    Bounds, Camera, Cancel, Frame, Indirect, Instance, Light, Lighting, Material, Mesh, Output, Outputs,
    Plan, PlaneData, PlaneKind, Sample, SampleId, SampleJob, SampleSetInfo, Sampler, Sampling, Scene,
    SceneHash, SceneState, Sky, Specification, Version, ViewJob, Visibility,
};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use image::RgbImage;

/// One device for all tests of a binary: opening one takes longer than most of them.
pub(crate) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    Arc::clone(
        GPU.get_or_init(|| Gpu::new(&GpuOptions::default()).expect("these tests need a Vulkan driver")),
    )
}

pub(crate) fn sampler(scene: &Arc<Scene>) -> GpuSampler {
    sampler_with(scene, SamplerSettings::default())
}

pub(crate) fn sampler_with(scene: &Arc<Scene>, settings: SamplerSettings) -> GpuSampler {
    GpuSampler::with_methods(gpu(), Arc::clone(scene), settings, crate::methods())
        .expect("the scene fits the device")
}

/// Both outputs of a direct view.
pub(crate) fn view_job(camera: Camera, size: [u32; 2], samples_per_pixel: u32) -> ViewJob {
    ViewJob {
        camera,
        width: size[0],
        height: size[1],
        outputs: Outputs::COLOR.with(Output::Range),
        plan: Plan::direct(samples_per_pixel),
        band_rows: 0,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: None,
        history: None,
        rays: None,
        visibility: Visibility::default(),
    }
}

pub(crate) fn direct(sampler: &mut GpuSampler, job: &ViewJob) -> Frame {
    sampler.render_views(std::slice::from_ref(job), &Cancel::new()).remove(0).expect("renders")
}

pub(crate) fn image_of(frame: &Frame) -> RgbImage {
    let bytes = frame.images[Output::Color].as_ref().expect("colour was asked for").to_vec();
    RgbImage::from_raw(frame.width, frame.height, bytes).expect("three bytes a pixel")
}

pub(crate) fn range_of(frame: &Frame) -> Vec<f32> {
    floats(frame.images[Output::Range].as_ref().expect("range was asked for"))
}

pub(crate) fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
}

pub(crate) fn reference(scene: &Arc<Scene>, camera: &Camera, size: [u32; 2], spp: u32) -> ReferenceImage {
    Tracer::new(Arc::clone(scene)).render(camera, size[0], size[1], spp, |_| {})
}

/// Orders of one camera of a rig.
pub(crate) fn sample_job(scene: &Scene, rig: Rig, index: u64, to_host: bool) -> SampleJob {
    let info = SampleSetInfo {
        scene: scene.hash,
        bounds: scene.bounds(),
        extent: scene.extent(),
        rig,
        version: Version::of_epoch(0, 0),
        epoch_secs: 0.0,
        lighting: scene.lighting.clone(),
        visibility: Visibility::default(),
        sampling: Sampling::default(),
        sub_samples: Specification::USUAL_SUB_SAMPLES,
        effects: argus_scene::LightEffects::NONE,
        indirect: Indirect::Off,
        reflections: None,
    };
    SampleJob::new(Arc::new(info), vec![SampleId { version: 0, camera: index }], to_host)
}

/// The same samples, of a set that is specified as that sampler was made.
pub(crate) fn specified(sampler: &GpuSampler, job: &SampleJob) -> SampleJob {
    let SamplerSettings { sub_samples, effects, indirect, .. } = *sampler.settings();
    let info = SampleSetInfo { sub_samples, effects, indirect, ..(*job.info).clone() };
    SampleJob { info: Arc::new(info), ..job.clone() }
}

pub(crate) fn sample(sampler: &mut GpuSampler, job: &SampleJob) -> Sample {
    let job = specified(sampler, job);
    sampler.render_samples(&job, &Cancel::new()).remove(0).expect("renders")
}

pub(crate) fn host_bytes(sample: &Sample, kind: PlaneKind) -> Vec<u8> {
    match &sample.plane(kind).expect("the sample has this plane").data {
        PlaneData::Host(bytes) => bytes.to_vec(),
        PlaneData::Device(_) => panic!("the plane is on the device"),
    }
}

/// Linear radiance of an Rgb9e5Ufloat plane.
pub(crate) fn radiance_of(sample: &Sample) -> Vec<Vec3> {
    let bytes = host_bytes(sample, PlaneKind::Radiance);
    let words = bytes.as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b));
    words
        .map(|w| {
            let scale = ((w >> 27) as f32 - 24.0).exp2();
            Vec3::new((w & 511) as f32, (w >> 9 & 511) as f32, (w >> 18 & 511) as f32) * scale
        })
        .collect()
}

/// One sample from the origin, of cube faces of so many texels, read back.
pub(crate) fn job_around_origin(scene: &Scene, face: u32) -> SampleJob {
    let rig = omni_rig(DVec3::ZERO, face);
    let here = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    sample_job(scene, rig, rig.nearest(&here, 1)[0], true)
}

/// Mean radiance of a sample's texels, all of which are finite.
pub(crate) fn mean_radiance(sampler: &mut GpuSampler, job: &SampleJob) -> Vec3 {
    let radiance = radiance_of(&sample(sampler, job));
    assert!(radiance.iter().all(|r| r.is_finite()));
    radiance.iter().sum::<Vec3>() / radiance.len() as f32
}

/// An empty scene: a sky, one matt material, no light.
pub(crate) fn empty_scene() -> Scene {
    let sky = Sky {
        zenith: Vec3::new(0.2, 0.4, 0.9),
        horizon: Vec3::new(0.8, 0.8, 0.7),
        ground: Vec3::new(0.3, 0.2, 0.1),
        map: None,
        reach: None,
    };
    Scene {
        name: "test".to_owned(),
        hash: SceneHash([1; 32]),
        meshes: Vec::new(),
        instances: Vec::new(),
        materials: vec![Material::default()],
        textures: Vec::new(),
        nodes: Vec::new(),
        animations: Vec::new(),
        lighting: Lighting { lights: vec![Light::sun()], sky, exposure: 0.7 },
        cameras: Vec::new(),
        rig: argus_scene::RigKind::TileCorners,
        ..Scene::default()
    }
}

/// A square of two triangles in the plane through `center` with the given half axes; its front is where
/// `x` × `y` points. Texture coordinates run from 0 to `tiles`.
pub(crate) fn quad(center: Vec3, x: Vec3, y: Vec3, tiles: f32, material: u32) -> Mesh {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    Mesh {
        positions: corners.iter().map(|&(u, v)| center + x * u + y * v).collect(),
        normals: vec![x.cross(y).normalize(); 4],
        tangents: vec![x.normalize().extend(1.0); 4],
        uvs: corners.iter().map(|&(u, v)| Vec2::new(u + 1.0, 1.0 - v) * 0.5 * tiles).collect(),
        indices: vec![0, 1, 2, 0, 2, 3],
        material,
        ..Mesh::default()
    }
}

/// A ball of radius one about zero, its triangles' fronts outside.
pub(crate) fn ball(material: u32, rings: u32) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    let around = 2 * rings;
    for i in 0..=rings {
        for j in 0..=around {
            let (v, u) = (i as f32 / rings as f32, j as f32 / around as f32);
            let (polar, azimuth) = (v * std::f32::consts::PI, u * std::f32::consts::TAU);
            let n = Vec3::new(polar.sin() * azimuth.cos(), polar.cos(), -polar.sin() * azimuth.sin());
            mesh.positions.push(n);
            mesh.normals.push(n);
            mesh.uvs.push(Vec2::new(4.0 * u, 2.0 * v));
            mesh.tangents.push(Vec3::new(-azimuth.sin(), 0.0, -azimuth.cos()).extend(1.0));
        }
    }
    let row = around + 1;
    for i in 0..rings {
        for j in 0..around {
            let (a, b) = (i * row + j, (i + 1) * row + j);
            mesh.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    mesh
}

/// Adds a mesh and an instance of it.
pub(crate) fn place(scene: &mut Scene, mesh: Mesh, world_from_mesh: DAffine3) {
    scene.instances.push(Instance { mesh: scene.meshes.len() as u32, node: None, world_from_mesh });
    scene.meshes.push(mesh);
}

/// A rig whose camera 0 looks at the box from one of its corners.
pub(crate) fn corner_rig(bounds: Bounds, size: [u32; 2]) -> Rig {
    Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size }
}

/// A rig one of whose cameras stands at `origin`, whatever its index, and looks everywhere.
pub(crate) fn omni_rig(origin: DVec3, face: u32) -> Rig {
    Rig::Cell { origin, spacing: 1.0, face }
}

/// Mean FLIP against an image that is written beside it, with the difference, under `name`, if
/// `ARGUS_TEST_IMAGES` names a folder.
pub(crate) fn flip(name: &str, ours: &RgbImage, truth: &RgbImage) -> f64 {
    if let Some(folder) = std::env::var_os("ARGUS_TEST_IMAGES") {
        let path = |what: &str| std::path::Path::new(&folder).join(format!("{name}-{what}.png"));
        ours.save(path("gpu")).expect("the folder is writable");
        truth.save(path("reference")).expect("the folder is writable");
    }
    argus_scene::metrics::compare(truth, ours).expect("equal sizes").flip_mean
}
