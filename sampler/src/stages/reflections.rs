//! Reflections of direct views: what is reflected, and what that is shaded by.

use argus_scene::{Cancel, Lighting};
use bytes::Bytes;

use super::points::PointShading;
use crate::frame::Frame;
use crate::indirect::Lights;
use crate::reflected_light::{Bounces, ReflectionSource, ViewMaps, offset_about};
use crate::scratch::Scratch;
use crate::view_reflections::{Lobes, ViewReflections};

/// Taps of a pixel into maps of points, as in the paper.
const TAPS: u32 = 25;

/// What finds the reflections of a view.
pub(crate) struct ViewReflecting<'a> {
    pub(crate) programs: &'a ViewReflections,
    pub(crate) by: &'a ReflectionSource,
    /// The view's maps, if points are looked up.
    pub(crate) maps: Option<&'a dyn ViewMaps>,
    pub(crate) lighting: &'a Lighting,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) cancel: &'a Cancel,
}

/// The rays of what sub-samples reflect, by surfaces, materials and numbers of reflectors that were read back.
pub(super) fn lobes(frame: &Frame<'_>, of: &ViewReflecting<'_>, read: &[Bytes; 3]) -> Lobes {
    let tile = &frame.context.tile;
    let taps = if of.maps.is_some() { TAPS.div_ceil(tile.side.pow(2)) } else { 1 };
    let offset = offset_about(of.by, frame.context.eye.position);
    Lobes::new(read.each_ref().map(|bytes| &bytes[..]), tile, taps, offset, &of.programs.reflectors.instances)
}

/// What rays meet, and what shades that.
pub(super) fn ways<'a>(
    frame: &'a Frame<'_>,
    of: &'a mut ViewReflecting<'_>,
    lights: &'a mut Lights,
) -> (Bounces<'a>, PointShading<'a>) {
    let context = &frame.context;
    let bounces = Bounces {
        by: of.by,
        maps: of.maps,
        reflectors: &of.programs.reflectors,
        sky: &of.lighting.sky,
        eye: context.eye.position,
        tile: &context.tile,
    };
    let shading = PointShading {
        gpu: context.gpu,
        resident: context.resident,
        eye: context.eye,
        lights,
        programs: &of.programs.points,
        scratch: of.scratch,
        cancel: of.cancel,
    };
    (bounces, shading)
}
