//! Looks up what reflected rays meet, and lists it for shading. Program: `shaders/points_lookup.wgsl`.

use argus_gpu::ScanSums;
use argus_gpu::wgpu::{Buffer, BufferUsages};
use bytemuck::Zeroable;

use super::{FacetRange, MapTurn, PointFacets, PointPasses, Points, PointsError};
use crate::layout::{LookupStep, PointPixel, PointRay};

/// Bytes of a listed point.
const LISTED_BYTES: u64 = 16;

/// Reflected rays on the device, in as many arrays as they need.
#[derive(Debug)]
pub struct DeviceRays {
    batches: Vec<Batch>,
    /// Offsets of a pixel's rays; `None` where rays are given one by one.
    taps: Option<(Buffer, u32)>,
}

/// Rays of one array: pixels with their taps, or rays.
#[derive(Debug)]
struct Batch {
    buffer: Buffer,
    /// Number of pixels, or of rays.
    count: u32,
}

/// Points that rays meet.
#[derive(Debug)]
pub struct Requested {
    /// For each batch and ray the id of the point that it meets, + 1.
    met: Vec<Buffer>,
    words: Buffer,
    before: Buffer,
    list: Buffer,
    count: u32,
}

/// What shading needs of a point: its triangle (bit 31: the back), the quarters and flags of its part, bits of the density that the
/// part needs (f32), and its row and column in 16 bits each.
pub type ListedPoint = [u32; 4];

/// Points of a range of triangles.
#[derive(Debug, Clone, Copy)]
pub struct ListPart<'a> {
    pub(crate) facets: &'a PointFacets,
    pub(crate) range: FacetRange,
    pub(crate) points: &'a Points,
    /// For each piece its part, as [`PointPasses::pieces`] returns them.
    pub(crate) kept_parts: &'a Buffer,
    /// Id of the first point.
    pub(crate) base: u32,
}

impl DeviceRays {
    /// Rays of a pixel.
    fn each(&self) -> u32 {
        self.taps.as_ref().map_or(1, |(_, taps)| *taps)
    }
}

impl Requested {
    /// Number of requested points.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        let lists = [&self.words, &self.before, &self.list];
        self.met.iter().chain(lists).map(Buffer::size).sum()
    }
}

impl PointPasses {
    /// Uploads pixels, each with a ray for each tap; offsets of taps are in pixels.
    ///
    /// # Errors
    /// More taps than an array holds.
    pub fn pixels(&self, pixels: &[PointPixel], taps: &[[f32; 2]]) -> Result<DeviceRays, PointsError> {
        self.fits("taps", (size_of_val(taps) as u64).max(4 * taps.len() as u64))?;
        let each = (4 * taps.len().max(1)).max(size_of::<PointPixel>());
        let taps = (self.gpu.upload("taps", taps, BufferUsages::STORAGE), taps.len() as u32);
        Ok(DeviceRays { batches: self.batches("reflective pixels", pixels, each), taps: Some(taps) })
    }

    /// Uploads rays.
    pub fn rays(&self, rays: &[PointRay]) -> DeviceRays {
        DeviceRays { batches: self.batches("reflected rays", rays, size_of::<PointRay>()), taps: None }
    }

    /// Uploads as many arrays as needed, where an element takes at most so many bytes in the largest array.
    fn batches<T: bytemuck::NoUninit>(&self, label: &str, all: &[T], bytes: usize) -> Vec<Batch> {
        let each = (self.largest as usize / bytes).clamp(1, 1 << 26);
        let upload = |part: &[T]| Batch {
            buffer: self.gpu.upload(label, part, BufferUsages::STORAGE),
            count: part.len() as u32,
        };
        all.chunks(each).map(upload).collect()
    }

