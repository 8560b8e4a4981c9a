//! Conversions of lights, rigs and sample sets.

use argus_scene::{
    Bounds, CellSettings, Indirect, InvalidField, Light, LightEffects, Lighting, MapSource, ProbeEye,
    ProbeSource, ReflectionProbeSet, Reflections, Rig, SampleSetInfo, Sampling, SceneState, Sky,
    Specification, Stage, Version, Visibility, VplSettings,
};
use glam::DVec3;

use super::enums::{WireEnum, light_level};
use super::{duration_ms, finite, point, required, rgb, scene_hash, scene_hash_bytes};
use crate::v1;

impl From<&Light> for v1::Light {
    fn from(light: &Light) -> Self {
        use v1::light::Kind;
        let kind = match *light {
            Light::Directional { direction, irradiance, angular_radius } => {
                Kind::Directional(v1::DirectionalLight {
                    direction: Some(direction.into()),
                    irradiance: Some(irradiance.into()),
                    angular_radius,
                })
            }
            Light::Point { position, intensity, range, radius } => Kind::Point(v1::PointLight {
                position: Some(position.into()),
                intensity: Some(intensity.into()),
                range,
                radius,
            }),
            Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, radius } => {
                Kind::Spot(v1::SpotLight {
                    position: Some(position.into()),
                    direction: Some(direction.into()),
                    intensity: Some(intensity.into()),
                    range,
                    inner_cone,
                    outer_cone,
                    radius,
                })
            }
        };
        Self { kind: Some(kind) }
    }
}

impl TryFrom<v1::Light> for Light {
    type Error = InvalidField;

    fn try_from(wire: v1::Light) -> Result<Self, InvalidField> {
        use v1::light::Kind;
        Ok(match required(wire.kind, "lights.kind")? {
            Kind::Directional(light) => Self::Directional {
                direction: unit(light.direction, "lights.directional.direction")?,
                irradiance: rgb(light.irradiance, "lights.directional.irradiance")?,
                angular_radius: InvalidField::within(
                    "lights.directional.angular_radius",
                    light.angular_radius,
                    0.0..=1.57,
                )?,
            },
            Kind::Point(light) => Self::Point {
                position: point(light.position, "lights.point.position")?,
                intensity: rgb(light.intensity, "lights.point.intensity")?,
                range: cut_off(light.range, "lights.point.range")?,
                radius: InvalidField::within("lights.point.radius", light.radius, 0.0..=f64::MAX)?,
            },
            Kind::Spot(light) => {
                let (inner_cone, outer_cone) = (light.inner_cone, light.outer_cone);
                // Written so that NaN is refused.
                if !(inner_cone >= 0.0 && inner_cone < outer_cone && outer_cone.is_finite()) {
                    let reason = format!("must be above inner_cone {inner_cone}, not {outer_cone}");
                    return Err(InvalidField::new("lights.spot.outer_cone", reason));
                }
                Self::Spot {
                    position: point(light.position, "lights.spot.position")?,
                    direction: unit(light.direction, "lights.spot.direction")?,
                    intensity: rgb(light.intensity, "lights.spot.intensity")?,
                    range: cut_off(light.range, "lights.spot.range")?,
                    inner_cone,
                    outer_cone,
                    radius: InvalidField::within("lights.spot.radius", light.radius, 0.0..=f64::MAX)?,
                }
            }
        })
    }
}

fn unit(value: Option<v1::Vec3>, field: &'static str) -> Result<DVec3, InvalidField> {
    let v = point(value, field)?;
    // Loaders normalise in f32.
    if (v.length() - 1.0).abs() < 1e-3 {
        Ok(v)
    } else {
        Err(InvalidField::new(field, format!("must be a unit vector, not {v}")))
    }
}

fn cut_off(range: Option<f64>, field: &'static str) -> Result<Option<f64>, InvalidField> {
    range.map(|range| InvalidField::positive(field, range)).transpose()
}

