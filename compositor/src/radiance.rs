//! Views with radiance. Each is composed twice: once without radiance, as all views are, and once for radiance alone, whose sub-pixels
//! are drawn as linear radiance. So a view's other images have the same bytes with and without radiance.

use argus_scene::{Frame, Output, Outputs, RenderError, ViewJob};

const RADIANCE: Outputs = Outputs::only(Output::Radiance);

/// The views without radiance, in order, and behind them those that have it, for radiance alone.
pub(crate) fn apart(views: &[ViewJob]) -> Vec<ViewJob> {
    let only = |view: &ViewJob, outputs| ViewJob { outputs, ..view.clone() };
    let others = views.iter().map(|view| only(view, view.outputs.outside(RADIANCE)));
    let radiance = views.iter().filter(|view| view.outputs.has(Output::Radiance));
    others.chain(radiance.map(|view| only(view, RADIANCE))).collect()
}

/// The frames of some views, from the frames of [`apart`].
pub(crate) fn joined(
    views: &[ViewJob],
    mut frames: Vec<Result<Frame, RenderError>>,
) -> Vec<Result<Frame, RenderError>> {
    let mut radiance = frames.split_off(views.len().min(frames.len())).into_iter();
    let join = |(view, frame): (&ViewJob, Result<Frame, RenderError>)| {
        if !view.outputs.has(Output::Radiance) {
            return frame;
        }
        let missing = || Err(RenderError::Internal("a view has no radiance".to_owned()));
        let (mut frame, beside) = (frame, radiance.next().unwrap_or_else(missing)?);
        if let Ok(frame) = &mut frame {
            frame.images.take_over(beside.images);
        }
        frame
    };
    views.iter().zip(frames).map(join).collect()
}

/// A number from a half float. Targets hold neither infinities nor NaN.
pub(crate) fn from_half(bits: u16) -> f32 {
    let (sign, exponent, mantissa) =
        (u32::from(bits >> 15), u32::from(bits >> 10 & 31), u32::from(bits & 1023));
    match exponent {
        0 => f32::from_bits(sign << 31 | (mantissa as f32 * 2f32.powi(-24)).to_bits()),
        _ => f32::from_bits(sign << 31 | (exponent + 112) << 23 | mantissa << 13),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_floats_are_read_at_both_ends_of_their_range() {
        let known =
            [(0, 0.0), (1, 2f32.powi(-24)), (0x3ff, 1023.0 * 2f32.powi(-24)), (0x400, 2f32.powi(-14))];
        let more = [(0x3c00, 1.0), (0x3c01, 1.0 + 2f32.powi(-10)), (0x7bff, 65504.0), (0xc000, -2.0)];
        for (bits, value) in known.into_iter().chain(more) {
            assert_eq!(from_half(bits), value, "{bits:#x}");
        }
    }
}
