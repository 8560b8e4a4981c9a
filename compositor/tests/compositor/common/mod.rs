//! Samples made on the CPU, so that a compositor is tested without a sampler: scenes whose answer is known on
//! paper, and scenes that the reference ray tracer looks at.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_compositor::{CompositorSettings, GpuCompositor};
use argus_gpu::{Gpu, GpuOptions};
use argus_scene::reference::Tracer;
use argus_scene::shading::{Surface, diffuse_radiance, sky_radiance, specular_radiance};
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Bounds, Camera, Cancel, Compositor as _, FaceMask, Frame, Light, Lighting, OmniLayout, Output, Outputs,
    Plan, Plane, PlaneData, PlaneFormat, PlaneKind, RenderError, Rig, Sample, SampleCamera, SampleId,
    SampleSet, SampleSetInfo, SceneHash, SceneState, Search, Sky, Version, ViewJob, Warp,
};
use bytes::Bytes;
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Something that rays can be sent at.
pub(crate) trait Subject: Sync {
    /// The nearest surface along a unit direction, and its distance.
    fn see(&self, origin: DVec3, direction: DVec3) -> Option<(f64, Surface)>;
    fn bounds(&self) -> Bounds;
    fn lighting(&self) -> Lighting;

    /// What a viewer sees, linear.
    fn radiance(&self, origin: DVec3, direction: DVec3) -> Vec3 {
        let lighting = self.lighting();
        match self.see(origin, direction) {
            Some((_, surface)) => {
                diffuse_radiance(&surface, &lighting)
                    + specular_radiance(&surface, -direction.as_vec3(), &lighting)
            }
            None => sky_radiance(&lighting.sky, direction.as_vec3()),
        }
    }
}

/// A ground plane with a smooth pattern, and spheres on it, all about an origin anywhere.
#[derive(Debug, Clone)]
pub(crate) struct Analytic {
    pub(crate) origin: DVec3,
    /// Half the edge of the square of ground, metres; 0 for none.
    pub(crate) ground: f64,
    /// Centre about the origin, and radius.
    pub(crate) spheres: Vec<(DVec3, f64)>,
    pub(crate) f0: f32,
    pub(crate) roughness: f32,
    pub(crate) lighting: Lighting,
}

impl Analytic {
    /// Ground of 20 m × 20 m and three spheres of one metre.
    pub(crate) fn garden() -> Self {
        let spheres = vec![
            (DVec3::new(0.0, 1.0, 0.0), 1.0),
            (DVec3::new(3.0, 1.0, -2.0), 1.0),
            (DVec3::new(-2.5, 1.0, 2.0), 1.0),
        ];
        Self {
            origin: DVec3::ZERO,
            ground: 10.0,
            spheres,
            f0: 0.0,
            roughness: 0.3,
            lighting: Lighting { lights: vec![Light::sun()], sky: Sky::DAYLIGHT, exposure: 0.8 },
        }
    }

    /// A sphere seen from its inside: every direction has a surface.
    pub(crate) fn shell(radius: f64) -> Self {
        Self { ground: 0.0, spheres: vec![(DVec3::ZERO, radius)], ..Self::garden() }
    }

    pub(crate) fn at(self, origin: DVec3) -> Self {
        Self { origin, ..self }
    }

    fn surface(&self, position: DVec3, normal: DVec3, hue: f64) -> Surface {
        let local = position - self.origin;
        let wave = |k: f64| (0.5 + 0.25 * (local.x * k).sin() + 0.25 * (local.z * k + local.y).cos()) as f32;
        let albedo = Vec3::new(wave(0.7), wave(0.9) * 0.8, (hue * 0.5 + 0.2) as f32);
        Surface {
            position,
            normal: normal.as_vec3(),
            albedo,
            emissive: Vec3::ZERO,
            f0: Vec3::splat(self.f0),
            roughness: self.roughness,
            transmission: 0.0,
        }
    }
}