impl From<&Lighting> for v1::Lighting {
    fn from(lighting: &Lighting) -> Self {
        // A map and a reach are parts of the scene, which the receiver has.
        let Sky { zenith, horizon, ground, map: _, reach: _ } = lighting.sky;
        let sky = v1::Sky {
            zenith: Some(zenith.into()),
            horizon: Some(horizon.into()),
            ground: Some(ground.into()),
        };
        Self {
            lights: lighting.lights.iter().map(Into::into).collect(),
            sky: Some(sky),
            exposure: lighting.exposure,
        }
    }
}

impl TryFrom<v1::Lighting> for Lighting {
    type Error = InvalidField;

    fn try_from(wire: v1::Lighting) -> Result<Self, InvalidField> {
        let sky = required(wire.sky, "lighting.sky")?;
        Ok(Self {
            lights: wire.lights.into_iter().map(TryInto::try_into).collect::<Result<_, _>>()?,
            sky: Sky {
                zenith: rgb(sky.zenith, "lighting.sky.zenith")?,
                horizon: rgb(sky.horizon, "lighting.sky.horizon")?,
                ground: rgb(sky.ground, "lighting.sky.ground")?,
                map: None,
                reach: None,
            },
            exposure: InvalidField::positive("lighting.exposure", wire.exposure)?,
        })
    }
}

impl From<&Rig> for v1::Rig {
    fn from(rig: &Rig) -> Self {
        use v1::rig::Kind;
        let kind = match *rig {
            Rig::TileCorners { bounds, tiles, height, size } => Kind::TileCorners(v1::TileCornersRig {
                bounds: Some(bounds.into()),
                tiles_x: tiles[0],
                tiles_z: tiles[1],
                height,
                width_px: size[0],
                height_px: size[1],
            }),
            Rig::Cell { origin, spacing, face } => {
                Kind::Cell(v1::CellRig { origin: Some(origin.into()), spacing, face })
            }
        };
        Self { kind: Some(kind) }
    }
}

impl TryFrom<v1::Rig> for Rig {
    type Error = InvalidField;

    /// The rig, validated.
    fn try_from(wire: v1::Rig) -> Result<Self, InvalidField> {
        use v1::rig::Kind;
        let rig = match required(wire.kind, "rig.kind")? {
            Kind::TileCorners(rig) => Self::TileCorners {
                bounds: required(rig.bounds, "rig.bounds")?.try_into()?,
                tiles: [rig.tiles_x, rig.tiles_z],
                height: finite(rig.height, "rig.height")?,
                size: [rig.width_px, rig.height_px],
            },
            Kind::Cell(rig) => Self::Cell {
                origin: point(rig.origin, "rig.origin")?,
                spacing: finite(rig.spacing, "rig.spacing")?,
                face: rig.face,
            },
        };
        rig.validate()?;
        Ok(rig)
    }
}

impl From<&SampleSetInfo> for v1::SampleSetInfo {
    fn from(info: &SampleSetInfo) -> Self {
        Self {
            scene_hash: scene_hash_bytes(info.scene),
            bounds: Some(info.bounds.into()),
            extent: Some(info.extent.into()),
            rig: Some((&info.rig).into()),
            version: Some(info.version.into()),
            epoch_secs: info.epoch_secs,
            lighting: Some((&info.lighting).into()),
            specification: Some((&info.specification()).into()),
        }
    }
}

impl TryFrom<v1::SampleSetInfo> for SampleSetInfo {
    type Error = InvalidField;

    fn try_from(wire: v1::SampleSetInfo) -> Result<Self, InvalidField> {
        let rig: Rig = required(wire.rig, "set.rig")?.try_into()?;
        let lighting: Lighting = required(wire.lighting, "set.lighting")?.try_into()?;
        let specification: Specification = required(wire.specification, "set.specification")?.try_into()?;
        let Specification { visibility, sampling, sub_samples, effects, indirect, reflections, exposure } =
            specification;
        sampling.validate(&rig)?;
        if exposure != lighting.exposure {
            let reason = format!("must be the lighting's {}, not {exposure}", lighting.exposure);
            return Err(InvalidField::new("set.specification.exposure", reason));
        }
        Ok(Self {
            scene: scene_hash(&wire.scene_hash, "set.scene_hash")?,
            bounds: required::<v1::Bounds>(wire.bounds, "set.bounds").and_then(Bounds::try_from)?,
            extent: required::<v1::Bounds>(wire.extent, "set.extent").and_then(Bounds::try_from)?,
            rig,
            version: required(wire.version, "set.version")?.try_into()?,
            epoch_secs: epoch_secs(wire.epoch_secs, "set.epoch_secs")?,
            lighting,
            visibility,
            sampling,
            sub_samples,
            effects,
            indirect,
            reflections,
        })
    }
}

