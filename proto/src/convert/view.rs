//! Conversions of views, plans and provenance.

use argus_scene::frame::{Decision, Reason};
use argus_scene::{
    Camera, CellSettings, Detail, FaceMask, FaceMasks, FrameSource, Holes, InvalidField, Limits, Output,
    Outputs, Plan, PlanRequest, Prediction, Provenance, RayList, SampleId, SceneState, Search, Specification,
    SurfaceLight, View, Warp,
};

use bytes::Bytes;

use super::enums::{WireEnum, light_level};
use super::{
    duration_ms, required, scene_hash, scene_hash_bytes, specification_hash, specification_hash_bytes,
};
use crate::v1;

/// Greatest number of samples of a plan, like that of [`PlanRequest::samples`].
const MAX_PLAN_SAMPLES: usize = 8;
/// Greatest number of sub-pixels of a pixel: a regular grid of 16 × 16.
const MAX_SAMPLES_PER_PIXEL: u32 = 256;

/// A set of outputs for the wire.
pub(crate) fn wire_outputs(outputs: Outputs) -> Vec<i32> {
    outputs.iter().map(WireEnum::number).collect()
}

fn outputs(wire: &[i32]) -> Result<Outputs, InvalidField> {
    wire.iter().map(|number| Output::from_number(*number, "outputs")).collect()
}

impl From<Prediction> for v1::Prediction {
    fn from(prediction: Prediction) -> Self {
        Self { error: prediction.error, ms: prediction.ms }
    }
}

impl TryFrom<v1::Prediction> for Prediction {
    type Error = InvalidField;

    fn try_from(wire: v1::Prediction) -> Result<Self, InvalidField> {
        let error = InvalidField::within("predicted.error", wire.error, 0.0..=1.0)?;
        Ok(Self { error, ms: duration_ms(wire.ms, "predicted.ms")? })
    }
}

impl From<Decision> for v1::Decision {
    fn from(decision: Decision) -> Self {
        let Decision { reason, wait_ms, render_ms, excess } = decision;
        let number = Reason::ALL.iter().position(|known| *known == reason).map_or(0, |at| at as i32 + 1);
        Self { reason: number, wait_ms, render_ms, excess }
    }
}

impl TryFrom<v1::Decision> for Decision {
    type Error = InvalidField;

    fn try_from(wire: v1::Decision) -> Result<Self, InvalidField> {
        let unknown =
            || InvalidField::new("decision.reason", format!("{} is not a known value", wire.reason));
        let at = usize::try_from(wire.reason).ok().and_then(|number| number.checked_sub(1));
        let reason = at.and_then(|at| Reason::ALL.get(at).copied()).ok_or_else(unknown)?;
        Ok(Self {
            reason,
            wait_ms: duration_ms(wire.wait_ms, "decision.wait_ms")?,
            render_ms: duration_ms(wire.render_ms, "decision.render_ms")?,
            excess: InvalidField::within("decision.excess", wire.excess, -1.0..=1.0)?,
        })
    }
}

impl From<&PlanRequest> for v1::PlanRequest {
    fn from(plan: &PlanRequest) -> Self {
        Self {
            direct: plan.direct,
            detail: plan.detail.map(WireEnum::number),
            search: plan.search.map(WireEnum::number),
            steps: plan.steps,
            supersampling: plan.supersampling,
            samples: plan.samples,
            holes: plan.holes.map(WireEnum::number),
            preset: plan.preset.map(WireEnum::number),
            max_error: plan.max_error,
            deadline_ms: plan.deadline_ms,
        }
    }
}

/// A choice that the client may leave open, by absence or as unspecified.
fn open<E: WireEnum>(number: Option<i32>, field: &'static str) -> Result<Option<E>, InvalidField> {
    Ok(number.map(|number| E::open(number, field)).transpose()?.flatten())
}

/// A detail from the wire; unspecified is full.
fn detail(number: i32, field: &'static str) -> Result<Detail, InvalidField> {
    Ok(Detail::open(number, field)?.unwrap_or(Detail::Full))
}

impl TryFrom<v1::PlanRequest> for PlanRequest {
    type Error = InvalidField;

    fn try_from(wire: v1::PlanRequest) -> Result<Self, InvalidField> {
        Ok(Self {
            direct: wire.direct,
            detail: wire.detail.map(|number| detail(number, "plan.detail")).transpose()?,
            search: open(wire.search, "plan.search")?,
            steps: wire.steps,
            supersampling: wire.supersampling,
            samples: wire.samples,
            holes: open(wire.holes, "plan.holes")?,
            preset: open(wire.preset, "plan.preset")?,
            max_error: wire.max_error,
            deadline_ms: wire.deadline_ms,
        })
    }
}

