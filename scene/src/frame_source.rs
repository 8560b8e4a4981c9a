//! Direct frames as samples of the views around them.
//!
//! A frame from triangles, with the range of its pixels, is a sample with a pinhole camera. It costs nothing, because it
//! was rendered for its viewer. Its radiance is what its viewer saw: highlights and reflections included, exposed,
//! clipped at white and rounded to 8 bits of sRGB. It is stored as the radiance that the exposure shows as these colours. At
//! the frame's own camera a view repeats its colours to within rounding.

use bytes::Bytes;

use crate::tone::linear_from_srgb;
use crate::{
    Camera, FaceMask, Frame, FrameSource, InvalidField, Limits, Output, Plan, Plane, PlaneData, PlaneFormat,
    PlaneKind, Sample, SampleCamera, SampleId,
};

impl FrameSource {
    /// Most frames that a view is warped from.
    pub const MOST: usize = 4;

    /// Columns and rows of the grid over a frame's image at whose points a worker reports its range.
    pub const GRID: [u32; 2] = [12, 9];

    /// Most samples per pixel: a grid of 16 × 16.
    const MOST_SAMPLES_PER_PIXEL: u32 = 256;

    /// Exposures at which a half holds the radiance of every displayed colour but the darkest few to within rounding.
    const EXPOSURES: std::ops::RangeInclusive<f32> = 2e-5..=1e3;

    /// Bytes of a pixel as a texel: four halves of colour, and an f32 of inverse range.
    const TEXEL_BYTES: u64 = 12;

    /// Rejects a frame that a service would not render as a view, by field.
    ///
    /// # Errors
    /// The fields of [`Camera::validate`]; `width`, `height`, `samples_per_pixel`, `band_rows`.
    pub fn validate(&self, limits: &Limits) -> Result<(), InvalidField> {
        self.camera.validate()?;
        if !self.camera.is_pinhole() {
            return Err(InvalidField::new("camera", "views are warped from frames of pinholes alone"));
        }
        InvalidField::within("width", self.width, 1..=limits.max_side)?;
        InvalidField::within("height", self.height, 1..=limits.max_side)?;
        let n = self.samples_per_pixel;
        if !(1..=Self::MOST_SAMPLES_PER_PIXEL).contains(&n) || n.isqrt().pow(2) != n {
            let reason = format!("must be a square number up to {}, not {n}", Self::MOST_SAMPLES_PER_PIXEL);
            return Err(InvalidField::new("samples_per_pixel", reason));
        }
        InvalidField::within("band_rows", self.band_rows, 0..=self.height)?;
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels > limits.max_pixels
            || pixels.saturating_mul(n.into()) > limits.max_pixels.saturating_mul(16)
        {
            let reason = format!("width × height is {pixels} pixels, more than this service renders");
            return Err(InvalidField::new("width", reason));
        }
        Ok(())
    }

    /// The plan by which the frame is rendered.
    pub fn plan(&self) -> Plan {
        Plan::direct(self.samples_per_pixel).with_light(self.light)
    }

    /// Its number among frames of one state: the first 64 bits of the BLAKE3 of its fields.
    pub fn number(&self) -> u64 {
        let Camera { eye, target, up, fov_deg, lens } = self.camera;
        let mut hasher = blake3::Hasher::new();
        for value in [eye, target, up].iter().flat_map(glam::DVec3::to_array).chain([fov_deg]) {
            hasher.update(&value.to_bits().to_le_bytes());
        }
        for value in [self.width, self.height, self.samples_per_pixel, self.band_rows] {
            hasher.update(&value.to_le_bytes());
        }
        if let Some(lens) = lens {
            // Digits that bring back every f64.
            hasher.update(format!("{lens:?}").as_bytes());
        }
        if let Some(light) = self.light {
            hasher.update(light.to_string().as_bytes());
        }
        let hash = hasher.finalize();
        hash.as_bytes()[..8].iter().fold(0, |number, byte| number << 8 | u64::from(*byte))
    }

    /// Its id as a sample, which no sample of a set has.
    pub fn id(&self) -> SampleId {
        SampleId { version: SampleId::FRAMES, camera: self.number() }
    }

