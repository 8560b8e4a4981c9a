//! Tests of every state with every event, then of paths of several steps.

use std::time::Duration;

use argus_scene::{Plan, SceneState};

use super::*;
use crate::core::{ViewId, WorkerId};

fn order(attempt: u32) -> Box<Order> {
    Box::new(Order {
        view_id: ViewId(7),
        attempt,
        worker: WorkerId(attempt.into()),
        address: String::new(),
        state: SceneState::default(),
        plan: Plan::direct(1),
        sources: Vec::new(),
        tracers: Vec::new(),
        expected: None,
        judged: false,
        decision: None,
        fallback: None,
        keeps_frame: false,
        probe: None,
    })
}

fn judged(attempt: u32) -> Box<Order> {
    Box::new(Order { judged: true, ..*order(attempt) })
}

fn ordered(order: Box<Order>) -> Event {
    Event::Ordered { order, ticket: None }
}

fn with_ticket(order: Box<Order>, serial: u64) -> Event {
    Event::Ordered { order, ticket: Some(v1::Redirect { serial, ..v1::Redirect::default() }) }
}

fn chunk(body: Option<Body>) -> Event {
    Event::Chunk { chunk: v1::FrameChunk { body }, age_ms: 9.0 }
}

/// The header of a frame of four bytes that took 5 ms.
fn a_header() -> v1::FrameHeader {
    v1::FrameHeader {
        images: vec![v1::ImageHeader { packed_bytes: 4, ..v1::ImageHeader::default() }],
        stages: vec![v1::Stage { name: "render".to_owned(), ms: 5.0 }],
        ..v1::FrameHeader::default()
    }
}

fn header() -> Event {
    chunk(Some(Body::Header(a_header())))
}

fn data(offset: u64, bytes: &'static [u8]) -> Event {
    chunk(Some(Body::Data(v1::FrameData { offset, bytes: bytes.into() })))
}

fn trailer() -> Event {
    chunk(Some(Body::Trailer(v1::FrameTrailer::default())))
}

fn missed(ticket: u64, unreachable: bool) -> Event {
    Event::Missed { ticket, unreachable }
}

fn fetched(header: Option<v1::FrameHeader>, newest: Option<Box<Order>>) -> Event {
    Event::Fetched { header: header.map(Box::new), newest }
}

fn delivered(attempt: u32) -> Event {
    Event::Delivered { attempt, expected: Prediction { error: 0.1, ms: 5.0 } }
}

fn deadline() -> Event {
    Event::Refused(Fault::Deadline(Duration::from_secs(1)))
}

fn none_left() -> Event {
    Event::Refused(Fault::Unavailable("3 workers failed at this view".to_owned()))
}

/// The state machine after these events.
fn after(events: &[Event]) -> ViewPath {
    let mut path = ViewPath::new(true);
    for event in events {
        path.step(event.clone());
    }
    path
}

/// The names of the state and of the commands.
fn describe(path: &ViewPath, commands: &[Command]) -> String {
    let state = match path.state() {
        State::Queued { failed: None } => "queued",
        State::Queued { failed: Some(_) } => "failed",
        State::Ordered(order) if order.judged => "ordered*",
        State::Ordered(_) => "ordered",
        State::Judged { .. } => "judged",
        State::Streaming(_) => "streaming",
        State::Redirected { .. } => "redirected",
        State::Done => "done",
    };
    let done = commands.iter().map(|command| match command {
        Command::Open => "open",
        Command::Redirect(_) => "redirect",
        Command::PauseRedirects => "pause",
        Command::Judge { .. } => "judge",
        Command::Failed { failure: Failure::Final, .. } => "final",
        Command::Failed { failure: Failure::OfWorker, .. } => "blame",
        Command::Failed { failure: Failure::TryElsewhere, .. } => "elsewhere",
        Command::Answered(_) => "answered",
        Command::Cancel => "cancel",
        Command::Send(_) => "send",
        Command::CloseStream => "close",
        Command::Fail(_) => "fail",
    });
    std::iter::once(state).chain(done).collect::<Vec<_>>().join(" ")
}

