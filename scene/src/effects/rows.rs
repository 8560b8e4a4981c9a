//! The rows of a plan: causes, bounds and decisions.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::lights::{
    OPEN_SKY, brightest, caster, contrast, distance_of_boxes, half_angle, irradiance, lost_to_itself,
};
use super::request::{EffectCosts, EffectRequest, Effects, ReflectionRequest};
use super::row::{Causes, EffectKind, EffectRow, Paid, bytes};
use super::surfaces::{Body, bodies};
use crate::transparency::transparent_meshes;
use crate::{
    AlphaMode, CellSettings, Indirect, Light, LightEffects, Material, ReflectionCost, Reflections, Scene,
};

/// Bytes below which `auto` leaves an effect out.
const LEAST_BYTES: f64 = 0.5;
/// Largest value of the environment's BRDF in [`crate::shading`], for reflectances up to 1.
const ENVIRONMENT: f32 = 1.05;

/// All rows for a scene.
pub(super) fn rows(scene: &Scene, request: &EffectRequest, costs: Option<&EffectCosts>) -> Vec<EffectRow> {
    let facts = Facts::of(scene);
    let exposure = request.exposure.unwrap_or(scene.lighting.exposure);
    let request = &Settled {
        effects: request.effects,
        indirect: facts.method(request, exposure),
        reflections: match (request.reflections, request.effects) {
            (ReflectionRequest::Auto(_), Effects::None | Effects::List(_)) => None,
            (reflections, _) => reflections.settled(scene),
        },
        exposure,
    };
    let mut rows: Vec<EffectRow> =
        EffectKind::ALL.into_iter().map(|effect| facts.row(effect, request, costs)).collect();
    let has_shadows = rows.iter().any(|row| row.effect == EffectKind::Shadows && row.on);
    for row in rows.iter_mut().filter(|row| row.effect == EffectKind::SoftShadows && row.on && !has_shadows) {
        (row.on, row.why) = (false, "shadows are off".to_owned());
    }
    rows
}

/// A request without open choices.
struct Settled {
    effects: Effects,
    indirect: Indirect,
    reflections: Option<(Reflections, ReflectionCost)>,
    exposure: f32,
}

/// What is known of a scene without rendering it.
struct Facts<'a> {
    scene: &'a Scene,
    bodies: Vec<Body>,
    moves: bool,
    /// For each light, an instance that may cast a shadow.
    casters: Vec<Option<u32>>,
    /// Whether something may block the sky.
    is_occluded: bool,
    /// Largest albedo, emission, irradiance of all lights together, and radiance of the sky.
    albedo: Vec3,
    emission: Vec3,
    irradiance: Vec3,
    sky: Vec3,
}

/// Cause and bound of an effect. `bound` is before exposure.
struct Found {
    causes: Causes,
    bound: Vec3,
    /// The cause, or its absence, in words.
    because: String,
}

impl<'a> Facts<'a> {
    fn of(scene: &'a Scene) -> Self {
        let bodies = bodies(scene);
        let moves = scene.is_animated();
        let lights = &scene.lighting.lights;
        let most = |of: &dyn Fn(&Body) -> Vec3| bodies.iter().map(of).fold(Vec3::ZERO, Vec3::max);
        let irradiance =
            lights.iter().map(|light| most(&|body| irradiance(light, &body.bounds, moves))).sum();
        Self {
            scene,
            moves,
            casters: lights.iter().map(|light| caster(light, &bodies, moves)).collect(),
            is_occluded: bodies.len() > 1 || bodies.iter().any(|body| !body.is_convex),
            albedo: most(&|body| body.albedo),
            emission: most(&|body| body.emission),
            irradiance,
            sky: brightest(&scene.lighting.sky),
            bodies,
        }
    }

    fn row(&self, effect: EffectKind, request: &Settled, costs: Option<&EffectCosts>) -> EffectRow {
        let found = self.found(effect, request);
        let bound = displayed(&found, request.exposure);
        let (on, why) = decision(effect, request, &found, bound);
        let each = effect.lights_of(self.scene);
        let measured = costs.and_then(|costs| costs.ms.get(&effect)).copied();
        let ms = match (effect, request.reflections) {
            (EffectKind::Reflection, Some((_, cost))) if on => measured.or(Some(cost.ms)),
            _ => measured,
        };
        EffectRow {
            effect,
            causes: found.causes,
            paid: paid(effect).to_vec(),
            predicted_ms: ms.map(|ms| ms * each as f64),
            bound,
            on,
            why,
            measured_ms: None,
            saved_ms: None,
        }
    }

