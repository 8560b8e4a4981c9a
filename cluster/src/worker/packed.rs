//! Samples as they go over the wire, kept for a while.
//!
//! A sample is passed on to several workers, at nearly the same time (`core/samples/distribution.rs`). Who rendered it packs
//! it once for all of them, and who received it has it packed already: what came is kept as it came, since whoever gets it checks it by its hash.

use std::sync::Arc;

use argus_proto::chunks::sample_chunks;
use argus_proto::{Fault, v1};
use argus_scene::{Sample, SampleId};
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};
use tokio::sync::Semaphore;

/// A sample in chunks.
pub(super) type Chunks = Arc<[v1::SampleChunk]>;

/// The part of what is kept of samples that they may take packed besides; they are asked for within seconds, or never again.
const SHARE: u64 = 16;

/// Greatest number of bytes of packed samples.
const MOST: u64 = 64 << 20;

/// Roughly what one takes, bytes: only the size of a table follows from it.
const USUAL: u64 = 1 << 19;

#[derive(Debug, Clone)]
struct Weight;

impl Weighter<SampleId, Chunks> for Weight {
    fn weight(&self, _: &SampleId, chunks: &Chunks) -> u64 {
        let bytes = |chunk: &v1::SampleChunk| match &chunk.body {
            Some(v1::sample_chunk::Body::Data(data)) => data.bytes.len() as u64,
            _ => 0,
        };
        chunks.iter().map(bytes).sum::<u64>().max(1)
    }
}

/// The packed samples, by id.
#[derive(Debug)]
pub(super) struct Packed {
    cache: Cache<SampleId, Chunks, Weight>,
}

impl Packed {
    /// Empty, beside a store that keeps so many bytes.
    pub(super) fn beside(store_bytes: u64) -> Self {
        let limit = (store_bytes / SHARE).min(MOST);
        // With several shards, one of which a sample would have to fit in, large samples were never kept.
        let options = OptionsBuilder::new()
            .weight_capacity(limit)
            .estimated_items_capacity((limit / USUAL).max(1) as usize)
            .shards(1)
            .build();
        let options =
            options.unwrap_or_else(|e| unreachable!("a capacity and a number of items are given: {e}"));
        let cache =
            Cache::with_options(options, Weight, DefaultHashBuilder::default(), DefaultLifecycle::default());
        Self { cache }
    }

    /// A sample packed, in a turn of `packing`, or as it was before; those who ask meanwhile wait for the first one.
    ///
    /// # Errors
    /// [`Fault`] of a sample whose planes are not in host memory.
    pub(super) async fn of(&self, sample: Arc<Sample>, packing: &Semaphore) -> Result<Chunks, Fault> {
        let id = sample.id;
        let pack = async {
            let _turn = packing.acquire().await.map_err(|e| Fault::Unavailable(e.to_string()))?;
            let chunks = tokio::task::spawn_blocking(move || sample_chunks(&sample)).await;
            Ok(chunks.map_err(|e| Fault::Unavailable(e.to_string()))??.into())
        };
        self.cache.get_or_insert_async(&id, pack).await
    }

    /// Keeps a sample as it came.
    pub(super) fn keep(&self, id: SampleId, chunks: Chunks) {
        self.cache.insert(id, chunks);
    }

    pub(super) fn forget(&self, id: SampleId) {
        self.cache.remove(&id);
    }

    /// Forgets what is older than an epoch.
    pub(super) fn retire(&self, before_version: u64) {
        self.cache.retain(|id, _| id.version >= before_version);
    }

    pub(super) fn clear(&self) {
        self.cache.clear();
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, FaceMask, Plane, PlaneData, PlaneFormat, PlaneKind, SampleCamera};
    use bytes::Bytes;
    use glam::DVec3;
    use rand::rngs::SmallRng;
    use rand::{RngCore, SeedableRng};

    use super::*;

    /// Noise, which takes as much packed.
    fn sample(index: u64, side: u32) -> Arc<Sample> {
        let mut texels = vec![0; (side * side * 4) as usize];
        SmallRng::seed_from_u64(index).fill_bytes(&mut texels);
        let data = PlaneData::Host(Bytes::from(texels));
        let kind = PlaneKind::InverseRange;
        let plane = Plane { kind, format: PlaneFormat::R32Float, size: [side, side], data };
        let camera = Camera::look_at(DVec3::ONE, DVec3::ZERO);
        let camera = SampleCamera::Perspective { camera, width: side, height: side };
        let id = SampleId { version: index / 10, camera: index };
        Arc::new(Sample { id, camera, faces: FaceMask::ALL, planes: vec![plane], stages: Vec::new() })
    }

    #[tokio::test]
    async fn those_who_ask_at_once_get_what_was_packed_once() {
        let packed = Packed::beside(64 << 20);
        let packing = Semaphore::new(4);
        let sample = sample(0, 200);
        let all = futures::future::join_all((0..8).map(|_| packed.of(sample.clone(), &packing))).await;
        let first = all[0].as_ref().unwrap();
        assert!(all.iter().all(|chunks| Arc::ptr_eq(chunks.as_ref().unwrap(), first)));
        assert_eq!(first[..], sample_chunks(&sample).unwrap()[..]);
    }

    #[tokio::test]
    async fn what_came_packed_is_not_packed_again() {
        let packed = Packed::beside(64 << 20);
        let sample = sample(0, 50);
        let came: Chunks = sample_chunks(&sample).unwrap().into();
        packed.keep(sample.id, came.clone());
        // With no turn to be had.
        assert!(Arc::ptr_eq(&packed.of(sample, &Semaphore::new(0)).await.unwrap(), &came));
    }

    #[tokio::test]
    async fn what_is_kept_is_bounded_and_one_too_large_to_keep_is_packed_all_the_same() {
        let packed = Packed::beside(SHARE * 400_000);
        let packing = Semaphore::new(1);
        for index in 0..40 {
            packed.of(sample(index, 100), &packing).await.unwrap();
        }
        assert!(packed.cache.weight() <= 400_000 && packed.cache.len() >= 5, "{}", packed.cache.weight());
        let large = sample(41, 400);
        assert_eq!(packed.of(large.clone(), &packing).await.unwrap()[..], sample_chunks(&large).unwrap()[..]);
        assert!(packed.cache.weight() <= 400_000);
    }

    #[tokio::test]
    async fn past_moments_are_forgotten() {
        let packed = Packed::beside(64 << 20);
        let packing = Semaphore::new(1);
        for index in [0, 9, 10, 25] {
            packed.of(sample(index, 10), &packing).await.unwrap();
        }
        packed.retire(1);
        assert_eq!(packed.cache.len(), 2);
        packed.forget(sample(25, 10).id);
        assert_eq!(packed.cache.len(), 1);
        packed.clear();
        assert_eq!(packed.cache.len(), 0);
    }

    #[tokio::test]
    async fn whoever_gives_up_leaves_the_packing_to_the_next() {
        let packed = Packed::beside(64 << 20);
        let packing = Semaphore::new(0);
        let given_up = packed.of(sample(0, 10), &packing);
        assert!(tokio::time::timeout(std::time::Duration::from_millis(10), given_up).await.is_err());
        packing.add_permits(1);
        assert!(packed.of(sample(0, 10), &packing).await.is_ok());
    }
}
