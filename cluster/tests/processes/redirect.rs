//! Redirected sessions, which fetch their frames from workers.

use std::sync::Arc;
use std::time::Duration;

use argus_client::{Client, ClientError, ConnectOptions, Credentials, SessionEvent, SessionOptions, Token};
use argus_cluster::core;
use argus_cluster::security::{CLUSTER_NAME, ReloadableSecurity, Security, Tokens};
use argus_cluster::worker::{Config, Public};
use argus_proto::chunks::FrameAssembler;
use argus_proto::v1;
use argus_proto::v1::redeem_response::Body as Redeemed;
use argus_proto::v1::session_request::Body as Asked;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::{Frame, Limits, Output, Stage, View};
use tonic::{Code, Status};

use crate::common::session::Session;
use crate::common::{Authority, Cluster, LIMIT, channel, quick, start_coordinator, start_worker_with, view};
use crate::watching::{page, value};

/// A cluster whose workers clients can reach.
async fn open_to_clients(config: argus_cluster::coordinator::Config, count: usize) -> Cluster {
    let mut cluster = Cluster::start_with(config, 0).await;
    let url = cluster.coordinator.url();
    for _ in 0..count {
        let config = Config { public: Some(Public::AsAdvertised), ..Config::new(&url) };
        cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    }
    cluster.wait_for(|status| status.processes as usize == count).await;
    cluster
}

async fn redirectable(cluster: &Cluster) -> Session {
    let mut session = Session::open(cluster).await;
    session.redirectable = true;
    session
}

fn missed(serial: u64, unreachable: bool) -> Asked {
    Asked::Missed(v1::SessionMissed { reason: "a wall".to_owned(), serial, unreachable })
}