    /// Its camera as a sample.
    pub fn sample_camera(&self) -> SampleCamera {
        SampleCamera::Perspective { camera: self.camera, width: self.width, height: self.height }
    }

    /// Bytes of its texels.
    pub fn bytes(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * Self::TEXEL_BYTES
    }

    /// Whether frames of this exposure, from linear radiance to display-linear values, can be samples.
    pub fn allows(exposure: f32) -> bool {
        Self::EXPOSURES.contains(&exposure)
    }

    /// The frame as a sample. `None` if the frame lacks colour or range, or has another size.
    ///
    /// Radiance is what the exposure of its specification shows as its colour. A range that is not positive counts as sky.
    pub fn sample(&self, frame: &Frame) -> Option<Sample> {
        let size = [self.width, self.height];
        let pixels = self.width as usize * self.height as usize;
        let (color, range) = (frame.images[Output::Color].as_ref()?, frame.images[Output::Range].as_ref()?);
        if [frame.width, frame.height] != size || color.len() != 3 * pixels || range.len() != 4 * pixels {
            return None;
        }
        let exposure = frame.provenance.specification.map_or(1.0, |specification| specification.exposure);
        let halves = radiance_halves(exposure);
        let mut radiance = Vec::with_capacity(8 * pixels);
        for rgb in color.as_chunks::<3>().0 {
            rgb.iter().for_each(|byte| radiance.extend_from_slice(&halves[usize::from(*byte)]));
            radiance.extend_from_slice(&half::f16::ONE.to_le_bytes());
        }
        let mut inverse_range = Vec::with_capacity(4 * pixels);
        for bytes in range.as_chunks::<4>().0 {
            inverse_range.extend_from_slice(&inverse(f32::from_le_bytes(*bytes)).to_le_bytes());
        }
        let plane = |kind, format, data: Vec<u8>| Plane {
            kind,
            format,
            size,
            data: PlaneData::Host(Bytes::from(data)),
        };
        Some(Sample {
            id: self.id(),
            camera: self.sample_camera(),
            faces: FaceMask::ALL,
            planes: vec![
                plane(PlaneKind::Radiance, PlaneFormat::Rgba16Float, radiance),
                plane(PlaneKind::InverseRange, PlaneFormat::R32Float, inverse_range),
            ],
            stages: frame.stages.clone(),
        })
    }
}

/// The radiance that an exposure shows as each 8-bit sRGB value. A half has 11 bits of mantissa, so every value survives.
fn radiance_halves(exposure: f32) -> [[u8; 2]; 256] {
    let most = half::f16::MAX.to_f32();
    let radiance = |byte: usize| (linear_from_srgb(byte as f32 / 255.0) / exposure).min(most);
    std::array::from_fn(|byte| half::f16::from_f32(radiance(byte)).to_le_bytes())
}