/// Masks of the samples' faces for the wire, in the samples' order; empty if all samples have all faces.
fn face_bits(samples: &[SampleId], faces: &FaceMasks) -> Vec<u32> {
    match faces.are_all() {
        true => Vec::new(),
        false => samples.iter().map(|id| faces.of(id.camera).bits()).collect(),
    }
}

/// Masks of the cameras' faces from the wire, in the cameras' order. Without masks, all cameras have all faces.
///
/// # Errors
/// [`InvalidField`] of `field` for an empty mask, or if the number of masks is not the number of cameras.
pub fn face_masks(cameras: &[u64], bits: &[u32], field: &'static str) -> Result<FaceMasks, InvalidField> {
    if bits.is_empty() {
        return Ok(FaceMasks::default());
    }
    if bits.len() != cameras.len() {
        let reason =
            format!("must have one mask for each of {} samples, not {} masks", cameras.len(), bits.len());
        return Err(InvalidField::new(field, reason));
    }
    cameras.iter().zip(bits).map(|(camera, bits)| Ok((*camera, FaceMask::new(*bits, field)?))).collect()
}

impl From<&FrameSource> for v1::FrameSource {
    fn from(source: &FrameSource) -> Self {
        let FrameSource { camera, width, height, samples_per_pixel, band_rows, light } = *source;
        // A frame with older cells serves no other view.
        let (light, reflections_by_rays, _) = wire_surface_light(light);
        let camera = Some((&camera).into());
        Self { camera, width, height, samples_per_pixel, light, reflections_by_rays, band_rows }
    }
}

impl TryFrom<v1::FrameSource> for FrameSource {
    type Error = InvalidField;

    /// A frame within the limits of every service; a service checks its own limits.
    fn try_from(wire: v1::FrameSource) -> Result<Self, InvalidField> {
        let v1::FrameSource {
            camera,
            width,
            height,
            samples_per_pixel,
            light,
            reflections_by_rays,
            band_rows,
        } = wire;
        let camera = required(camera, "camera")?.try_into()?;
        let light = surface_light(light, reflections_by_rays, false)?;
        let source = Self { camera, width, height, samples_per_pixel, band_rows, light };
        source.validate(&Limits { max_side: u32::MAX, max_pixels: u64::MAX }).map(|()| source)
    }
}

/// The frames of a plan from the wire.
///
/// # Errors
/// `plan.warp.frames`, with the number of the frame and its field.
fn frame_sources(wire: Vec<v1::FrameSource>) -> Result<Vec<FrameSource>, InvalidField> {
    const FIELD: &str = "plan.warp.frames";
    if wire.len() > FrameSource::MOST {
        let reason = format!("must be at most {}, not {}", FrameSource::MOST, wire.len());
        return Err(InvalidField::new(FIELD, reason));
    }
    let frame = |(index, wire): (usize, v1::FrameSource)| {
        let at =
            |e: InvalidField| InvalidField::new(FIELD, format!("frame {index}: {}: {}", e.field, e.reason));
        FrameSource::try_from(wire).map_err(at)
    };
    wire.into_iter().enumerate().map(frame).collect()
}

impl From<&Plan> for v1::Plan {
    fn from(plan: &Plan) -> Self {
        use v1::plan::Kind;
        let kind = match plan {
            Plan::Direct { samples_per_pixel, detail, light } => {
                let (light, reflections_by_rays, older_cells) = wire_surface_light(*light);
                let (samples_per_pixel, detail) = (*samples_per_pixel, detail.number());
                Kind::Direct(v1::DirectPlan {
                    samples_per_pixel,
                    detail,
                    light,
                    reflections_by_rays,
                    older_cells,
                })
            }
            Plan::Warp(warp) => Kind::Warp(v1::WarpPlan {
                search: warp.search.number(),
                steps: warp.steps,
                supersampling: warp.supersampling,
                samples: warp.samples.iter().map(|id| (*id).into()).collect(),
                holes: warp.holes.number(),
                faces: face_bits(&warp.samples, &warp.faces),
                frames: warp.frames.iter().map(Into::into).collect(),
            }),
        };
        Self { kind: Some(kind) }
    }
}

impl TryFrom<v1::Plan> for Plan {
    type Error = InvalidField;

