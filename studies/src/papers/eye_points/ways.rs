//! The ways to fill maps around reflectors, and to do without.

use std::fmt;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_eye_points::{
    Density, DensityRule, DeviceLookups, EyePointSettings, EyePoints, Lookups, PointDevice, PointScene,
    Reflected, STEPS, Splatting, reflect, reflect_adaptively, reflect_all,
};
use argus_sampler::plug::{IndexMaps, MappedReflector, ReflectionRays, SurfacePoint};
use argus_scene::Stage as Timed;
use argus_scene::shading::sky_radiance;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::paper::Method;
use super::stage::{Seen, Stage};

/// A way to find reflections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Way {
    /// Eye-based points of a density.
    Points(f64),
    /// Eye-based points that take reflectors for planar: the paper's equations as they stand.
    PlanarPoints,
    /// Eye-based points without most of the smallest triangles.
    CulledPoints,
    /// Eye-based points that are splatted as they are made: the paper's splats without a buffer.
    BufferlessPoints,
    /// Eye-based points that are made and splatted on a device; maps are read back, lookups and shading are those of all ways.
    ComputePoints,
    /// Eye-based points of which a device does all but the shading: it cuts triangles, makes and splats points, looks them up, lists
    /// what is shaded, and averages its radiance.
    DevicePoints,
    /// Eye-based points of which only those wider than a texel are stored before they are splatted: the paper's splats of
    /// shadows.
    HybridPoints,
    /// Points as dense as texels, all of which are shaded: improved view-independent rendering.
    MapPoints,
    /// Every triangle is rasterised into every map, all of whose texels are shaded. The maps' sides follow the eye, or are
    /// fixed.
    MultiView(Option<u32>),
    /// A ray for each texel; shading as for points.
    TracedMaps,
    /// A ray for each tap of the eye.
    Rays,
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Points(_) => f.write_str("points"),
            Self::PlanarPoints => f.write_str("points, planar"),
            Self::CulledPoints => f.write_str("points, culled"),
            Self::BufferlessPoints => f.write_str("points, bufferless"),
            Self::ComputePoints => f.write_str("points, compute"),
            Self::DevicePoints => f.write_str("points, device"),
            Self::HybridPoints => f.write_str("points, hybrid"),
            Self::MapPoints => f.write_str("iVIR"),
            Self::MultiView(None) => f.write_str("MVR, adaptive"),
            Self::MultiView(Some(side)) => write!(f, "MVR, {side}²"),
            Self::TracedMaps => f.write_str("traced maps"),
            Self::Rays => f.write_str("rays"),
        }
    }
}

/// What a way found, and what it took.
pub(super) struct Outcome {
    pub(super) arriving: Vec<Vec3>,
    /// Where central rays end by the way's lookups; and by lookups without impostor steps.
    pub(super) met: Vec<Option<DVec3>>,
    pub(super) met_plain: Option<Vec<Option<DVec3>>>,
    pub(super) points: Option<u64>,
    /// Points at full density, where a budget has lowered it.
    pub(super) wanted: Option<u64>,
    pub(super) shades: u64,
    /// Lookups of taps.
    pub(super) lookups: u64,
    pub(super) memory: Memory,
    pub(super) stages: Vec<Timed>,
    /// Shares of texels that are holes, and that see another triangle than a ray.
    pub(super) holes: Option<[f64; 2]>,
}

/// Bytes that a way needs, as the paper divides them (section 4.2.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Memory {
    /// Texels of all maps.
    pub(super) maps: usize,
    /// Stored points.
    pub(super) points: usize,
    /// Pieces of triangles with their bits, or what rays have met.
    pub(super) pieces: usize,
    /// Looked-up texels, requests and shaded radiance.
    pub(super) deferred: usize,
}

impl Memory {
    /// All bytes.
    pub(super) fn sum(self) -> usize {
        self.maps + self.points + self.pieces + self.deferred
    }
}

/// How many of the taps a reflective pixel uses (section 4.1.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TapRule {
    /// All.
    Fixed,
    /// Four more until the variance of their colour declines no more.
    Adaptive,
}

impl fmt::Display for TapRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fixed => "fixed",
            Self::Adaptive => "adaptive",
        })
    }
}