#[test]
fn every_event_in_every_state_follows_the_table() {
    let broken = || Event::Broken(Status::unavailable("it went away"));
    let states = [
        ("queued", after(&[])),
        ("failed", after(&[ordered(order(1)), broken()])),
        ("ordered", after(&[ordered(order(1))])),
        ("ordered*", after(&[ordered(judged(1))])),
        ("judged", after(&[ordered(judged(1)), header()])),
        ("streaming", after(&[ordered(order(1)), header()])),
        ("redirected", after(&[with_ticket(order(1), 7)])),
        ("done", after(&[Event::Cancelled])),
    ];
    let all = |what: &'static str| [what, what, what, what, what, what, what, "done"];
    // ".": the state stays and no command is issued.
    let table: [(Event, [&str; 8]); 20] = [
        (ordered(order(2)), all("ordered open")),
        (with_ticket(order(2), 8), all("redirected redirect")),
        (Event::Cancelled, all("done cancel")),
        (deadline(), all("done fail")),
        (none_left(), all("done fail")),
        (delivered(1), [".", ".", ".", ".", "streaming send", ".", ".", "."]),
        (delivered(9), ["."; 8]),
        (header(), [".", ".", "streaming send", "judged judge", ".", "streaming", ".", "."]),
        (data(0, b"ab"), [".", ".", "failed blame", "failed blame", ".", "streaming send", ".", "."]),
        (data(0, b"abcd"), [".", ".", "failed blame", "failed blame", ".", "streaming send", ".", "."]),
        // Of a frame whose bytes are not all there.
        (trailer(), [".", ".", "failed blame", "failed blame", ".", "failed blame", ".", "."]),
        (chunk(None), [".", ".", "failed blame", "failed blame", ".", "failed blame", ".", "."]),
        (broken(), [".", ".", "failed blame", "failed blame", ".", "failed blame", ".", "."]),
        (
            Event::Broken(Status::resource_exhausted("no room")),
            [".", ".", "failed elsewhere", "failed elsewhere", ".", "failed elsewhere", ".", "."],
        ),
        (
            Event::Broken(Status::invalid_argument("no such camera")),
            [".", ".", "done final fail", "done final fail", ".", "done final fail", ".", "."],
        ),
        (fetched(Some(a_header()), None), [".", ".", ".", ".", ".", ".", "done answered", "."]),
        (fetched(None, None), [".", ".", ".", ".", ".", ".", "done answered", "."]),
        (missed(7, false), [".", ".", ".", ".", ".", ".", "queued elsewhere", "."]),
        (missed(6, false), ["."; 8]),
        (missed(0, true), [".", ".", ".", ".", ".", ".", "ordered pause open", "."]),
    ];
    for (event, row) in table {
        for ((name, path), expected) in states.iter().zip(row) {
            let mut path = ViewPath { relayed: path.relayed.clone(), state: path.state.clone(), ..*path };
            assert_eq!(describe(&path, &[]), *name);
            let commands = path.step(event.clone());
            let expected = if expected == "." { name } else { expected };
            assert_eq!(describe(&path, &commands), expected, "{name} × {event:?}");
        }
    }
}

#[test]
fn a_failure_before_the_first_chunk_is_hidden_from_the_client() {
    let mut path = after(&[ordered(order(1)), Event::Broken(Status::unavailable("x")), ordered(order(2))]);
    let mut sent = Vec::new();
    for event in [header(), data(0, b"abcd"), trailer()] {
        sent.extend(path.step(event));
    }
    let answers =
        |command: &&Command| matches!(command, Command::Answered(answered) if answered.attempt == 2);
    assert_eq!(sent.iter().filter(answers).count(), 1);
    assert_eq!(sent.iter().filter(|command| matches!(command, Command::Send(_))).count(), 3);
}

#[test]
fn another_worker_continues_the_frame_of_a_failed_one() {
    let mut path = after(&[ordered(order(1)), header(), data(0, b"ab")]);
    path.step(Event::Broken(Status::data_loss("x")));
    path.step(ordered(order(2)));
    assert_eq!(describe(&path, &[]), "ordered");
    for known in [header(), data(0, b"ab")] {
        let commands = path.step(known);
        assert_eq!(describe(&path, &commands), "streaming", "the client has it already");
    }
    path.step(data(2, b"cd"));
    // It failed again before the trailer.
    path.step(Event::Broken(Status::data_loss("x")));
    path.step(ordered(order(3)));
    for known in [header(), data(0, b"ab"), data(2, b"cd")] {
        path.step(known);
    }
    let commands = path.step(trailer());
    assert_eq!(describe(&path, &commands), "done answered send close");
}

