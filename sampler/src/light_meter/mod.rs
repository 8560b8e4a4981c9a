//! Meters the light of a scene: which light it is shown in, and its exposure.
//!
//! Rays of sight ([`viewers`]) find visible points. At each the irradiance of each class of light is estimated with a few
//! rays ([`arriving`]): of the scene's own lights, emitters and environment, of sun and sky, and of the light of interiors.
//!
//! # Which light
//!
//! Light is *enough* if at least [`ENOUGH`] of the points get at least [`LEAST_LIGHT`] of the median of those that get any.
//! The first of these that is enough is taken: the scene's own light; that with sun and sky; that with the light of
//! interiors, which reaches all. Only light that arrives directly counts: rooms that are lit by what comes through a window
//! get the light of interiors.
//!
//! Backs that are culled are not seen, and block light. Unlit surfaces are not metered.

mod arriving;
mod viewers;

use argus_scene::emitters::{EmittersByPower, emitters};
use argus_scene::exposure::{MeteredPoint, Metering, metered};
use argus_scene::{AddedLight, LightChoice, LightEffects, LightRequest, Lighting, Scene};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::PacketSight;
use crate::light_rays::{CullMode, LightRays};
use crate::packets::PacketTracer;
use crate::resident::placed;
use crate::surfaces::Surfaces;
use arriving::{Light, VisiblePoint};

/// Share of the visible points that light must reach.
const ENOUGH: f64 = 0.75;
/// Share of the median light that counts as light.
const LEAST_LIGHT: f64 = 1.0 / 64.0;
/// Size of a room in distances within which the light of interiors is blocked.
const REACHES_IN_ROOM: f64 = 10.0;
/// Panes of glass that a ray of sight passes, at most.
const MOST_PANES: u32 = 16;
/// Stops of radiance about 1 that samples store well.
const STORED_STOPS: f64 = 9.0;
/// Own light at visible points, in strengths of the added light, above which it is weakened.
const MOST_OWN: f64 = 1.0;

/// A light for a scene, and what it is metered to be.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedLight {
    /// The light.
    pub choice: LightChoice,
    /// Why it was chosen, in plain words.
    pub reason: String,
    /// Light at visible surfaces in it, for [`argus_scene::Exposure::factor`]; `None` if there is none.
    pub metered: Option<f64>,
}

/// A scene that is ready to be metered.
struct Meter {
    surfaces: Surfaces,
    rays: LightRays,
    center: DVec3,
    /// Length of the diagonal of what is seen, metres.
    size: f64,
    points: Vec<VisiblePoint>,
}

impl PacketSight {
    /// Light at the surfaces that viewers see at time zero, in the scene's lighting, for
    /// [`argus_scene::Exposure::factor`]. `None` if no light arrives.
    pub fn metered(&self, metering: Metering) -> Option<f64> {
        let lighting = self.scene().at(0.0).lighting;
        self.at(0.0, |tracer| Meter::new(self.scene(), tracer)?.exposed(&lighting, 1.0, metering))
    }

    /// The light for a scene as it was opened, at time zero.
    pub fn resolve_light(&self, request: LightRequest, metering: Metering) -> ResolvedLight {
        let (scene, begin) = (self.scene(), std::time::Instant::now());
        let meter = self.at(0.0, |tracer| Meter::new(scene, tracer)).filter(|meter| !meter.points.is_empty());
        let Some(meter) = meter else {
            let (choice, reason) = match request {
                LightRequest::File => (LightChoice::FILE, "as asked for"),
                LightRequest::Sky => (LightChoice::SKY, "as asked for"),
                LightRequest::Interior => (LightChoice::interior(1.0), "as asked for"),
                LightRequest::Auto => (scene.opened_light(), "nothing that light would change is seen"),
            };
            return ResolvedLight { choice, reason: reason.to_owned(), metered: None };
        };
        let resolved = meter.resolved(scene, request, metering);
        let (ms, points) = (begin.elapsed().as_secs_f64() * 1e3, meter.points.len());
        tracing::info!(ms, points, light = %resolved.choice, "light metered");
        resolved
    }
}