    /// The method of indirect light. Moving scenes have none unless it is asked for: every pose would trace its links anew.
    fn method(&self, request: &EffectRequest, exposure: f32) -> Indirect {
        let cells = Indirect::Cells(CellSettings::default());
        let found = self.indirect();
        match (request.indirect, request.effects) {
            (Some(indirect), _) => indirect,
            (None, Effects::All) => cells,
            (None, Effects::Auto) if self.moves || found.causes.is_empty() => Indirect::Off,
            (None, Effects::Auto) if self.scene.lighting.sky.reach.is_some() => Indirect::Off,
            (None, Effects::Auto) if bytes(displayed(&found, exposure)) >= LEAST_BYTES => cells,
            (None, _) => Indirect::Off,
        }
    }

    fn found(&self, effect: EffectKind, request: &Settled) -> Found {
        match effect {
            EffectKind::Sun => self.lights("directional", |light| matches!(light, Light::Directional { .. })),
            EffectKind::PointLights => self.lights("point", |light| matches!(light, Light::Point { .. })),
            EffectKind::SpotLights => self.lights("spot", |light| matches!(light, Light::Spot { .. })),
            EffectKind::Shadows => self.shadows(|_| true, "light"),
            EffectKind::SoftShadows => self.shadows(Light::is_extended, "light with an extent"),
            EffectKind::Emitters => self.emitters(),
            EffectKind::SkyVisibility => self.sky_visibility(),
            EffectKind::Highlights => self.highlights(),
            EffectKind::Reflection => self.reflection(request),
            EffectKind::Transmission => self.transmission(),
            EffectKind::Indirect => self.indirect(),
            EffectKind::Glow => self.of_materials("emit", self.emission, |_, body| body.emits()),
            EffectKind::Particles => self.particles(request),
            EffectKind::CutOuts => self.of_materials("are cut out by alpha", Vec3::ONE, |material, _| {
                matches!(material.alpha, AlphaMode::Mask(_))
            }),
            EffectKind::Transparency => self.transparency(),
            EffectKind::Animation => self.animation(),
        }
    }

    /// The largest sum over lights, of all bodies.
    fn largest(&self, of: impl Fn(&Body, usize, &Light) -> Vec3) -> Vec3 {
        let sum = |body: &Body| {
            let lights = self.scene.lighting.lights.iter().enumerate();
            lights.map(|(index, light)| of(body, index, light)).sum::<Vec3>()
        };
        self.bodies.iter().map(sum).fold(Vec3::ZERO, Vec3::max)
    }

    fn diffuse(&self, body: &Body, light: &Light) -> Vec3 {
        body.albedo * irradiance(light, &body.bounds, self.moves) * FRAC_1_PI
    }

    fn highlight(&self, body: &Body, light: &Light) -> Vec3 {
        let Some(gloss) = body.gloss else { return Vec3::ZERO };
        let peak = gloss.most * 0.5 * FRAC_1_PI / gloss.alpha.powi(3);
        irradiance(light, &body.bounds, self.moves) * peak
    }

    fn indices(&self, of: impl Fn(usize, &Light) -> bool) -> Vec<u32> {
        let lights = self.scene.lighting.lights.iter().enumerate();
        listed(lights.filter(|(index, light)| of(*index, light)).map(|(index, _)| index as u32))
    }

    fn lights(&self, kind: &str, of: impl Fn(&Light) -> bool) -> Found {
        let bound = self.largest(|body, _, light| match of(light) {
            true => self.diffuse(body, light),
            false => Vec3::ZERO,
        });
        let count = self.scene.lighting.lights.iter().filter(|light| of(light)).count();
        Found {
            causes: Causes { lights: self.indices(|_, light| of(light)), ..Causes::default() },
            bound,
            because: counted(count, &format!("{kind} light")),
        }
    }

