//! The binary files of a model: little-endian, packed.

use anyhow::{Context, ensure};
use glam::{DQuat, DVec3};

use super::super::model::{Calibration, Model};
use super::super::shots::check_count;
use super::records::{Image, Sensor, side};

/// Bytes of a point of an image: two coordinates and the number of a point in the world.
const POINT_BYTES: u64 = 24;

/// What is left of a file.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> anyhow::Result<&'a [u8]> {
        let (bytes, left) = self.0.split_at_checked(count).context("the file ends early: it is cut off")?;
        self.0 = left;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> anyhow::Result<[u8; N]> {
        Ok(self.bytes(N)?.try_into()?)
    }

    fn u32(&mut self) -> anyhow::Result<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> anyhow::Result<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> anyhow::Result<f64> {
        self.array().map(f64::from_le_bytes)
    }

    /// A text that ends with a zero byte.
    fn text(&mut self) -> anyhow::Result<String> {
        let end =
            self.0.iter().position(|byte| *byte == 0).context("a name has no end: the file is cut off")?;
        let name = String::from_utf8(self.bytes(end)?.to_vec()).context("a name is no UTF-8")?;
        self.bytes(1)?;
        Ok(name)
    }

    /// The number of elements that follow. It is only a claim, so nothing is allocated by it.
    fn count(&mut self) -> anyhow::Result<usize> {
        let count = usize::try_from(self.u64()?)?;
        check_count(count)?;
        Ok(count)
    }

    /// Nothing may follow.
    fn end(&self) -> anyhow::Result<()> {
        ensure!(self.0.is_empty(), "{} bytes follow after its last element", self.0.len());
        Ok(())
    }
}

/// Reads `cameras.bin`.
pub(super) fn sensors(file: &[u8]) -> anyhow::Result<Vec<Sensor>> {
    let mut from = Reader(file);
    let mut sensors = Vec::new();
    for _ in 0..from.count()? {
        let id = from.u32()?;
        let model = Model::numbered(from.u32()?.cast_signed()).with_context(|| format!("camera {id}"))?;
        let size = [side(from.u64()?)?, side(from.u64()?)?];
        let parameters = (0..model.count()).map(|_| from.f64()).collect::<anyhow::Result<Vec<f64>>>()?;
        sensors.push(Sensor { id, size, lens: model.intrinsics(&parameters)? });
    }
    from.end()?;
    Ok(sensors)
}

/// Reads `images.bin`.
pub(super) fn images(file: &[u8]) -> anyhow::Result<Vec<Image>> {
    let mut from = Reader(file);
    let mut images = Vec::new();
    for _ in 0..from.count()? {
        let id = from.u32()?;
        let (w, x, y, z) = (from.f64()?, from.f64()?, from.f64()?, from.f64()?);
        let translation = DVec3::new(from.f64()?, from.f64()?, from.f64()?);
        let (sensor, name) = (from.u32()?, from.text()?);
        let points = from.u64()?.checked_mul(POINT_BYTES).context("the file ends early: it is cut off")?;
        from.bytes(usize::try_from(points)?)?;
        images.push(Image { id, rotation: DQuat::from_xyzw(x, y, z, w), translation, sensor, name });
    }
    from.end()?;
    Ok(images)
}

/// The bytes of `cameras.bin`.
pub(super) fn write_sensors(sensors: &[Sensor]) -> Vec<u8> {
    let mut file = (sensors.len() as u64).to_le_bytes().to_vec();
    for Sensor { id, size, lens } in sensors {
        let Calibration { model, parameters } = Calibration::of(lens);
        file.extend(id.to_le_bytes());
        file.extend(model.number().to_le_bytes());
        file.extend(size.iter().flat_map(|side| u64::from(*side).to_le_bytes()));
        file.extend(parameters.iter().flat_map(|number| number.to_le_bytes()));
    }
    file
}

/// The bytes of `images.bin`, without points.
pub(super) fn write_images(images: &[Image]) -> Vec<u8> {
    let mut file = (images.len() as u64).to_le_bytes().to_vec();
    for Image { id, rotation: q, translation: t, sensor, name } in images {
        file.extend(id.to_le_bytes());
        file.extend([q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().flat_map(|number| number.to_le_bytes()));
        file.extend(sensor.to_le_bytes());
        file.extend(name.as_bytes());
        file.push(0);
        file.extend(0u64.to_le_bytes());
    }
    file
}
