//! Sessions whose searches begin from their previous frame, across processes and on a device.

use std::time::Duration;

use crate::support::{Coordinator, SMALL};
use argus_client::{Client, ClientError, Session, SessionEvent, SessionOptions};
use argus_scene::{Camera, Frame, Output, PlanRequest, Search, View, metrics};
use image::RgbImage;

async fn next(session: &mut Session, view: &View) -> Result<Frame, ClientError> {
    session.send(view);
    let answer = tokio::time::timeout(Duration::from_secs(60), session.next());
    match answer.await.expect("a session must answer").unwrap() {
        SessionEvent::Frame { frame, .. } => Ok(*frame),
        SessionEvent::Failed { error, .. } => Err(error),
    }
}

/// A view of the scene's camera, turned by a number of steps.
fn turned(camera: &Camera, steps: u32) -> View {
    let axis = camera.target - camera.eye;
    let turn = glam::DQuat::from_axis_angle(camera.up.normalize(), f64::from(steps) * 0.01);
    View::new(Camera { target: camera.eye + turn * axis, ..*camera }, [160, 120], PlanRequest::default())
}

fn image_of(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width, frame.height, frame.images[Output::Color].as_ref().unwrap().to_vec())
        .unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_with_history_shows_the_same_image_and_survives_its_worker() {
    // Without light that still refines between two views which must be equal.
    let coordinator = Coordinator::start(SMALL, &["--effects", "none", "--exposure", "0"]);
    let mut workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let camera = client.description().cameras[0].camera;
    let mut session = client.session(SessionOptions { history: true, ..SessionOptions::default() });
    let seeded = PlanRequest { search: Some(Search::Seeded), ..PlanRequest::default() };
    let mut plain = client.session(SessionOptions::default());
    for i in 0..5 {
        let view = turned(&camera, i);
        let frame = next(&mut session, &view).await.unwrap();
        assert_eq!(frame.provenance.history, i > 0, "frame {i}");
        let fresh = next(&mut plain, &View { plan: seeded, ..view }).await.unwrap();
        assert!(!fresh.provenance.history);
        assert!(
            frame.images[Output::Range].is_none() && frame.images[Output::Source].is_none(),
            "colour alone was asked for"
        );
        let exact = PlanRequest { direct: true, supersampling: Some(2), ..PlanRequest::default() };
        let exact = image_of(&next(&mut plain, &View { plan: exact, ..turned(&camera, i) }).await.unwrap());
        let error = |of: &Frame| metrics::flip_mean(&exact, &image_of(of)).unwrap();
        // Pixels on silhouettes may fall to either side.
        assert!(error(&frame) < 1.1 * error(&fresh), "frame {i}: {} {}", error(&frame), error(&fresh));
        // They would be equal if every search began in the same place.
        let apart = metrics::flip_mean(&image_of(&fresh), &image_of(&frame)).unwrap();
        assert!(apart < 0.05 && (apart > 0.0) == (i > 0), "frame {i}: {apart}");
    }

    // The other worker lacks the session's frame.
    workers[0].kill();
    let _another = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let view = turned(&camera, 5);
    let frame = next(&mut session, &view).await.unwrap();
    assert!(!frame.provenance.history);
    let fresh = next(&mut plain, &View { plan: seeded, ..view.clone() }).await.unwrap();
    assert_eq!(
        (&frame.images[Output::Color], &frame.provenance),
        (&fresh.images[Output::Color], &fresh.provenance)
    );
    assert!(next(&mut session, &turned(&camera, 6)).await.unwrap().provenance.history);

    // A camera that turns away gains nothing from history, and its frame says so.
    let away = turned(&camera, 200);
    assert!(!next(&mut session, &away).await.unwrap().provenance.history);
    let linear = PlanRequest { search: Some(Search::Linear), ..PlanRequest::default() };
    match next(&mut session, &View { plan: linear, ..view }).await {
        Err(ClientError::Invalid { field, .. }) => assert_eq!(field, "history"),
        other => panic!("must be refused: {other:?}"),
    }
}