    fn shadows(&self, of: impl Fn(&Light) -> bool, name: &str) -> Found {
        let bound = self.largest(|body, index, light| {
            if !of(light) {
                return Vec3::ZERO;
            }
            let share = match self.casters[index] {
                Some(_) => 1.0,
                None => lost_to_itself(body, half_angle(light, &body.bounds, self.moves)),
            };
            (self.diffuse(body, light) + self.highlight(body, light)) * share as f32
        });
        let some = self.scene.lighting.lights.iter().any(&of);
        let casts = |index: usize, light: &Light| of(light) && self.casters[index].is_some();
        let lights = self.indices(casts);
        let instances = lights.iter().filter_map(|&light| self.casters[light as usize]);
        let because = match (some, lights.len()) {
            (false, _) => format!("no {name}"),
            (true, 0) => "nothing stands between a light and what it lights".to_owned(),
            (true, count) => format!("{} may be blocked", counted(count, name)),
        };
        Found { causes: Causes { instances: listed(instances), lights, ..Causes::default() }, bound, because }
    }

    fn emitters(&self) -> Found {
        let lit_by = |body: &Body, emitter: &Body| {
            // Irradiance / π, at most as if the emitter filled the hemisphere.
            let near = match body.instance == emitter.instance {
                true if body.is_convex => body.bend.sin(),
                true => 1.0,
                false => {
                    let d = distance_of_boxes(&body.bounds, &emitter.bounds);
                    (emitter.area / (std::f64::consts::PI * d * d)).min(1.0)
                }
            };
            emitter.emission * if near.is_finite() { near as f32 } else { 1.0 }
        };
        let emitters: Vec<&Body> =
            self.bodies.iter().filter(|body| body.emits() && body.area > 0.0).collect();
        let of = |body: &Body| {
            let sum: Vec3 = emitters.iter().map(|emitter| lit_by(body, emitter)).sum();
            body.albedo * sum.min(self.emission)
        };
        let bound = self.bodies.iter().map(of).fold(Vec3::ZERO, Vec3::max);
        let lights_any = |emitter: &&&Body| {
            self.bodies.iter().any(|body| {
                (body.instance != emitter.instance || !body.is_convex) && body.albedo.max_element() > 0.0
            })
        };
        let materials = listed(emitters.iter().filter(lights_any).map(|emitter| emitter.material));
        let because = match (emitters.len(), materials.len()) {
            (0, _) => "nothing emits".to_owned(),
            (_, 0) => "what emits has nothing to light".to_owned(),
            (_, count) => format!("{} emit", counted(count, "material")),
        };
        Found { causes: Causes { materials, ..Causes::default() }, bound, because }
    }

    fn sky_visibility(&self) -> Found {
        let contrast = contrast(&self.scene.lighting.sky);
        let of = |body: &Body| {
            let diffuse = match self.is_occluded {
                true => self.sky,
                // A surface's own triangle blocks what lies below it, though its shading normal faces it.
                false => contrast * OPEN_SKY + self.sky * (0.5 - 0.5 * body.bend.cos() as f32),
            };
            let reflected = body.gloss.map_or(0.0, |gloss| ENVIRONMENT * gloss.most);
            body.albedo * diffuse + self.sky * reflected
        };
        let bound = self.bodies.iter().map(of).fold(Vec3::ZERO, Vec3::max);
        let is_black = self.sky.max_element() == 0.0;
        let reflects = self.bodies.iter().any(Body::reflects);
        let has_cause = !is_black && self.is_occluded && reflects;
        let because = match (is_black, self.is_occluded) {
            (true, _) => "the sky is black",
            (_, false) => "nothing blocks the sky",
            (_, true) if !reflects => "nothing reflects the sky",
            (_, true) => "the sky may be blocked",
        };
        Found {
            causes: Causes { sky: has_cause, ..Causes::default() },
            bound: if is_black { Vec3::ZERO } else { bound },
            because: because.to_owned(),
        }
    }

    fn highlights(&self) -> Found {
        let bound = self.largest(|body, _, light| self.highlight(body, light));
        let glossy = self.of_materials("are glossy", bound, |_, body| body.gloss.is_some());
        if glossy.causes.is_empty() {
            return glossy;
        }
        let lights = self.indices(|_, _| true);
        match lights.is_empty() {
            true => Found { causes: Causes::default(), because: "no light to reflect".to_owned(), ..glossy },
            false => Found { causes: Causes { lights, ..glossy.causes }, ..glossy },
        }
    }

    /// Largest radiance of sky and surfaces, with all bounces of light.
    fn radiance(&self) -> Vec3 {
        bounced(self.emission + self.albedo * (self.irradiance * FRAC_1_PI + self.sky), self.albedo)
            .max(self.sky)
    }