/// What all ways share.
pub(super) struct Ways<'a> {
    pub(super) stage: &'a Stage,
    pub(super) points: &'a PointScene,
    /// The device that has the scene's triangles, if one can be opened.
    pub(super) device: Option<&'a PointDevice>,
    pub(super) rays: &'a ReflectionRays,
    pub(super) seen: &'a Seen,
    pub(super) taps: &'a [DVec2],
    /// How many taps eye-based points use; all others use all.
    pub(super) tap_rule: TapRule,
    pub(super) budget: u32,
}

/// Density of points in all rows that vary something else: the paper's choice.
pub(super) const USUAL_DENSITY: f64 = 0.5;
/// Pixels whose rays are traced together.
const SHARE: usize = 4096;

impl Way {
    /// The paper's name of it, if it has measured it.
    pub(super) fn method(self) -> Option<Method> {
        match self {
            Self::Points(density) if density == USUAL_DENSITY => Some(Method::Epr),
            Self::MapPoints => Some(Method::Ivir),
            Self::MultiView(Some(_)) => Some(Method::Mvr),
            _ => None,
        }
    }

    /// Whether its points are as dense as the eye's pixels.
    pub(super) fn is_eye_based(self) -> bool {
        self.density().is_some()
    }

    /// The paper's ρ_scale, of ways that have one.
    pub(super) fn density(self) -> Option<f64> {
        match self {
            Self::Points(density) => Some(density),
            Self::PlanarPoints
            | Self::CulledPoints
            | Self::BufferlessPoints
            | Self::HybridPoints
            | Self::ComputePoints
            | Self::DevicePoints => Some(USUAL_DENSITY),
            _ => None,
        }
    }
}