impl Meter {
    /// `None` for a scene too large for rays of light.
    fn new(scene: &std::sync::Arc<Scene>, tracer: &PacketTracer) -> Option<Self> {
        let placements = placed(scene, &scene.at(0.0).instances);
        // Leaves and other cut-outs are seen and block light.
        let whole = placements
            .iter()
            .any(|placement| placement.class.cutout)
            .then(|| PacketTracer::new(scene, &placements, f32::MIN_POSITIVE));
        let tracer = whole.as_ref().unwrap_or(tracer);
        let surfaces = Surfaces::new(scene, &placements);
        let extent = scene.extent();
        let rays = LightRays::new(tracer, CullMode::None)?;
        let (center, size) = (extent.center(), extent.size().length());
        let mut meter = Self { surfaces, rays, center, size, points: Vec::new() };
        let about = meter.rays.about(center);
        let sights = viewers::sights(scene, &extent, tracer);
        let seen = sights.par_iter().filter_map(|&(eye, way)| meter.seen(tracer, eye, way));
        let offset = |point: VisiblePoint| {
            let off = 2.0 * about.offset(point.position, point.position.length());
            VisiblePoint { start: point.position + point.side * off, ..point }
        };
        let points = seen.map(offset).collect();
        drop(about);
        meter.points = points;
        Some(meter)
    }

    /// The point behind glass and backdrops that a ray of sight ends at; `None` if light does not change it.
    fn seen(&self, tracer: &PacketTracer, eye: DVec3, way: DVec3) -> Option<VisiblePoint> {
        let mut passed = 0.0;
        for _ in 0..MOST_PANES {
            let hit = tracer.nearest(eye + way * passed, way, f64::INFINITY)?;
            let position = eye + way * (passed + hit.t);
            let material = self.surfaces.material(&hit)?;
            if self.surfaces.passes_light(&hit) {
                passed += hit.t + 1e-9 * (position.abs().max_element() + hit.t) / way.length();
                continue;
            }
            if material.unlit {
                return None;
            }
            let point = self.surfaces.hit(&hit, way)?;
            return Some(VisiblePoint {
                position: (position - self.center).as_vec3(),
                normal: point.normal.as_vec3(),
                side: point.side.as_vec3(),
                start: Vec3::ZERO,
                albedo: point.albedo,
                base: point.base,
                emissive: point.emissive,
            });
        }
        None
    }

    fn resolved(&self, scene: &Scene, request: LightRequest, metering: Metering) -> ResolvedLight {
        let own_lighting = scene.own_lighting();
        let direct = |lighting: &Lighting, emits: bool| self.direct(lighting, emits, metering.effects);
        let own = direct(&own_lighting, true);
        let has_sky_of_its_own = own_lighting.sky.map.is_some();
        let (own_share, own_median) = reached(&own);
        let percent = |share: f64| format!("{:.0}%", 100.0 * share);
        let of_own = match own_median > 0.0 {
            true => format!("own light reaches {} of what is seen", percent(own_share)),
            false => "it has no light of its own that reaches what is seen".to_owned(),
        };
        let is_auto = request == LightRequest::Auto;
        let asked = "as asked for".to_owned();
        if request == LightRequest::File || is_auto && own_share >= ENOUGH {
            let reason = if is_auto { of_own } else { asked };
            return self.with(scene, LightChoice::FILE, own_median, reason, metering);
        }
        let bare = |added: LightChoice| Lighting {
            lights: scene.lighting_in(added).lights.split_off(own_lighting.lights.len()),
            ..scene.lighting_in(added)
        };
        let (share, sum, added) = match has_sky_of_its_own {
            true => (own_share, own.clone(), vec![0.0; own.len()]),
            false => {
                let added = direct(&bare(LightChoice::SKY), false);
                let sum: Vec<f64> = own.iter().zip(&added).map(|(own, added)| own + added).collect();
                (reached(&sum).0, sum, added)
            }
        };
        if request == LightRequest::Sky || is_auto && share >= ENOUGH {
            let reason = if is_auto { format!("{of_own}: sun and sky are added") } else { asked };
            let choice = LightChoice::SKY.with_own(weakened(&own, &added));
            return self.with(scene, choice, reached(&sum).1, reason, metering);
        }
        let reason = match (is_auto, has_sky_of_its_own) {
            (false, _) => asked,
            (true, true) => format!("{of_own}: a light of interiors is taken"),
            (true, false) => {
                format!("{of_own}, with sun and sky {}: a light of interiors is taken", percent(share))
            }
        };
        let choice = LightChoice::interior(self.room_size() / REACHES_IN_ROOM);
        let added = direct(&bare(choice), false);
        let choice = choice.with_own(weakened(&own, &added));
        self.with(scene, choice, reached(&added).1, reason, metering)
    }