    fn try_from(wire: v1::Plan) -> Result<Self, InvalidField> {
        use v1::plan::Kind;
        let within = InvalidField::within::<u32>;
        Ok(match required(wire.kind, "plan.kind")? {
            Kind::Direct(plan) => {
                let field = "plan.direct.samples_per_pixel";
                let samples_per_pixel = within(field, plan.samples_per_pixel, 1..=MAX_SAMPLES_PER_PIXEL)?;
                if samples_per_pixel.isqrt().pow(2) != samples_per_pixel {
                    let reason = format!("must be a square number, not {samples_per_pixel}");
                    return Err(InvalidField::new(field, reason));
                }
                let detail = detail(plan.detail, "plan.direct.detail")?;
                Self::Direct {
                    samples_per_pixel,
                    detail,
                    light: surface_light(plan.light, plan.reflections_by_rays, plan.older_cells)?,
                }
            }
            Kind::Warp(plan) => {
                // Reflection maps come on top, and at most once.
                let of_rig =
                    plan.samples.iter().filter(|id| id.camera != SampleId::REFLECTION_PROBES).count();
                let frames = frame_sources(plan.frames)?;
                let is_complete = match frames.is_empty() {
                    true => (1..=MAX_PLAN_SAMPLES).contains(&of_rig) && plan.samples.len() <= of_rig + 1,
                    false => plan.samples.is_empty(),
                };
                if !is_complete {
                    let reason = match frames.is_empty() {
                        true => format!("must be 1 to {MAX_PLAN_SAMPLES}, not {of_rig}"),
                        false => "must be empty, since the plan warps frames".to_owned(),
                    };
                    return Err(InvalidField::new("plan.warp.samples", reason));
                }
                let search = Search::from_number(plan.search, "plan.warp.search")?;
                // Some searches take no steps. Their number is ignored.
                let least = u32::from(search.takes_steps());
                let cameras: Vec<u64> = plan.samples.iter().map(|id| id.camera).collect();
                Self::Warp(Warp {
                    search,
                    steps: within("plan.warp.steps", plan.steps, least..=4096)?,
                    supersampling: within("plan.warp.supersampling", plan.supersampling, 1..=8)?,
                    samples: plan.samples.into_iter().map(Into::into).collect(),
                    faces: face_masks(&cameras, &plan.faces, "plan.warp.faces")?,
                    holes: Holes::open(plan.holes, "plan.warp.holes")?.unwrap_or_default(),
                    frames,
                })
            }
        })
    }
}

/// The fields `light`, `reflections_by_rays` and `older_cells` of a plan.
fn wire_surface_light(light: Option<SurfaceLight>) -> (u32, bool, bool) {
    match light {
        None => (0, false, false),
        Some(SurfaceLight::Rays) => (1, false, false),
        Some(SurfaceLight::Cells { rays, reflected }) => (rays, !reflected, false),
        Some(SurfaceLight::OlderCells { rays, reflected }) => (rays, !reflected, true),
    }
}

fn surface_light(
    light: u32,
    reflections_by_rays: bool,
    older_cells: bool,
) -> Result<Option<SurfaceLight>, InvalidField> {
    let reflected = !reflections_by_rays;
    match light {
        0 => Ok(None),
        1 => Ok(Some(SurfaceLight::Rays)),
        rays if CellSettings::RAYS.contains(&rays) => Ok(Some(match older_cells {
            false => SurfaceLight::Cells { rays, reflected },
            true => SurfaceLight::OlderCells { rays, reflected },
        })),
        other => {
            let reason = format!("must be 0, 1, 16, 64 or 256, not {other}");
            Err(InvalidField::new("plan.direct.light", reason))
        }
    }
}

impl From<&Provenance> for v1::Provenance {
    fn from(provenance: &Provenance) -> Self {
        Self {
            scene_hash: scene_hash_bytes(provenance.scene),
            epoch: provenance.state.epoch,
            light: provenance.state.light.number(),
            revision: provenance.state.revision,
            plan: Some((&provenance.plan).into()),
            specification: provenance.specification.as_ref().map(Into::into),
            specification_hash: provenance
                .specification
                .map(|specification| specification_hash_bytes(specification.hash()))
                .unwrap_or_default(),
            device: provenance.device.clone(),
            history: provenance.history,
        }
    }
}

impl TryFrom<v1::Provenance> for Provenance {
    type Error = InvalidField;

