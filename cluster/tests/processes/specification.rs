//! The specification of a sample set: all workers of a cluster use the coordinator's, and frames name it.

use std::time::Duration;

use argus_cluster::coordinator::Config;
use argus_proto::convert::{scene_hash_bytes, specification_hash_bytes};
use argus_proto::v1;
use argus_proto::v1::samples_client::SamplesClient;
use argus_scene::{Exposure, Indirect, Output, PointSettings, Specification, Version, VplSettings};
use tonic::Code;

use crate::common::{Cluster, Source, channel, direct, pinned, quick, scene, start_coordinator_at, view};

const POINTS: Indirect =
    Indirect::Points(PointSettings { levels: 6, map_side: 16, block: 8, bounces: 1, sharing: true });

fn lit_by(indirect: Indirect) -> Config {
    Config { indirect: Some(indirect), ..quick() }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_workers_never_mix_indirect_light() {
    let mut cluster = Cluster::start_with(lit_by(POINTS), 2).await;
    let lit_alike = async |cluster: &Cluster, indirect: Indirect| {
        let mut colors = Vec::new();
        for wanted in (0..4).flat_map(|i| [view(i), direct(i)]) {
            let (frame, _) = cluster.render(&wanted).await.unwrap();
            assert_eq!(frame.provenance.specification.unwrap().indirect, indirect);
            colors.push(frame.images[Output::Color].clone());
        }
        colors
    };
    let by_points = lit_alike(&cluster, POINTS).await;

    // The same workers join a coordinator with other lighting: nothing of the old light is left.
    let address = cluster.coordinator.address;
    cluster.coordinator.kill();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let vpl = Indirect::Vpl(VplSettings { vpls: 64, ..VplSettings::default() });
    let source = Source { scene: scene("test"), files: Vec::new() };
    cluster.coordinator = start_coordinator_at(lit_by(vpl), Some(address), source);
    cluster.channel = channel(&cluster.coordinator.url());
    cluster.wait_for(|status| status.processes == 2).await;
    let by_vpls = lit_alike(&cluster, vpl).await;
    assert!(by_points.iter().zip(&by_vpls).all(|(points, vpls)| points != vpls));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_takes_over_the_exposure_of_another_coordinator() {
    let exposed = |stops| Config { exposure: Exposure::Stops(stops), ..quick() };
    let mut cluster = Cluster::start_with(exposed(0.0), 1).await;
    // The sampler's own, of which views from triangles are made.
    let shown = async |cluster: &Cluster| {
        let (frame, _) = cluster.render(&direct(0)).await.unwrap();
        frame.provenance.specification.unwrap().exposure
    };
    let before = shown(&cluster).await;
    let address = cluster.coordinator.address;
    cluster.coordinator.kill();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let source = Source { scene: scene("test"), files: Vec::new() };
    cluster.coordinator = start_coordinator_at(exposed(1.0), Some(address), source);
    cluster.channel = channel(&cluster.coordinator.url());
    cluster.wait_for(|status| status.processes == 1).await;
    assert_eq!(shown(&cluster).await, 2.0 * before);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn samples_and_pixels_of_another_specification_are_not_served() {
    let cluster = Cluster::start_with(lit_by(POINTS), 1).await;
    let (frame, _) = cluster.render(&view(1)).await.unwrap();
    let ours = frame.provenance.specification.unwrap();
    let mut worker = SamplesClient::new(channel(&cluster.workers[0].url()));
    let mut subscribe = async |specification: Specification| {
        let request = v1::SubscribeRequest {
            scene_hash: scene_hash_bytes(frame.provenance.scene),
            version: Some(Version { number: 0, state: frame.provenance.state }.into()),
            cameras: vec![0],
            specification_hash: specification_hash_bytes(specification.hash()),
            ..v1::SubscribeRequest::default()
        };
        worker.subscribe(request).await.map(|_| ())
    };
    subscribe(ours).await.unwrap();
    let refused = subscribe(Specification { indirect: Indirect::Off, ..ours }).await.unwrap_err();
    assert_eq!(refused.code(), Code::NotFound);
    assert!(refused.message().contains("specification"), "{refused}");
    let trace = v1::TraceRequest {
        scene_hash: scene_hash_bytes(frame.provenance.scene),
        epoch: frame.provenance.state.epoch,
        revision: frame.provenance.state.revision,
        light: argus_proto::convert::WireEnum::number(frame.provenance.state.light),
        camera: Some((&view(1).camera).into()),
        width: 8,
        height: 8,
        samples_per_pixel: 1,
        runs: vec![0, 1],
        specification_hash: specification_hash_bytes(Specification::default().hash()),
    };
    assert_eq!(worker.trace(trace).await.unwrap_err().code(), Code::NotFound);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_pin_of_another_specification_is_refused() {
    let cluster = Cluster::start_with(lit_by(POINTS), 2).await;
    for wanted in [view(1), direct(1)] {
        let (frame, _) = cluster.render(&wanted).await.unwrap();
        let (again, _) = cluster.render(&pinned(1, frame.provenance.clone())).await.unwrap();
        assert_eq!(
            (&again.images[Output::Color], &again.provenance),
            (&frame.images[Output::Color], &frame.provenance)
        );
        let mut other = frame.provenance.clone();
        let specification = other.specification.unwrap();
        other.specification = Some(Specification { indirect: Indirect::Off, ..specification });
        let refused = cluster.render(&pinned(1, other)).await.unwrap_err();
        assert_eq!(refused.code(), Code::FailedPrecondition);
        assert!(refused.message().contains("indirect off is not served here"), "{refused}");
    }
}