impl Ways<'_> {
    /// Goes a way once.
    ///
    /// # Errors
    /// The device failed, is not open, or is too small.
    pub(super) fn go(&self, way: Way) -> Result<Outcome> {
        Ok(match way {
            Way::Points(scale) => self.points(DensityRule::Eye, scale, false, Splatting::Buffered),
            Way::PlanarPoints => self.points(DensityRule::Planar, USUAL_DENSITY, false, Splatting::Buffered),
            Way::CulledPoints => self.points(DensityRule::Eye, USUAL_DENSITY, true, Splatting::Buffered),
            Way::BufferlessPoints => {
                self.points(DensityRule::Eye, USUAL_DENSITY, false, Splatting::Bufferless)
            }
            Way::ComputePoints => self.compute_points()?,
            Way::DevicePoints => self.device_points()?,
            Way::HybridPoints => self.points(DensityRule::Eye, USUAL_DENSITY, false, Splatting::Hybrid),
            Way::MapPoints => self.points(DensityRule::Map, 1.0, false, Splatting::Buffered),
            Way::MultiView(side) => self.multi_view(side),
            Way::TracedMaps => self.traced_maps(),
            Way::Rays => self.rays(),
        })
    }

    pub(super) fn lookups<'a>(
        &'a self,
        maps: &'a IndexMaps,
        reflectors: &'a [MappedReflector],
        steps: u32,
    ) -> Lookups<'a> {
        let (eye, pixels) = (self.seen.eye.position, &self.seen.pixels[..]);
        Lookups { maps, reflectors, eye, pixels, taps: self.taps, steps }
    }

    fn taps_of_all_pixels(&self) -> u64 {
        self.seen.pixels.len() as u64 * self.taps.len() as u64
    }

    fn outcome(&self, maps: &IndexMaps, reflectors: &[MappedReflector], reflected: Reflected) -> Outcome {
        Outcome {
            arriving: reflected.radiance,
            met: self.lookups(maps, reflectors, STEPS).met(),
            met_plain: Some(self.lookups(maps, reflectors, 0).met()),
            points: None,
            wanted: None,
            shades: reflected.shades as u64,
            lookups: self.taps_of_all_pixels(),
            memory: Memory { maps: maps.bytes(), deferred: reflected.bytes, ..Memory::default() },
            stages: reflected.stages,
            holes: None,
        }
    }

    fn points(&self, rule: DensityRule, scale: f64, culling: bool, splatting: Splatting) -> Outcome {
        let density = Density { rule, scale, ..Density::default() };
        let settings = EyePointSettings { density, budget: self.budget, culling };
        let found = self.points.points_by(&self.seen.eye, &self.seen.reflectors, &settings, splatting);
        self.reflected(rule, found)
    }

    fn compute_points(&self) -> Result<Outcome> {
        let device = self.device.context("no device is open")?;
        let density = Density { scale: USUAL_DENSITY, ..Density::default() };
        let budget = self.budget.min(device.most_points());
        let settings = EyePointSettings { density, budget, culling: false };
        let found = self.points.points_on(device, &self.seen.eye, &self.seen.reflectors, &settings)?;
        Ok(self.reflected(density.rule, found))
    }

    fn device_points(&self) -> Result<Outcome> {
        let device = self.device.context("no device is open")?;
        let density = Density { scale: USUAL_DENSITY, ..Density::default() };
        let settings = EyePointSettings { density, budget: self.budget, culling: false };
        let reflectors = &self.seen.reflectors[..];
        let filled = self.points.fill_on(device, &self.seen.eye, reflectors, &settings)?;
        let (eye, pixels) = (self.seen.eye.position, &self.seen.pixels[..]);
        let lookups = DeviceLookups { reflectors, eye, pixels, taps: self.taps, steps: STEPS };
        let sky = &self.stage.scene.lighting.sky;
        let shade = |at: &SurfacePoint| self.stage.shade(at);
        let reflected = self.points.reflect_on(device, &filled, &lookups, sky, shade)?;
        // What follows is not timed: errors are found on the CPU.
        let found = self.points.read_points(device, filled, reflectors)?;
        Ok(self.outcome_of_points(found, reflected, self.taps_of_all_pixels()))
    }

    /// What pixels reflect by the maps of points.
    fn reflected(&self, rule: DensityRule, found: EyePoints) -> Outcome {
        let reflectors = &self.seen.reflectors;
        let lookups = self.lookups(&found.maps, reflectors, STEPS);
        let sky = &self.stage.scene.lighting.sky;
        let shade = |id: u32| self.stage.shade(&self.points.shading_of_point(&found, id));
        let (reflected, looked_up) = match (rule, self.tap_rule) {
            (DensityRule::Map, _) => {
                (reflect_all(&lookups, sky, found.count(), |_, id| id, shade), self.taps_of_all_pixels())
            }
            (_, TapRule::Fixed) => {
                (reflect(&lookups, sky, found.count(), |_, id| id, shade), self.taps_of_all_pixels())
            }
            (_, TapRule::Adaptive) => reflect_adaptively(&lookups, sky, found.count(), |_, id| id, shade),
        };
        self.outcome_of_points(found, reflected, looked_up)
    }

    /// What is reported of points and what is reflected by them.
    fn outcome_of_points(&self, found: EyePoints, reflected: Reflected, looked_up: u64) -> Outcome {
        let outcome = self.outcome(&found.maps, &self.seen.reflectors, reflected);
        let facet_of = |id: u32| {
            let piece = &found.pieces.all[found.point(id).piece() as usize];
            let facet = &self.points.facets()[piece.facet as usize];
            (facet.instance, facet.primitive)
        };
        let holes = self.stage.holes(self.seen, &found.maps, facet_of);
        Outcome {
            points: Some(found.count() as u64),
            wanted: (found.budget.reduction < 1.0).then_some(found.budget.wanted),
            lookups: looked_up,
            memory: Memory {
                points: size_of_val(&found.points[..]),
                pieces: found.bytes() - found.maps.bytes() - size_of_val(&found.points[..]),
                ..outcome.memory
            },
            stages: [found.stages, outcome.stages].concat(),
            holes: Some(holes),
            ..outcome
        }
    }

    fn multi_view(&self, side: Option<u32>) -> Outcome {
        let mut reflectors = self.seen.reflectors.clone();
        reflectors.iter_mut().for_each(|reflector| reflector.side = side.unwrap_or(reflector.side));
        let begin = Instant::now();
        let maps = self.points.rasterise(&reflectors);
        let raster = Timed::new("splat", begin.elapsed().as_secs_f64() * 1e3);
        let lookups = self.lookups(&maps, &reflectors, STEPS);
        let shade = |texel: u32| {
            let at = self.points.shading_of_texel(&maps, &reflectors, texel as usize);
            at.map_or(Vec3::ZERO, |at| self.stage.shade(&at))
        };
        let sky = &self.stage.scene.lighting.sky;
        let reflected = reflect_all(&lookups, sky, maps.texels(), |texel, _| texel as u32, shade);
        let outcome = self.outcome(&maps, &reflectors, reflected);
        let facet_of = |id: u32| {
            let facet = &self.points.facets()[id as usize];
            (facet.instance, facet.primitive)
        };
        let holes = self.stage.holes(self.seen, &maps, facet_of);
        Outcome { stages: [vec![raster], outcome.stages].concat(), holes: Some(holes), ..outcome }
    }

    fn traced_maps(&self) -> Outcome {
        let reflectors = &self.seen.reflectors;
        let begin = Instant::now();
        let (maps, met) = self.rays.maps(reflectors);
        let traced = Timed::new("splat", begin.elapsed().as_secs_f64() * 1e3);
        let lookups = self.lookups(&maps, reflectors, STEPS);
        let shade = |texel: u32| {
            let Some(met) = &met[texel as usize] else { return Vec3::ZERO };
            let (map, direction) = maps.direction_of(texel as usize);
            let width = 2.0 * met.range / f64::from(maps.side(map));
            self.stage.shade(&self.rays.shading_of(met, direction.normalize(), width))
        };
        let sky = &self.stage.scene.lighting.sky;
        let reflected = reflect(&lookups, sky, maps.texels(), |texel, _| texel as u32, shade);
        let outcome = self.outcome(&maps, reflectors, reflected);
        let facet_of = |texel: u32| met[texel as usize].map_or((u32::MAX, 0), |m| (m.instance, m.primitive));
        let holes = self.stage.holes(self.seen, &maps, facet_of);
        Outcome {
            memory: Memory { pieces: size_of_val(&met[..]), ..outcome.memory },
            stages: [vec![traced], outcome.stages].concat(),
            holes: Some(holes),
            ..outcome
        }
    }

    fn rays(&self) -> Outcome {
        let Seen { eye, pixels, reflectors, .. } = self.seen;
        let eye = eye.position;
        let sky = &self.stage.scene.lighting.sky;
        let (mut arriving, mut met) = (Vec::with_capacity(pixels.len()), Vec::with_capacity(pixels.len()));
        let mut shades = 0;
        let (mut trace_ms, mut shade_ms) = (0.0, 0.0);
        for pixels in pixels.chunks(SHARE) {
            let begin = Instant::now();
            let of_pixel = |pixel: &argus_eye_points::ReflectivePixel| {
                let own = reflectors[pixel.reflector as usize].instance;
                let pixel = *pixel;
                self.taps.iter().map(move |&tap| {
                    let (origin, direction) = pixel.ray(eye, tap);
                    (origin, direction, own)
                })
            };
            let rays: Vec<_> = pixels.iter().flat_map(of_pixel).collect();
            let found = self.rays.trace(eye, &rays);
            trace_ms += begin.elapsed().as_secs_f64() * 1e3;
            let begin = Instant::now();
            let radiance = |(ray, found): (&(DVec3, DVec3, u32), &Option<_>)| match found {
                // Unfiltered, as the truth is.
                Some(found) => self.stage.shade(&self.rays.shading_of(found, ray.1, 0.0)),
                None => sky_radiance(sky, ray.1.as_vec3()),
            };
            let shaded: Vec<Vec3> = rays.par_iter().zip(&found).with_min_len(64).map(radiance).collect();
            let taps = self.taps.len();
            arriving.extend(shaded.chunks(taps).map(|taps| taps.iter().sum::<Vec3>() / taps.len() as f32));
            shades += found.iter().flatten().count() as u64;
            shade_ms += begin.elapsed().as_secs_f64() * 1e3;
            let central: Vec<_> = pixels
                .iter()
                .map(|pixel| {
                    let (origin, direction) = pixel.ray(eye, DVec2::ZERO);
                    (origin, direction, reflectors[pixel.reflector as usize].instance)
                })
                .collect();
            let ends = self.rays.trace(eye, &central);
            met.extend(central.iter().zip(ends).map(|(ray, end)| end.map(|end| ray.0 + ray.1 * end.range)));
        }
        Outcome {
            arriving,
            met,
            met_plain: None,
            points: None,
            wanted: None,
            shades,
            lookups: self.taps_of_all_pixels(),
            memory: Memory {
                deferred: SHARE * self.taps.len() * (size_of::<(DVec3, DVec3, u32)>() + size_of::<Vec3>()),
                ..Memory::default()
            },
            stages: vec![Timed::new("request", trace_ms), Timed::new("shade", shade_ms)],
            holes: None,
        }
    }
}