impl Subject for Analytic {
    fn see(&self, origin: DVec3, direction: DVec3) -> Option<(f64, Surface)> {
        let o = origin - self.origin;
        let mut best: Option<(f64, Surface)> = None;
        let mut offer = |t: f64, normal: DVec3, hue: f64| {
            if t > 1e-9 && best.as_ref().is_none_or(|(b, _)| t < *b) {
                let facing = if normal.dot(direction) > 0.0 { -normal } else { normal };
                best = Some((t, self.surface(origin + direction * t, facing, hue)));
            }
        };
        if direction.y != 0.0 {
            let t = -o.y / direction.y;
            let hit = o + direction * t;
            if hit.x.abs() <= self.ground && hit.z.abs() <= self.ground {
                offer(t, DVec3::Y, 0.0);
            }
        }
        for (i, &(center, radius)) in self.spheres.iter().enumerate() {
            let m = o - center;
            let b = m.dot(direction);
            let d = b * b - (m.length_squared() - radius * radius);
            if d >= 0.0 {
                for t in [-b - d.sqrt(), -b + d.sqrt()] {
                    offer(t, (m + direction * t) / radius, (i + 1) as f64 * 0.4);
                }
            }
        }
        best
    }

    fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        if self.ground > 0.0 {
            bounds.extend(self.origin + DVec3::new(-self.ground, 0.0, -self.ground));
            bounds.extend(self.origin + DVec3::new(self.ground, 0.0, self.ground));
        }
        for &(center, radius) in &self.spheres {
            bounds.extend(self.origin + center - radius);
            bounds.extend(self.origin + center + radius);
        }
        bounds
    }

    fn lighting(&self) -> Lighting {
        self.lighting.clone()
    }
}

impl Subject for Tracer {
    fn see(&self, origin: DVec3, direction: DVec3) -> Option<(f64, Surface)> {
        let hit = self.trace(origin, direction)?;
        // Texture footprints of a sample's texel, roughly: the tests do not look at single texels.
        let across = direction.any_orthonormal_vector() * 0.0015;
        Some((hit.range, self.surface(&hit, direction, across, direction.cross(across))))
    }

    fn bounds(&self) -> Bounds {
        self.scene().bounds()
    }

    fn lighting(&self) -> Lighting {
        self.scene().lighting.clone()
    }
}

/// A sample of a subject. `side`² rays a texel are averaged over the surface that the central one meets.
pub(crate) fn take(
    subject: &dyn Subject,
    camera: SampleCamera,
    id: SampleId,
    glossy: bool,
    side: u32,
) -> Arc<Sample> {
    let [width, height] = camera.size();
    let texels = width as usize * height as usize;
    let mut radiance = vec![0u32; texels];
    let mut inverse_range = vec![0f32; texels];
    let mut normal = vec![[0i16; 2]; texels];
    let mut specular = vec![[0u8; 4]; texels];
    let lighting = subject.lighting();
    let center = camera.center();
    for face in camera.faces() {
        let direction_at = |at: DVec2| {
            let ndc = at / DVec2::new(f64::from(face.size[0]), f64::from(face.size[1])) * 2.0 - 1.0;
            let half = face.tan_half_fov;
            let at = ndc * half + face.tan_center;
            let in_face = DVec3::new(at.x, -at.y, -1.0);
            (face.view_from_world.transpose() * in_face).normalize()
        };
        let rows: Vec<u32> = (0..face.size[1]).collect();
        let row = |y: u32| -> Vec<_> {
            (0..face.size[0])
                .map(|x| {
                    let at = DVec2::new(f64::from(x), f64::from(y));
                    let direction = direction_at(at + 0.5);
                    let Some((range, surface)) = subject.see(center, direction) else {
                        return (sky_radiance(&lighting.sky, direction.as_vec3()), 0.0, None);
                    };
                    let (mut sum, mut count) = (diffuse_radiance(&surface, &lighting), 1.0);
                    for i in 0..(side * side) * u32::from(side > 1) {
                        let sub = DVec2::new(f64::from(i % side) + 0.5, f64::from(i / side) + 0.5);
                        match subject.see(center, direction_at(at + sub / f64::from(side))) {
                            Some((r, s)) if (r / range - 1.0).abs() < 0.02 => {
                                sum += diffuse_radiance(&s, &lighting);
                                count += 1.0;
                            }
                            _ => {}
                        }
                    }
                    (sum / count, (1.0 / range) as f32, Some(surface))
                })
                .collect()
        };
        let (first, second) = rows.split_at(rows.len() / 2);
        let (a, b): (Vec<Vec<_>>, Vec<Vec<_>>) = std::thread::scope(|scope| {
            let other = scope.spawn(|| second.iter().map(|&y| row(y)).collect());
            (first.iter().map(|&y| row(y)).collect(), other.join().unwrap())
        });
        for (y, texels) in a.into_iter().chain(b).enumerate() {
            for (x, (linear, s, surface)) in texels.into_iter().enumerate() {
                let index = (face.offset[1] as usize + y) * width as usize + face.offset[0] as usize + x;
                radiance[index] = rgb9e5(linear);
                inverse_range[index] = s;
                if let Some(surface) = surface {
                    let n = octahedral(surface.normal);
                    normal[index] = [(n.x * 32767.0).round() as i16, (n.y * 32767.0).round() as i16];
                    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
                    specular[index] =
                        [byte(surface.f0.x), byte(surface.f0.y), byte(surface.f0.z), byte(surface.roughness)];
                }
            }
        }
    }
    let plane = |kind, format, bytes: &[u8]| Plane {
        kind,
        format,
        size: [width, height],
        data: PlaneData::Host(Bytes::copy_from_slice(bytes)),
    };
    let mut planes = vec![
        plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, bytemuck::cast_slice(&radiance)),
        plane(PlaneKind::InverseRange, PlaneFormat::R32Float, bytemuck::cast_slice(&inverse_range)),
    ];
    if glossy {
        planes.push(plane(PlaneKind::Normal, PlaneFormat::Rg16Snorm, bytemuck::cast_slice(&normal)));
        planes.push(plane(PlaneKind::Specular, PlaneFormat::Rgba8Unorm, bytemuck::cast_slice(&specular)));
    }
    Arc::new(Sample { id, camera, faces: FaceMask::ALL, planes, stages: Vec::new() })
}