impl From<&Specification> for v1::Specification {
    fn from(specification: &Specification) -> Self {
        Self {
            visibility: specification.visibility.number(),
            sampling: sampling_to_wire(specification.sampling),
            sub_samples: specification.sub_samples,
            light_effects: specification.effects.bits(),
            indirect: indirect_to_wire(specification.indirect),
            reflections: specification.reflections.map(Into::into),
            exposure: specification.exposure,
        }
    }
}

impl TryFrom<v1::Specification> for Specification {
    type Error = InvalidField;

    /// The specification, validated.
    fn try_from(wire: v1::Specification) -> Result<Self, InvalidField> {
        let specification = Self {
            visibility: Visibility::from_number(wire.visibility, "specification.visibility")?,
            sampling: sampling(wire.sampling),
            sub_samples: wire.sub_samples,
            effects: LightEffects::from_bits(wire.light_effects)?,
            indirect: indirect(wire.indirect)?,
            reflections: wire.reflections.map(ReflectionProbeSet::try_from).transpose()?,
            exposure: wire.exposure,
        };
        specification.validate()?;
        Ok(specification)
    }
}

impl From<ReflectionProbeSet> for v1::ReflectionProbes {
    fn from(ReflectionProbeSet { settings, count, eye }: ReflectionProbeSet) -> Self {
        let (levels, budget, rays) = match settings.source {
            ProbeSource::Octree { levels } => (levels, None, false),
            ProbeSource::Points { budget } => (0, Some(budget), false),
            ProbeSource::Rays => (0, None, true),
        };
        let points = budget.map(|budget| v1::ProbePoints {
            budget,
            viewpoints: eye.map(|eye| eye.viewpoints.into()),
            pixels: eye.map_or(0.0, |eye| eye.pixels),
        });
        Self { side: settings.side, levels, most: settings.most, count, points, rays }
    }
}

impl TryFrom<v1::ReflectionProbes> for ReflectionProbeSet {
    type Error = InvalidField;

    /// The probes, validated.
    fn try_from(wire: v1::ReflectionProbes) -> Result<Self, InvalidField> {
        let v1::ReflectionProbes { side, levels, most, count, points, rays } = wire;
        let (source, eye) = match points {
            _ if levels != 0 && (rays || points.is_some()) => {
                return Err(InvalidField::new("reflections.levels", "must be 0 with points or rays"));
            }
            Some(_) if rays => {
                return Err(InvalidField::new("reflections.points", "must not be given with rays"));
            }
            None if rays => (ProbeSource::Rays, None),
            None => (ProbeSource::Octree { levels }, None),
            Some(v1::ProbePoints { budget, viewpoints, pixels }) => {
                let viewpoints = required(viewpoints, "reflections.viewpoints")?.try_into()?;
                (ProbeSource::Points { budget }, Some(ProbeEye { viewpoints, pixels }))
            }
        };
        let probes = Self { settings: Reflections { side, most, source }, count, eye };
        probes.validate()?;
        Ok(probes)
    }
}