    fn reflection(&self, request: &Settled) -> Found {
        let most = request.reflections.map_or(Reflections::default(), |(settings, _)| settings).most;
        let reflectors = self.scene.reflectors(most);
        let peak =
            self.bodies.iter().filter_map(|body| body.gloss).map(|gloss| gloss.most).fold(0.0, f32::max);
        let because = match reflectors.len() {
            0 => "nothing is smooth".to_owned(),
            count => counted(count, "reflector"),
        };
        let bound = if reflectors.is_empty() { Vec3::ZERO } else { self.radiance() * (ENVIRONMENT * peak) };
        Found {
            causes: Causes { instances: listed(reflectors.into_iter()), ..Causes::default() },
            bound,
            because,
        }
    }

    fn transmission(&self) -> Found {
        let share = self.bodies.iter().map(|body| body.transmission).fold(0.0, f32::max);
        let bound = if share > 0.0 { self.radiance() * share } else { Vec3::ZERO };
        self.of_materials("let light through", bound, |_, body| body.transmission > 0.0)
    }

    fn transparency(&self) -> Found {
        let meshes = transparent_meshes(self.scene);
        let is_transparent = |body: &Body| meshes[self.scene.instances[body.instance as usize].mesh as usize];
        self.of_materials("are transparent by alpha", Vec3::ONE, |_, body| is_transparent(body))
    }

    fn indirect(&self) -> Found {
        let source = self.emission + self.albedo * (self.irradiance * FRAC_1_PI + self.sky);
        let bound = self.albedo * bounced(source, self.albedo);
        // A single convex surface sends no light to itself.
        let has_cause = source.max_element() > 0.0 && self.is_occluded && self.albedo.max_element() > 0.0;
        let lights = if has_cause { self.indices(|_, _| true) } else { Vec::new() };
        let materials = self.bodies.iter().filter(|body| has_cause && body.emits()).map(|body| body.material);
        Found {
            causes: Causes { lights, materials: listed(materials), ..Causes::default() },
            bound,
            because: match has_cause {
                true => "lit surfaces face one another",
                false => "no lit surface faces another",
            }
            .to_owned(),
        }
    }

    fn particles(&self, request: &Settled) -> Found {
        // Their power is the square of the diagonal, and 1.7 times that in a channel: see `particles::glowing`.
        let (count, clamp) = match request.indirect {
            Indirect::Vpl(settings) => (settings.particles, settings.clamp as f32),
            _ => (0, 0.0),
        };
        let bound = match count {
            0 => Vec3::ZERO,
            _ => self.albedo * (1.7 * FRAC_1_PI * FRAC_1_PI / (clamp * clamp)),
        };
        let because =
            if count == 0 { "no particles".to_owned() } else { counted(count as usize, "particle") };
        Found { causes: Causes::default(), bound, because }
    }

    fn animation(&self) -> Found {
        let channels = self.scene.animations.iter().flat_map(|animation| &animation.channels);
        let nodes = listed(channels.filter(|_| self.moves).map(|channel| channel.node));
        Found {
            causes: Causes { nodes, ..Causes::default() },
            bound: if self.moves { Vec3::ONE } else { Vec3::ZERO },
            because: if self.moves { "nodes move" } else { "nothing moves" }.to_owned(),
        }
    }

    /// An effect of some materials. Its bound is 0 if none of them is used.
    fn of_materials(&self, verb: &str, bound: Vec3, of: impl Fn(&Material, &Body) -> bool) -> Found {
        let used = self.bodies.iter().filter(|body| of(&self.scene.materials[body.material as usize], body));
        let materials = listed(used.map(|body| body.material));
        let because = match materials.len() {
            0 => format!("no materials {verb}"),
            count => format!("{} {verb}", counted(count, "material")),
        };
        let bound = if materials.is_empty() { Vec3::ZERO } else { bound };
        Found { causes: Causes { materials, ..Causes::default() }, bound, because }
    }
}

/// A bound in display-linear values, at most 1.
fn displayed(found: &Found, exposure: f32) -> f64 {
    let bound = f64::from((found.bound * exposure).max_element());
    // NaN and what is too large are 1.
    if bound < 1.0 { bound.max(0.0) } else { 1.0 }
}