    /// A choice with its exposure. `median` is the light that it brings.
    fn with(
        &self,
        scene: &Scene,
        mut choice: LightChoice,
        median: f64,
        reason: String,
        metering: Metering,
    ) -> ResolvedLight {
        let stops = -median.log2();
        if choice.added == AddedLight::None
            && stops.is_finite()
            && stops.abs() > STORED_STOPS
            && scene.lighting.sky.map.is_none()
        {
            choice = choice.with_own(stops.round() as i32);
        }
        let factor = (choice.own_stops as f32).exp2();
        let metering = match choice.added {
            // It stands for light between surfaces.
            AddedLight::Interior(_) => Metering { indirect: false, ..metering },
            AddedLight::None | AddedLight::Sky => metering,
        };
        let metered = self.exposed(&scene.lighting_in(choice), factor, metering);
        ResolvedLight { choice, reason, metered }
    }

    /// Luminance of the light of a lighting that reaches each point directly; `emits`: of emitting surfaces, too.
    fn direct(&self, lighting: &Lighting, emits: bool, effects: LightEffects) -> Vec<f64> {
        let effects = LightEffects { emitters: emits && effects.emitters, ..effects };
        let light = self.light(lighting, 1.0, Metering { effects, indirect: false });
        let own = if emits { 1.0 } else { 0.0 };
        let at = |(index, point): (usize, &VisiblePoint)| {
            // What shines needs no light.
            luminance(light.arriving(point, index as u32).as_dvec3() + point.emissive.as_dvec3() * own)
        };
        self.points.par_iter().enumerate().map(at).collect()
    }

    /// Light for an exposure, where emission is `factor` times the scene's.
    fn exposed(&self, lighting: &Lighting, factor: f32, metering: Metering) -> Option<f64> {
        let light = self.light(lighting, factor, metering);
        let at = |(index, point): (usize, &VisiblePoint)| {
            let arriving = light.arriving(point, index as u32);
            let emissive = point.emissive * factor;
            MeteredPoint {
                light: luminance(arriving.as_dvec3()),
                radiance: arriving * point.base + emissive,
                emits: emissive != Vec3::ZERO,
            }
        };
        let points: Vec<MeteredPoint> = self.points.par_iter().enumerate().map(at).collect();
        metered(&points)
    }

    fn light<'a>(&'a self, lighting: &Lighting, factor: f32, metering: Metering) -> Light<'a> {
        let scene = self.surfaces.scene();
        let mut all = match metering.effects.emitters {
            true => emitters(scene, &scene.at(0.0).instances, self.surfaces.textures()),
            false => Vec::new(),
        };
        all.iter_mut().for_each(|emitter| emitter.radiance *= factor);
        Light {
            about: self.rays.about(self.center),
            surfaces: &self.surfaces,
            center: self.center,
            lighting: lighting.clone(),
            metering,
            emitters: EmittersByPower::new(all),
        }
    }

    /// The distance that most rays from visible surfaces travel, metres.
    fn room_size(&self) -> f64 {
        let about = self.rays.about(self.center);
        let far = self.size as f32;
        let each = |(index, point): (usize, &VisiblePoint)| -> Vec<f32> {
            let ways = arriving::directions(point, index as u32, 8);
            let most =
                |way: Vec3| about.nearest(point.start, way, f32::MAX).map_or(far, |hit| hit.t.min(far));
            ways.map(most).collect()
        };
        let mut distances: Vec<f32> = self.points.par_iter().enumerate().flat_map_iter(each).collect();
        distances.sort_by(f32::total_cmp);
        distances.get(distances.len() * 3 / 4).map_or(1.0, |distance| f64::from(*distance))
    }
}

/// The share of points that light reaches, and the median of those that get any; 0 if none does.
fn reached(light: &[f64]) -> (f64, f64) {
    let mut lit: Vec<f64> = light.iter().copied().filter(|light| *light > 0.0 && light.is_finite()).collect();
    lit.sort_by(f64::total_cmp);
    let Some(&median) = lit.get(lit.len() / 2) else { return (0.0, 0.0) };
    let enough = light.iter().filter(|light| **light >= LEAST_LIGHT * median).count();
    (enough as f64 / light.len() as f64, median)
}

/// Stops by which own light is weakened beside light that is added: none, or so many that it is about as strong where it is
/// strong.
fn weakened(own: &[f64], added: &[f64]) -> i32 {
    let mut own: Vec<f64> = own.iter().copied().filter(|light| light.is_finite()).collect();
    own.sort_by(f64::total_cmp);
    let strong = own.get(own.len() * 19 / 20).copied().unwrap_or(0.0);
    let excess = strong / (MOST_OWN * reached(added).1);
    if excess > 1.0 && excess.is_finite() { -(excess.log2().ceil() as i32) } else { 0 }
}

fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests;