fn indirect_to_wire(indirect: Indirect) -> Option<v1::specification::Indirect> {
    Some(match indirect {
        Indirect::Off => return None,
        Indirect::Vpl(settings) => v1::specification::Indirect::Vpl(v1::VplIndirect {
            vpls: settings.vpls,
            particles: settings.particles,
            bounces: settings.bounces,
            map_side: settings.map_side,
            maps: settings.maps.number(),
            points: settings.points,
            levels: settings.levels,
            samples: settings.samples,
            filter: settings.filter,
            cull: settings.cull,
            weigh: settings.weigh,
            groups: settings.groups,
            cutoff: settings.cutoff,
            clamp: settings.clamp,
            bias: settings.bias,
            seed: settings.seed,
        }),
        Indirect::Points(points) => v1::specification::Indirect::Points(points.into()),
        Indirect::Paths(paths) => v1::specification::Indirect::Paths(paths.into()),
        Indirect::Cells(CellSettings { paths, pixels, rays }) => {
            let paths = Some(paths.into());
            v1::specification::Indirect::Cells(v1::CellIndirect { paths, pixels, rays })
        }
    })
}

fn indirect(wire: Option<v1::specification::Indirect>) -> Result<Indirect, InvalidField> {
    Ok(match wire {
        None => Indirect::Off,
        Some(v1::specification::Indirect::Vpl(wire)) => Indirect::Vpl(VplSettings {
            vpls: wire.vpls,
            particles: wire.particles,
            bounces: wire.bounces,
            map_side: wire.map_side,
            maps: MapSource::from_number(wire.maps, "specification.indirect.maps")?,
            points: wire.points,
            levels: wire.levels,
            samples: wire.samples,
            filter: wire.filter,
            cull: wire.cull,
            weigh: wire.weigh,
            groups: wire.groups,
            cutoff: wire.cutoff,
            clamp: wire.clamp,
            bias: wire.bias,
            seed: wire.seed,
        }),
        Some(v1::specification::Indirect::Points(points)) => Indirect::Points(points.into()),
        Some(v1::specification::Indirect::Paths(paths)) => Indirect::Paths(paths.into()),
        Some(v1::specification::Indirect::Cells(v1::CellIndirect { paths, pixels, rays })) => {
            let paths = required(paths, "indirect.paths")?.into();
            Indirect::Cells(CellSettings { paths, pixels, rays })
        }
    })
}

fn sampling_to_wire(sampling: Sampling) -> Option<v1::specification::Sampling> {
    let Sampling::MegaViews(maps) = sampling else { return None };
    Some(v1::specification::Sampling::MegaViews(maps.into()))
}

fn sampling(wire: Option<v1::specification::Sampling>) -> Sampling {
    match wire {
        None => Sampling::Triangles,
        Some(v1::specification::Sampling::MegaViews(maps)) => Sampling::MegaViews(maps.into()),
    }
}

/// Seconds of an epoch.
pub(super) fn epoch_secs(secs: f64, field: &'static str) -> Result<f64, InvalidField> {
    InvalidField::within(field, secs, 0.0..=86400.0)
}

impl From<SceneState> for v1::SceneState {
    fn from(state: SceneState) -> Self {
        Self { epoch: state.epoch, light: state.light.number(), revision: state.revision }
    }
}

impl TryFrom<v1::SceneState> for SceneState {
    type Error = InvalidField;

    fn try_from(wire: v1::SceneState) -> Result<Self, InvalidField> {
        let light = light_level(wire.light, "version.state.light")?;
        Ok(Self { epoch: wire.epoch, light, revision: wire.revision })
    }
}

impl From<Version> for v1::Version {
    fn from(version: Version) -> Self {
        Self { number: version.number, state: Some(version.state.into()) }
    }
}

impl TryFrom<v1::Version> for Version {
    type Error = InvalidField;

    fn try_from(wire: v1::Version) -> Result<Self, InvalidField> {
        let state = wire.state.map(SceneState::try_from).transpose()?.unwrap_or_default();
        Ok(Self { number: wire.number, state })
    }
}

impl From<&Stage> for v1::Stage {
    fn from(stage: &Stage) -> Self {
        Self { name: stage.name.clone(), ms: stage.ms }
    }
}

impl TryFrom<v1::Stage> for Stage {
    type Error = InvalidField;

    fn try_from(wire: v1::Stage) -> Result<Self, InvalidField> {
        Ok(Self { ms: duration_ms(wire.ms, "stages.ms")?, name: wire.name })
    }
}
