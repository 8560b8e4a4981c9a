//! Images of frames, and the arrays of the caller that they are copied into.

use argus_client::ClientError;
use argus_scene::{Frame, Output};
use numpy::{PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::invalid;

/// Python's name of an output.
fn name(output: Output) -> &'static str {
    if output == Output::Color { "rgb" } else { output.name() }
}

/// The outputs of a frame, each with its bytes a pixel.
#[pyfunction]
pub(crate) fn outputs() -> Vec<(&'static str, usize)> {
    Output::ALL.into_iter().map(|output| (name(output), output.pixel_bytes())).collect()
}

/// An array of the caller for one output: frames × bytes of an image.
pub(crate) type Array<'py> = (String, PyReadwriteArray2<'py, u8>);

/// Memory of the caller for one output of all frames.
pub(crate) struct Images<'a> {
    output: Output,
    bytes: &'a mut [u8],
    image_bytes: usize,
}

impl<'a> Images<'a> {
    /// The memory of the caller's arrays for `frames` frames of `pixels` pixels.
    ///
    /// # Errors
    /// `InvalidField` if an output is not known, or if an array has another shape or has gaps.
    pub(crate) fn of(
        py: Python<'_>,
        arrays: &'a mut [Array<'_>],
        frames: usize,
        pixels: usize,
    ) -> PyResult<Vec<Self>> {
        let mut images = Vec::new();
        for (known_as, array) in arrays {
            let output = named(py, known_as)?;
            let (shape, image_bytes) = (array.shape().to_vec(), pixels * output.pixel_bytes());
            let bytes =
                array.as_slice_mut().ok().filter(|_| shape == [frames, image_bytes]).ok_or_else(|| {
                    invalid(
                        py,
                        known_as,
                        format!("must be {frames} × {image_bytes} bytes without gaps, not {shape:?}"),
                    )
                })?;
            images.push(Images { output, bytes, image_bytes });
        }
        Ok(images)
    }
}

/// # Errors
/// `InvalidField` if no output has this name.
pub(crate) fn named(py: Python<'_>, known_as: &str) -> PyResult<Output> {
    Output::ALL.into_iter().find(|output| name(*output) == known_as).ok_or_else(|| {
        let all: Vec<&str> = Output::ALL.into_iter().map(name).collect();
        invalid(py, "outputs", format!("{known_as:?} is none of {}", all.join(", ")))
    })
}

/// Copies a frame's images into its row of the arrays. The client has checked that the frame has them in this size.
///
/// # Errors
/// The frame lacks one of them.
pub(crate) fn copy(images: &mut [Images<'_>], index: usize, frame: &Frame) -> Result<(), ClientError> {
    for Images { output, bytes, image_bytes } in images {
        let image = frame.images[*output].as_ref().filter(|image| image.len() == *image_bytes);
        let row = bytes.chunks_exact_mut(*image_bytes).nth(index);
        let (Some(image), Some(row)) = (image, row) else {
            let reason = format!("the frame has no whole image {:?}", output.name());
            return Err(ClientError::Invalid { field: "frame.images".to_owned(), reason });
        };
        row.copy_from_slice(image);
    }
    Ok(())
}