/// Redeems a ticket: the frame and its receipt.
async fn redeem(redirect: &v1::Redirect) -> Result<(Frame, v1::Sealed), Status> {
    let mut worker = ViewsClient::new(channel(&redirect.address));
    let answer = async {
        let request = v1::RedeemRequest { ticket: redirect.ticket.clone() };
        let mut answers = worker.redeem(request).await?.into_inner();
        let mut assembler = FrameAssembler::new(Limits::default());
        let mut frame = None;
        loop {
            match answers.message().await?.and_then(|answer| answer.body) {
                Some(Redeemed::Chunk(chunk)) => frame = assembler.push(chunk).unwrap().or(frame),
                Some(Redeemed::Receipt(receipt)) => {
                    return Ok((frame.expect("a receipt is behind its frame").0, receipt));
                }
                Some(Redeemed::Working(_)) => {}
                None => return Err(Status::data_loss("no receipt")),
            }
        }
    };
    tokio::time::timeout(LIMIT, answer).await.expect("a worker must answer")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn redirected_frames_are_counted_by_their_receipts() {
    let cluster = open_to_clients(quick(), 2).await;
    let mut session = redirectable(&cluster).await;
    for seq in 1..=3 {
        let wanted = view(seq as usize);
        session.ask(seq, &wanted).await;
        let (of, redirect) = session.redirect().await;
        assert_eq!(of, seq);
        assert!(cluster.workers.iter().any(|worker| worker.url() == redirect.address), "{redirect:?}");
        let (frame, receipt) = redeem(&redirect).await.unwrap();
        // The same bytes as those of a relayed frame.
        let relayed = View { pin: Some(frame.provenance.clone()), ..wanted };
        assert_eq!(
            frame.images[Output::Color],
            cluster.render(&relayed).await.unwrap().0.images[Output::Color]
        );
        session.say(seq, Asked::Ack(v1::SessionAck { receipt: Some(receipt) })).await;
    }
    let status = cluster.wait_for(|s| s.counters.as_ref().unwrap().views_answered == 6).await;
    assert_eq!(status.counters.unwrap().views_failed, 0);
    // Frames are counted by their receipts.
    let (_, metrics) = page(cluster.coordinator.address, "/metrics").await;
    assert_eq!(value(&metrics, "argus_view_seconds_count"), 6.0);
    for way in ["fetched", "relayed"] {
        assert_eq!(value(&metrics, &format!("argus_frames_total{{way=\"{way}\"}}")), 3.0, "{way}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_ticket_is_accepted_once_unchanged_and_only_by_its_worker() {
    let cluster = open_to_clients(quick(), 2).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, redirect) = session.redirect().await;
    let refused = async |redirect: v1::Redirect| {
        let status = redeem(&redirect).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
        status.message().to_owned()
    };
    let sealed = redirect.ticket.clone().unwrap();
    let mut body = sealed.body.to_vec();
    *body.last_mut().unwrap() ^= 1;
    for ticket in [
        None,
        Some(v1::Sealed { body: body.into(), ..sealed.clone() }),
        Some(v1::Sealed { seal: vec![0; 32].into(), ..sealed.clone() }),
    ] {
        assert!(refused(v1::Redirect { ticket, ..redirect.clone() }).await.contains("was not issued"));
    }
    let other = cluster.workers.iter().map(|worker| worker.url()).find(|url| *url != redirect.address);
    assert!(
        refused(v1::Redirect { address: other.unwrap(), ..redirect.clone() })
            .await
            .contains("was not issued")
    );
    redeem(&redirect).await.unwrap();
    assert!(refused(redirect).await.contains("was redeemed before"));
    // A coordinator does not redeem tickets.
    let here =
        v1::Redirect { address: cluster.coordinator.url(), ticket: Some(sealed), ..Default::default() };
    assert!(refused(here).await.contains("must be redeemed at the worker"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn frames_are_relayed_if_the_worker_is_unreachable() {
    let cluster = open_to_clients(quick(), 1).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, redirect) = session.redirect().await;
    // A notice about another ticket is ignored.
    session.say(1, missed(redirect.serial + 7, true)).await;
    session.say(1, missed(redirect.serial, true)).await;
    // This frame and the following ones are relayed, without another try.
    for seq in 1..=3 {
        if seq > 1 {
            session.ask(seq, &view(seq as usize)).await;
        }
        assert!(matches!(session.answer().await, Some((of, 0, Ok(()))) if of == seq));
        session.acknowledge(seq).await;
    }
    // A session that does not support redirects gets none.
    let mut plain = Session::open(&cluster).await;
    plain.ask(1, &view(5)).await;
    assert!(matches!(plain.answer().await, Some((1, 0, Ok(())))));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_that_a_worker_could_not_make_is_fetched_from_another_one() {
    let cluster = open_to_clients(quick(), 3).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, first) = session.redirect().await;
    session.say(1, missed(first.serial, false)).await;
    let (_, second) = session.redirect().await;
    assert_ne!(second.address, first.address);
    // The first frame arrived after all, and its notice crossed the second ticket.
    let (_, receipt) = redeem(&first).await.unwrap();
    session.say(1, Asked::Ack(v1::SessionAck { receipt: Some(receipt) })).await;
    session.ask(2, &view(2)).await;
    assert_eq!(session.redirect().await.0, 2, "the session goes on, and is sent on as before");
    let status = cluster.wait_for(|s| s.counters.as_ref().unwrap().views_answered == 1).await;
    assert_eq!(status.counters.unwrap().views_failed, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_that_do_not_read_their_frames_block_no_other_client() {
    let mut cluster = Cluster::start(0).await;
    let url = cluster.coordinator.url();
    let public = Some(Public::AsAdvertised);
    let config = Config { public, max_queued_views: 8, ..Config::new(&url) };
    cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    cluster.wait_for(|status| status.processes == 1).await;
    // Each holds one of four places by not reading a frame larger than any window.
    let large = View { width: 4096, height: 4096, ..view(1) };
    let mut unread = Vec::new();
    let mut sessions = Vec::new();
    for _ in 0..4 {
        let mut session = redirectable(&cluster).await;
        session.ask(1, &large).await;
        let (_, redirect) = session.redirect().await;
        let request = v1::RedeemRequest { ticket: redirect.ticket };
        let mut worker = ViewsClient::new(channel(&redirect.address));
        unread.push(worker.redeem(request).await.unwrap());
        session.acknowledge(1).await;
        sessions.push(session);
    }
    // A fifth is refused, and has its frame relayed.
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(2)).await;
    let (_, redirect) = session.redirect().await;
    let status = redeem(&redirect).await.unwrap_err();
    assert_eq!(status.code(), Code::ResourceExhausted, "{status}");
    session.say(1, missed(redirect.serial, true)).await;
    assert!(matches!(session.answer().await, Some((1, 0, Ok(())))));
    cluster.render(&view(3)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_ticket_of_a_dead_worker_is_replaced() {
    let mut cluster = open_to_clients(quick(), 2).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, first) = session.redirect().await;
    cluster.worker_at(&first.address).kill();
    let (seq, second) = session.redirect().await;
    assert_eq!(seq, 1);
    assert_ne!(second.address, first.address);
    redeem(&second).await.unwrap();
    session.acknowledge(1).await;
    cluster.wait_for(|s| s.counters.as_ref().unwrap().views_answered == 1).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_silent_client_holds_no_place_for_long() {
    let core = core::Config { max_view_time: Duration::from_millis(700), ..quick().core };
    let cluster = open_to_clients(argus_cluster::coordinator::Config { core, ..quick() }, 1).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    session.redirect().await;
    let Some((1, 0, Err(failure))) = session.answer().await else { panic!("its time is over") };
    assert_eq!(Code::from_i32(failure.code), Code::DeadlineExceeded, "{failure:?}");
    // The session continues.
    session.ask(2, &view(2)).await;
    let (seq, redirect) = session.redirect().await;
    assert_eq!(seq, 2);
    redeem(&redirect).await.unwrap();
    session.acknowledge(2).await;
    cluster.wait_for(|s| s.counters.as_ref().unwrap().views_answered == 1).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_without_receipts_gets_no_more_tickets() {
    let cluster = open_to_clients(quick(), 1).await;
    let mut session = redirectable(&cluster).await;
    let mut hoard = Vec::new();
    // One receipt may be lost.
    for seq in 1..=2 {
        session.ask(seq, &view(seq as usize)).await;
        hoard.push(session.redirect().await.1);
        session.acknowledge(seq).await;
    }
    session.ask(3, &view(3)).await;
    assert!(matches!(session.answer().await, Some((3, 0, Ok(())))), "it is sent nowhere for a while");
    // Serial numbers are per session, so they identify tickets of all workers.
    assert_eq!(hoard.iter().map(|redirect| redirect.serial).collect::<Vec<_>>(), [1, 2]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_holds_no_more_tickets_than_its_limit_of_views() {
    let core = core::Config { max_views_per_client: 3, ..quick().core };
    let cluster = open_to_clients(argus_cluster::coordinator::Config { core, ..quick() }, 1).await;
    let (mut kept, mut sessions) = (Vec::new(), Vec::new());
    for _ in 0..3 {
        // A new session has no failed redirects.
        let mut session = redirectable(&cluster).await;
        session.ask(1, &view(1)).await;
        kept.push(session.redirect().await.1);
        session.acknowledge(1).await;
        sessions.push(session);
    }
    cluster.wait_for(|s| s.counters.as_ref().unwrap().views_answered == 3).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    assert!(matches!(session.answer().await, Some((1, 0, Ok(())))), "a fourth has its frames relayed");
    // The tickets are still valid for their frames.
    for redirect in &kept {
        redeem(redirect).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_is_relayed_after_two_failed_fetches() {
    let cluster = open_to_clients(quick(), 3).await;
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, first) = session.redirect().await;
    session.say(1, missed(first.serial, false)).await;
    let (_, second) = session.redirect().await;
    // The notice that crossed the second ticket concerns the first one.
    session.say(1, missed(first.serial, false)).await;
    session.say(1, missed(second.serial, false)).await;
    assert!(matches!(session.answer().await, Some((1, 0, Ok(())))));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_of_a_slow_frame_gets_progress_messages() {
    let cluster = open_to_clients(quick(), 1).await;
    cluster.priced().await;
    cluster.settings.set(1_200_000, 1_200_000);
    let mut session = redirectable(&cluster).await;
    session.ask(1, &view(1)).await;
    let (_, redirect) = session.redirect().await;
    let mut worker = ViewsClient::new(channel(&redirect.address));
    let request = v1::RedeemRequest { ticket: redirect.ticket };
    let mut answers = worker.redeem(request).await.unwrap().into_inner();
    let mut beats = 0;
    while let Some(answer) = answers.message().await.unwrap() {
        beats += u32::from(matches!(answer.body, Some(Redeemed::Working(_))));
    }
    assert!((1..=4).contains(&beats), "{beats}");
    // A client that disconnects cancels the work.
    session.acknowledge(1).await;
    session.ask(2, &view(2)).await;
    let (_, redirect) = session.redirect().await;
    let request = v1::RedeemRequest { ticket: redirect.ticket };
    let mut answers = worker.redeem(request).await.unwrap().into_inner();
    assert!(matches!(answers.message().await.unwrap().unwrap().body, Some(Redeemed::Working(_))));
    drop(answers);
    let cancelled = async {
        while cluster.settings.cancelled.load(std::sync::atomic::Ordering::SeqCst) == 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(LIMIT, cancelled).await.expect("the frame is no longer wanted");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_tls_clients_verify_workers_by_the_clusters_name() {
    let authority = Authority::new();
    let ca = authority.pem().into_bytes();
    let member = |names: &[&str], tokens: Tokens| {
        let [certificate, key] = authority.certify(names).map(String::into_bytes);
        let ca = ca.clone();
        let security = Security { certificate, key, ca, tokens, require_client_certificates: false };
        Some(Arc::new(ReloadableSecurity::new(security).unwrap()))
    };
    let token = "a-token-of-the-tests-0123456789";
    let tokens = Tokens::parse(&format!("view tester {token}\n")).unwrap();
    let security = member(&[CLUSTER_NAME, "127.0.0.1"], tokens);
    let coordinator = start_coordinator(argus_cluster::coordinator::Config { security, ..quick() });
    let url = coordinator.url().replace("http:", "https:");
    // Certificates of workers do not contain their addresses.
    let security = member(&[CLUSTER_NAME], Tokens::default());
    let config = Config { public: Some(Public::AsAdvertised), security, ..Config::new(&url) };
    let worker = start_worker_with(config, &Default::default(), Default::default());
    let token = Token::parse(token).ok();
    let credentials = Credentials { ca: Some(ca), token, identity: None };
    let options = ConnectOptions { credentials, ..ConnectOptions::default() };
    let client = Client::connect_with(&url, &options).await.unwrap();
    let mut session = client.session(SessionOptions::default());
    let fetched = async {
        loop {
            session.send(&view(1));
            // Until a worker is ready views fail; after that no frame may be relayed.
            if let SessionEvent::Frame { frame, .. } = session.next().await.unwrap() {
                return frame.stages.iter().any(|stage| stage.name == Stage::DETOUR);
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    assert!(tokio::time::timeout(LIMIT, fetched).await.unwrap(), "the worker was not trusted");
    // A worker that poses as the coordinator is detected.
    let posing = worker.url().replace("http:", "https:");
    let error = Client::connect_with(&posing, &options).await.unwrap_err();
    assert!(matches!(error, ClientError::Untrusted { .. }), "{error}");
}