/// EXT_texture_shared_exponent, the specification's own steps.
pub(crate) fn rgb9e5(linear: Vec3) -> u32 {
    let c = linear.clamp(Vec3::ZERO, Vec3::splat(65408.0));
    let most = c.max_element();
    let mut exponent = (most.log2().floor() as i32).max(-16) + 16;
    if (most / 2f32.powi(exponent - 24)).round() as u32 == 512 {
        exponent += 1;
    }
    let q = (c / 2f32.powi(exponent - 24)).round();
    q.x as u32 | (q.y as u32) << 9 | (q.z as u32) << 18 | (exponent as u32) << 27
}

/// What such a texel says.
pub(crate) fn radiance_of_rgb9e5(bits: u32) -> Vec3 {
    let scale = 2f32.powi((bits >> 27) as i32 - 24);
    Vec3::new((bits & 511) as f32, ((bits >> 9) & 511) as f32, ((bits >> 18) & 511) as f32) * scale
}

fn octahedral(n: Vec3) -> Vec2 {
    let p = n.truncate() / (n.x.abs() + n.y.abs() + n.z.abs());
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    if n.z >= 0.0 { p } else { Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y)) }
}

/// Sample cameras by hand.
pub(crate) fn perspective(eye: DVec3, target: DVec3, fov_deg: f64, width: u32, height: u32) -> SampleCamera {
    let camera = Camera { fov_deg, ..Camera::look_at(eye, target) };
    SampleCamera::Perspective { camera, width, height }
}

pub(crate) fn cube(center: DVec3, face: u32) -> SampleCamera {
    SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face } }
}

pub(crate) fn id(index: u64) -> SampleId {
    SampleId { version: 0, camera: index }
}

/// A set of a subject's samples, ids counting from 0.
pub(crate) fn sample_set(
    subject: &dyn Subject,
    cameras: &[SampleCamera],
    glossy: bool,
    side: u32,
) -> SampleSet {
    let info = SampleSetInfo {
        version: Version::of_epoch(0, 3),
        epoch_secs: 0.1,
        lighting: subject.lighting(),
        ..SampleSetInfo::plain(
            SceneHash([7; 32]),
            subject.bounds(),
            Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 },
        )
    };
    let samples = cameras
        .iter()
        .enumerate()
        .map(|(i, &camera)| take(subject, camera, id(i as u64), glossy, side))
        .collect();
    SampleSet { info: Arc::new(info), samples }
}

pub(crate) fn gpu() -> Arc<Gpu> {
    Gpu::new(&GpuOptions::default()).expect("these tests need a Vulkan driver; scripts/setup installs one")
}