#[test]
fn a_frame_that_cannot_be_continued_is_retried_until_no_worker_is_left() {
    let mut path = after(&[ordered(order(1)), header()]);
    path.step(ordered(order(2)));
    let mut other = a_header();
    other.images.clear();
    let commands = path.step(chunk(Some(Body::Header(other))));
    assert_eq!(describe(&path, &commands), "failed blame");
    let commands = path.step(none_left());
    let [Command::Fail(status)] = &commands[..] else { panic!("{commands:?}") };
    assert!(
        status.message().contains("within a frame"),
        "what the worker said, not that none is left: {status}"
    );
}

#[test]
fn a_deadline_during_a_retry_is_reported_as_a_deadline() {
    let mut path = after(&[ordered(order(1)), Event::Broken(Status::unavailable("x"))]);
    let commands = path.step(deadline());
    let [Command::Fail(status)] = &commands[..] else { panic!("{commands:?}") };
    assert_eq!(status.code(), Code::DeadlineExceeded);
}

#[test]
fn the_cost_of_a_rejected_frame_is_in_the_next_header() {
    let mut path = after(&[ordered(judged(1)), header()]);
    let commands = path.step(ordered(judged(2)));
    assert_eq!(describe(&path, &commands), "ordered* open");
    assert!(matches!(&path.step(header())[..], [Command::Judge { attempt: 2, ms: 5.0, .. }]));
    let commands = path.step(delivered(2));
    let [Command::Send(v1::FrameChunk { body: Some(Body::Header(sent)) })] = &commands[..] else {
        panic!("{commands:?}")
    };
    assert!(sent.stages.iter().any(|stage| stage.name == argus_scene::Stage::REFUSED && stage.ms == 5.0));
    assert_eq!(sent.predicted.map(|predicted| predicted.error), Some(0.1));
    // Its cost was reported with the judgement.
    path.step(data(0, b"abcd"));
    let commands = path.step(trailer());
    assert!(matches!(&commands[0], Command::Answered(Answered { ms: None, relayed: true, .. })));
}

#[test]
fn a_partly_sent_frame_is_not_judged_again() {
    let mut path = after(&[ordered(judged(1)), header(), delivered(1), data(0, b"ab")]);
    path.step(ordered(judged(2)));
    let commands = path.step(header());
    assert_eq!(describe(&path, &commands), "streaming");
}

#[test]
fn a_frame_is_relayed_after_two_failed_redirects() {
    let mut path = after(&[with_ticket(order(1), 1), missed(1, false)]);
    assert!(path.may_redirect(&order(2)));
    path.step(with_ticket(order(2), 2));
    let commands = path.step(missed(2, false));
    assert_eq!(describe(&path, &commands), "queued pause elsewhere");
    assert!(!path.may_redirect(&order(3)));
    let commands = path.step(none_left());
    assert_eq!(describe(&path, &commands), "done fail");
}

#[test]
fn the_same_attempt_is_relayed_to_a_client_that_reaches_no_worker() {
    let mut path = after(&[with_ticket(order(1), 1), missed(1, true)]);
    assert_eq!(path.order().map(|order| order.attempt), Some(1));
    assert!(!path.may_redirect(&order(1)));
    path.step(header());
    path.step(data(0, b"abcd"));
    let commands = path.step(trailer());
    assert_eq!(describe(&path, &commands), "done answered send close");
}

#[test]
fn a_fetched_frame_answers_the_newest_attempt() {
    let mut path = after(&[with_ticket(order(1), 1)]);
    let commands = path.step(fetched(Some(a_header()), Some(order(2))));
    let [Command::Answered(Answered { attempt: 2, header: Some(_), ms: Some(5.0), relayed: false, .. })] =
        &commands[..]
    else {
        panic!("{commands:?}")
    };
}

#[test]
fn neither_judged_nor_partly_relayed_frames_are_redirected() {
    let path = after(&[]);
    assert!(path.may_redirect(&order(1)));
    assert!(!path.may_redirect(&judged(1)), "they pass here to be looked at");
    let path = after(&[ordered(order(1))]);
    assert!(!path.may_redirect(&order(2)), "the client may have a part");
    assert!(!ViewPath::new(false).may_redirect(&order(1)));
}

#[test]
fn every_state_with_a_worker_has_an_order() {
    let has_order = |events: &[Event]| after(events).order().is_some();
    assert!(!has_order(&[]));
    assert!(has_order(&[ordered(order(1))]));
    assert!(has_order(&[ordered(judged(1)), header()]));
    assert!(has_order(&[ordered(order(1)), header()]));
    assert!(has_order(&[with_ticket(order(1), 1)]));
    assert!(!has_order(&[Event::Cancelled]));
}