/// Radiance after all reflections, if every surface has this albedo.
fn bounced(source: Vec3, albedo: Vec3) -> Vec3 {
    let channel = |source: f32, albedo: f32| match (source > 0.0, albedo < 1.0) {
        (false, _) => 0.0,
        (true, true) => source / (1.0 - albedo),
        (true, false) => f32::MAX,
    };
    Vec3::new(channel(source.x, albedo.x), channel(source.y, albedo.y), channel(source.z, albedo.z))
}

/// Ascending, each once, and at most as many as a row names.
fn listed(indices: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut all: Vec<u32> = indices.collect();
    all.sort_unstable();
    all.dedup();
    all.truncate(Causes::MOST);
    all
}

/// "3 lights", "1 light" or "no light".
fn counted(count: usize, name: &str) -> String {
    match count {
        0 => format!("no {name}"),
        1 => format!("1 {name}"),
        count => match name.split_once(' ') {
            // "lights with an extent".
            Some((noun, rest)) if rest.starts_with("with") => format!("{count} {noun}s {rest}"),
            _ => format!("{count} {name}s"),
        },
    }
}

fn paid(effect: EffectKind) -> &'static [Paid] {
    match effect {
        EffectKind::Highlights => &[Paid::View],
        EffectKind::Reflection | EffectKind::Transmission => &[Paid::Epoch, Paid::View],
        EffectKind::Indirect => &[Paid::Pose, Paid::Sample],
        EffectKind::Animation => &[Paid::Epoch],
        _ => &[Paid::Sample],
    }
}

/// Whether an effect is on, and why.
fn decision(effect: EffectKind, request: &Settled, found: &Found, bound: f64) -> (bool, String) {
    let because = &found.because;
    match effect {
        EffectKind::Shadows | EffectKind::SoftShadows | EffectKind::Emitters | EffectKind::SkyVisibility => {
            switched(effect, request, found, bound)
        }
        EffectKind::Reflection | EffectKind::Transmission => {
            match (found.causes.is_empty(), request.reflections) {
                (true, _) => (false, because.clone()),
                (false, None) => (false, format!("{because}, but reflections are off")),
                (false, Some((settings, cost))) => {
                    (true, format!("{because}, by {}: {cost}", settings.source.name()))
                }
            }
        }
        EffectKind::Indirect => {
            let is_on = match request.indirect {
                Indirect::Off => false,
                Indirect::Vpl(settings) => settings.vpls > 0,
                Indirect::Points(_) | Indirect::Paths(_) | Indirect::Cells(_) => true,
            };
            match (found.causes.is_empty(), is_on) {
                (_, false) => (false, format!("{because}, but indirect light is off")),
                (true, true) => (false, because.clone()),
                (false, true) => (true, format!("{because}: {}", request.indirect)),
            }
        }
        EffectKind::Particles => (bound > 0.0, because.clone()),
        _ => (!found.causes.is_empty(), because.clone()),
    }
}

/// The decision on an effect that a request can switch.
fn switched(effect: EffectKind, request: &Settled, found: &Found, bound: f64) -> (bool, String) {
    let because = &found.because;
    // Whether the method of indirect light leaves a choice.
    if named(effect, request.indirect.effects_with(LightEffects::NONE)) {
        return (true, format!("indirect light by paths needs it; {because}"));
    }
    if !named(effect, request.indirect.effects_with(LightEffects::ALL)) {
        return (false, "indirect light counts emission".to_owned());
    }
    match request.effects {
        Effects::All => (true, format!("all effects were asked for; {because}")),
        Effects::None => (false, format!("no effect was asked for; {because}")),
        Effects::List(effects) if named(effect, effects) => (true, format!("it was asked for; {because}")),
        Effects::List(_) => (false, format!("it was not asked for; {because}")),
        Effects::Auto if found.causes.is_empty() => (false, because.clone()),
        Effects::Auto if bytes(bound) < LEAST_BYTES => {
            (false, format!("{because}, but no pixel changes by half a byte"))
        }
        Effects::Auto => (true, because.clone()),
    }
}

fn named(effect: EffectKind, effects: LightEffects) -> bool {
    match effect {
        EffectKind::Shadows => effects.shadows,
        EffectKind::SoftShadows => effects.soft_shadows,
        EffectKind::Emitters => effects.emitters,
        EffectKind::SkyVisibility => effects.sky_visibility,
        _ => false,
    }
}