pub(crate) fn compositor(set: &SampleSet) -> GpuCompositor {
    compositor_with(set, CompositorSettings::default())
}

pub(crate) fn compositor_with(set: &SampleSet, settings: CompositorSettings) -> GpuCompositor {
    let mut compositor = GpuCompositor::with_settings(gpu(), settings).unwrap();
    compositor.hold(set).unwrap();
    compositor
}

pub(crate) const EVERYTHING: Outputs =
    Outputs::COLOR.with(Output::Range).with(Output::Mask).with(Output::Source);

/// A view of everything, from all samples of a set, nearest first.
pub(crate) fn job(set: &SampleSet, camera: Camera, size: [u32; 2], search: Search) -> ViewJob {
    let mut samples: Vec<&Arc<Sample>> = set.samples.iter().collect();
    samples.sort_by(|a, b| {
        let distance = |s: &Sample| s.camera.center().distance(camera.eye);
        distance(a).total_cmp(&distance(b))
    });
    let samples = samples.iter().map(|sample| sample.id).collect();
    let plan = Plan::Warp(Warp { search, samples, ..Warp::default() });
    ViewJob {
        outputs: EVERYTHING,
        state: SceneState::of_epoch(3),
        time_secs: 0.3,
        ..ViewJob::new(camera, size, plan)
    }
}

pub(crate) fn compose_one(compositor: &mut GpuCompositor, job: &ViewJob) -> Result<Frame, RenderError> {
    let mut frames = compositor.compose(std::slice::from_ref(job), &Cancel::new());
    assert_eq!(frames.len(), 1);
    frames.remove(0)
}

/// A frame beside the truth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judged {
    /// Share of resolved pixels whose range is off by more than the tolerance, or sky where there is a surface and the
    /// reverse.
    pub(crate) bad_range: f64,
    /// Mean absolute difference of shown bytes over resolved pixels.
    pub(crate) color: f64,
    pub(crate) unresolved: f64,
    pub(crate) sky: f64,
}

/// Compares a frame with what the subject looks like from there.
pub(crate) fn judge(subject: &dyn Subject, job: &ViewJob, frame: &Frame, tolerance: f64) -> Judged {
    let (color, range) =
        (frame.images[Output::Color].as_ref().unwrap(), frame.images[Output::Range].as_ref().unwrap());
    let (mask, source) =
        (frame.images[Output::Mask].as_ref().unwrap(), frame.images[Output::Source].as_ref().unwrap());
    let exposure = subject.lighting().exposure;
    let (mut bad, mut difference, mut unresolved, mut sky) = (0.0, 0.0, 0.0, 0.0);
    let pixels = (job.width * job.height) as usize;
    for i in 0..pixels {
        let at = DVec2::new((i as u32 % job.width) as f64 + 0.5, (i as u32 / job.width) as f64 + 0.5);
        let direction = job.camera.direction(at, job.width, job.height);
        let got = f32::from_le_bytes(range[4 * i..4 * i + 4].try_into().unwrap());
        assert!(!got.is_nan() && got > 0.0, "pixel {i} has range {got}");
        if mask[i] == 255 {
            assert!(source[i] == 0 && got == f32::INFINITY, "an unresolved pixel claims a source or a range");
            unresolved += 1.0;
            continue;
        }
        assert_eq!(mask[i], 0);
        assert_eq!(
            source[i] == 0,
            got == f32::INFINITY,
            "a resolved pixel is sky or has a source: {i} {} {got}",
            source[i]
        );
        sky += f64::from(u8::from(source[i] == 0));
        let truth = subject.see(job.camera.eye, direction).map(|(range, _)| range);
        let good = match truth {
            Some(truth) => (f64::from(got) / truth - 1.0).abs() <= tolerance,
            None => got == f32::INFINITY,
        };
        bad += f64::from(u8::from(!good));
        let expected = display_from_radiance(subject.radiance(job.camera.eye, direction), exposure);
        for (c, expected) in expected.into_iter().enumerate() {
            difference += f64::from(color[3 * i + c].abs_diff(expected)) / 3.0;
        }
    }
    let resolved = (pixels as f64 - unresolved).max(1.0);
    let pixels = pixels as f64;
    Judged {
        bad_range: bad / resolved,
        color: difference / resolved,
        unresolved: unresolved / pixels,
        sky: sky / pixels,
    }
}
