//! Files of a frame's images.

use std::path::{Path, PathBuf};

use anyhow::Context;
use argus_scene::{Frame, Output};
use exr::image::FlatSamples;

use crate::output;

/// The file of each output: `out` for a single one, else a file in the folder `out` that is named for its output.
pub(crate) fn files(out: &Path, outputs: &[Output]) -> Vec<(Output, PathBuf)> {
    match outputs {
        [output] => vec![(*output, out.to_owned())],
        _ => outputs.iter().map(|output| (*output, out.join(file_name(*output)))).collect(),
    }
}

fn file_name(output: Output) -> String {
    format!("{}.{}", output.name(), ending(output))
}

/// The ending of an output's files.
pub(crate) fn ending(output: Output) -> &'static str {
    if channels(output).is_empty() { "png" } else { "exr" }
}

/// The channels of an output in an OpenEXR file; none for an output that is written as PNG. By convention, `Z` is a distance along the
/// camera's axis, `R`, `G` and `B` are linear radiance, and `N` is a normal.
fn channels(output: Output) -> &'static [&'static str] {
    match output {
        Output::Color | Output::Mask | Output::Source | Output::Confidence => &[],
        Output::Range => &["range"],
        Output::Depth => &["Z"],
        Output::Radiance => &["R", "G", "B"],
        Output::Normal => &["N.X", "N.Y", "N.Z"],
        Output::Instance => &["instance"],
        Output::Material => &["material"],
        Output::Flow => &["flow.X", "flow.Y"],
    }
}

/// Writes an image of a frame.
pub(crate) fn write(path: &Path, output: Output, frame: &Frame) -> anyhow::Result<()> {
    let (width, height) = (frame.width, frame.height);
    let image = frame.images[output].as_ref().context("the frame lacks the requested image")?;
    let names = channels(output);
    if names.is_empty() {
        return match output {
            Output::Color => output::write_rgb_png(path, width, height, image),
            _ => output::write_gray_png(path, width, height, image),
        };
    }
    let numbers = image.as_chunks::<4>().0;
    let of = |at: usize| numbers.iter().skip(at).step_by(names.len()).copied();
    let samples = |at: usize| match output {
        // OpenEXR has no signed integers: 4294967295 stands where nothing is.
        Output::Instance | Output::Material => FlatSamples::U32(of(at).map(u32::from_le_bytes).collect()),
        _ => FlatSamples::F32(of(at).map(f32::from_le_bytes).collect()),
    };
    let channels = names.iter().enumerate().map(|(at, name)| (*name, samples(at))).collect();
    output::write_samples_exr(path, width, height, channels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_output_is_the_named_file_and_several_are_in_a_folder() {
        let out = Path::new("out/view.png");
        assert_eq!(files(out, &[Output::Color]), [(Output::Color, out.to_owned())]);
        let several = files(Path::new("out"), &[Output::Color, Output::Depth]);
        let expected = [(Output::Color, "out/color.png".into()), (Output::Depth, "out/depth.exr".into())];
        assert_eq!(several, expected);
    }

    #[test]
    fn each_number_of_an_output_is_a_channel_of_its_file() {
        for output in Output::ALL {
            let channels = channels(output);
            assert!(channels.is_empty() || channels.len() == output.format().channels, "{output:?}");
        }
    }
}