    /// Looks rays up in the maps of all turns, in so many impostor steps, and lists the points that they meet. `points` is the
    /// number of all ids.
    ///
    /// # Errors
    /// The device failed.
    pub fn request(
        &self,
        turns: &[MapTurn],
        rays: &DeviceRays,
        steps: u32,
        points: u32,
    ) -> Result<Requested, PointsError> {
        let words = points.div_ceil(32);
        let requested = self.array("requested points", 4 * u64::from(words))?;
        let before = self.array("requested points before", 4 * u64::from(words))?;
        let lookups = |batch: &Batch| u64::from(batch.count) * u64::from(rays.each());
        let most = rays.batches.iter().map(lookups).sum::<u64>().min(u64::from(points));
        let list = self.array("list of requested points", 4 * most)?;
        let mut commands = self.gpu.commands("request points");
        let mut met = Vec::with_capacity(rays.batches.len());
        for batch in &rays.batches {
            let count = lookups(batch) as u32;
            let found = self.array("points that rays meet", 4 * u64::from(count))?;
            let step = LookupStep { count, taps: rays.each(), steps, ..LookupStep::zeroed() };
            for turn in turns {
                let pipeline = if rays.taps.is_some() { &self.lookups.taps } else { &self.lookups.rays };
                let call = commands
                    .compute("request", pipeline)
                    .read("texels", &turn.texels)
                    .read("maps", &turn.maps)
                    .write("met", &found)
                    .write("requested", &requested);
                let call = match &rays.taps {
                    Some((taps, _)) => call.read("pixels", &batch.buffer).read("taps", taps),
                    None => call.read("rays", &batch.buffer),
                };
                call.immediates(bytemuck::bytes_of(&step)).dispatch_linear(u64::from(count));
            }
            met.push(found);
        }
        let step = LookupStep { count: words, ..LookupStep::zeroed() };
        commands
            .compute("list", &self.lookups.count)
            .read("request_words", &requested)
            .write("request_counts", &before)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(words));
        let sums = ScanSums::new(&self.gpu, u64::from(words));
        self.scan.run(&mut commands, "list", &before, words, &sums);
        commands
            .compute("list", &self.lookups.list)
            .read("request_words", &requested)
            .read("requested_before", &before)
            .write("list", &list)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(words));
        let total = commands.read_buffer(sums.total(), 0..4);
        let count = bytemuck::pod_read_unaligned(&commands.submit().wait()?.take(total));
        Ok(Requested { met, words: requested, before, list, count })
    }

    /// Reads back the ids of requested points, ascending.
    ///
    /// # Errors
    /// The device failed.
    pub fn requested_ids(&self, requested: &Requested) -> Result<Vec<u32>, PointsError> {
        self.read_words(&requested.list, requested.count)
    }

    /// Reads back the id of the point that each ray meets, + 1; 0 for the sky.
    ///
    /// # Errors
    /// The device failed.
    pub fn met_ids(&self, rays: &DeviceRays, requested: &Requested) -> Result<Vec<u32>, PointsError> {
        let mut all = Vec::new();
        for (batch, met) in rays.batches.iter().zip(&requested.met) {
            all.extend(self.read_words(met, batch.count * rays.each())?);
        }
        Ok(all)
    }

    /// Reads back for each ray the place of the point that it meets in the list, + 1; 0 for the sky.
    ///
    /// # Errors
    /// The device failed.
    pub fn slots(&self, rays: &DeviceRays, requested: &Requested) -> Result<Vec<u32>, PointsError> {
        let mut all = Vec::new();
        for (batch, met) in rays.batches.iter().zip(&requested.met) {
            let count = batch.count * rays.each();
            let slots = self.array("slots of rays", 4 * u64::from(count))?;
            let step = LookupStep { count, ..LookupStep::zeroed() };
            let mut commands = self.gpu.commands("slots of rays");
            commands
                .compute("list", &self.lookups.slots)
                .read("met_ids", met)
                .read("request_words", &requested.words)
                .read("requested_before", &requested.before)
                .write("slots", &slots)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(count));
            let read = commands.read_buffer(&slots, 0..4 * u64::from(count));
            let bytes = commands.submit().wait()?.take(read);
            all.extend(bytemuck::pod_collect_to_vec::<u8, u32>(&bytes[..4 * count as usize]));
        }
        Ok(all)
    }

    fn read_words(&self, buffer: &Buffer, count: u32) -> Result<Vec<u32>, PointsError> {
        let mut commands = self.gpu.commands("read words");
        let read = commands.read_buffer(buffer, 0..4 * u64::from(count));
        let bytes = commands.submit().wait()?.take(read);
        Ok(bytemuck::pod_collect_to_vec(&bytes[..4 * count as usize]))
    }

    /// Reads back what shading needs of the requested points, in the order of their ids.
    ///
    /// # Errors
    /// The device failed.
    pub fn listed(
        &self,
        requested: &Requested,
        parts: &[ListPart<'_>],
    ) -> Result<Vec<ListedPoint>, PointsError> {
        let each = (self.largest / LISTED_BYTES).clamp(1, u64::from(u32::MAX)) as u32;
        let mut all = Vec::with_capacity(requested.count as usize);
        let mut first = 0;
        while first < requested.count {
            let count = each.min(requested.count - first);
            let found = self.array("requested points", LISTED_BYTES * u64::from(count))?;
            let mut commands = self.gpu.commands("list points");
            for part in parts {
                let step = LookupStep {
                    first,
                    count,
                    base: part.base,
                    points: part.points.count,
                    facet_base: part.facets.first_of(part.range.chunk),
                    ..LookupStep::zeroed()
                };
                commands
                    .compute("list", &self.lookups.points)
                    .read("listed", &requested.list)
                    .read("points", &part.points.buffer)
                    .read("kept_parts", part.kept_parts)
                    .write("found", &found)
                    .immediates(bytemuck::bytes_of(&step))
                    .dispatch_linear(u64::from(count));
            }
            let read = commands.read_buffer(&found, 0..LISTED_BYTES * u64::from(count));
            let bytes = commands.submit().wait()?.take(read);
            let bytes = &bytes[..LISTED_BYTES as usize * count as usize];
            all.extend(bytemuck::pod_collect_to_vec::<u8, ListedPoint>(bytes));
            first += count;
        }
        Ok(all)
    }

    /// The mean radiance that each pixel's rays meet. `shaded` has that of the requested points, in the order of their ids;
    /// `sky` that above, at the horizon and below.
    ///
    /// # Errors
    /// Radiance exceeds an array, or the device failed.
    ///
    /// # Panics
    /// If the rays are of no pixels.
    pub fn mirror(
        &self,
        rays: &DeviceRays,
        requested: &Requested,
        shaded: &[[f32; 4]],
        [zenith, horizon, ground]: [[f32; 3]; 3],
    ) -> Result<Vec<[f32; 4]>, PointsError> {
        let Some((taps, tap_count)) = &rays.taps else { panic!("rays of pixels") };
        self.fits("radiance of requested points", size_of_val(shaded) as u64)?;
        let shaded = self.gpu.upload("radiance of requested points", shaded, BufferUsages::STORAGE);
        let mut all = Vec::new();
        for (batch, met) in rays.batches.iter().zip(&requested.met) {
            let bytes = 16 * u64::from(batch.count);
            let arriving = self.array("arriving radiance", bytes)?;
            let step = LookupStep {
                zenith,
                horizon,
                ground,
                count: batch.count,
                taps: *tap_count,
                ..LookupStep::zeroed()
            };
            let mut commands = self.gpu.commands("mirror");
            commands
                .compute("mirror", &self.lookups.mirror)
                .read("pixels", &batch.buffer)
                .read("taps", taps)
                .read("met_ids", met)
                .read("request_words", &requested.words)
                .read("requested_before", &requested.before)
                .read("shaded", &shaded)
                .write("arriving", &arriving)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(batch.count));
            let read = commands.read_buffer(&arriving, 0..bytes);
            let read = commands.submit().wait()?.take(read);
            all.extend(bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&read[..bytes as usize]));
        }
        Ok(all)
    }
}
