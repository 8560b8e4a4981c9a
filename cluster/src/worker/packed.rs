//! Cache of packed samples.
//!
//! A sample is sent to several workers at nearly the same time (`core/samples/distribution.rs`). The worker that
//! rendered it packs it once for all of them. A worker that received it forwards the received chunks; the receiver
//! checks the sample's hash.

use std::sync::Arc;

use argus_proto::chunks::sample_chunks;
use argus_proto::{Fault, v1};
use argus_scene::{Sample, SampleId};
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};
use tokio::sync::Semaphore;

/// A sample in chunks.
pub(super) type Chunks = Arc<[v1::SampleChunk]>;

/// The packed samples take at most this part of the store's bytes. They are requested within seconds or not at all.
const SHARE: u64 = 16;

/// Greatest number of bytes of packed samples.
const MOST: u64 = 64 << 20;

/// Typical bytes of a packed sample. Only the size of a table depends on it.
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
    /// An empty cache beside a store of `store_bytes`.
    pub(super) fn beside(store_bytes: u64) -> Self {
        let limit = (store_bytes / SHARE).min(MOST);
        // A sample must fit into one shard. With several shards, large samples were never kept.
        let options = OptionsBuilder::new()
            .weight_capacity(limit)
            .estimated_items_capacity((limit / USUAL).max(1) as usize)
            .shards(1)
            .build();
        let options = options.unwrap_or_else(|e| unreachable!("capacity and number of items are set: {e}"));
        let cache =
            Cache::with_options(options, Weight, DefaultHashBuilder::default(), DefaultLifecycle::default());
        Self { cache }
    }

    /// Packs a sample with a permit of `packing`, or returns it from the cache. Concurrent callers wait for the first
    /// one.
    ///
    /// # Errors
    /// [`Fault`] for a sample whose planes are not in host memory.
    pub(super) async fn of(&self, sample: Arc<Sample>, packing: &Semaphore) -> Result<Chunks, Fault> {
        let id = sample.id;
        let pack = async {
            let _permit = packing.acquire().await.map_err(|e| Fault::Unavailable(e.to_string()))?;
            let chunks = tokio::task::spawn_blocking(move || sample_chunks(&sample)).await;
            Ok(chunks.map_err(|e| Fault::Unavailable(e.to_string()))??.into())
        };
        self.cache.get_or_insert_async(&id, pack).await
    }

    /// Keeps a sample as it was received.
    pub(super) fn keep(&self, id: SampleId, chunks: Chunks) {
        self.cache.insert(id, chunks);
    }

    /// Forgets a sample.
    pub(super) fn forget(&self, id: SampleId) {
        self.cache.remove(&id);
    }

    /// Forgets samples of versions below this number.
    pub(super) fn retire(&self, before_version: u64) {
        self.cache.retain(|id, _| id.version >= before_version);
    }

    /// Forgets all samples.
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

    /// A sample of noise, which does not get smaller by packing.
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
    async fn concurrent_requests_pack_a_sample_once() {
        let packed = Packed::beside(64 << 20);
        let packing = Semaphore::new(4);
        let sample = sample(0, 200);
        let all = futures::future::join_all((0..8).map(|_| packed.of(sample.clone(), &packing))).await;
        let first = all[0].as_ref().unwrap();
        assert!(all.iter().all(|chunks| Arc::ptr_eq(chunks.as_ref().unwrap(), first)));
        assert_eq!(first[..], sample_chunks(&sample).unwrap()[..]);
    }

    #[tokio::test]
    async fn a_received_sample_is_not_packed_again() {
        let packed = Packed::beside(64 << 20);
        let sample = sample(0, 50);
        let received: Chunks = sample_chunks(&sample).unwrap().into();
        packed.keep(sample.id, received.clone());
        // No permit is available.
        assert!(Arc::ptr_eq(&packed.of(sample, &Semaphore::new(0)).await.unwrap(), &received));
    }

    #[tokio::test]
    async fn the_cache_is_bounded_and_a_sample_too_large_for_it_is_still_packed() {
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
    async fn samples_of_retired_versions_are_forgotten() {
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
    async fn after_a_caller_gives_up_the_next_one_packs() {
        let packed = Packed::beside(64 << 20);
        let packing = Semaphore::new(0);
        let given_up = packed.of(sample(0, 10), &packing);
        assert!(tokio::time::timeout(std::time::Duration::from_millis(10), given_up).await.is_err());
        packing.add_permits(1);
        assert!(packed.of(sample(0, 10), &packing).await.is_ok());
    }
}