    fn try_from(wire: v1::Provenance) -> Result<Self, InvalidField> {
        let specification: Option<Specification> = wire.specification.map(TryInto::try_into).transpose()?;
        if !wire.specification_hash.is_empty() {
            let field = "provenance.specification_hash";
            let said = specification_hash(&wire.specification_hash, field)?;
            if specification.is_none_or(|specification| specification.hash() != said) {
                return Err(InvalidField::new(field, "must be the hash of the specification"));
            }
        }
        Ok(Self {
            scene: scene_hash(&wire.scene_hash, "provenance.scene_hash")?,
            state: SceneState {
                epoch: wire.epoch,
                light: light_level(wire.light, "provenance.light")?,
                revision: wire.revision,
            },
            plan: required(wire.plan, "provenance.plan")?.try_into()?,
            specification,
            device: wire.device,
            history: wire.history,
        })
    }
}

impl From<&View> for v1::View {
    fn from(view: &View) -> Self {
        Self {
            camera: Some((&view.camera).into()),
            width: view.width,
            height: view.height,
            outputs: wire_outputs(view.outputs),
            plan: Some((&view.plan).into()),
            pin: view.pin.as_ref().map(Into::into),
            flow_to: view.flow_to.as_ref().map(Into::into),
            rays: view.rays.as_ref().map(packed_rays).unwrap_or_default(),
        }
    }
}

impl TryFrom<v1::View> for View {
    type Error = InvalidField;

    /// The view; [`View::validate`] checks it against the service's limits.
    fn try_from(wire: v1::View) -> Result<Self, InvalidField> {
        let mut camera = required(wire.camera, "camera")?;
        let rays = (!wire.rays.is_empty()).then(|| rays(&wire.rays)).transpose()?;
        if let (Some(list), Some(v1::camera::Lens::ListedRays(lens))) = (&rays, &mut camera.lens) {
            lens.spacing_deg.get_or_insert_with(|| list.spacing_deg(wire.width));
        }
        Ok(Self {
            camera: camera.try_into()?,
            width: wire.width,
            height: wire.height,
            outputs: outputs(&wire.outputs)?,
            plan: wire.plan.map(TryInto::try_into).transpose()?.unwrap_or_default(),
            pin: wire.pin.map(pin).transpose()?,
            flow_to: wire.flow_to.map(flow_to).transpose()?,
            rays,
        })
    }
}

fn packed_rays(list: &RayList) -> Bytes {
    list.directions().iter().flat_map(|direction| direction.to_array()).flat_map(f32::to_le_bytes).collect()
}

/// The list of rays of a view.
fn rays(packed: &[u8]) -> Result<RayList, InvalidField> {
    let (numbers, rest) = packed.as_chunks::<4>();
    let (directions, odd) = numbers.as_chunks::<3>();
    if !rest.is_empty() || !odd.is_empty() {
        let reason = format!("must be three f32 for each pixel, 12 bytes, not {} bytes in all", packed.len());
        return Err(InvalidField::new("rays", reason));
    }
    RayList::new(directions.iter().map(|numbers| numbers.map(f32::from_le_bytes).into()).collect())
}

/// The camera that flow leads to. Its errors are of the field `flow_to`.
fn flow_to(wire: v1::Camera) -> Result<Camera, InvalidField> {
    wire.try_into()
        .map_err(|at: InvalidField| InvalidField::new("flow_to", format!("{}: {}", at.field, at.reason)))
}

/// A pinned provenance. Its errors name fields below `pin`.
fn pin(wire: v1::Provenance) -> Result<Provenance, InvalidField> {
    wire.try_into().map_err(|at: InvalidField| {
        let field = match at.field {
            "provenance.scene_hash" => "pin.scene_hash",
            "provenance.specification_hash" => "pin.specification_hash",
            field if field.starts_with("plan.") => "pin.plan",
            _ => "pin",
        };
        InvalidField::new(field, format!("{}: {}", at.field, at.reason))
    })
}

impl From<Limits> for v1::Limits {
    fn from(limits: Limits) -> Self {
        Self { max_side: limits.max_side, max_pixels: limits.max_pixels }
    }
}

impl TryFrom<v1::Limits> for Limits {
    type Error = InvalidField;

    fn try_from(wire: v1::Limits) -> Result<Self, InvalidField> {
        if wire.max_side == 0 || wire.max_pixels == 0 {
            return Err(InvalidField::new("limits", "must allow at least one pixel"));
        }
        Ok(Self { max_side: wire.max_side, max_pixels: wire.max_pixels })
    }
}
