//! Samples from maps of an octree, across processes: views are reconstructed from them like from any samples.

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL, run, stderr};
use argus_scene::{Output, Outputs, Plan, PlanRequest, Sampling, View};

/// With a fixed visibility backend: on a busy machine two clusters may measure different ones as cheapest.
const MAPS: [&str; 6] = [
    "--sampling=megaviews",
    "--map-side=256",
    "--octree-levels=8",
    "--face=128",
    "--refining-share=0",
    "--visibility=raster",
];

#[tokio::test(flavor = "multi_thread")]
async fn views_come_from_shared_maps_and_two_workers_give_the_bytes_of_one() {
    let cluster = Coordinator::start(SMALL, &MAPS);
    let _workers = cluster.workers(2);
    cluster.wait_for_workers(2);
    let mut of_many = Wire::connect(&cluster.url).await;
    let camera = of_many.describe().await.cameras[0].camera;
    let (frame, _) = of_many.render((&small_view(camera)).into()).await.unwrap();
    let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a warp") };
    assert!(!warp.samples.is_empty());
    let specification = frame.provenance.specification.unwrap().to_string();
    assert!(specification.contains("; sampling megaviews maps of 256 from 8 levels;"), "{specification}");
    assert!(frame.unresolved_fraction < 0.1, "{}", frame.unresolved_fraction);

    // A direct view comes from the triangles, and is nearly the same image.
    let direct = View { plan: PlanRequest { direct: true, ..PlanRequest::default() }, ..small_view(camera) };
    let direct = View { outputs: Outputs::COLOR, ..direct };
    let (exact, _) = of_many.render((&direct).into()).await.unwrap();
    assert_eq!(exact.provenance.specification.unwrap().sampling, Sampling::Triangles);
    let image = |frame: &argus_scene::Frame| {
        let color = frame.images[Output::Color].as_ref().unwrap().to_vec();
        image::RgbImage::from_raw(frame.width, frame.height, color).unwrap()
    };
    let compared = argus_scene::metrics::compare(&image(&exact), &image(&frame)).unwrap();
    assert!(compared.flip_mean > 0.0 && compared.flip_mean < 0.2, "{compared:?}");

    // A single process gives the same bytes for these samples, in any batches.
    let single = Coordinator::start(SMALL, &MAPS);
    let _worker = single.worker(&[]);
    single.wait_for_workers(1);
    let pinned = View { pin: Some(frame.provenance.clone()), ..small_view(camera) };
    let (alone, _) = Wire::connect(&single.url).await.render((&pinned).into()).await.unwrap();
    assert_eq!(alone.provenance, frame.provenance);
    assert!(
        alone.images[Output::Color] == frame.images[Output::Color]
            && alone.images[Output::Range] == frame.images[Output::Range]
            && alone.images[Output::Mask] == frame.images[Output::Mask]
    );

    // Samples from triangles differ, and a request pinned to maps is refused.
    let triangles = Coordinator::start(SMALL, &["--rig=cell", "--face=128", "--visibility=raster"]);
    let _other = triangles.worker(&[]);
    triangles.wait_for_workers(1);
    let refused = Wire::connect(&triangles.url).await.render((&pinned).into()).await.unwrap_err();
    assert!(refused.message().contains("sampling megaviews"), "{refused:?}");
}

#[test]
fn maps_that_cannot_be_rendered_are_refused_at_the_start() {
    let refused = |more: &[&str]| {
        let output = run(&[&["coordinator", "--scene", SMALL, "--listen", "127.0.0.1:0"], more].concat());
        assert!(!output.status.success());
        stderr(&output)
    };
    let rig = refused(&["--sampling", "megaviews", "--rig", "tile-corners"]);
    assert!(rig.contains("sampling") && rig.contains("tile-corners"), "{rig}");
    let side = refused(&["--sampling", "megaviews", "--map-side", "4096"]);
    assert!(side.contains("--map-side") && side.contains("1024"), "{side}");
    let block = refused(&["--set", "coordinator.map_block=3"]);
    assert!(block.contains("map_block"), "{block}");
}