/// Inverse of a range in metres; 0 for sky, and for a range that is no distance.
fn inverse(range: f32) -> f32 {
    let inverse = range.recip();
    if inverse >= f32::MIN_POSITIVE && inverse.is_finite() { inverse } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::tone::display_from_radiance;
    use crate::{Images, Intrinsics, Lens, Provenance, SceneHash, SceneState, Specification, SurfaceLight};

    fn source(width: u32, height: u32) -> FrameSource {
        let camera = Camera::look_at(DVec3::new(1e6, 2.0, 3.0), DVec3::ZERO);
        FrameSource { camera, width, height, samples_per_pixel: 4, band_rows: 0, light: None }
    }

    /// A frame of one row that has every 8-bit value, and these ranges first.
    fn frame(ranges: &[f32]) -> Frame {
        let range = |i: usize| ranges.get(i).copied().unwrap_or(2.0).to_le_bytes();
        let source = source(256, 1);
        Frame {
            images: Images::from([
                (Output::Color, (0..=255u8).flat_map(|byte| [byte; 3]).collect()),
                (Output::Range, (0..256).flat_map(range).collect()),
            ]),
            ..Frame::without_images(
                256,
                1,
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), source.plan()),
            )
        }
    }

    fn host(sample: &Sample, kind: PlaneKind) -> Bytes {
        match &sample.plane(kind).unwrap().data {
            PlaneData::Host(bytes) => bytes.clone(),
            PlaneData::Device(_) => panic!("on the device"),
        }
    }

    #[test]
    fn every_colour_of_a_frame_survives_as_a_texel() {
        for exposure in [2e-5, 0.01, 1.0, 30.0, 1e3] {
            assert!(FrameSource::allows(exposure));
            let mut frame = frame(&[]);
            frame.provenance.specification = Some(Specification { exposure, ..Specification::default() });
            let radiance = host(&source(256, 1).sample(&frame).unwrap(), PlaneKind::Radiance);
            for (byte, texel) in radiance.as_chunks::<8>().0.iter().enumerate() {
                let red = half::f16::from_le_bytes([texel[0], texel[1]]).to_f32();
                assert_eq!(display_from_radiance(glam::Vec3::splat(red), exposure), [byte as u8; 3]);
            }
        }
        assert!(![1e-6, 1e6, 0.0, f32::NAN].into_iter().any(FrameSource::allows));
    }

    #[test]
    fn ranges_that_are_no_distance_count_as_sky() {
        let odd = [4.0, f32::INFINITY, 0.0, -1.0, f32::NAN, f32::MAX, 1e-45];
        let sample = source(256, 1).sample(&frame(&odd)).unwrap();
        let bytes = host(&sample, PlaneKind::InverseRange);
        let inverse: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().take(8).map(|bytes| f32::from_le_bytes(*bytes)).collect();
        assert_eq!(inverse, [0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn a_frame_of_another_size_or_without_images_is_no_sample() {
        assert!(source(255, 1).sample(&frame(&[])).is_none());
        for lost in [Output::Range, Output::Color] {
            let images = frame(&[]).images.with(lost, None);
            assert!(source(256, 1).sample(&Frame { images, ..frame(&[]) }).is_none());
        }
    }

    #[test]
    fn every_field_changes_the_number() {
        let usual = source(4, 3);
        let moved = |by: DVec3| FrameSource {
            camera: Camera { eye: usual.camera.eye + by, ..usual.camera },
            ..usual
        };
        let lens = |focal| Lens::Intrinsics(Intrinsics::pinhole(DVec2::splat(focal), DVec2::ONE));
        let others = [
            moved(DVec3::X * 1e-6),
            FrameSource { camera: Camera { fov_deg: 46.0, ..usual.camera }, ..usual },
            FrameSource { camera: Camera { lens: Some(lens(3.0)), ..usual.camera }, ..usual },
            FrameSource { camera: Camera { lens: Some(lens(3.0 + 1e-15)), ..usual.camera }, ..usual },
            FrameSource { width: 5, ..usual },
            FrameSource { height: 4, ..usual },
            FrameSource { samples_per_pixel: 1, ..usual },
            FrameSource { band_rows: 1, ..usual },
            FrameSource { light: Some(SurfaceLight::Rays), ..usual },
            FrameSource { light: Some(SurfaceLight::Cells { rays: 16, reflected: true }), ..usual },
        ];
        assert!(others.iter().all(|other| other.id() != usual.id()));
        assert_ne!(others[2].id(), others[3].id());
        assert_eq!(moved(DVec3::ZERO).id(), usual.id());
    }

    #[test]
    fn a_frame_that_a_service_would_not_render_is_refused_by_field() {
        let limits = Limits::default();
        let field = |source: FrameSource| source.validate(&limits).unwrap_err().field;
        let usual = source(4, 3);
        assert_eq!(usual.validate(&limits), Ok(()));
        assert_eq!(field(FrameSource { width: 8193, ..usual }), "width");
        assert_eq!(field(FrameSource { height: 0, ..usual }), "height");
        assert_eq!(field(FrameSource { band_rows: 4, ..usual }), "band_rows");
        assert_eq!(field(FrameSource { width: 8192, height: 8192, ..usual }), "width");
        for samples_per_pixel in [0, 2, 289] {
            assert_eq!(field(FrameSource { samples_per_pixel, ..usual }), "samples_per_pixel");
        }
        let camera = Camera { eye: DVec3::NAN, ..usual.camera };
        assert_eq!(field(FrameSource { camera, ..usual }), "camera.eye");
        let camera = Camera { lens: Some(Lens::Equirectangular), ..usual.camera };
        assert_eq!(field(FrameSource { camera, ..usual }), "camera");
    }
}
